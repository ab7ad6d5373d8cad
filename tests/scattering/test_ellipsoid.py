"""Ellipsoids, as the ellipsoid model and as facets, against geometrical optics at the nearest point found by search."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from builders import icosphere
from measures import db
from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes, specular_points
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import PEC, Echoes, EchoStream, Ellipsoids, Material, MovingMesh, Radar

TABLE2 = Radar.preset("table2")
RADAR = np.array([0.0, 0.0, 1.0])
LIMB = np.array([0.08, 0.08, 0.22])
ASPECTS_DEG = np.linspace(0, 90, 7)
STATIC_S = np.arange(4) / TABLE2.prf_hz

ReadField = Callable[..., np.ndarray]


def limb_axes(aspect_deg: float) -> np.ndarray:
    """Axes in columns, the long one at an angle from the line of sight (x), in a plane that is neither level
    nor upright."""
    cos, sin = math.cos(math.radians(aspect_deg)), math.sin(math.radians(aspect_deg))
    long, first = np.array([cos, 0.8 * sin, 0.6 * sin]), np.array([-sin, 0.8 * cos, 0.6 * cos])
    return np.stack([first, np.cross(long, first), long], axis=1)


def searched_point(
    centre: np.ndarray, axes: np.ndarray, semi_axes: np.ndarray, tx: np.ndarray, rx: np.ndarray
) -> np.ndarray:
    """Point of shortest path tx - ellipsoid - rx by a search over directions; knows nothing of normals."""

    def point(direction: np.ndarray) -> np.ndarray:
        return centre + axes @ (semi_axes * direction / np.linalg.norm(direction))

    def path(direction: np.ndarray) -> float:
        return float(np.linalg.norm(point(direction) - tx) + np.linalg.norm(point(direction) - rx))

    start = axes.T @ ((tx + rx) / 2 - centre) / semi_axes
    found = minimize(path, start / np.linalg.norm(start), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14})
    return point(found.x)


def optics(
    point: np.ndarray, centre: np.ndarray, axes: np.ndarray, semi_axes: np.ndarray, seen_from: np.ndarray
) -> float:
    """sigma = pi R1 R2/((1 + R1/R)(1 + R2/R)) (eq. 8), the curvatures from gradient and Hessian of sum (x/a)^2 = 1."""
    quadric = axes @ np.diag(1 / semi_axes**2) @ axes.T
    gradient = quadric @ (point - centre)
    normal = gradient / np.linalg.norm(gradient)
    flat = np.eye(3) - np.outer(normal, normal)
    curvatures = np.sort(np.linalg.eigvalsh(flat @ quadric @ flat / np.linalg.norm(gradient)))[1:]
    range_m = np.linalg.norm(seen_from - point)
    return float(math.pi / np.prod(curvatures + 1 / range_m))


def echoes_of(
    centre: np.ndarray, axes: np.ndarray, radar: Radar = TABLE2, *, semi_axes: np.ndarray = LIMB, **options: str
) -> Echoes:
    ellipsoids = Ellipsoids(semi_axes[None], np.tile(centre, (2, 1, 1)), [0, 1], axes[None])
    stream = ellipsoid_echoes(ellipsoids, radar, times_s=STATIC_S, material=PEC, **options)  # type: ignore[arg-type]
    return stream.gather()


def standing(stream: EchoStream, k: int) -> Echoes:
    """Frames 4k..4k+3 of a target that jumps from pose to pose, as a record of its own."""
    delay, amplitude, slope, *_ = stream.frames(4 * k, 4 * k + 4)
    return Echoes(times_s=STATIC_S, delay_s=delay, amplitude=amplitude, slope=slope)


def spheroid_mesh(poses: list[np.ndarray], centre: np.ndarray, radar: Radar, backend: Backend) -> EchoStream:
    """Facets of the limb at 4 frames of each pose, one refinement for all."""
    sphere, faces = icosphere(4)
    rest = sphere * LIMB
    places = np.stack([centre + rest @ axes.T for axes in poses])
    mesh = MovingMesh.from_track(
        lambda t: places[np.minimum(t // 4, len(poses) - 1).astype(int)], faces, [0, 4 * len(poses)], rest=rest
    )
    times_s = np.arange(4.0 * len(poses))
    return mesh_echoes(
        mesh, radar, times_s=times_s, material=PEC, detail=Detail(sagitta_rad=mesh.sagitta_rad), seed=0,
        views=[PathVisibility()], backend=backend,
    )  # fmt: skip


@pytest.mark.slow
def test_spheroid_at_seven_aspects_both_models(backend: Backend, field_in_cube: ReadField) -> None:
    centre = np.array([3.2, 0.0, 1.0])
    poses = [limb_axes(a) for a in ASPECTS_DEG]
    facets = spheroid_mesh(poses, centre, TABLE2, backend)
    fields = []
    for k, axes in enumerate(poses):
        point = searched_point(centre, axes, LIMB, RADAR, RADAR)
        range_m = float(np.linalg.norm(point - RADAR))
        sigma = optics(point, centre, axes, LIMB, RADAR)
        echoes = echoes_of(centre, axes)
        # Path of the nearest point: 1e-7 m is 0.2 mrad of phase.
        assert echoes.delay_s[0, 0] * SPEED_OF_LIGHT / 2 == pytest.approx(range_m, abs=1e-7)
        read = [field_in_cube(synthesize(e, TABLE2), TABLE2, range_m)[0] for e in (echoes, standing(facets, k))]
        fields.append(read)
        assert np.abs(db(np.abs(read) ** 2 / sigma)).max() < 0.3
        assert abs(db(abs(read[0]) ** 2 / sigma)) < 0.01
    ellipsoid, mesh = np.array(fields).T
    # One field, phases included: a conductor's -1 times sqrt(sigma).
    assert np.abs(np.angle(-ellipsoid)).max() < 1e-3
    assert db(np.sum(np.abs(mesh - ellipsoid) ** 2) / np.sum(np.abs(ellipsoid) ** 2)) < -20


def test_far_field_shortcut_is_not_what_the_model_does() -> None:
    # At 3 m the paper's eq. 1 is off by up to 0.85 dB and R_centre - h by up to 3 mm for this segment.
    centre = np.array([3.0, 0, 1])
    offs = []
    for psi in np.radians(ASPECTS_DEG):
        near = echoes_of(centre, limb_axes(math.degrees(psi)))
        h2 = (LIMB[0] * math.sin(psi)) ** 2 + (LIMB[2] * math.cos(psi)) ** 2
        far_rcs = math.pi * LIMB[0] ** 4 * LIMB[2] ** 2 / h2**2
        range_m = near.delay_s[0, 0] * SPEED_OF_LIGHT / 2
        near_rcs = abs(near.amplitude[0, 0]) ** 2 / TABLE2.received_power_w(1.0, range_m)
        offs.append((3 - math.sqrt(h2) - range_m, float(db(far_rcs / near_rcs))))
    worst = np.abs(offs).max(axis=0)
    assert 2e-3 < worst[0] < 4e-3
    assert 0.6 < worst[1] < 1.3


def test_centre_form_is_the_papers() -> None:
    centre = np.array([2.5, 0.4, 1.3])
    range_m = float(np.linalg.norm(centre - RADAR))
    for angle in (0, 35, 90):
        axes = Rotation.from_euler("xyz", [20, angle, 50], degrees=True).as_matrix()
        cos_psi = axes[:, 2] @ (RADAR - centre) / range_m
        a, c, sin2 = LIMB[0], LIMB[2], 1 - cos_psi**2
        paper = math.pi * a**4 * c**2 / (a**2 * sin2 + c**2 * cos_psi**2) ** 2
        echoes = echoes_of(centre, axes, phase_from="centre")
        np.testing.assert_allclose(echoes.delay_s, 2 * range_m / SPEED_OF_LIGHT, rtol=1e-14)
        np.testing.assert_allclose(np.abs(echoes.amplitude) ** 2, TABLE2.received_power_w(paper, range_m), rtol=1e-5)
        assert echoes.slope is None


def test_centre_form_is_what_remains_far_away() -> None:
    centre = np.array([5e3, 0, 1.0])
    axes = limb_axes(40)
    near, paper = (echoes_of(centre, axes, phase_from=form) for form in ("specular", "centre"))
    np.testing.assert_allclose(np.abs(near.amplitude), np.abs(paper.amplitude), rtol=3e-4)


@pytest.mark.slow
def test_bistatic_point_of_shortest_path_and_both_models(backend: Backend) -> None:
    radar = TABLE2.replace(tx_offsets_m=(0.0, 1.0, 0.2), rx_offsets_m=(0.1, -1.2, -0.3))
    tx, rx, centre = radar.tx_position_m, radar.rx_position_m, np.array([2.5, 0.3, 1.1])
    poses = [limb_axes(a) for a in (10, 55, 90)]
    facets = spheroid_mesh(poses, centre, radar, backend)
    for k, axes in enumerate(poses):
        point = searched_point(centre, axes, LIMB, tx, rx)
        path = np.linalg.norm(point - tx) + np.linalg.norm(point - rx)
        echoes = echoes_of(centre, axes, radar)
        assert echoes.delay_s[0, 0] * SPEED_OF_LIGHT == pytest.approx(path, abs=2e-7)
        expected = echoes.amplitude[0, 0] * np.exp(2j * np.pi * (radar.mid_frequency_hz * path / SPEED_OF_LIGHT % 1))
        mesh = standing(facets, k)
        lit = mesh.amplitude[0] != 0
        cycles = radar.mid_frequency_hz * mesh.delay_s[0, lit] % 1
        got = np.sum(mesh.amplitude[0, lit].astype(complex) * np.exp(2j * np.pi * cycles))
        # Facets know nothing of specular points: sigma = 4 pi cos^2(beta/2)/det H, phase within 0.15 rad.
        # 0.5 dB: near the tip, of 3 cm radius, the shadow boundary's share of physical optics is 1/(k a), 0.2 dB.
        assert abs(db(abs(got / expected) ** 2)) < 0.5
        assert abs(np.angle(got / expected)) < 0.15


def test_bistatic_sphere_is_the_willis_formula() -> None:
    # Far apart from its size, a sphere's bistatic RCS is pi a^2 at every angle that is not forward.
    radar = TABLE2.replace(tx_offsets_m=(0.0, 300.0, 0.0), rx_offsets_m=(0.0, -300.0, 0.0))
    ball = np.array([0.1, 0.1, 0.1])
    echoes = echoes_of(np.array([400.0, 0, 1]), np.eye(3), radar, semi_axes=ball)
    np.testing.assert_allclose(np.abs(echoes.amplitude) ** 2, radar.received_power_w(math.pi * 0.01, 500.0), rtol=2e-3)
    # Path over the nearest point of the bisector: 2 (R - a cos(beta/2)), cos(beta/2) = 4/5.
    assert echoes.delay_s[0, 0] * SPEED_OF_LIGHT / 2 == pytest.approx(500 - 0.1 * 0.8, abs=1e-5)


@pytest.mark.slow
@given(
    semi_axes=st.tuples(*[st.floats(0.02, 0.6)] * 3),
    angles=st.tuples(*[st.floats(-180, 180)] * 3),
    gap=st.floats(0.05, 5.0),
    apart=st.floats(0, 1),
)
@settings(max_examples=150, deadline=None)
def test_specular_point_lies_on_the_surface_and_reflects(
    semi_axes: tuple[float, ...], angles: tuple[float, ...], gap: float, apart: float
) -> None:
    axes = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    sizes, centre = np.array(semi_axes), np.array([max(semi_axes) + gap, 0.2, 0.1])
    tx, rx = np.array([0, apart / 2, 0]), np.array([0, -apart / 2, 0])
    point, normal = (x[0, 0] for x in specular_points(centre[None, None], axes[None, None], sizes[None], tx, rx))
    inside = axes.T @ (point - centre) / sizes
    assert inside @ inside == pytest.approx(1, abs=1e-12)
    outward = axes @ (inside / sizes)
    assert normal == pytest.approx(outward / np.linalg.norm(outward), abs=1e-9)
    bisector = sum((antenna - point) / np.linalg.norm(antenna - point) for antenna in (tx, rx))
    # The angle between normal and bisector is the path's slope on the surface: 1e-6 leaves the path right to 1e-12.
    assert normal == pytest.approx(bisector / np.linalg.norm(bisector), abs=1e-6)


def test_rotating_scene_and_radar_together_and_swapping_antennas() -> None:
    radar = TABLE2.replace(tx_offsets_m=(0.0, 0.4, 0.1), rx_offsets_m=(0.2, -0.5, 0.0))
    centre, axes = np.array([2.0, 0.5, 0.3]), limb_axes(30)
    reference = echoes_of(centre + RADAR, axes, radar)
    rotation = Rotation.from_euler("z", 70, degrees=True)
    rotated = radar.replace(boresight=tuple(rotation.apply([1.0, 0, 0])))
    swapped = radar.replace(tx_offsets_m=radar.rx_offsets_m, rx_offsets_m=radar.tx_offsets_m)
    for other in (
        echoes_of(rotation.apply(centre) + RADAR, rotation.as_matrix() @ axes, rotated),
        echoes_of(centre + RADAR, axes, swapped),
    ):
        np.testing.assert_allclose(other.delay_s, reference.delay_s, rtol=1e-12)
        np.testing.assert_allclose(other.amplitude, reference.amplitude, rtol=1e-6)


def test_material_scales_and_shifts_the_field() -> None:
    glass = Material(relative_permittivity=6.31, conductivity_s_per_m=3.0)
    ball = Ellipsoids(LIMB[None], np.full((2, 1, 3), 2.0), [0, 1])
    made = [ellipsoid_echoes(ball, TABLE2, times_s=STATIC_S, material=m).gather().amplitude[0, 0] for m in (glass, PEC)]
    gamma = glass.reflection(TABLE2.mid_frequency_hz)
    assert made[0] / made[1] == pytest.approx(-gamma.conjugate(), rel=1e-5)  # IF = tx conj(rx)
