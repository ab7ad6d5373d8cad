"""Facets and diffuse points: RCS read back from the ADC cube against closed forms and quadrature, and invariants."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from builders import icosphere, slow_after, static_mesh
from measures import db
from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.setup import check_outside
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scattering.phase_integral import divided_difference
from t2d_rt.scattering.refinement import facets
from t2d_rt.scattering.streams import joined
from t2d_rt.types import PEC, EchoArrays, Echoes, EchoStream, Material, MovingMesh, Radar
from t2d_rt.types.scatterer import Scatterer

TABLE2 = Radar.preset("table2")
FRAMES_S = np.arange(4) / TABLE2.prf_hz
BISTATIC = {"tx_offsets_m": (0.0, 0.4, 0.1), "rx_offsets_m": (0.2, -0.5, 0.0)}
SKIN = Material(name="rough skin", relative_permittivity=6.565, conductivity_s_per_m=38.2, scattering_coefficient=0.6)
LAMBERT = Material(name="Lambertian conductor", relative_permittivity=math.inf, scattering_coefficient=1.0)

ReadField = Callable[..., np.ndarray]


def echoes_of(
    mesh: MovingMesh, radar: Radar, backend: Backend, *, material: Material = PEC, seed: int = 0
) -> Scatterer:
    return mesh_echoes(
        mesh, radar, times_s=FRAMES_S, material=material, detail=Detail(sagitta_rad=mesh.sagitta_rad), seed=seed,
        views=[PathVisibility()], backend=backend,
    )  # fmt: skip


def field(echoes: Echoes | Scatterer, radar: Radar) -> np.ndarray:
    """Sum of all echoes at mid-sweep (frame,), carrier included [sqrt(W)]."""
    whole = echoes.gather() if isinstance(echoes, Scatterer) else echoes
    lit = whole.amplitude.any(axis=0)
    return summed(whole.delay_s[:, lit], whole.amplitude[:, lit], radar)


def summed(delay_s: np.ndarray, amplitude: np.ndarray, radar: Radar) -> np.ndarray:
    """Echoes (..., N) with their carriers, added."""
    cycles = radar.mid_frequency_hz * delay_s % 1
    return np.sum(amplitude.astype(complex) * np.exp(2j * np.pi * cycles), axis=-1)


def geodesic_sphere(frequency: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """An icosahedron with 20 frequency^2 faces, projected on the sphere; nearly even."""
    corners, triangles = icosphere(0)
    n = frequency
    rows = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    index = {ij: k for k, ij in enumerate(rows)}
    up = [[index[i, j], index[i + 1, j], index[i, j + 1]] for i, j in rows if i + j < n]
    down = [[index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]] for i, j in rows if i + j < n - 1]
    weights = np.array([[n - i - j, i, j] for i, j in rows]) / n
    points = (weights @ corners[triangles]).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = (np.array(up + down) + np.arange(20)[:, None, None] * len(rows)).reshape(-1, 3)
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    return points[first] * radius, same.reshape(-1)[faces]


def square(side: float, centre: list[float], cells: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A square across x, its front towards -x, of 2 cells^2 triangles."""
    grid = np.linspace(-side / 2, side / 2, cells + 1)
    vertices = np.array([(0, y, z) for y, z in product(grid, grid)]) + centre
    low = np.add.outer(np.arange(cells) * (cells + 1), np.arange(cells)).ravel()
    right, above = low + cells + 1, low + 1
    return vertices, np.concatenate(
        [np.stack([low, above, right], axis=1), np.stack([right, above, right + 1], axis=1)]
    )


def static_plate(range_m: float, **options: float) -> MovingMesh:
    """The 10 cm plate of the stated limits, two triangles broadside at a range."""
    with pytest.warns(T2DWarning, match="not watertight"):
        return static_mesh(*square(0.1, [range_m, 0, 1]), **options)


def quadrature_field(side: float, range_m: float, frequency_hz: float) -> complex:
    """E (physics.md, eq. 3) of a conducting plate broadside, times R^2: 200 x 200 Gauss-Legendre points, phase from its
    centre."""
    x, w = np.polynomial.legendre.leggauss(200)
    y, z = np.meshgrid(x * side / 2, x * side / 2)
    distance = np.sqrt(range_m**2 + y**2 + z**2)
    wavelength = SPEED_OF_LIGHT / frequency_hz
    values = np.exp(4j * np.pi / wavelength * (distance - range_m)) * (range_m / distance) / distance**2
    integral = np.sum(np.outer(w, w) * values) * (side / 2) ** 2
    return complex(1j * math.sqrt(4 * math.pi) / wavelength * integral * range_m**2)


