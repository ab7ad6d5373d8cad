"""Several bounces: corner reflectors, a sphere over a plate, and tubes that ride on moving surfaces (physics.md, eq. 31)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import icosphere, slow_after, static_mesh
from measures import db
from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.propagation.rays import Rays
from t2d_rt.scattering.bounces import Setting, TubeDetail, bounce_echoes
from t2d_rt.scattering.ray_fronts import focal_phase
from t2d_rt.scattering.refinement import refined
from t2d_rt.scattering.reflectors import Reflector
from t2d_rt.types import Echoes, EchoStream, Material, MovingMesh, Radar
from validation.physics import bounces as corners
from validation.physics.exact import dihedral_rcs, trihedral_area

RADAR = Radar.preset("ism-24").replace(samples=16)
EDGE_M, RANGE_M = 0.1, 50.0
pytestmark = [
    pytest.mark.filterwarnings(f"ignore:.*{told}:t2d_rt.core.errors.T2DWarning") for told in ("not watertight",)
]

Triangles = tuple[np.ndarray, np.ndarray]


def dihedral(angle_deg: float = 0.0) -> Triangles:
    """Two square plates with a vertical edge at the origin, that open towards -x, turned about that."""
    vertices, faces = corners.dihedral()
    return vertices @ rotation(angle_deg).T, faces


def rotation(angle_deg: float) -> np.ndarray:
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def before(radar: Radar, shape: Triangles) -> MovingMesh:
    return static_mesh(shape[0] + radar.tx_position_m + [RANGE_M, 0, 0], shape[1], until_s=0.01)


def difference(mesh: MovingMesh, radar: Radar, bounces: int, without: int) -> float:
    """RCS [m^2] of what more bounces add, from the middle samples of ADC cubes."""
    more, less = (np.asarray(t2d.simulate(mesh, radar=radar, bounces=each).cube[0, 0]) for each in (bounces, without))
    middle = (more - less)[radar.samples // 2 - 1 : radar.samples // 2 + 1]
    return float(np.mean(np.abs(middle) ** 2)) * RANGE_M**4 / radar.link_amplitude**2


@pytest.mark.parametrize("angle_deg", slow_after(2, [-20.0, 0.0, 9.0]))
@pytest.mark.parametrize("preset", ["ism-24", "table2"])
def test_dihedral(preset: str, angle_deg: float) -> None:
    radar = Radar.preset(preset, sample_rate_hz=30e6)  # of a range axis beyond 50 m
    found = difference(before(radar, dihedral(angle_deg)), radar, 2, 1)
    expected = dihedral_rcs(EDGE_M, math.radians(angle_deg), radar.wavelength_m)
    assert db(found / expected) == pytest.approx(0, abs=0.6)  # tubes at the plates' rims count by thirds


@pytest.mark.parametrize("angle_deg", slow_after(1, [0.0, 20.0]))
@pytest.mark.parametrize("preset", slow_after(1, ["ism-24", "table2"]))
def test_trihedral(preset: str, angle_deg: float) -> None:
    radar = Radar.preset(preset, sample_rate_hz=30e6)
    towards = rotation(angle_deg) @ np.ones(3) / math.sqrt(3)
    found = difference(before(radar, corners.trihedral(towards)), radar, 3, 2)
    expected = 4 * math.pi * trihedral_area(EDGE_M, towards) ** 2 / radar.wavelength_m**2
    assert db(found / expected) == pytest.approx(0, abs=0.45)


def echoes(
    meshes: Sequence[MovingMesh], backend: Backend, radar: Radar = RADAR, *, samples: int = 2, gamma: complex = -1,
    times_s: np.ndarray | None = None, unblocked: float | None = None, spacing: float = 2.0,
) -> EchoStream:  # fmt: skip
    wavenumber = 2 * math.pi / radar.wavelength_m
    facets = [refined(mesh, wavenumber, 10.0, [mesh.sagitta_rad], 10**6)[0] for mesh in meshes]
    reflectors = [
        Reflector(surface=mesh, facets=each, reflection=np.full(len(each.faces), gamma, complex))
        for mesh, each in zip(meshes, facets, strict=True)
    ]
    last = float(meshes[0].times_s[-1])
    setting = Setting(
        radar=radar, scene=lambda vertices, faces: Rays(vertices, faces, backend), backend=backend,
        unblocked=None if unblocked is None else lambda out, back, times_s: np.full(len(out), unblocked),
    )  # fmt: skip
    return bounce_echoes(
        reflectors, setting, samples_s=np.linspace(0, last, samples),
        times_s=np.linspace(0, last, 5) if times_s is None else times_s, detail=TubeDetail(bounces=2, spacing=spacing),
    )  # fmt: skip


def field(found: Echoes, radar: Radar = RADAR) -> np.ndarray:
    """At mid-sweep (frame,) [sqrt(W)]."""
    return np.sum(found.amplitude * np.exp(2j * np.pi * (radar.mid_frequency_hz * found.delay_s % 1)), axis=1)


@pytest.fixture
def corner() -> MovingMesh:
    vertices, faces = dihedral()
    return static_mesh(vertices + RADAR.tx_position_m + [RANGE_M, 0, 0], faces, until_s=0.1)


@pytest.mark.slow
def test_sphere_over_a_plate(backend: Backend) -> None:
    """Two paths of equal length, plate and sphere in either order, each with the sphere's own pi a^2: 4 pi a^2 in all."""
    radius, half = 0.1, 0.8
    vertices, faces = icosphere(3, radius, (0, 0, 0.25))
    plate = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    place = RANGE_M * np.array([math.cos(0.8), 0, -math.sin(0.8)]) + RADAR.tx_position_m
    meshes = [
        static_mesh(np.asarray(shape) + place, triangles, until_s=0.1)
        for shape, triangles in ((vertices, faces), (plate, np.array([[0, 1, 2], [0, 2, 3]])))
    ]
    power = np.abs(field(echoes(meshes, backend).gather())[0]) ** 2 * RANGE_M**4 / RADAR.link_amplitude**2
    assert db(power / (4 * math.pi * radius**2)) == pytest.approx(0, abs=0.6)


