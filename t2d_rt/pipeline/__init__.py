"""The stages between an experiment and its ADC cube: targets, path pairs, visibility, and the scatterers made from them."""
