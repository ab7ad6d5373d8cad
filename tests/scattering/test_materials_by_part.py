"""Surfaces of several materials: a plate and a sphere against closed forms, nothing counted twice, one material as before."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import icosphere
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import PEC, ByPart, Material, MovingMesh, Radar
from t2d_rt.types.material import is_rough, values_of

RADAR = Radar.preset("table2")
RANGE_M = 30.0
NOTHING = Material(name="nothing")
GLASSY = Material(name="glassy", relative_permittivity=4.0)
LAMBERT = Material(name="Lambertian conductor", relative_permittivity=math.inf, scattering_coefficient=1.0)


def fields(mesh: MovingMesh, material: Material | ByPart, backend: Backend, *, seed: int = 0) -> np.ndarray:
    """Sum of all echoes at the mesh's times, carriers included, over that of a target of 1 m^2 at RANGE_M (time,)."""
    found = mesh_echoes(
        mesh, RADAR, times_s=mesh.times_s, material=material, detail=Detail(sagitta_rad=mesh.sagitta_rad, cycles_per_step=math.inf),
        seed=seed, views=[PathVisibility()], backend=backend,
    ).gather()  # fmt: skip
    turns = RADAR.mid_frequency_hz * found.delay_s
    whole = (found.amplitude * np.exp(2j * np.pi * (turns % 1))).sum(axis=1)
    return whole / math.sqrt(RADAR.received_power_w(1.0, RANGE_M))


def plate(side_m: float, cut: float) -> MovingMesh:
    """A plate that faces the radar, of two strips: below and above `cut` of its height."""
    y, z = side_m * np.array([-0.5, 0.5]), side_m * (np.array([0, cut, 1]) - 0.5)
    vertices = np.array([[RANGE_M, a, 1 + b] for b in z for a in y])
    faces = np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]])
    with pytest.warns(t2d.T2DWarning, match="watertight"):
        return MovingMesh(np.stack([vertices] * 4), faces, np.arange(4.0), PEC)


def test_a_plate_of_two_materials_reflects_as_their_mean_by_area(backend: Backend) -> None:
    cut, side_m = 0.25, 0.03
    mesh, part = plate(side_m, cut), np.array([0, 0, 1, 1])
    found = fields(mesh, ByPart((PEC, GLASSY), part), backend)[0]
    # 4 pi A^2/lambda^2, and Gamma of eps = 4 is -1/3; 3 cm at 30 m are 0.02 rad from the far field.
    gamma = cut + (1 - cut) / 3
    assert abs(found) == pytest.approx(math.sqrt(4 * math.pi) * side_m**2 / RADAR.wavelength_m * gamma, rel=2e-3)
    swapped = fields(mesh, ByPart((GLASSY, PEC), part), backend)[0]
    assert abs(swapped) == pytest.approx(abs(found) * ((1 - cut) + cut / 3) / gamma, rel=1e-3)


def test_a_diffuse_point_is_of_the_material_that_it_lies_on(backend: Backend) -> None:
    cut, side_m = 0.25, 0.3
    mesh, rough = plate(side_m, cut), Material(name="rough", scattering_coefficient=0.5, relative_permittivity=3.0)
    made = mesh_echoes(
        mesh, RADAR, times_s=mesh.times_s, material=ByPart((rough, NOTHING), np.array([0, 0, 1, 1])),
        detail=Detail(sagitta_rad=0.4), seed=0, views=[PathVisibility()], backend=backend,
    )  # fmt: skip
    points = made.model.points
    places = np.asarray(points.operator @ mesh.rest)[points.corners]
    first, second, root, _ = points.packets.T
    height_m = np.einsum("qi,qi->q", np.stack([first, second, 1 - first - second], axis=1), places[..., 2])
    scatters = np.repeat(points.scattered > 0, np.diff(points.starts))
    above_m = height_m - 1 - side_m * (cut - 0.5)
    assert np.array_equal(scatters[np.abs(above_m) > 1e-4], above_m[np.abs(above_m) > 1e-4] < 0)
    assert (root[scatters] ** 2).sum() == pytest.approx(cut * side_m**2, rel=0.03)


def tumbling(level: int, seed: int, aspects: int) -> MovingMesh:
    """A ball of 10 cm, turned at random at each whole second."""
    rest, faces = icosphere(level, 0.1)
    rotations = Rotation.random(aspects, rng=np.random.default_rng(seed)).as_matrix()
    places = np.einsum("kij,vj->kvi", rotations, rest) + [RANGE_M, 0, 1]
    times_s = np.arange(aspects, dtype=float)
    return MovingMesh.from_track(
        lambda t: places[np.rint(t).astype(int)], faces, times_s, rest=rest, crease_deg=180, sagitta_rad=0.4
    )


def caps(mesh: MovingMesh, height: float) -> np.ndarray:
    """1 of the faces whose middle lies above that part of the diameter, 0 of the others."""
    return np.asarray(mesh.rest[mesh.faces].mean(axis=1)[:, 2] > 0.2 * height - 0.1, int)


