"""Experiments as plain data, and their set-up: targets placed, on one clock, checked against the room."""
