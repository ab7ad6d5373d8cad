"""Manners: small changes of posture, swing of the arms and height of steps, beside those of the speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.descriptions.slots import Manner, Step
from t2d_rt.motion.generate.chain import Piece, from_rotation_vector, swung
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.kinematics import INDEX


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What a manner changes."""

    tempo: float = 1.0
    stride: float = 1.0
    trunk_deg: float = 0.0
    """Lean forward."""
    head_deg: float = 0.0
    """Nod down."""
    arms: float = 1.0
    """Factor of the arms' swing."""
    elbows_deg: float = 0.0
    """Further bend."""
    apart_deg: float = 0.0
    """Arms farther from the body."""
    bounce: float = 1.0
    """Factor of the pelvis's rise and fall."""
    crouch: float = 0.0
    """Lowering of the pelvis over the length of the legs."""


CHANGES: Mapping[Manner, Change] = {
    "careful": Change(
        tempo=0.9, stride=0.88, trunk_deg=4, head_deg=9, arms=0.6, elbows_deg=12, apart_deg=6, crouch=0.015
    ),
    "happy": Change(tempo=1.07, stride=1.03, trunk_deg=-3, head_deg=-6, arms=1.35, bounce=1.25),
    "angry": Change(tempo=1.1, stride=1.08, trunk_deg=5, head_deg=3, arms=1.3, elbows_deg=15),
    "sad": Change(tempo=0.87, stride=0.88, trunk_deg=6, head_deg=16, arms=0.55, bounce=0.8),
}
"""Sadness: walking slower by a fifth, arms that swing little, a slumped trunk and a bowed head, little bounce (Michalak et al.
2009); anger and joy: faster, larger swing, an erect trunk in joy (Roether, Omlor, Christensen, Giese 2009; Gross, Crane,
Fredrickson 2012). Care: shorter and slower steps, gaze to the floor, as on slippery ground (Cham, Redfern 2002)."""

STRENGTH = 0.6, 1.3
"""Range of how much of a change a sample has."""


def with_manner(piece: Piece, step: Step, rng: np.random.Generator) -> Piece:
    """The piece in the step's manner."""
    if step.manner is None:
        return piece
    change, strength = CHANGES[step.manner], float(rng.uniform(*STRENGTH))
    travels = step.action in ("walk", "run")
    # A manner brings its own pace; where the description says the speed, that is said already.
    pace = strength if step.speed == "normal" else 0.0
    piece = (edits.paced if step.action in ("jump", "dance") else edits.tempo)(piece, change.tempo**pace)
    if travels:
        piece = edits.strided(piece, change.stride**pace)
    arms = change.arms**strength
    if step.action in ("dance", "jump"):
        # Arms of dancers and jumpers swing as far as they can: farther, they would go faster than recorded ones.
        arms = min(arms, 1.0)
    local = piece.poses.local.copy()
    for joint, part in (("spine1", 0.4), ("spine2", 0.3), ("spine3", 0.3)):
        _turned(local, joint, [0.0, np.radians(change.trunk_deg) * strength * part, 0.0])
    for joint in ("neck", "head"):
        _turned(local, joint, [0.0, 0.5 * strength * np.radians(change.head_deg), 0.0])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint in ("shoulder", "elbow"):
            index = INDEX[f"{side}_{joint}"]
            local[:, index] = swung(local[:, index], arms, piece.poses.rate_hz)
        _turned(local, f"{side}_elbow", [0.0, 0.0, -sign * strength * np.radians(change.elbows_deg)])
        _turned(local, f"{side}_shoulder", [sign * strength * np.radians(change.apart_deg), 0.0, 0.0])
    root = piece.poses.root.copy()
    if travels:
        middle = root[:, 2].mean()
        root[:, 2] = middle + (root[:, 2] - middle) * change.bounce**strength
    root[:, 2] -= strength * change.crouch * piece.poses.skeleton.leg_m
    return replace(piece, poses=replace(piece.poses, root=root, local=local)).noted(f"{step.manner} by {strength:.2f}")


def _turned(local: np.ndarray, joint: str, vector: list[float]) -> None:
    index = INDEX[joint]
    local[:, index] = quaternions.multiply(local[:, index], from_rotation_vector(np.array(vector)))
