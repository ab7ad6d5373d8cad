"""Recordings: samples and settings, their maps, paths and truth; reading, saving, exporting, comparing, making again."""
