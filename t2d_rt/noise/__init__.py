"""What a real recording has beside echoes: receiver noise, background, occlusion masks."""
