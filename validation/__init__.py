"""Slow checks of the physics against what was worked out independently: `python -m validation`, results in report/."""
