"""Muscles of a falling person: they go on with the step, react after a while, and give way.

Each hinge is a spring and damper toward a target angle (proportional-derivative control), limited to the joint's greatest torque.
`Course` says for every frame what the targets and the tone are, 1 being a walking person's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.generate.falls.anatomy import PARENTS, SIDES
from t2d_rt.motion.generate.falls.humanoid import Humanoid
from t2d_rt.motion.generate.falls.plan import Heading
from t2d_rt.motion.generate.falls.pose import hinge_angles

STIFFNESS_PER_TORQUE = 2.2
"""Stiffness of a hinge at tone 1 over its greatest torque [1/rad]: an ankle of 240, a knee of 370 Nm/rad."""
DAMPING_PER_STIFFNESS = 0.07
"""[s]"""

REGIONS: dict[str, tuple[str, ...]] = {
    "leg": tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "foot")),
    "trunk": ("spine1", "spine2", "spine3"),
    "arm": tuple(f"{side}_{joint}" for side in SIDES for joint in ("collar", "shoulder", "elbow", "wrist")),
    "neck": ("neck", "head"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Fading:
    """A tone that falls from 1 to `floor`, `delay_s` after the event, within about `within_s`."""

    delay_s: float
    within_s: float
    floor: float

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """The tone at times since the event (T,)."""
        return self.floor + (1 - self.floor) * (1 - minimum_jerk((time_s - self.delay_s) / self.within_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaction:
    """The pose that a falling person strives for."""

    heading: Heading
    delay_s: float
    """From the event; 0.1 to 0.25 s for balance reactions (Maki and McIlroy 1997)."""
    within_s: float
    arms: bool
    pose: dict[str, float] = field(default_factory=dict)
    """Angle [rad] by canonical joint and axis, as "spine1 x"."""
    reach: tuple[float, float] = (0.0, 0.0)
    """How far (side, up) the arms' directions differ from the usual."""
    elbow_rad: float = 0.6


def arm_directions(heading: Heading, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Where an arm reaches and where its elbow flexes to, in the chest's axes (left, up, forward).

    Forward falls are met with both hands, backward falls with hands behind the hips, sideways falls with the arm of that side while
    the other one comes across (Hsiao and Robinovitch 1998, J. Biomech. 31).
    """
    out = 1.0 if side == "left" else -1.0
    if heading == "forward":
        return np.array([0.3 * out, 0.0, 0.95]), np.array([-0.5 * out, 0.85, 0.0])
    if heading == "back":
        return np.array([0.55 * out, -0.75, -0.3]), np.array([0.2 * out, 0.0, 1.0])
    toward = (heading == "left") == (side == "left")
    if toward:
        return np.array([0.85 * out, -0.4, 0.35]), np.array([0.0, 0.5, 0.85])
    return np.array([-0.05 * out, -0.5, 0.85]), np.array([-0.5 * out, 0.8, 0.3])


def reaction_pose(body: Humanoid, reaction: Reaction, reference: np.ndarray) -> np.ndarray:
    """Target coordinates (T, nq) of the reaction, where the lead's are `reference` (T, nq)."""
    target = reference.copy()
    for key, angle in reaction.pose.items():
        name, axis = key.split()
        hinge = body.hinges[name][body.axes[name].index(axis.upper())]
        target[:, hinge] = angle
    if reaction.arms:
        for side in SIDES:
            along, flexion = arm_directions(reaction.heading, side)
            out = 1.0 if side == "left" else -1.0
            along = along + np.array([reaction.reach[0] * out, reaction.reach[1], 0.0])
            along = along / np.linalg.norm(along)
            x = np.cross(along, flexion)
            x /= np.linalg.norm(x)
            y = -along
            segment = np.stack([x, y, np.cross(x, y)], axis=-1)
            name = f"{side}_shoulder"
            angles = hinge_angles(body, name, segment[None])[0]
            target[:, body.hinges[name]] = within_range(body, name, angles)
            target[:, body.hinges[f"{side}_elbow"]] = reaction.elbow_rad
            target[:, body.hinges[f"{side}_collar"]] = 0.0
    return target


def within_range(body: Humanoid, name: str, angles: np.ndarray) -> np.ndarray:
    """Angles of a joint's hinges within their ranges."""
    model = body.model
    numbers = [int(np.flatnonzero(model.jnt_qposadr == hinge)[0]) for hinge in body.hinges[name]]
    ranges = model.jnt_range[numbers]
    return np.clip(angles, ranges[:, 0], ranges[:, 1])


def hinge_tones(body: Humanoid, tones: dict[str, np.ndarray]) -> np.ndarray:
    """Tone of each actuator (T, nu) from that of each canonical joint (T,)."""
    model = body.model
    count = len(next(iter(tones.values())))
    found = np.ones((count, model.nu))
    of_hinge = {hinge: name for name, hinges in body.hinges.items() for hinge in hinges}
    for actuator in range(model.nu):
        hinge = int(model.jnt_qposadr[model.actuator_trnid[actuator, 0]])
        found[:, actuator] = tones[of_hinge[hinge]]
    return found


JOINTS = tuple(name for name, parent in PARENTS.items() if parent >= 0)