@pytest.mark.parametrize(("scale", "expected"), [((3, 2), 1), ((-3, 2), -1j), ((3, -2), -1j), ((-3, -2), -1)])
def test_each_focal_line_takes_a_quarter_of_a_cycle(scale: tuple[float, float], expected: complex) -> None:
    """A conjugate of exp(j pi/2), as IF = tx conj(rx); the section is mapped along two axes, rotated against the triangle."""
    start = np.array([[[0.1, 0.2, 0], [1.2, 0.1, 0], [0.3, 0.9, 0]]])
    frame = rotation(33.0)
    mapped = start @ frame @ np.diag([*scale, 1.0]) @ frame.T
    slanted = mapped + [0, 0, 5.0] + 0.3 * mapped[..., :1] * [0, 0, 1]  # where it lies along the rays does not count
    assert focal_phase(start, slanted, np.array([[0, 0, 1.0]]))[0] == expected


def test_both_surfaces_reflect(backend: Backend, corner: MovingMesh) -> None:
    gamma = 0.5 - 0.3j
    metal, other = (field(echoes([corner], backend, gamma=each).gather())[0] for each in (-1, gamma))
    assert other / metal == pytest.approx(gamma.conjugate() ** 2, rel=1e-5)


def test_blockage_by_the_scene_counts(backend: Backend, corner: MovingMesh) -> None:
    free, blocked = (field(echoes([corner], backend, unblocked=each).gather())[0] for each in (None, 0.25))
    assert blocked == pytest.approx(0.25 * free, rel=1e-5)


