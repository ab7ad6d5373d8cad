"""The radar stage: from echoes to ADC samples."""

from t2d_rt.radar.checks import check_speed

__all__ = ["check_speed"]
