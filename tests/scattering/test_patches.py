"""Patches: every facet once, no patch larger than motion and sweep allow, and none cut for nothing."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import ball, icosphere, slow_after, static_mesh
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import T2DWarning
from t2d_rt.geometry import Refinement, refinements
from t2d_rt.scattering.patches import CYCLES_PER_STEP, MOST_FACETS, Patches, centres, normals, patches, tilts
from t2d_rt.scattering.points import DiffusePoints
from t2d_rt.types import MovingMesh, Radar

TABLE2 = Radar.preset("table2")
NARROW = TABLE2.replace(slope_hz_per_s=1e9)  # 60 kHz of sweep: range has no part in the cuts
BISTATIC = TABLE2.replace(tx_offsets_m=(0.0, 0.4, 0.1), rx_offsets_m=(0.2, -0.5, 0.0))
RATE_HZ = 150.0
TIMES_S = np.arange(76) / RATE_HZ


def spinning_ball(spin_rad_per_s: float, velocity_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> MovingMesh:
    """A ball of 20 cm radius 3 m away that spins about z and flies."""
    rest, faces = icosphere(3, 0.2)

    def track(times_s: np.ndarray) -> np.ndarray:
        rotation = Rotation.from_euler("z", spin_rad_per_s * times_s[:, None]).as_matrix()
        return rest @ rotation.transpose(0, 2, 1) + [3, 0.3, 1.2] + times_s[:, None, None] * np.array(velocity_mps)

    return MovingMesh.from_track(track, faces, TIMES_S, "pec", rest=rest)


def refined(mesh: MovingMesh, sagitta_rad: float = 0.5) -> Refinement:
    wavenumber = 2 * math.pi / TABLE2.wavelength_m
    return refinements(mesh.rest, mesh.faces, wavenumber=wavenumber, range_m=2.5, sagittas_rad=[sagitta_rad])[0]


def as_it_is(mesh: MovingMesh) -> Refinement:
    """Facets that are the mesh's own faces."""
    one = sparse.identity(len(mesh.rest), format="csr")
    return Refinement(operator=one, faces=mesh.faces, base_face=np.arange(len(mesh.faces)), linear=one)


def facet_rows(corners: np.ndarray, base_face: np.ndarray) -> np.ndarray:
    rows = np.column_stack([corners, base_face])
    return rows[np.lexsort(rows.T)]


def spreads(values: np.ndarray, parts: Patches) -> np.ndarray:
    """Greatest less least of values (F, C), facets patch by patch, in each patch, (G, C)."""
    return np.array([np.ptp(values[a:b], axis=0) for a, b in zip(parts.starts, parts.starts[1:], strict=False)])


def path_speeds(mesh: MovingMesh, fine: Refinement, parts: Patches, radar: Radar, count: int = 31) -> np.ndarray:
    """How fast the path over each facet's centroid grows, by central differences at instants of this test's own, (F, count)."""
    step = 1e-5
    times_s = np.linspace(step, mesh.times_s[-1] - step, count)

    def path(at_s: np.ndarray) -> np.ndarray:
        centroid = np.stack([(fine.operator @ v)[parts.corners].mean(axis=1) for v in mesh.at(at_s)], axis=1)
        return sum(np.linalg.norm(centroid - place, axis=2) for place in (radar.tx_position_m, radar.rx_position_m))

    return (path(times_s + step) - path(times_s - step)) / (2 * step)