def test_a_screen_hides_the_corner(backend: Backend, corner: MovingMesh) -> None:
    screen = 0.3 * np.array([[0, -1, -1], [0, -1, 1], [0, 1, 1], [0, 1, -1.0]])
    hiding = static_mesh(screen + RADAR.tx_position_m + [RANGE_M - 1, 0, 0], np.array([[0, 1, 2], [0, 2, 3]]), 0.1)
    seen, hidden = (echoes(meshes, backend).gather() for meshes in ([corner], [corner, hiding]))
    assert np.abs(field(hidden)).max() < 1e-3 * np.abs(field(seen)).max()


@pytest.mark.parametrize("side", [1, -1])
def test_a_screen_before_one_antenna_hides_it_too(backend: Backend, side: float) -> None:
    radar = RADAR.replace(tx_offsets_m=(0.0, 0.1, 0.0), rx_offsets_m=(0.0, -0.1, 0.0))
    vertices, faces = dihedral()
    corner = static_mesh(vertices + RADAR.tx_position_m + [10.0, 0, 0], faces, until_s=0.1)
    screen = 0.05 * np.array([[0, -1, -1], [0, -1, 1], [0, 1, 1], [0, 1, -1.0]]) + [0.3, 0.1 * side, 0]
    hiding = static_mesh(screen + RADAR.tx_position_m, np.array([[0, 1, 2], [0, 2, 3]]), until_s=0.1)
    seen, hidden = (field(echoes(meshes, backend, radar).gather(), radar) for meshes in ([corner], [corner, hiding]))
    assert np.abs(hidden).max() < 1e-3 * np.abs(seen).max()


def test_transmitter_and_receiver_may_be_swapped(backend: Backend) -> None:
    """Within the lobe; beside it neither physical optics nor two bounces alone are reciprocal."""
    vertices, faces = dihedral(7.0)
    mesh = static_mesh(vertices + RADAR.tx_position_m + [3.0, 0, 0], faces, until_s=0.1)
    ends = (0.0, 0.1, 0.05), (0.0, 0.02, -0.04)
    one, other = (
        field(echoes([mesh], backend, RADAR.replace(tx_offsets_m=tx, rx_offsets_m=rx)).gather())[0]
        for tx, rx in (ends, ends[::-1])
    )
    assert abs(one - other) < 0.1 * abs(one)


def test_smaller_tubes_return_the_same(backend: Backend, corner: MovingMesh) -> None:
    wide, narrow = (field(echoes([corner], backend, spacing=each).gather())[0] for each in (2.0, 0.5))
    assert abs(wide - narrow) < 0.08 * abs(narrow)


# --- in motion ---


def rotating(time_s: float = 0.4) -> MovingMesh:
    """The corner, that rotates by 25 degrees and approaches at 0.5 m/s."""
    times = np.linspace(0, time_s, 9)
    vertices, faces = dihedral()
    places = [vertices @ rotation(-10 + 25 * t / time_s).T + RADAR.tx_position_m + [3.0 - 0.5 * t, 0, 0] for t in times]
    return MovingMesh(np.stack(places), faces, times, "pec")


@pytest.mark.slow
def test_frames_between_agree_with_the_interpolation(backend: Backend) -> None:
    """At twice the surface rate, and tubes traced at the frames between."""
    from scipy.interpolate import CubicSpline

    mesh, times = rotating(), np.linspace(0, 0.2, 41)
    fine = echoes([mesh], backend, times_s=times, samples=6).gather()
    delay = CubicSpline(times[::2], fine.delay_s[::2])(times)
    amplitude = CubicSpline(times[::2], fine.amplitude[::2].astype(complex))(times)
    between = np.sum(amplitude * np.exp(2j * np.pi * (RADAR.mid_frequency_hz * delay % 1)), axis=1)
    true = field(fine)
    assert np.sum(np.abs(between - true) ** 2) < 0.003 * np.sum(np.abs(true) ** 2)
    traced = field(echoes([mesh], backend, times_s=times, samples=41).gather())
    assert np.sum(np.abs(traced - true) ** 2) < 0.03 * np.sum(np.abs(traced) ** 2)


