"""Motions from recorded clips: chosen, warped, mirrored, bent, blended and chained, feet staying planted."""
