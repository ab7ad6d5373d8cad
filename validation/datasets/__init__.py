"""Data sets: whether labels and pictures belong together."""
