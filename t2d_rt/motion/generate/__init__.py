"""Descriptions -> motions, by several providers behind one interface."""
