"""What real recordings contain in addition to echoes: receiver noise, background, occlusion masks."""
