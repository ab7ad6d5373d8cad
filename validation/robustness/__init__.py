"""Robustness: odd inputs, many calls, little memory, interrupted and concurrent writers, hostile working directories."""