def test_blocks_of_frames_make_no_difference(backend: Backend) -> None:
    """Bit for bit; nor does another run."""
    mesh, times = rotating(), np.linspace(0, 0.4, 9)
    whole, again = (echoes([mesh], backend, times_s=times, samples=5) for _ in range(2))
    parts = [again.frames(start, stop) for start, stop in ((0, 2), (2, 7), (7, 9))]
    for name in ("delay_s", "amplitude", "slope"):
        assert np.array_equal(getattr(whole.frames(0, 9), name), np.concatenate([getattr(p, name) for p in parts]))


def test_slope_over_the_sweep(backend: Backend) -> None:
    """That of the field at two frequencies."""
    step_hz = 20e6
    corner = before(RADAR, dihedral(12.0))
    sums = []
    for shift in (-step_hz, 0.0, step_hz):
        radar = RADAR.replace(carrier_hz=RADAR.carrier_hz + shift)
        found = echoes([corner], backend, radar).gather()
        late = (found.delay_s - 2 * RANGE_M / SPEED_OF_LIGHT)[0]
        phase = np.exp(2j * np.pi * radar.mid_frequency_hz * late)
        assert found.slope is not None
        change = found.slope + 2j * np.pi * late * found.amplitude
        sums.append([np.sum(each[0] * phase) / radar.link_amplitude for each in (found.amplitude, change)])
    (low, _), (_, slope), (high, _) = sums
    assert (high - low) / (2 * step_hz) == pytest.approx(slope, rel=0.05)


# --- the option ---


