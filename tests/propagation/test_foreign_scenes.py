"""Scenes as others make them: closed shells, town quarters, materials without values at the radar's frequency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh import Trimesh
from trimesh.creation import box

import t2d_rt as t2d
from builders import icosphere, plate, shape
from command_line import Command
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.pipeline.path_pairs import paths_to, within_reach
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import Ellipsoids, Radar, Scene, Surface

Make = Callable[..., Path]
RADAR = Radar.preset("table2")
TARGET_M = np.array([3.0, 0.5, 1.2])


def solid(name: str, low_m: tuple[float, ...], high_m: tuple[float, ...], material: str = "concrete") -> Surface:
    made = box(bounds=np.array([low_m, high_m]))
    return Surface(
        name=name, vertices=np.array(made.vertices), faces=np.array(made.faces), material=material, thickness_m=0.1
    )


def joined(name: str, *surfaces: Surface) -> Surface:
    """As one mesh."""
    before = np.cumsum([0, *(len(each.vertices) for each in surfaces)])
    faces = [each.faces + first for each, first in zip(surfaces, before[:-1], strict=True)]
    vertices = np.concatenate([each.vertices for each in surfaces])
    return Surface(name=name, vertices=vertices, faces=np.concatenate(faces), material="concrete", thickness_m=0.1)


SHELL = solid("room", (-1, -3, 0), (7, 3, 2.6))
CHEST = solid("chest", (2.5, -2, 0), (3.5, -1.4, 0.5))


# --- closed shells ---


@pytest.mark.parametrize(
    "surfaces",
    [
        (SHELL,),
        (replace(SHELL, faces=SHELL.faces[:, ::-1]),),
        tuple(replace(SHELL, name=f"side{k}", faces=SHELL.faces[[k, k + 1]]) for k in range(0, 12, 2)),
        (SHELL, CHEST),
        (joined("all", SHELL, CHEST),),
        (joined("all", SHELL, replace(CHEST, faces=CHEST.faces[:, ::-1])),),
    ],
    ids=["outward", "inward", "six", "chest", "one mesh", "one mesh of two senses"],
)
def test_a_closed_shell_around_radar_and_target_is_the_room(surfaces: tuple[Surface, ...]) -> None:
    """The direct path and one over each of the six sides, whose images are as far as reflection puts them."""
    paths = paths_to(Scene(name="shell", surfaces=surfaces), RADAR, TARGET_M, reflections=1)
    lengths = sorted(float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) for _, points in paths)
    planes = [(0, -1.0), (0, 7.0), (1, -3.0), (1, 3.0), (2, 0.0), (2, 2.6)]
    images = [TARGET_M]
    for axis, at in planes:
        image = TARGET_M.copy()
        image[axis] = 2 * at - image[axis]
        images.append(image)
    expected = sorted(float(np.linalg.norm(image - RADAR.tx_position_m)) for image in images)
    assert all(min(abs(length - each) for each in lengths) < 1e-6 for length in expected)
    if len(surfaces) != 2 and "all" not in surfaces[0].name:
        assert len(lengths) == 7


def test_a_closed_shell_may_stand_askew() -> None:
    turn = Rotation.from_euler("zyx", [30, 10, -5], degrees=True).as_matrix()
    shell = replace(SHELL, vertices=(SHELL.vertices - [3, 0, 1.3]) @ turn.T + [3, 0, 1.3])
    assert len(paths_to(Scene(name="askew", surfaces=(shell,)), RADAR, TARGET_M, reflections=1)) == 7


def test_an_open_box_is_no_shell() -> None:
    """The radar in a pit of one mesh, the target above its rim: the direct path leads out."""
    pit = replace(SHELL, faces=SHELL.faces[(SHELL.vertices[SHELL.faces][:, :, 2] < 2.6).any(axis=1)])
    assert len(pit.faces) == 10
    paths = paths_to(Scene(name="pit", surfaces=(pit,)), RADAR, np.array([3.0, 0.0, 6.0]), reflections=0)
    assert len(paths) == 1


@pytest.mark.parametrize("together", [False, True])
def test_furniture_around_the_radar_is_refused_within_a_shell(together: bool) -> None:
    cupboard = solid("cupboard", (-0.3, -0.3, 0), (0.3, 0.3, 2))
    surfaces = (joined("cupboard", SHELL, cupboard),) if together else (SHELL, cupboard)
    with pytest.raises(InputError, match=r"is inside cupboard of scene shell; move the radar \(position_m\)"):
        paths_to(Scene(name="shell", surfaces=surfaces), RADAR, TARGET_M, reflections=1)


def test_a_target_outside_the_shell_needs_transmissions() -> None:
    thin = replace(SHELL, material="wood", thickness_m=0.02)
    scene, outside = Scene(name="shell", surfaces=(thin,)), still(8.5)
    with pytest.raises(
        InputError, match=r"is inside room of scene shell and the target is not; .* allow transmissions"
    ):
        t2d.simulate(outside, radar=RADAR, scene=scene, reflections=0, collisions="ignore")
    through = t2d.simulate(
        outside, radar=RADAR, scene=scene, reflections=0, transmissions=2, clutter="none", collisions="ignore"
    )
    assert through.settings["pairs"] == ["room +x (through)"]


# --- town quarters ---


def ground(size_m: float) -> Surface:
    half = size_m / 2
    return plate("ground", [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], "concrete", 0.3)


def far_away(count: int) -> list[Surface]:
    """Round buildings of 1280 triangles, 60 m away and more."""
    return [
        Surface(name=f"dome{k}", vertices=vertices, faces=faces, material="concrete", thickness_m=0.2)
        for k in range(count)
        for vertices, faces in [icosphere(3, 5.0, (60.0 + 12 * k, 20.0, 0.0))]
    ]


def still(range_m: float) -> Ellipsoids:
    return Ellipsoids([[0.15] * 3], np.tile([range_m, 0.3, 1.1], (4, 1, 1)), np.linspace(0, 0.02, 4), material="pec")


@pytest.mark.slow
@pytest.mark.parametrize("size_m", [150.0, 1500.0])
def test_what_lies_beyond_the_farthest_range_changes_nothing(size_m: float) -> None:
    """The ground of a town with many triangles gives what a piece of it around the radar gives."""
    wall = plate("wall", [(-5, 4, 0), (15, 4, 0), (15, 4, 8), (-5, 4, 8)], "concrete", 0.3)
    town = Scene(name="town", surfaces=(ground(size_m), wall, *far_away(9)))
    piece = Scene(name="piece", surfaces=(ground(60.0), wall))
    cubes = [np.asarray(t2d.simulate(still(5.0), radar=RADAR, scene=scene).cube) for scene in (town, piece)]
    assert np.sum(np.abs(cubes[0] - cubes[1]) ** 2) < 1e-9 * np.sum(np.abs(cubes[1]) ** 2)


def test_a_recording_keeps_the_whole_town_and_its_substitutes() -> None:
    scene = Scene(name="town", surfaces=(ground(150.0), *far_away(1)))
    recording = t2d.simulate(still(5.0), radar=RADAR, scene=scene)
    assert [each.name for each in recording.experiment.scene.surfaces] == ["ground", "dome0"]
    assert np.array_equal(recording.cube, recording.again().cube)


def test_far_from_the_coordinates_origin_everything_is_the_same() -> None:
    """A street 1 km away from it: rays are traced in float32 from a place near by."""
    wall = plate("wall", [(-5, 4, 0), (15, 4, 0), (15, 4, 8), (-5, 4, 8)], "concrete", 0.3)
    found = []
    for shift in (np.zeros(3), np.array([-700.3, 1300.2, 0.0])):
        surfaces = tuple(replace(each, vertices=each.vertices + shift) for each in (ground(60.0), wall, CHEST))
        times_s, place = np.linspace(0, 0.02, 4), TARGET_M + shift
        target = Ellipsoids([[0.15] * 3], np.tile(place, (4, 1, 1)), times_s, material="pec")
        radar = Radar.preset("table2", position_m=tuple(RADAR.position_m + shift))
        found.append(t2d.simulate(target, radar=radar, scene=Scene(name="street", surfaces=surfaces)))
    there, here = (np.asarray(each.cube) for each in found)
    assert found[0].settings["pairs"] == found[1].settings["pairs"]
    assert found[0].settings["clutter_paths"] == found[1].settings["clutter_paths"]
    assert np.sum(np.abs(there - here) ** 2) < 1e-9 * np.sum(np.abs(there) ** 2)


def test_large_scenes_say_what_is_too_much_and_where(monkeypatch: pytest.MonkeyPatch) -> None:
    many = Scene(name="town", surfaces=tuple(far_away(9)))
    reaching = Radar.preset("table2", slope_hz_per_s=3e12, position_m=(110.0, 0.0, 1.0))
    monkeypatch.setattr("t2d_rt.propagation.mirrors.ROOM_PLANES", 1_000)
    with pytest.raises(
        InputError, match="has more than 1000 plane parts where its rays are traced; give what is round"
    ):
        paths_to(many, reaching, TARGET_M, reflections=1)
    monkeypatch.setattr("t2d_rt.pipeline.path_pairs.ROOM_TRIANGLES", 10_000)
    with pytest.raises(
        InputError, match="9 surfaces and 11520 triangles within the 342 m that the radar reaches, more"
    ):
        within_reach(many, reaching)
    with pytest.warns(
        T2DWarning,
        match=r"nothing of town, which reaches from .* is within 22.1 m of the radar .* so there is free space",
    ):
        assert within_reach(many, RADAR) is None


def test_a_room_in_centimetres_is_told() -> None:
    cm = replace(SHELL, vertices=100 * SHELL.vertices)
    with pytest.warns(T2DWarning, match="the ceiling of cm is 259 m above the radar, higher than any room"):
        within_reach(Scene(name="cm", surfaces=(cm,)), RADAR)


def test_a_wall_of_many_triangles_is_one_mirror() -> None:
    """As exporters and Boolean operations leave walls: the shell's 12 triangles cut into 12 288."""
    cut = Trimesh(SHELL.vertices, SHELL.faces)
    for _ in range(5):
        cut = cut.subdivide()
    shell = replace(SHELL, vertices=np.array(cut.vertices), faces=np.array(cut.faces))
    assert len(shell.faces) == 12_288
    assert len(paths_to(Scene(name="cut", surfaces=(shell,)), RADAR, TARGET_M, reflections=1)) == 7


