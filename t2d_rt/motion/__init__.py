"""Motion: read a skeleton, interpolate it in time, place and repeat it."""

from __future__ import annotations

from t2d_rt.motion.edit import MotionInfo, aside, describe, place, place_together, placement, repeat
from t2d_rt.motion.interpolate import Track, resample, sample, smooth, track, trim
from t2d_rt.motion.read import load_motion, load_motions, motion_from_joints
from t2d_rt.motion.skeletons import Flavour, flavours, register_flavour

__all__ = [
    "Flavour", "MotionInfo", "Track", "aside", "describe", "flavours", "load_motion", "load_motions", "motion_from_joints", "place",
    "place_together", "placement", "register_flavour", "repeat", "resample", "sample", "smooth", "track", "trim",
]  # fmt: skip
