"""Targets are frozen values that other processes can be handed."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ball
from t2d_rt.core.resources import resource

SPAN_S = 0.0, 0.2


def walk() -> t2d.Motion:
    return t2d.trim(t2d.load_motion(resource("motions", "12_01_walk.bvh")), 1.0, 1.1)


def limbs() -> t2d.Ellipsoids:
    times_s = np.linspace(*SPAN_S, 6)
    centres = np.stack([3 + 0.3 * times_s, 0.1 * times_s**2, 1 - 0.2 * times_s], axis=-1)[:, None]
    angle = 2 * times_s
    zero, one = np.zeros(6), np.ones(6)
    rows = [[np.cos(angle), -np.sin(angle), zero], [np.sin(angle), np.cos(angle), zero], [zero, zero, one]]
    return t2d.Ellipsoids(np.array([[0.1, 0.08, 0.3]]), centres, times_s, np.array(rows).transpose(2, 0, 1)[:, None])


TARGETS: dict[str, Callable[[], Any]] = {
    "motion": walk,
    "body": lambda: t2d.skin(t2d.place(walk())),
    "segments": lambda: t2d.segments(walk()),
    "mesh": lambda: ball((3.0, 0.2, 1.0), (-1.0, 0, 0), SPAN_S[1]),
    "ellipsoids": limbs,
    "fan": lambda: t2d.TableFan(position_m=(2, 1, 1), rpm=200),
    **{
        kind: lambda kind=kind: t2d.mover(f"{kind}:2,1,1").mesh(*SPAN_S)
        for kind in ("fan", "ceiling_fan", "curtain", "door", "pet")
    },
}


@pytest.mark.parametrize("kind", TARGETS)
def test_a_pickled_target_is_the_same_to_the_last_bit(kind: str) -> None:
    target = TARGETS[kind]()
    again = pickle.loads(pickle.dumps(target))
    assert repr(again) == repr(target)
    if isinstance(target, t2d.Motion):
        assert np.array_equal(again.joints, target.joints)
        assert np.array_equal(again.rotations, target.rotations)
    if not isinstance(target, (t2d.MovingMesh, t2d.Ellipsoids)):
        return
    times_s = np.linspace(target.times_s[0], target.times_s[-1], 7)
    assert np.array_equal(again.points_at(times_s), target.points_at(times_s))
    assert (again.made is None) == (target.made is None)


@pytest.mark.parametrize(("kind", "field"), [("motion", "rate_hz"), ("body", "sagitta_rad"), ("ellipsoids", "made")])
def test_targets_are_frozen(kind: str, field: str) -> None:
    target = TARGETS[kind]()
    with pytest.raises(FrozenInstanceError):
        setattr(target, field, None)