# --- RCS through the ADC cube ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("range_m", "preset", "sagitta_rad"),
    slow_after(1, [(3.0, "table2", 0.2), (1.0, "table2", 0.07), (10.0, "table2", 0.2), (30.0, "table2-long", 0.2)]),
)
def test_sphere_reads_its_rcs(
    range_m: float, preset: str, sagitta_rad: float, backend: Backend, field_in_cube: ReadField
) -> None:
    # pi a^2 = 0 dBsm; near by (R/(R + a))^2 of it. Against exact PO (eq. 6) that is within 8.69/(2 k a) = 0.01 dB.
    radius, radar = 0.5642, Radar.preset(preset)
    assert radar.max_range_m > range_m + radius
    mesh = static_mesh(*icosphere(4, radius, [range_m + radius, 0, 1]), sagitta_rad=sagitta_rad)
    cube = synthesize(echoes_of(mesh, radar, backend), radar)
    read = field_in_cube(cube, radar, range_m)
    expected = radius * math.sqrt(math.pi) * range_m / (range_m + radius)
    assert np.abs([db(abs(x / expected) ** 2) for x in read]).max() < 0.3
    # A perfect conductor turns the sign; 0.2 rad is 6 um of range, the facets' finite size.
    assert np.abs(np.angle(read / -expected)).max() < 0.2


def test_small_sphere_follows_exact_physical_optics(backend: Backend) -> None:
    # k a = 12..14: the terms beyond pi a^2 are up to 1 dB and come from the shadow line (eq. 6); far field.
    for radius in np.linspace(12.0, 14.0, 5) * TABLE2.wavelength_m / (2 * math.pi):
        ka = 2 * math.pi / TABLE2.wavelength_m * radius
        exact = math.pi * radius**2 * (1 - math.sin(2 * ka) / ka + (math.sin(ka) / ka) ** 2)
        mesh = static_mesh(*icosphere(4, radius, [300.0, 0, 1]), sagitta_rad=0.02)
        power = abs(field(echoes_of(mesh, TABLE2, backend), TABLE2)[0]) ** 2
        assert abs(db(power / TABLE2.received_power_w(exact, 300.0))) < 0.15


def test_the_quadrature_agrees_with_the_known_plate() -> None:
    levels = {r: db(abs(quadrature_field(0.1, r, SPEED_OF_LIGHT / 3.893e-3)) ** 2) for r in (1.0, 3.0, 1000.0)}
    assert levels == pytest.approx({1.0: 5.62, 3.0: 17.77, 1000.0: 19.19}, abs=0.01)
    assert levels[1000.0] == pytest.approx(db(4 * math.pi * 0.1**4 / 3.893e-3**2), abs=0.001)


@pytest.mark.parametrize(
    ("range_m", "preset"), [(1.0, "table2"), (3.0, "table2"), (10.0, "table2"), (30.0, "table2-long")]
)
def test_plate_reads_its_rcs(range_m: float, preset: str, backend: Backend, field_in_cube: ReadField) -> None:
    radar = Radar.preset(preset)
    mesh = static_plate(range_m)
    read = field_in_cube(synthesize(echoes_of(mesh, radar, backend), radar), radar, range_m)
    expected = quadrature_field(0.1, range_m, radar.mid_frequency_hz)
    assert np.abs([db(abs(x / expected) ** 2) for x in read]).max() < 0.3
    assert np.abs(np.angle(read / expected)).max() < 0.1


def test_field_of_a_plate_at_mid_sweep_is_the_quadratures(backend: Backend) -> None:
    # Without the radar in between, and off the default setting: the field itself converges.
    expected = quadrature_field(0.1, 1.0, TABLE2.mid_frequency_hz) * TABLE2.link_amplitude
    carrier = np.exp(4j * np.pi * TABLE2.mid_frequency_hz / SPEED_OF_LIGHT)
    errors = []
    for sagitta in (0.2, 0.05, 0.0125):
        mesh = static_plate(1.0, sagitta_rad=sagitta)
        errors.append(abs(field(echoes_of(mesh, TABLE2, backend), TABLE2)[0] / (expected * carrier) - 1))
    assert errors[2] < 0.01
    # A quarter of the sagitta is half the edge, and the error is of second order in the edge.
    assert errors[0] / errors[1] > 3
    assert errors[1] / errors[2] > 3


