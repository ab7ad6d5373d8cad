"""`Motion`: the joints of one person in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, flag, instance, listed, number, numeric, shown, text
from t2d_rt.core.errors import InputError, html_table
from t2d_rt.geometry.vectors import norms
from t2d_rt.types.carried import ROTATION_LIMIT, Carried
from t2d_rt.types.splines import set_fields

CANONICAL_JOINTS: tuple[str, ...] = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
"""HumanML3D's 22 joints in HumanML3D's order; every `Motion` starts with them."""

CANONICAL_PARENTS: tuple[int, ...] = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)

OPTIONAL_JOINTS: dict[str, str] = {
    "head_top": "head",
    "left_hand": "left_wrist",
    "right_hand": "right_wrist",
    "left_toe": "left_foot",
    "right_toe": "right_foot",
}
"""Ends of limbs that a file may or may not have, with their parent joints; they follow the 22 in this order."""

RATES_HZ = 1e-3, 1e5
"""Least and greatest frame rate that is accepted [Hz]."""


_COORDINATES = {
    True: "in the radar's world",
    False: "in its own coordinates",
    None: "in coordinates that are not known",
}
"""Words for the values of a motion's `placed`."""


INHALES = 0.35
"""k of a breath's phase, cycle + k (1 - cos(cycle)) [rad]: breathing in takes 40 % of the cycle, as at rest (1 : 1.5)."""