def test_diffuse_power_goes_with_the_area_of_what_is_rough(backend: Backend) -> None:
    # Averaged over all aspects each bit of surface returns alike: (8/3) pi a^2 times its part of the area (physics.md, eq. 9).
    powers = []
    for seed in range(12):
        mesh = tumbling(3, seed, 60)
        part = caps(mesh, 0.5)
        area = np.linalg.norm(np.cross(*np.diff(mesh.rest[mesh.faces], axis=1).swapaxes(0, 1)), axis=1)
        powers.append(np.abs(fields(mesh, ByPart((NOTHING, LAMBERT), part), backend, seed=seed)) ** 2)
    expected = 8 / 3 * math.pi * 0.1**2 * float(area[part == 1].sum() / area.sum())
    # 720 looks: 1/sqrt(720) = 4 % of an exponential one, twice that as half of them see little.
    assert np.mean(powers) == pytest.approx(expected, rel=0.2)


def test_parts_add_up_to_the_whole(backend: Backend) -> None:
    # Every facet and every diffuse point is in one part, whichever way patches are cut.
    rough = Material(name="rough", relative_permittivity=math.inf, scattering_coefficient=0.6)
    mesh = tumbling(3, 0, 20)
    part = caps(mesh, 0.3)
    whole = fields(mesh, rough, backend)
    each = [fields(mesh, ByPart(pair, part), backend) for pair in ((rough, NOTHING), (NOTHING, rough))]
    assert min(np.abs(one).max() for one in each) > 0.1 * np.abs(whole).max()
    assert np.abs(sum(each) - whole).max() < 1e-3 * np.abs(whole).max()


def moving_ball(material: str | Material | ByPart) -> MovingMesh:
    rest, faces = icosphere(2, 0.03)
    times_s = np.linspace(0, 0.1, 5)
    vertices = rest + np.array([2.0, 0, 1]) - times_s[:, None, None] * [0.5, 0, 0]
    return MovingMesh(vertices, faces, times_s, material, crease_deg=180)


def test_the_same_material_for_all_parts_is_that_material_bit_for_bit() -> None:
    part = np.arange(320) % 2
    one = t2d.simulate(moving_ball("clothed"), bounces=1)
    assert np.array_equal(one.adc, t2d.simulate(moving_ball(ByPart(("clothed", "clothed"), part))).adc)
    other = t2d.simulate(moving_ball(ByPart(("clothed", "metal"), part)))
    assert not np.array_equal(one.adc, other.adc)
    # A material for all takes the place of the mesh's own.
    assert np.array_equal(one.adc, t2d.simulate(moving_ball(ByPart(("skin", "metal"), part)), material="clothed").adc)


def test_ellipsoids_have_a_material_each() -> None:
    times_s, centres = np.array([0.0, 0.1]), np.array([[[2.0, 0, 1], [2.5, 0, 1]]] * 2)
    axes = np.full((2, 3), 0.1)

    def cube(material: str | Material | ByPart, which: Sequence[int] = (0, 1)) -> np.ndarray:
        some = list(which)
        return np.asarray(t2d.simulate(t2d.Ellipsoids(axes[some], centres[:, some], times_s, material=material)).adc[:])

    both = cube(ByPart(("pec", GLASSY), np.array([0, 1])))
    assert np.abs(both - cube("pec", [0]) - cube(GLASSY, [1])).max() < 1e-5 * np.abs(both).max()


@pytest.mark.parametrize("method", ["mesh", "ellipsoids"])
def test_recordings_keep_materials_by_part(tmp_path, method) -> None:
    target: t2d.MovingMesh | t2d.Ellipsoids = moving_ball(ByPart(("skin", GLASSY), np.arange(320) // 160))
    if method == "ellipsoids":
        places = np.array([[[2.0, 0, 1], [2.5, 0, 1]]] * 2)
        target = t2d.Ellipsoids(
            np.full((2, 3), 0.1), places, [0.0, 0.1], material=ByPart(("skin", GLASSY), np.array([0, 1]))
        )
    recording = t2d.simulate(target)
    recording.save(tmp_path / "kept.zarr")
    again = t2d.load_recording(tmp_path / "kept.zarr").again()
    assert np.array_equal(again.adc, recording.adc)


@pytest.mark.parametrize(
    ("materials", "part", "message"),
    [
        ((), [0], "at least one"),
        ("skin", [0], "at least one"),
        (("skin", 3), [0], "a name or a Material"),
        (("skin",), [1], r"0\.\.0"),
        (("skin", "pec"), [0.5], r"0\.\.1"),
        (("skin", "pec"), [[0, 1]], "shape"),
        (("skin",), [], "got none"),
    ],
)
def test_wrong_parts_are_refused(materials, part, message) -> None:
    with pytest.raises(InputError, match=message):
        ByPart(materials, part)


def test_parts_must_fit_the_surface_and_nest_in_none() -> None:
    with pytest.raises(InputError, match="320 faces or ellipsoids, got 3"):
        moving_ball(ByPart(("skin", "pec"), np.array([0, 1, 1])))
    with pytest.raises(InputError, match="name or a Material"):
        ByPart((ByPart(("skin",), np.array([0])),), np.array([0]))  # type: ignore[arg-type]


def test_materials_by_name_have_no_values_until_they_are_resolved() -> None:
    named = ByPart(("skin", GLASSY), np.array([0, 0]))
    for ask in (lambda: is_rough(named), lambda: values_of(named, 2, lambda each: each.relative_permittivity)):
        with pytest.raises(InputError, match="resolve them first"):
            ask()
    assert not is_rough(named.resolved(lambda each: PEC if isinstance(each, str) else each))
