from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import builders
from builders import rest_pose
from measures import volume
from t2d_rt.body import segments, skin, template
from t2d_rt.body.fit import fit
from t2d_rt.body.segments import SEGMENTS, _ellipsoid, fit_ellipsoids, segment_of_faces
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.motion import load_motion, track
from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.motion import Motion

TIMES = np.linspace(0, 1, 21)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return builders.walk()


@pytest.mark.parametrize("name", ["12_01_walk.bvh", "iclone_002_03_run_jog.bvh.gz", "momask_22j_120frames.bvh"])
def test_segments_have_the_bodys_volume_and_extents(name):
    body = fit(template(), load_motion(resource("motions", name)))
    semi_axes, centres, axes = fit_ellipsoids(body)
    total = (4 / 3 * np.pi * semi_axes.prod(1)).sum()
    assert total == pytest.approx(volume(body.vertices, body.template.faces), rel=0.15)
    reach = np.linalg.norm(axes * semi_axes[:, None, :], axis=2)
    np.testing.assert_allclose((centres + reach).max(0), body.vertices.max(0), atol=0.04)
    np.testing.assert_allclose((centres - reach).min(0), body.vertices.min(0), atol=0.04)


def test_each_face_belongs_to_the_segment_it_lies_in(walk):
    body = fit(template(), walk)
    owner, middle = segment_of_faces(body), body.vertices[body.template.faces].mean(axis=1)
    assert owner.shape == (len(body.template.faces),)
    places = {name: middle[owner == number] for number, name in enumerate(SEGMENTS)}
    assert all(len(found) > 20 for found in places.values())
    storeys = ("pelvis", "abdomen", "chest", "neck", "head")
    heights = [places[name][:, 2].mean() for name in storeys]
    assert heights == sorted(heights)
    for part in ("thigh", "shank", "forearm", "hand", "foot"):
        left, right = places[f"left_{part}"], places[f"right_{part}"]
        np.testing.assert_allclose(left.mean(0), right.mean(0) * [1, -1, 1], atol=0.02)
        assert (left[:, 1] > 0).all()


def test_a_segments_surface_lies_near_the_bodys():
    """Half of each segment's own vertices are within 2 cm of its ellipsoid (first order: value over gradient)."""
    body = fit(template(), load_motion(resource("motions", "iclone_002_03_run_jog.bvh.gz")))
    semi_axes, centres, axes = fit_ellipsoids(body)
    own = np.einsum("nij,vni->vnj", axes, body.vertices[:, None] - centres) / semi_axes
    level = np.linalg.norm(own, axis=2)
    distance = np.abs(level - 1) * level / np.linalg.norm(own / semi_axes, axis=2)
    nearest = distance.argmin(1)
    assert np.median(distance.min(1)) < 0.012
    for i, name in enumerate(SEGMENTS):
        assert np.count_nonzero(nearest == i) > 10, name
        assert np.median(distance[nearest == i, i]) < 0.02, name


def test_a_cylinder_becomes_as_long_and_by_half_as_thick_as_its_volume_asks():
    """V = pi r^2 L = 1.5 times the ellipsoid between its ends; half of that, in the geometric mean, is 1.5^(1/4)."""
    import trimesh

    radius, length = 0.05, 0.3
    cylinder = trimesh.creation.cylinder(radius, length, sections=128).subdivide_to_size(0.02)
    semi_axes, centre, _ = _ellipsoid(cylinder.triangles + 1.0, *np.eye(3))
    np.testing.assert_allclose(semi_axes, [1.5**0.25 * radius, 1.5**0.25 * radius, length / 2], rtol=0.01)
    np.testing.assert_allclose(centre, 1, atol=1e-3)


def test_left_and_right_have_the_same_size():
    semi_axes = dict(zip(SEGMENTS, fit_ellipsoids(fit(template(), rest_pose(ends=False, frames=4)))[0], strict=True))
    for name in SEGMENTS:
        if name.startswith("left"):
            np.testing.assert_allclose(semi_axes[name], semi_axes[name.replace("left", "right")], rtol=0.06, atol=0.002)


def test_segments_move_with_the_surface(walk):
    """Each centre keeps its distance from the vertices that its bone alone carries, and sits among them."""
    course = track(walk)
    ellipsoids, surface = segments(walk, track=course), skin(walk, track=course)
    times = np.linspace(0, walk.duration_s, 9)
    (centres, axes), vertices = ellipsoids.at(times), surface.at(times)
    assert ellipsoids.names == tuple(SEGMENTS)
    assert len(SEGMENTS) == 17
    np.testing.assert_allclose(np.swapaxes(axes, -1, -2) @ axes, np.broadcast_to(np.eye(3), axes.shape), atol=1e-12)
    head = template().weights[:, list(template().joints).index("head")] > 0.9999
    offset = vertices[:, head] - centres[:, None, ellipsoids.names.index("head")]
    own = np.einsum("kij,kvi->kvj", axes[:, ellipsoids.names.index("head")], offset)
    assert np.ptp(own, axis=0).max() < 1e-9