# --- invariants -----------------------------------------------------------------------------------------------------


def as_they_are(vertices: np.ndarray, faces: np.ndarray, backend: Backend, radar: Radar = TABLE2) -> complex:
    """Field of flat triangles without refinement [sqrt(W)]."""
    with pytest.warns(T2DWarning, match="not watertight"):
        mesh = static_mesh(vertices, faces, crease_deg=0, sagitta_rad=1e6)
    return complex(field(echoes_of(mesh, radar, backend), radar)[0])


def slow_field(vertices: np.ndarray, faces: np.ndarray, radar: Radar, frequency_hz: float) -> complex:
    """The same at any frequency by eq. 3, written out in float64; the antennas' lambda is that of mid-sweep."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_area = np.linalg.norm(normal, axis=1)
    normal /= doubled_area[:, None]
    cosine, path, spread = np.zeros(len(faces)), np.zeros(corners.shape[:2]), np.ones(len(faces))
    lit = np.ones(len(faces), bool)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        offset = antenna - corners.mean(axis=1)
        distance = np.linalg.norm(offset, axis=1)
        one = np.einsum("fi,fi->f", normal, offset) / distance
        lit &= one > 0
        cosine, path, spread = cosine + one / 2, path + np.linalg.norm(antenna - corners, axis=2), spread * distance
    k = 2 * math.pi * frequency_hz / SPEED_OF_LIGHT
    integral = doubled_area * divided_difference(*(k * path).T)
    scale = radar.link_amplitude * math.sqrt(4 * math.pi) * k / (2 * math.pi)
    return complex(1j * scale * np.sum((cosine * integral / spread)[lit]))


@pytest.mark.parametrize("cells", [2, 5, 16])
def test_splitting_a_flat_facet_changes_nothing_far_away(cells: int, backend: Backend) -> None:
    # 2 cm at 200 m: the wave bends by k d^2/R = 1e-3 rad over the plate, which a finer split follows better.
    rotation = Rotation.from_euler("yz", [3.0, -4.0], degrees=True)
    fields = []
    for n in (1, cells):
        vertices, faces = square(0.02, [0, 0, 0], n)
        fields.append(as_they_are(rotation.apply(vertices) + np.array([200, 0, 1]), faces, backend))
    assert abs(fields[1] / fields[0] - 1) < 2e-3


def test_power_falls_with_the_fourth_power_of_range(backend: Backend) -> None:
    fields = []
    for range_m in (100.0, 200.0, 400.0):
        vertices, faces = square(0.02, [range_m, 0, 1])
        fields.append(abs(as_they_are(vertices, faces, backend)))
    assert np.array(fields[:-1]) / fields[1:] == pytest.approx([4, 4], rel=1e-4)
    rcs = 4 * math.pi * 0.02**4 / TABLE2.wavelength_m**2
    assert fields[0] ** 2 == pytest.approx(TABLE2.received_power_w(rcs, 100.0), rel=1e-4)


def test_facets_are_the_sum_in_float64(backend: Backend) -> None:
    # The facets that the refinement makes, one by one, against the echoes of whole patches; antennas apart.
    radar = TABLE2.replace(**BISTATIC)
    vertices, faces = icosphere(2, 0.1, [0, 0, 0])
    mesh = static_mesh(vertices @ np.diag([0.7, 1.0, 1.5]) + [1.2, 0.1, 0.9], faces)
    got = field(echoes_of(mesh, radar, backend), radar)[0]
    fine = facets(mesh, radar, mesh.sagitta_rad, span_s=(0.0, 1.0))
    expected = slow_field(fine.rest, fine.faces, radar, radar.mid_frequency_hz)
    assert len(fine.faces) > 10 * len(faces)
    assert abs(got / expected - 1) < 1e-4  # float32


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* rotates too fast")  # poses, not a motion
@pytest.mark.parametrize("material", [PEC, SKIN], ids=["smooth", "rough"])
def test_smaller_facets_converge_and_large_ones_are_displaced(material: Material, backend: Backend) -> None:
    # Field of an ellipsoid in four poses; facets that are not displaced would leave -16 dB at 0.4 rad.
    rest, faces = icosphere(3, 0.06, [0, 0, 0])
    rest = rest @ np.diag([0.8, 1.0, 1.6])
    rotations = Rotation.random(4, rng=np.random.default_rng(2)).as_matrix()
    places = np.einsum("kij,vj->kvi", rotations, rest) + np.array([2.0, 0.1, 1.0])

    def fields(sagitta_rad: float) -> np.ndarray:
        mesh = MovingMesh.from_track(lambda t: places[t.astype(int)], faces, np.arange(4.0), rest=rest)
        stream = mesh_echoes(
            mesh, TABLE2, times_s=np.arange(4.0), material=material, detail=Detail(sagitta_rad=sagitta_rad), seed=0,
            views=[PathVisibility()],
            backend=backend,
        )  # fmt: skip
        static_frames = [stream.frames(k, k + 1) for k in range(4)]  # every pose for itself: nothing moves
        return np.array([summed(frame.delay_s[0], frame.amplitude[0], TABLE2) for frame in static_frames])

    reference = fields(0.025)
    coarse, fine = (db(np.sum(np.abs(fields(s) - reference) ** 2) / np.sum(np.abs(reference) ** 2)) for s in (0.4, 0.1))
    assert coarse < -20
    # A quarter of the sagitta is half the edge.
    assert fine < coarse - 6


def test_the_back_of_a_plate_is_dark(backend: Backend) -> None:
    vertices, faces = square(0.1, [2, 0, 1])
    assert as_they_are(vertices, faces[:, ::-1], backend) == 0
    # Lit by the transmitter, but the receiver stands behind: dark as well.
    behind = TABLE2.replace(rx_offsets_m=(5.0, 0.5, 0.0))
    assert as_they_are(vertices, faces, backend, behind) == 0


def test_bistatic_triangle_is_the_sum_of_both_paths(backend: Backend) -> None:
    radar = TABLE2.replace(**BISTATIC)
    triangle = np.array([[2.0, 0.3, 1.1], [2.01, 0.302, 1.106], [2.004, 0.293, 1.103]])
    faces = np.array([[0, 1, 2]])
    back, front = sorted(
        (slow_field(triangle, f, radar, radar.mid_frequency_hz) for f in (faces, faces[:, ::-1])), key=abs
    )
    assert back == 0
    faces = faces if slow_field(triangle, faces, radar, radar.mid_frequency_hz) else faces[:, ::-1]
    assert as_they_are(triangle, faces, backend, radar) == pytest.approx(front, rel=1e-5)


def _clothed_ball(radar: Radar, backend: Backend, *, rotation: Rotation, order: np.ndarray | None = None) -> Scatterer:
    """A rough dented ball with its rest pose fixed, so that its points stay the same however it is turned."""
    rest, faces = icosphere(3, 0.12, [0, 0, 0])
    rest[:, 2] *= 1.3
    place = rotation.apply(rest + np.array([2.0, 0.1, 0.0]))
    faces = faces if order is None else faces[order]
    mesh = MovingMesh.from_track(
        lambda t: np.repeat(place[None] + [0, 0, 1], len(t), axis=0), faces, [0, 1], rest=rest, sagitta_rad=0.4
    )
    return echoes_of(mesh, radar, backend, material=SKIN, seed=3)


def test_reciprocity_rotation_and_order_leave_the_field(backend: Backend) -> None:
    radar = TABLE2.replace(**BISTATIC)
    reference = field(_clothed_ball(radar, backend, rotation=Rotation.identity()), radar)[0]
    exchanged = TABLE2.replace(tx_offsets_m=BISTATIC["rx_offsets_m"], rx_offsets_m=BISTATIC["tx_offsets_m"])
    # Everything turned about the radar's place by 40 degrees: boresight and the antennas' offsets turn with it.
    rotation = Rotation.from_euler("z", 40, degrees=True)
    rotated = radar.replace(boresight=tuple(rotation.apply([1.0, 0, 0])))
    shuffled = np.random.default_rng(0).permutation(1280)
    others = [
        field(_clothed_ball(exchanged, backend, rotation=Rotation.identity()), exchanged)[0],
        field(_clothed_ball(rotated, backend, rotation=rotation), rotated)[0],
        field(_clothed_ball(radar, backend, rotation=Rotation.identity(), order=shuffled), radar)[0],
    ]
    # float32 amplitudes of thousands of echoes; a few facets' cuts of the same size differ where faces are reordered.
    assert np.abs(np.array(others) / reference - 1) == pytest.approx(0, abs=1e-4)


def test_the_receiver_alone_matters(backend: Backend) -> None:
    # The check of the test above: antennas that differ give a field that differs.
    radar = TABLE2.replace(**BISTATIC)
    here, there = (field(_clothed_ball(r, backend, rotation=Rotation.identity()), r)[0] for r in (radar, TABLE2))
    assert abs(here / there - 1) > 0.1


# --- diffuse points -------------------------------------------------------------------------------------------------

ASPECTS = 50


def correlation(a: np.ndarray, b: np.ndarray) -> complex:
    return complex(np.vdot(a, b) / np.linalg.norm(a) / np.linalg.norm(b))


def speckle(frequency: int, seed: int, backend: Backend) -> np.ndarray:
    """sqrt(sigma) of a Lambertian conducting ball of 10 cm at 30 m, turned at random, (ASPECTS,)."""
    rest, faces = geodesic_sphere(frequency, 0.1)
    rotations = Rotation.random(ASPECTS, rng=np.random.default_rng(1)).as_matrix()
    places = np.einsum("kij,vj->kvi", rotations, rest) + np.array([30.1, 0, 1])
    mesh = MovingMesh.from_track(
        lambda t: places[np.rint(t).astype(int)], faces, [0, ASPECTS - 1], rest=rest, sagitta_rad=0.4
    )
    times_s = np.arange(ASPECTS, dtype=float)
    stream = mesh_echoes(
        mesh, TABLE2, times_s=times_s, material=LAMBERT, detail=Detail(sagitta_rad=0.4), seed=seed,
        views=[PathVisibility()], backend=backend,
    )  # fmt: skip
    return field(stream, TABLE2) / math.sqrt(TABLE2.received_power_w(1.0, 30.1))


@pytest.mark.slow
def test_lambertian_sphere_and_its_realisation_at_two_face_counts(backend: Backend) -> None:
    # |field|^2 of one look is exponentially distributed. 12 seeds, each seen from 50 sides, are 600 looks: their mean
    # has a standard deviation of 1/sqrt(600) = 0.18 dB. At 50 000 faces the looks are those at 2 000; one seed does.
    coarse = np.array([speckle(10, seed, backend) for seed in range(12)])
    fine = speckle(50, 0, backend)
    expected = 8 / 3 * math.pi * 0.1**2
    assert abs(db((np.abs(coarse) ** 2).mean() / expected)) < 0.5
    assert abs(db(np.linalg.norm(fine) ** 2 / np.linalg.norm(coarse[0]) ** 2)) < 0.5
    assert correlation(coarse[0], fine).real > 0.95
    # Seeds are independent of one another: |correlation| of 50 looks is about 1/sqrt(50) = 0.14.
    assert abs(correlation(coarse[0], coarse[1])) < 0.5


def test_same_seed_same_bits_another_seed_other_points_only(backend: Backend) -> None:
    def made(seed: int, material: Material, sagitta_rad: float = 0.4) -> Echoes:
        mesh = static_mesh(*icosphere(2, 0.1, [2.0, 0, 1]), sagitta_rad=sagitta_rad)
        return echoes_of(mesh, TABLE2, backend, material=material, seed=seed).gather()

    first, again, other = made(1, SKIN), made(1, SKIN), made(2, SKIN)
    assert np.array_equal(first.delay_s, again.delay_s)
    assert np.array_equal(first.amplitude, again.amplitude)
    assert np.array_equal(first.slope, again.slope)  # type: ignore[arg-type]
    assert np.array_equal(first.delay_s, other.delay_s)
    assert not np.array_equal(first.amplitude, other.amplitude)
    # The coherent part of a rough surface is sqrt(1 - S^2) conj(Gamma)/-1 of the smooth conductor's; the points add the rest.
    fraction = -math.sqrt(1 - 0.6**2) * SKIN.reflection(TABLE2.mid_frequency_hz).conjugate()

    def diffuse(seed: int, sagitta_rad: float) -> np.ndarray:
        rough, smooth = made(seed, SKIN, sagitta_rad), made(seed, PEC, sagitta_rad)
        return field(rough, TABLE2) - fraction * field(smooth, TABLE2)

    own, finer, another = diffuse(1, 0.4), diffuse(1, 0.1), diffuse(2, 0.4)
    # Smaller facets and other patches, the same points.
    np.testing.assert_allclose(finer, own, rtol=1e-3)
    assert np.abs(another / own - 1).min() > 0.1


def test_visibility_scales_what_is_seen(backend: Backend) -> None:
    mesh = static_mesh(*icosphere(2, 0.1, [2.0, 0, 1]), sagitta_rad=0.4)
    parts = []
    for fraction in (1.0, 0.25, 0.0):
        stream = mesh_echoes(
            mesh, TABLE2, times_s=FRAMES_S, material=SKIN, detail=Detail(sagitta_rad=0.4), seed=0, backend=backend,
            views=[PathVisibility(visibility=(lambda t, fraction=fraction: np.full((len(t), len(mesh.rest)), fraction),))],
        )  # fmt: skip
        parts.append(stream.gather().amplitude)
    np.testing.assert_allclose(parts[1], 0.25 * parts[0], rtol=1e-5, atol=1e-16)
    assert not parts[2].any()


# --- streams and guards ---------------------------------------------------------------------------------------------


def test_frames_do_not_depend_on_how_they_are_asked_for(backend: Backend) -> None:
    rest, faces = icosphere(2, 0.1, [0, 0, 0])
    times_s = np.arange(12) / 100
    path = np.stack([2 - 2 * times_s, 0 * times_s, 1 + 0 * times_s], axis=1)
    mesh = MovingMesh(rest + path[:, None], faces, times_s, sagitta_rad=0.4)
    stream = mesh_echoes(
        mesh, TABLE2, times_s=times_s, material=SKIN, detail=Detail(sagitta_rad=0.4), seed=0, views=[PathVisibility()],
        backend=backend,
    )  # fmt: skip
    whole, part = stream.gather(), stream.frames(5, 9)
    assert np.array_equal(part[0], whole.delay_s[5:9])
    assert np.array_equal(part[1], whole.amplitude[5:9])
    assert np.array_equal(part[2], whole.slope[5:9])  # type: ignore[arg-type, index]


def test_joined_targets_are_side_by_side(backend: Backend) -> None:
    ball = echoes_of(static_mesh(*icosphere(2, 0.1, [2.0, 0, 1]), sagitta_rad=0.4), TABLE2, backend)
    flat = ball.gather()
    point = EchoStream(
        times_s=FRAMES_S, frames=lambda a, b: EchoArrays(np.ones((b - a, 1)), np.ones((b - a, 1), np.complex64))
    )
    both = joined([ball, point]).gather()
    assert both.delay_s.shape == (4, flat.delay_s.shape[1] + 1)
    assert np.array_equal(both.amplitude[:, :-1], flat.amplitude)
    assert not both.slope[:, -1].any()
    assert joined([ball]) is ball


def test_radar_inside_a_target_is_refused() -> None:
    vertices, faces = icosphere(2, 0.5, [0, 0, 0])
    times_s = np.linspace(0, 1, 5)
    arriving = MovingMesh(
        vertices + np.stack([2 - 2 * times_s, 0 * times_s, 1 + 0 * times_s], 1)[:, None], faces, times_s, name="ball"
    )
    with pytest.raises(
        InputError, match=r"the radar at \(0, 0, 1\) m is inside ball at 0\.792 s; place the target farther away"
    ):
        check_outside(arriving, TABLE2, times_s)
    check_outside(arriving, TABLE2.replace(position_m=(0.0, 0.0, 3.0)), times_s)
    with pytest.raises(InputError, match=r"the radar at \(1\.9, 0, 1\) m is inside ball at 0 s"):
        check_outside(arriving, TABLE2.replace(position_m=(0.0, 0.0, 3.0), rx_offsets_m=(1.9, 0.0, -2.0)), times_s)
    check_outside(static_mesh(vertices + np.array([0.51, 0, 1]), faces), TABLE2, np.array([0.0, 1.0]))
    with pytest.raises(InputError, match="touches mesh at 0 s"):
        check_outside(static_mesh(vertices - vertices[0] + np.array([0, 0, 1]), faces), TABLE2, np.array([0.0, 1.0]))