BEAT_NARROWNESS = 1.7
"""k of a beat exp(k cos(cycle)): half of its height or more for 30 % of the time, as the ventricles contract for
0.3 s of a second at rest. Beats are trains of like pulses in Nosrati and Tavassolian (IEEE Trans. Microw. Theory
Tech. 66(7), 2018)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Breathing:
    """Movement of chest and abdomen by breathing, in addition to that of the joints."""

    rate_hz: float
    """Breaths a second; adults at rest take 12 to 20 a minute."""
    depth_m: float
    """How far the front of the trunk moves forward in a breath [m], peak to peak."""
    phase_rad: float = 0.0
    """Phase of the breath at the first frame [rad]; at 0 the person begins to breathe in."""

    def __post_init__(self) -> None:
        _check_cycle(self, (0.01, 5.0), 0.1)

    def displacement_m(self, times_s: np.ndarray) -> np.ndarray:
        """Displacement of the front of the trunk at times [s] (K,) of the motion [m], (K,): 0 to the depth, positive outwards."""
        cycle = _cycle_rad(self, times_s)
        return np.asarray(0.5 * self.depth_m * (1 - np.cos(cycle + INHALES * (1 - np.cos(cycle)))))

    def from_time(self, start_s: float) -> Breathing:
        """The same breathing on a clock that begins `start_s` later [s]."""
        return replace(self, phase_rad=float(_cycle_rad(self, start_s) % (2 * np.pi)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat:
    """Movement of the front of the trunk by the heart, in addition to `Breathing`: a pulse for each beat."""

    rate_hz: float
    """Beats a second; adults at rest have 60 to 100 a minute."""
    depth_m: float
    """How far the front of the trunk moves forward in a beat [m], peak to peak: some 0.5 mm in adults at rest (Droitcour et al.,
    IEEE Trans. Microw. Theory Tech. 52(3), 2004), mostly less."""
    phase_rad: float = 0.0
    """Phase of the beat at the first frame [rad]: 0 half way between two beats."""

    def __post_init__(self) -> None:
        _check_cycle(self, (0.1, 10.0), 0.01)

    def displacement_m(self, times_s: np.ndarray) -> np.ndarray:
        """Displacement of the front of the trunk at times [s] (K,) of the motion [m], (K,): 0 to the depth, positive outwards."""
        cycle = _cycle_rad(self, times_s)
        pulse = np.exp(-BEAT_NARROWNESS * (1 + np.cos(cycle)))
        least = np.exp(-2 * BEAT_NARROWNESS)
        return np.asarray(self.depth_m * (pulse - least) / (1 - least))

    def from_time(self, start_s: float) -> Heartbeat:
        """The same heartbeat on a clock that begins `start_s` later [s]."""
        return replace(self, phase_rad=float(_cycle_rad(self, start_s) % (2 * np.pi)))


def _check_cycle(cycle: Breathing | Heartbeat, rates_hz: tuple[float, float], most_m: float) -> None:
    phase_rad = number("phase_rad", cycle.phase_rad, -1e6, 1e6, unit="rad")
    rate_hz = number("rate_hz", cycle.rate_hz, *rates_hz, unit="Hz")
    set_fields(
        cycle, rate_hz=rate_hz, depth_m=number("depth_m", cycle.depth_m, 0.0, most_m, unit="m"), phase_rad=phase_rad
    )


def _cycle_rad(cycle: Breathing | Heartbeat, times_s: np.ndarray | float) -> np.ndarray:
    """Phase of the cycle at times [s] (K,) of the motion [rad]."""
    return 2 * np.pi * cycle.rate_hz * np.asarray(times_s, float) + cycle.phase_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Joints of one person in time: metres, right-handed, z up.

    `names` are `CANONICAL_JOINTS` followed by any of `OPTIONAL_JOINTS`.
    """

    joints: np.ndarray
    """Positions [m], float64 (T, J, 3)."""
    rotations: np.ndarray
    """Global orientations, unit quaternions x, y, z, w, float64 (T, J, 4). Each rotates its joint's bone rigidly; which orientation
    is zero differs from file to file and says nothing about the pose."""
    rate_hz: float
    names: tuple[str, ...] = CANONICAL_JOINTS
    parents: tuple[int, ...] = CANONICAL_PARENTS
    placed: bool | None = True
    """Whether positions are those of the radar's world. False where they are the file's own: a simulation then places the motion
    before the radar. None where it is not known: the simulation places it too, with a warning."""
    report: str = ""
    """One line: what the reader found in the file (units, up axis, flavour, floor, dropped frames, smoothing)."""
    origin: tuple[str, ...] = ()
    """Origin of the motion: the file's name and the SHA-256 of its content, then each edit made since."""
    activities: tuple[tuple[str, float], ...] = ()
    """What the person does, and from when on [s], in order; each activity lasts until the next one begins. () where it is not
    known."""
    breathing: Breathing | None = None
    """How the person breathes, which does not show in the joints; None for a motion without breathing, such as one of a file."""
    heartbeat: Heartbeat | None = None
    """How the person's heart moves the skin; None where it does not."""
    carries: tuple[Carried, ...] = ()
    """Things that move with the person's joints, as `carry` adds them."""

    def __post_init__(self) -> None:
        names, parents = listed("names", self.names, str, "a list of joint names"), _parents(self.parents)
        if names[:22] != CANONICAL_JOINTS:
            raise InputError("a motion's names must start with the 22 canonical joints; map the file's skeleton first")
        joints = array("joints", self.joints, ("time", len(names), 3), limit=LARGEST_M, unit="m")
        rotations = array("rotations", self.rotations, (len(joints), len(names), 4), limit=ROTATION_LIMIT)
        if len(parents) != len(names):
            raise InputError(f"parents must name a parent for each of the {len(names)} joints, got {len(parents)}")
        if len(joints) < 2:
            raise InputError(f"a motion needs at least 2 frames, got {len(joints)}; a single pose has no Doppler")
        if not (norms(rotations) > 1e-6).all():
            raise InputError(
                "rotations must be unit quaternions x, y, z, w, got one of no length; 0, 0, 0, 1 is no rotation"
            )
        if self.placed is not None:
            flag("placed", self.placed)
        if self.breathing is not None:
            instance("breathing", self.breathing, Breathing, "a Breathing, as Breathing(rate_hz=0.25, depth_m=0.008)")
        if self.heartbeat is not None:
            instance("heartbeat", self.heartbeat, Heartbeat, "a Heartbeat, as Heartbeat(rate_hz=1.2, depth_m=0.0002)")
        carries = listed("carries", self.carries, Carried, "a list of Carried, as t2d_rt.carry makes it")
        for item in carries:
            if item.joint not in names:
                raise InputError(f"the {item.thing} is carried by {shown(item.joint)}, which the motion does not have")
        set_fields(
            self,
            joints=joints,
            rotations=rotations,
            names=names,
            parents=parents,
            rate_hz=checked_rate(self.rate_hz),
            report=text("report", self.report),
            origin=listed("origin", self.origin, str, "a list of texts"),
            activities=_activities(self.activities),
            carries=carries,
        )

    def __repr__(self) -> str:
        return (
            f"Motion({len(self.joints)} frames at {self.rate_hz:g} Hz, {self.duration_s:.2f} s, {len(self.names)} joints, "
            f"{_COORDINATES[self.placed]})"
        )

    def _repr_html_(self) -> str:
        corners = self.joints.min((0, 1)), self.joints.max((0, 1))
        low, high = (", ".join(f"{x:.2f}" for x in corner) for corner in corners)
        rows = [
            ("frames", f"{len(self.joints)} at {self.rate_hz:g} Hz"),
            ("duration", f"{self.duration_s:.2f} s"),
            ("joints", f"{len(self.names)}, from ({low}) to ({high}) m"),
            ("positions", _COORDINATES[self.placed]),
            ("report", self.report),
        ]
        return html_table("Motion", rows)

    def edited(self, edit: str, **changes: Any) -> Motion:
        """A copy with some fields changed; `edit` names the change in the copy's origin."""
        return replace(self, **changes, origin=(*self.origin, edit))

    def activity_at(self, times_s: np.ndarray) -> np.ndarray:
        """Name of the activity at times [s] (K,), as texts (K,); "" where it is not known."""
        names = ["", *(name for name, _ in self.activities)]
        begins_s = [begin_s for _, begin_s in self.activities]
        return np.array(names, np.str_)[np.searchsorted(begins_s, np.asarray(times_s) + 1e-9, side="right")]

    @property
    def chest_moves(self) -> bool:
        """Whether the person breathes or has a heartbeat."""
        return self.breathing is not None or self.heartbeat is not None

    def chest_m(self, times_s: np.ndarray) -> np.ndarray:
        """Displacement of the front of the trunk by breathing and heartbeat at times [s] (K,) of the motion [m], (K,)."""
        cycles = [cycle.displacement_m(times_s) for cycle in (self.breathing, self.heartbeat) if cycle is not None]
        return np.asarray(sum(cycles, np.zeros(len(times_s))))

    @property
    def times_s(self) -> np.ndarray:
        """Times of the frames [s], (T,), from 0."""
        return np.arange(len(self.joints)) / self.rate_hz

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.joints) - 1) / self.rate_hz

    def index(self, name: str) -> int:
        """Index of a joint by its canonical name."""
        if not isinstance(name, str) or name not in self.names:
            raise InputError(f"the motion has no joint {shown(name)}; choose one of {', '.join(self.names)}")
        return self.names.index(name)


