"""Bodies: a template that is skinned by a motion, or divided into ellipsoids."""

from __future__ import annotations

from t2d_rt.body.segments import segments
from t2d_rt.body.skin import depth_m, skin
from t2d_rt.body.template import ABOUT, Template, bodies, regressed_joints, rest_joints, template

__all__ = ["ABOUT", "Template", "bodies", "depth_m", "regressed_joints", "rest_joints", "segments", "skin", "template"]
