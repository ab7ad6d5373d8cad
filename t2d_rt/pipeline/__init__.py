"""What stands between the parts of an experiment and its ADC cube: targets, path pairs, visibility, echoes, their sum."""