def test_a_forearm_lies_along_its_joints(walk):
    ellipsoids = segments(walk, track=track(walk))
    centres, axes = ellipsoids.at(np.array([1.0]))
    joints = track(walk)(np.array([1.0]))[0][0]
    elbow, wrist = (joints[walk.index(f"left_{joint}")] for joint in ("elbow", "wrist"))
    forearm = ellipsoids.names.index("left_forearm")
    bone = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    assert axes[0, forearm, :, 2] @ bone == pytest.approx(1, abs=1e-9)
    middle = centres[0, forearm] - (elbow + wrist) / 2
    assert np.linalg.norm(middle) < 0.04


def test_a_static_spheroid():
    ball = Ellipsoids([[0.1, 0.1, 0.2]], np.full((2, 1, 3), 3.0), [0, 1])
    centres, axes = ball.at(np.array([0, 0.3, 1]))
    np.testing.assert_array_equal(centres, np.full((3, 1, 3), 3.0))
    np.testing.assert_array_equal(axes, np.broadcast_to(np.eye(3), (3, 1, 3, 3)))
    assert ball.duration_s == 1
    assert "skin" in repr(ball)


def test_a_spheroid_that_flies_in_a_parabola_and_spins():
    """Cubic splines carry a parabola exactly, a steady spin to fourth order."""
    path = np.stack([2 - TIMES, 0 * TIMES, 1 + TIMES - 4.9 * TIMES**2], -1)[:, None]
    spin = Rotation.from_rotvec(np.outer(TIMES, [0, 7.0, 0])).as_matrix()[:, None]
    ball = Ellipsoids([[0.1, 0.1, 0.2]], path, TIMES, spin)
    between = np.linspace(0.01, 0.99, 77)
    centres, axes = ball.at(between)
    np.testing.assert_allclose(centres[:, 0, 2], 1 + between - 4.9 * between**2, atol=1e-12)
    expected = Rotation.from_rotvec(np.outer(between, [0, 7.0, 0])).as_matrix()
    np.testing.assert_allclose(axes[:, 0], expected, atol=1e-4)


def test_two_frames_are_a_straight_line():
    ball = Ellipsoids([[0.1, 0.1, 0.1]], np.array([[[0.0, 0, 0]], [[1.0, 0, 0]]]), [0, 2])
    np.testing.assert_allclose(ball.at(np.array([0.5]))[0], [[[0.25, 0, 0]]], atol=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"semi_axes_m": [0.1, 0.1, 0.2]}, r"semi_axes_m must have shape \(ellipsoid, 3\), got \(3,\)"),
        ({"semi_axes_m": [[0.1, 0, 0.2]]}, "semi_axes_m must be positive and finite, got 0 m"),
        ({"centres": np.zeros((2, 2, 3))}, r"centres must have shape \(2, 1, 3\), got \(2, 2, 3\)"),
        ({"centres": np.full((2, 1, 3), np.nan)}, "centres must be finite"),
        ({"times_s": [0, 0]}, "finite and increasing"),
        ({"times_s": [0]}, "a static target needs two equal frames"),
        ({"axes": np.eye(3)}, r"axes must have shape \(2, 1, 3, 3\) or \(1, 3, 3\), got \(3, 3\)"),
        ({"axes": -np.eye(3)[None]}, "right-handed orthogonal unit vectors"),
        ({"axes": 2 * np.eye(3)[None]}, "normalise them first"),
        ({"names": ["a", "b"]}, "1 ellipsoids need as many names, got 2"),
    ],
)
def test_ellipsoids_refuse_what_makes_no_sense(change, message):
    good = {"semi_axes_m": [[0.1, 0.1, 0.2]], "centres": np.zeros((2, 1, 3)), "times_s": [0, 1]}
    with pytest.raises(InputError, match=message):
        Ellipsoids(**good | change)


def test_ellipsoids_are_known_only_for_a_while():
    ball = Ellipsoids([[0.1, 0.1, 0.2]], np.zeros((2, 1, 3)), [0, 1])
    with pytest.raises(InputError, match=r"known from 0 s to 1 s, asked for 0 s to 1\.5 s"):
        ball.at(np.array([0, 1.5]))