def _activities(value: Any) -> tuple[tuple[str, float], ...]:
    """Checked activities: names, and the times at which they begin."""
    hint = "such as [('walk', 0.0), ('sit', 2.5)], each later than the one before"
    listed = instance("activities", value, (list, tuple), f"a list of names and times, {hint}")
    if not all(isinstance(item, (list, tuple)) and len(item) == 2 for item in listed):
        raise InputError(f"activities must be names and times, {hint}, got {shown(value)}")
    pairs = tuple((text("activities", name), number("activities", begin_s, 0.0, unit="s")) for name, begin_s in listed)
    begins_s = [begin_s for _, begin_s in pairs]
    if begins_s != sorted(set(begins_s)):
        raise InputError(f"activities must begin one after the other, {hint}, got {shown(value)}")
    return pairs


def checked_motion(motion: Any) -> Motion:
    """A checked motion; refuses the name of a file, or an array."""
    hint = "load_motion reads a file, motion_from_joints takes arrays"
    return cast(Motion, instance("motion", motion, Motion, "a Motion", hint=hint))


def checked_rate(rate_hz: Any) -> float:
    """A checked frame rate [Hz]."""
    return number("rate_hz", rate_hz, *RATES_HZ, unit="Hz", hint="frames per second, 20 to 240 in most files")


def _parents(value: Any) -> tuple[int, ...]:
    """Checked indices of the joints' parents: parents come before their children, so that a chain can be followed in one pass."""
    chain = numeric("parents", value)
    if chain.ndim != 1 or not np.issubdtype(chain.dtype, np.integer):
        raise InputError(f"parents must be a list of joint numbers, got {shown(value)}")
    if not len(chain) or chain[0] != -1 or not all(0 <= parent < joint for joint, parent in enumerate(chain[1:], 1)):
        raise InputError("parents must begin with -1, the root's, and then name joints that come before their own")
    return tuple(chain.tolist())