# --- each facet once, none too large --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spin", "radar"),
    slow_after(1, [(6.0, TABLE2), (0.0, TABLE2), (20.0, TABLE2), (20.0, BISTATIC), (0.0, NARROW)]),
    ids=["slow", "still", "fast", "bistatic", "narrow"],
)
def test_every_facet_in_one_patch_and_no_patch_too_large(spin: float, radar: Radar) -> None:
    mesh = spinning_ball(spin, (-1.0, 0.5, 0.0))
    fine = refined(mesh)
    parts = patches(mesh, fine, radar, TIMES_S)
    assert np.array_equal(facet_rows(parts.corners, parts.base_face), facet_rows(fine.faces, fine.base_face))
    assert parts.starts[0] == 0
    assert parts.starts[-1] == len(fine.faces)
    sizes = np.diff(parts.starts)
    assert len(sizes) == len(parts)
    assert sizes.min() >= 1
    assert sizes.max() <= MOST_FACETS
    # So many cycles of phase from frame to frame; 5 % for instants between those evaluated, on the cage's flat faces.
    rates = spreads(path_speeds(mesh, fine, parts, radar), parts) / (radar.wavelength_m * RATE_HZ)
    assert rates.max() < CYCLES_PER_STEP * 1.05
    # A quarter of a cycle over the sweep along x, y and z, there and back.
    centroid = (fine.operator @ mesh.rest)[parts.corners].mean(axis=1)
    cycles = spreads(centroid, parts) * 2 * radar.bandwidth_hz / SPEED_OF_LIGHT
    assert cycles.max() <= 0.25 + 1e-6
    # One bound or the other is made use of: patches are not needlessly small.
    assert max(rates.max() / CYCLES_PER_STEP, cycles.max() / 0.25, sizes.max() / MOST_FACETS) > 0.8


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* rotates too fast")
@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(1, 700),
    spin=st.sampled_from([0.0, 3.0, 100.0]),
    size_m=st.sampled_from([1e-3, 0.05, 1.0]),
    seed=st.integers(0, 2**16),
)
def test_any_soup_of_facets(count: int, spin: float, size_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rest = rng.uniform(-size_m, size_m, (3 * count, 3))
    faces = rng.permutation(3 * count).reshape(count, 3)

    def track(times_s: np.ndarray) -> np.ndarray:
        return rest @ Rotation.from_euler("z", spin * times_s[:, None]).as_matrix().transpose(0, 2, 1) + [5, 0, 1]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)  # every edge has one face only
        mesh = MovingMesh.from_track(track, faces, TIMES_S, "pec", rest=rest)
    fine = as_it_is(mesh)
    parts = patches(mesh, fine, TABLE2, TIMES_S)
    assert np.array_equal(facet_rows(parts.corners, parts.base_face), facet_rows(faces, np.arange(count)))
    assert (np.diff(parts.starts) >= 1).all()
    assert np.diff(parts.starts).max() <= MOST_FACETS
    centroid = rest[parts.corners].mean(axis=1)
    # The mean of its corners' path speeds stands for a facet's: v = spin (-y, x, 0), at the 40 instants of the code or any.
    rotated = np.stack([mesh.at(t)[0] for t in np.linspace(0, TIMES_S[-1] - 1e-3, 40) + 5e-4], axis=1)
    towards = rotated - TABLE2.tx_position_m
    velocity = spin * np.stack([-rotated[..., 1], rotated[..., 0] - 5, 0 * rotated[..., 0]], axis=-1)
    speed = 2 * np.sum(velocity * towards, axis=2) / np.linalg.norm(towards, axis=2)
    columns = np.hstack(
        [
            speed[parts.corners].mean(axis=1) / (TABLE2.wavelength_m * RATE_HZ * CYCLES_PER_STEP),
            centroid * 2 * TABLE2.bandwidth_hz / SPEED_OF_LIGHT / 0.25,
        ]
    )
    used = spreads(columns, parts).max(axis=1)
    assert used.max() <= 1 + 1e-3  # float32, and differences over 1 ms
    # None is cut for nothing.
    whole = np.ptp(columns, axis=0).max() if count > 1 else 0.0
    if count <= MOST_FACETS and whole < 0.99:
        assert len(parts) == 1
    if whole > 1.01:
        assert len(parts) > 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* rotates too fast")
