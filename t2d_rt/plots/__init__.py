"""Figures with physical axes for papers and notebooks: maps, comparisons, scenes and point clouds."""

from t2d_rt.core.calls import public
from t2d_rt.plots.figures import (
    VELOCITY_LABEL,
    plot_comparison,
    plot_point_cloud,
    plot_range_angle,
    plot_range_doppler,
    plot_range_time,
    plot_scene,
    plot_spectrogram,
)
from t2d_rt.plots.parts import plot_parts, plot_stacked_parts

__all__ = [
    "VELOCITY_LABEL", "plot_comparison", "plot_parts", "plot_point_cloud", "plot_range_angle", "plot_range_doppler",
    "plot_range_time", "plot_scene", "plot_spectrogram", "plot_stacked_parts",
]  # fmt: skip

globals().update({name: public(globals()[name]) for name in __all__})
