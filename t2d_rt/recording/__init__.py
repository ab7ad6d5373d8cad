"""Recordings: samples, settings, maps, paths and ground truth; reading, saving, exporting, comparing and repeating them."""
