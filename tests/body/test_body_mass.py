"""Bodies of a body mass index that is asked for."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import t2d_rt as t2d
from builders import rest_pose
from measures import volume
from t2d_rt.body import segments, skin, template
from t2d_rt.core.errors import InputError


@pytest.mark.parametrize("name", ["adult@19", "woman@32", "man@22.5", "man@36", "heavy@40", "old@20", "child@19"])
def test_a_body_has_the_index_asked_for_and_head_hands_and_feet_stay(name: str) -> None:
    body, shipped = template(name), template(name.partition("@")[0])
    assert 1000 * volume(body.vertices, body.faces) / body.stature_m**2 == pytest.approx(
        float(name.partition("@")[2]), rel=1e-3
    )
    assert body.stature_m == pytest.approx(shipped.stature_m, abs=1e-3)
    moved = np.linalg.norm(body.vertices - shipped.vertices, axis=1)
    rigid = shipped.weights[:, [15, 20, 21, 10, 11]].sum(axis=1) == 1  # head, wrists, feet
    assert np.count_nonzero(rigid) > 300
    assert moved[rigid].max() < 1e-9
    assert 0.01 < moved.max() < 0.06
    assert pickle.loads(pickle.dumps(body)).name == name


def test_more_mass_goes_to_the_belly() -> None:
    thin, thick = (template(name).vertices for name in ("man@22", "man@34"))
    waist = np.abs(thin[:, 2] - 1.08) < 0.06
    trunk = waist & (np.abs(thin[:, 1]) < 0.25)
    depth, breadth = (np.ptp(thick[trunk], 0) / np.ptp(thin[trunk], 0))[:2]
    assert depth > breadth > 1.1


def test_people_of_one_shape_share_their_facets() -> None:
    motion = rest_pose()
    thin, thick = (skin(motion, name) for name in ("man@22", "man@34"))
    assert np.array_equal(thin.refined_rest, thick.refined_rest)
    chest = [segments(motion, name).semi_axes_m[4] for name in ("man@22", "man@34")]
    assert (chest[1][:2] > np.array([1.3, 1.05]) * chest[0][:2]).all()


@pytest.mark.parametrize(
    ("name", "match"), [("man@60", "18.5 to 40"), ("man@fat", "18.5 to 40"), ("giant@25", "unknown body")]
)
def test_other_bodies_are_refused(name: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        template(name)


@pytest.mark.parametrize("name", ["man@99", "man@fat", "man@", "giant@25"])
def test_nobody_is_made_with_a_body_that_is_none(name: str) -> None:
    with pytest.raises(InputError, match="body mass index"):
        t2d.motion_from_text("a person walks", seed=1, body=name)