def test_one_bounce_is_the_default_and_traces_nothing(corner: MovingMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.pipeline.prepare.bounce_scatterers", None)
    one, default = (t2d.simulate(corner, radar=RADAR, **given).cube[:] for given in ({"bounces": 1}, {}))
    assert np.array_equal(one, default)


def test_recordings_tell_their_bounces_and_are_made_again(corner: MovingMesh) -> None:
    recording = t2d.simulate(corner, radar=RADAR, bounces=2)
    assert recording.settings["bounces"] == recording.experiment.bounces == 2
    assert np.array_equal(t2d.run(recording).cube[:], recording.cube[:])


@pytest.mark.parametrize("bounces", [0, 4, 1.5, True, "two"])
def test_other_numbers_are_refused(corner: MovingMesh, bounces: object) -> None:
    with pytest.raises(
        InputError, match=r"bounces must be (an integer of 0 or more|(less|greater) than or equal to [13]), got"
    ):
        t2d.simulate(corner, radar=RADAR, bounces=bounces)  # type: ignore[arg-type]


def test_the_command_line_has_them(refused: Callable[..., str]) -> None:
    assert "bounces: got 7, should be less than or equal to 3; correct it" in refused(
        "simulate", "walk.bvh", "--bounces", "7"
    )


def test_experiments_hold_them(tmp_path: Path) -> None:
    experiment = Experiment(targets=[{"kind": "fan", "position_m": (3, 0, 1)}], radar="ism-24", bounces=3)  # type: ignore[arg-type]
    path = tmp_path / "corner.yaml"
    path.write_text(experiment.to_yaml())
    assert Experiment.from_yaml(path) == experiment
    with pytest.raises(InputError, match="bounces"):
        Experiment(targets=experiment.targets, radar="ism-24", bounces=4)  # type: ignore[arg-type]


def test_targets_that_take_no_part_are_told(corner: MovingMesh) -> None:
    ball = t2d.Ellipsoids([[0.1, 0.1, 0.1]], [[[3.0, 0, 1]], [[3.0, 0, 1]]], [0, 0.1])
    with pytest.warns(T2DWarning, match="made of ellipsoids and takes no part in several bounces"):
        t2d.simulate([corner, ball], radar=RADAR, bounces=2)
    fan = t2d.TableFan(position_m=(3.0, 0.5, 1.0), rpm=1500)
    with pytest.warns(T2DWarning, match="rotates too fast for ray tubes and takes no part in several bounces"):
        t2d.simulate([corner, fan], radar=RADAR, bounces=2)


def test_in_a_room_the_direct_path_has_them() -> None:
    vertices, faces = dihedral()
    radar = RADAR.replace(position_m=(1.0, 2.0, 1.0))
    mesh = static_mesh(vertices + radar.tx_position_m + [2.0, 0, 0], faces, until_s=0.1)
    added = []
    for scene in ("free_space", "empty_room"):
        options = {"radar": radar, "scene": scene, "reflections": 0, "clutter": "none", "collisions": "ignore"}
        two, one = (np.asarray(t2d.simulate(mesh, bounces=each, **options).cube[0]) for each in (2, 1))  # type: ignore[arg-type]
        added.append(two - one)
    assert np.abs(added[0] - added[1]).max() < 0.02 * np.abs(added[0]).max() > 0


def test_materials_have_their_own_reflection(corner: MovingMesh) -> None:
    powers = []
    for material in ("pec", Material(name="rough", relative_permittivity=math.inf, scattering_coefficient=0.6)):
        two, one = (
            np.asarray(t2d.simulate(corner, radar=RADAR, bounces=each, material=material).cube[0]) for each in (2, 1)
        )
        powers.append(float(np.sum(np.abs(two - one) ** 2)))
    assert powers[1] / powers[0] == pytest.approx((1 - 0.6**2) ** 2, rel=1e-3)


def test_a_weak_corner_beside_a_strong_one_is_kept(backend: Backend, corner: MovingMesh) -> None:
    # Of a hundredth of the size, 80 dB weaker: less than what is left out of one target's echoes.
    vertices, faces = dihedral()
    small = static_mesh(0.1 * vertices + RADAR.tx_position_m + [RANGE_M, 3.0, 0], faces, until_s=0.1)
    alone, both = (echoes(meshes, backend).frames(0, 2) for meshes in ([small], [corner, small]))
    place = np.linalg.norm([RANGE_M, 3.0]) * 2 / SPEED_OF_LIGHT
    mine = np.abs(both.delay_s[0] - place) * SPEED_OF_LIGHT / 2 < 0.02
    assert alone.delay_s.shape[1] == mine.sum() > 0
    np.testing.assert_allclose(np.abs(both.amplitude[0, mine]).sum(), np.abs(alone.amplitude[0]).sum(), rtol=1e-3)


def test_surfaces_too_large_for_the_memory_are_refused(corner: MovingMesh) -> None:
    square = np.array([[4.0, -4, -4], [4, 4, -4], [4, 4, 4], [4, -4, 4]])
    wall = static_mesh(square, np.array([[0, 2, 1], [0, 3, 2]]), until_s=0.1, sagitta_rad=1.0)
    with pytest.raises(
        InputError, match=r"tracing rays from .* GB of memory, more than the limit .* or take bounces=1"
    ):
        t2d.simulate(
            [corner, wall], radar=Radar.preset("table2", samples=16, sample_rate_hz=2e7), bounces=2, memory_gb=1
        )


@pytest.mark.slow
def test_without_a_direct_path_there_are_none_and_that_is_told() -> None:
    vertices, faces = dihedral()
    behind = static_mesh(vertices + [9.5, 2.0, 1.0], faces, until_s=0.1)
    options = {"radar": RADAR.replace(position_m=(1.0, 2.0, 1.0)), "scene": "empty_room", "collisions": "ignore"}
    with pytest.warns(
        T2DWarning, match="no direct path leads from the radar to the targets, so there are no echoes of 2"
    ):
        t2d.simulate(behind, bounces=2, transmissions=4, **options)  # type: ignore[arg-type]