# --- materials ---


BRICK = '<bsdf type="itu-radio-material" id="m"><string name="type" value="brick"/><float name="thickness" value="0.2"/></bsdf>'


def test_materials_without_values_are_told_before_meshes_are_read(make: Make) -> None:
    gone = shape(inside=BRICK).replace(".ply", "_gone.ply")
    with pytest.raises(InputError, match=r"no values for brick at 77\.86.* --scene-material brick=concrete"):
        load_scene(make(gone), frequency_hz=RADAR.mid_frequency_hz)


def test_substitutes_stand_in_the_scene_and_in_the_recording(make: Make) -> None:
    file = make(shape(inside=BRICK))
    scene = load_scene(file, materials={"brick": "concrete"})
    assert [(each.material, each.thickness_m) for each in scene.surfaces] == [("concrete", pytest.approx(0.2))]
    recording = t2d.simulate(still(5.0), radar=RADAR, scene=scene)
    assert [each.material for each in recording.experiment.scene.surfaces] == ["concrete"]
    for materials, message in (
        ({"brik": "concrete"}, "it has no material 'brik' to substitute; it has brick, concrete, itu_concrete, m"),
        ({"brick": "cheese"}, "unknown material 'cheese'"),
        ("brick=concrete", "materials must be a mapping like"),
    ):
        with pytest.raises(InputError, match=message):
            load_scene(file, materials=materials)  # type: ignore[arg-type]


