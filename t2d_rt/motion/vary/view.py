"""The same motion seen from elsewhere: a radar on a circle around the motion's start (Text2Doppler's change of view)."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.core.checks import instance, number
from t2d_rt.core.errors import InputError
from t2d_rt.motion.edit import main_direction
from t2d_rt.types import Radar
from t2d_rt.types.motion import Motion, checked_motion


def vary_view(motion: Motion, radar: Radar, *, angle_deg: float, height_m: float | None = None) -> Radar:
    """The radar at another place around a motion that was placed before it: the motion stays, the distance of its start too.

    angle_deg: angle between the motion's main direction (that of the pelvis's track by principal components; on the spot, what the
        body faces) and the line from its start to the radar, counterclockwise from above: at 0 the person comes towards the
        radar, at 90 it passes across, at 180 it goes away. The radial speed of the start follows the cosine.
    height_m: height of the new radar [m]; by default its own. The distance to the pelvis at the start is kept in three dimensions.

    The new radar looks at the pelvis where the motion starts.
    """
    checked_motion(motion)
    instance("radar", radar, Radar, "a Radar")
    number("angle_deg", angle_deg, -1e6, 1e6, unit="deg")
    if motion.placed is False:  # simulate would put it before the new radar as before any other
        raise InputError(
            "vary_view needs a motion in the radar's world, and this one lies in its own coordinates; put it there with place"
        )
    start, before = motion.joints[0, 0], np.array(radar.position_m)
    height = float(before[2]) if height_m is None else number("height_m", height_m, -1e3, 1e3, unit="m")
    distance = float(np.linalg.norm(before - start))
    level2 = distance**2 - (height - start[2]) ** 2
    if not level2 > 1e-6 * distance**2:
        raise InputError(
            f"a radar at a height of {height:.3g} m cannot be {distance:.3g} m from the start of the motion, whose pelvis is at "
            f"{start[2]:.3g} m; give a height between {start[2] - distance:.3g} and {start[2] + distance:.3g} m"
        )
    ahead = main_direction(motion)
    angle = math.atan2(ahead[1], ahead[0]) + math.radians(angle_deg)
    position = np.array([*(start[:2] + math.sqrt(level2) * np.array([math.cos(angle), math.sin(angle)])), height])
    return radar.model_copy(
        update={"position_m": tuple(position.tolist()), "boresight": tuple((start - position).tolist())}
    )
