"""Parametric changes of a recorded straight walk: where feet go, how the trunk is held, when each step comes.

The recorded walk gives what a formula does not: weight shift, roll of the feet, the person's own variation. Places are changed by a
map of the path, so that a planted foot stays planted; the legs then follow their feet by inverse kinematics, and time is warped
last.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion.contacts import contacts, follow, plant
from t2d_rt.motion.kinematics import Poses, at_frames
from t2d_rt.motion.vary.carriage import held_body, pelvis_track
from t2d_rt.motion.vary.gait_change import GaitChange
from t2d_rt.motion.vary.steps import lifted_toes, pitched_feet, pivots, placed_feet, turned_knees
from t2d_rt.motion.vary.straight_walk import along_x, on_floor, phase, stances
from t2d_rt.motion.vary.timing import new_times, trembling


def changed_walk(walk: Poses, change: GaitChange, rng: np.random.Generator) -> Poses:
    """A straight walk with a gait changed: it starts at the origin and goes along +x.

    Raises an InputError for a walk that is not straight or shorter than 1.5 m.
    """
    poses = along_x(walk)
    planted = contacts(poses)
    stands = stances(poses, planted)
    weight, swing = phase(stands, poses.rate_hz)
    ankles = placed_feet(poses, change, stands, swing, rng)
    times = new_times(poses, change, stands, weight, rng)  # of the recorded walk, before its path is shortened
    poses = replace(poses, root=pelvis_track(poses, change, weight), local=held_body(poses, change, weight, rng))
    poses = follow(poses, ankles)
    poses = turned_knees(lifted_toes(pitched_feet(poses, change, swing), change, swing), change)
    poses = plant(poses, pivots(planted, change))
    poses = at_frames(poses, times)
    return on_floor(trembling(poses, change, times, rng))