def test_faster_motion_and_wider_sweep_make_finer_patches() -> None:
    by_speed = []
    for spin in (0.0, 5.0, 30.0):
        mesh = spinning_ball(spin)
        by_speed.append(len(patches(mesh, refined(mesh), NARROW, TIMES_S)))
    assert by_speed[0] * 1.5 < by_speed[1]
    assert by_speed[1] * 1.5 < by_speed[2]
    mesh = spinning_ball(0.0)
    fine = refined(mesh)
    by_sweep = [len(patches(mesh, fine, TABLE2.replace(slope_hz_per_s=slope), TIMES_S)) for slope in (5e12, 2e13, 8e13)]
    assert by_sweep[0] < by_sweep[1] < by_sweep[2]
    # The surface frames' rate is what a change of path is measured by.
    spinning = spinning_ball(60.0)
    often, rarely = (patches(spinning, fine, NARROW, np.linspace(0, 0.5, n)) for n in (151, 38))
    assert len(often) < len(rarely)


def test_what_moves_towards_the_radar_as_one_needs_no_finer_patches() -> None:
    # Path speeds differ over a ball by v d/R at most: 1 m/s over 0.4 m at 3 m is 0.27 m/s, of 0.29 m/s allowed.
    static, flying = spinning_ball(0.0), spinning_ball(0.0, (-1.0, 0.0, 0.0))
    fine = refined(static)
    assert len(patches(flying, fine, TABLE2, TIMES_S)) == len(patches(static, fine, TABLE2, TIMES_S))


def test_a_static_plate_needs_few_patches() -> None:
    grid = np.linspace(-0.05, 0.05, 41)
    rest = np.array([(3.0, y, z) for y, z in product(grid, grid)])
    low = np.add.outer(np.arange(40) * 41, np.arange(40)).ravel()
    faces = np.concatenate([np.stack([low, low + 1, low + 41], 1), np.stack([low + 41, low + 1, low + 42], 1)])
    with pytest.warns(UserWarning, match="not watertight"):
        mesh = static_mesh(rest, faces)
    fine = as_it_is(mesh)
    assert len(patches(mesh, fine, NARROW, TIMES_S)) == math.ceil(len(faces) / MOST_FACETS)
    # c/(8 B) = 2.2 cm of extent: 5 x 5 squares at least; halving the curve by number does not hit the squares' sides.
    cells = math.ceil(0.1 * (1 - 1 / 60) / (SPEED_OF_LIGHT / (8 * TABLE2.bandwidth_hz)))
    assert cells**2 <= len(patches(mesh, fine, TABLE2, TIMES_S)) < len(faces) / 15


# --- some of the patches --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cut() -> tuple[MovingMesh, Refinement, Patches]:
    mesh = spinning_ball(20.0)
    fine = refined(mesh)
    return mesh, fine, patches(mesh, fine, TABLE2, TIMES_S)


@pytest.mark.parametrize("chosen", [[0], [3, 4, 9], [-1, 2, 2], []], ids=["first", "some", "any order", "none"])
def test_only_some(cut: tuple[MovingMesh, Refinement, Patches], chosen: list[int]) -> None:
    parts = cut[2]
    indices = np.array(chosen, int) % len(parts)
    few = parts.only(indices)
    slices = [slice(parts.starts[g], parts.starts[g + 1]) for g in indices]
    assert len(few) == len(indices)
    assert np.array_equal(few.corners, np.concatenate([parts.corners[:0], *(parts.corners[s] for s in slices)]))
    assert np.array_equal(few.base_face, np.concatenate([parts.base_face[:0], *(parts.base_face[s] for s in slices)]))
    assert few.starts.tolist() == [0, *np.cumsum([s.stop - s.start for s in slices]).tolist()]


def test_any_of(cut: tuple[MovingMesh, Refinement, Patches]) -> None:
    mesh, _, parts = cut
    bounds = list(zip(parts.starts, parts.starts[1:], strict=False))
    for fraction in (0.0, 0.01, 0.5, 1.0):
        base = np.random.default_rng(0).uniform(size=len(mesh.faces)) < fraction
        expected = [any(base[f] for f in parts.base_face[a:b]) for a, b in bounds]
        assert parts.any_of(base).tolist() == expected
    one = np.zeros(len(mesh.faces), bool)
    one[parts.base_face[-1]] = True
    assert parts.any_of(one)[-1]