CARPETS = (
    '<bsdf type="diffuse" id="carpet"/>',
    '<bsdf type="itu-radio-material" id="a"><string name="type" value="carpet"/></bsdf>',
)


@pytest.mark.parametrize("bsdf", CARPETS)
def test_materials_that_are_not_known_have_substitutes_too(make: Make, bsdf: str) -> None:
    file = make(shape(inside=bsdf))
    with pytest.raises(InputError, match="carpet"):
        load_scene(file)
    assert load_scene(file, materials={"carpet": "chipboard"}).surfaces[0].material == "chipboard"


def test_own_values_of_a_material_named_itu_are_told_to_be_dropped(make: Make) -> None:
    values = '<float name="relative_permittivity" value="9"/><float name="scattering_coefficient" value="0.5"/>'
    own = f'<bsdf type="radio-material" id="itu_wood">{values}</bsdf>'
    with pytest.warns(T2DWarning, match="relative_permittivity and scattering_coefficient of itu_wood are left out"):
        assert load_scene(make(shape(inside=own))).surfaces[0].material == "wood"


def test_an_experiments_file_substitutes(make: Make) -> None:
    file = make(shape(inside=BRICK))
    yaml = file.parent / "experiment.yaml"
    walk = "targets: [{kind: file, file: walk, stop_s: 0.1}]\nradar: table2\nmethod: ellipsoid\ncollisions: ignore\n"
    yaml.write_text(walk + f"scene: {{file: {file.name}, materials: {{brick: concrete}}}}\n")
    recording = t2d.run(t2d.Experiment.from_yaml(yaml))
    assert [each.material for each in recording.experiment.scene.surfaces] == ["concrete"]
    yaml.write_text(walk + f"scene: {{file: {file.name}, material: {{brick: concrete}}}}\n")
    with pytest.raises(
        InputError, match=r"key scene: got .* write it as .* \{file: street.xml, materials: \{brick: concrete\}\}"
    ):
        t2d.Experiment.from_yaml(yaml)


def test_the_command_line_substitutes(make: Make, run: Command) -> None:
    file = str(make(shape(inside=BRICK)))
    assert "no values for brick at 77.8" in run("scene", file).err
    assert run("scene", file, "--scene-material", "brick=concrete").code == 0
    told = run("scene", file, "--scene-material", "brick").err
    assert "must name a material and its substitute, as brick=concrete, got 'brick'" in told