# --- where they are -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_centres_lie_among_their_facets_and_move_with_them(cut: tuple[MovingMesh, Refinement, Patches]) -> None:
    mesh, fine, parts = cut
    centre = centres(parts, fine)
    assert centre.shape == (len(parts), len(mesh.rest))
    assert np.asarray(centre.sum(axis=1)).ravel() == pytest.approx(1)
    for cage in mesh.at(np.array([0.0, 0.13, 0.4])):
        flat = (fine.linear @ cage)[parts.corners]
        place = centre @ cage
        for g, (a, b) in enumerate(zip(parts.starts, parts.starts[1:], strict=False)):
            assert place[g] == pytest.approx(flat[a:b].mean(axis=(0, 1)), abs=1e-12)
            assert (flat[a:b].min(axis=(0, 1)) - 1e-12 <= place[g]).all()
            assert (place[g] <= flat[a:b].max(axis=(0, 1)) + 1e-12).all()
    # The cage's faces lie up to 1 mm inside the ball of 20 cm, and so do the centres.
    apart = np.linalg.norm(centre @ mesh.rest, axis=1)
    assert 0.19 < apart.min() < apart.max() < 0.2


def test_tilts_of_a_made_up_refinement() -> None:
    # Face 0 lies in z = 0, its two facets are tilted about its edges by tan = 0.3 and -0.5; face 1's one facet is not.
    rest = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)  # it is open
        mesh = MovingMesh.from_track(lambda t: np.repeat(rest[None], len(t), axis=0), faces, TIMES_S, "pec", rest=rest)
    raised = np.array([[-0.3, 0, 1, 0.3], [0.5, 1, 0, -0.5]])  # rows sum to 1; places (0, 1, 0.3) and (1, 0, -0.5)
    operator = sparse.csr_array(np.vstack([np.eye(4), raised]))
    fine = Refinement(
        operator=operator,
        faces=np.array([[0, 1, 4], [0, 5, 2], [0, 1, 2], [0, 3, 1]]),
        base_face=np.array([0, 0, 0, 1]),
        linear=operator,
    )
    assert tilts(mesh, fine) == pytest.approx([math.atan(0.5), 0.0], abs=1e-7)
    few = Refinement(operator=operator, faces=fine.faces[[0, 2, 3]], base_face=np.array([0, 0, 1]), linear=operator)
    assert tilts(mesh, few) == pytest.approx([math.atan(0.3), 0.0], abs=1e-7)


def test_tilts_of_an_icosahedron_that_stands_for_a_sphere() -> None:
    # The sphere's normal at a corner leans 37.4 degrees out of the face's; facets of a fine refinement nearly as much.
    mesh = static_mesh(*icosphere(0, 0.2), crease_deg=180)
    (fine,) = refinements(mesh.rest, mesh.faces, wavenumber=1600, range_m=3, sagittas_rad=[0.3], crease_deg=180)
    tilt = np.degrees(tilts(mesh, fine))
    assert tilt.min() > 25
    assert tilt.max() < 45
    assert tilts(mesh, as_it_is(mesh)) == pytest.approx(0, abs=1e-7)


def test_normals_are_unit_and_follow_the_right_hand() -> None:
    vertices = np.array([[[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 0]]], float)
    faces = np.array([[0, 1, 2], [0, 2, 1], [0, 3, 1]])
    assert normals(vertices[:, faces])[0].tolist() == [[0, 0, 1], [0, 0, -1], [0, 0, 0]]


def test_visible_patches_may_hold_no_diffuse_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a few small ones of a pet behind furniture: their facets are summed alone."""
    radar = Radar.preset("ci4r", prf_hz=2000, samples=32)
    target = ball((2, 0, 1), (-1, 0, 0), 0.05, level=2, material="skin")
    whole = t2d.simulate(target, radar=radar).cube

    def none(points: DiffusePoints, patches: np.ndarray) -> DiffusePoints:
        starts = np.zeros(len(patches) + 1, points.starts.dtype)
        return replace(points, corners=points.corners[:0], packets=points.packets[:0], starts=starts)

    monkeypatch.setattr(DiffusePoints, "only", none)
    smooth = t2d.simulate(target, radar=radar).cube
    energy = np.sum(np.abs(smooth) ** 2)

    assert 0 < np.sum(np.abs(whole - smooth) ** 2) < energy
