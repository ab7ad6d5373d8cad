"""Rooms from mesh files: drawings as they are, scans by their planes, and what is not plane."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import slow_after
from t2d_rt.cli import main
from t2d_rt.cli.simulations import reports_said
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.geometry.planes import Plane, rectangles, voxels
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.pipeline.path_pairs import paths_to
from t2d_rt.types.material import ABSORBER
from t2d_rt.types.scene import Scene

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns z up into y up."""


@pytest.fixture(scope="module")
def living() -> Scene:
    return t2d.load_scene("living_room")


def materials_of(scene: Scene) -> dict[str, str]:
    return {each.name: f"{each.material} {each.thickness_m:.9g}" for each in scene.surfaces}


def write(scene: Scene, path: Path, axes: np.ndarray | None = None, scale: float = 1.0) -> Path:
    """An OBJ or a GLB with an object for each surface."""
    axes = np.eye(3) if axes is None else axes
    if path.suffix == ".glb":
        drawn = trimesh.Scene()
        for each in scene.surfaces:
            mesh = trimesh.Trimesh(scale * each.vertices @ axes.T, each.faces, process=False)
            drawn.add_geometry(mesh, node_name=each.name, geom_name=each.name)
        drawn.export(path)
        return path
    lines, first = [], 1
    for each in scene.surfaces:
        lines += [f"o {each.name}", f"usemtl {each.material}"]
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in scale * each.vertices @ axes.T]
        lines += [f"f {a + first} {b + first} {c + first}" for a, b, c in each.faces]
        first += len(each.vertices)
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(("name", "axes"), [("a.obj", None), ("y.obj", Y_UP), ("a.glb", Y_UP)])
def test_a_drawing_has_the_same_paths(tmp_path: Path, living: Scene, name: str, axes: np.ndarray | None) -> None:
    """A drawing of the living room: the same surfaces, the same paths to within 1 mm."""
    found = t2d.Room.from_mesh(write(living, tmp_path / name, axes), materials=materials_of(living))
    assert found.name == Path(name).stem
    assert sorted(materials_of(found).items()) == sorted(materials_of(living).items())
    radar, place = t2d.Radar.preset("table2-uniform"), np.array([2.7, 0.4, 1.1])
    known, mine = (
        sorted(paths_to(scene, radar, place, reflections=2), key=lambda each: each[0]) for scene in (living, found)
    )
    assert [name for name, _ in mine] == [name for name, _ in known]
    assert len(known) > 10
    assert max(np.abs(a[1] - b[1]).max() for a, b in zip(mine, known, strict=True)) < 1e-3
    assert "0.0 m^2 that is not plane" in found.report


def test_a_person_in_a_drawing_has_the_same_echo(tmp_path: Path, living: Scene) -> None:
    path = write(living, tmp_path / "a.obj")
    motion = t2d.place(t2d.trim(t2d.example("walk"), 2.0, 2.05), distance_m=3.0)
    scene = t2d.load_scene(path, materials=materials_of(living))
    options = {"radar": "table2", "reflections": 1, "method": "ellipsoid", "clutter": "none"}
    cubes = [np.asarray(t2d.simulate(motion, scene=each, **options).cube) for each in (living, scene)]
    assert np.sum(np.abs(cubes[1] - cubes[0]) ** 2) < 1e-4 * np.sum(np.abs(cubes[0]) ** 2)


def scan(noise_m: float, longest_m: float, rng: np.random.Generator) -> trimesh.Trimesh:
    """A room of 6 x 4.5 x 2.6 m of triangles with edges up to so long, with a cupboard and a ball of 1 m, leaning by 2.5 deg."""
    box, cupboard = trimesh.creation.box((6.0, 4.5, 2.6)), trimesh.creation.box((0.6, 1.2, 1.8))
    box.apply_translation((2.5, 0.25, 1.3))
    cupboard.apply_translation((5.2, -1.0, 0.9))
    both = trimesh.util.concatenate([box, cupboard])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    ball.apply_translation((3.0, 1.0, 0.7))
    fine = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(both.vertices, both.faces, longest_m))
    mesh = trimesh.util.concatenate([fine, ball])
    lean = Rotation.from_euler("xyz", [2.0, -1.5, 0.0], degrees=True)
    mesh.vertices = lean.apply(mesh.vertices + rng.normal(scale=noise_m, size=mesh.vertices.shape)) + [0.0, 0.0, -1.2]
    return mesh


@pytest.mark.parametrize(("longest_m", "count"), slow_after(1, [(0.3, 10_000), (0.2, 21_000)]))
def test_walls_of_a_noisy_scan(tmp_path: Path, longest_m: float, count: int) -> None:
    mesh = scan(0.01, longest_m, np.random.default_rng(5))
    assert len(mesh.faces) == pytest.approx(count, rel=0.1)
    mesh.export(tmp_path / "scan.ply")
    found = t2d.Room.from_mesh(tmp_path / "scan.ply", materials={"wall": "concrete 0.15"})
    by_name = {each.name: each for each in found.surfaces}
    planes = []  # normal, offset and area of every triangle
    for name in ("floor", "ceiling", "wall", "thing"):
        triangles = by_name[name].vertices[by_name[name].faces]
        normal = edge_cross(triangles)
        area = 0.5 * np.linalg.norm(normal, axis=1)
        normal /= 2 * area[:, None]
        assert np.abs(normal).max(axis=1).min() > np.cos(np.radians(1.5))  # none across an edge
        planes += list(zip(normal, np.einsum("fi,fi->f", normal, triangles[:, 0]), area, strict=True))
    # Leaning it back about its own origin shifts it over the floor by what its height makes of the lean, to second order.
    middle = np.array([2.5, 0.25, 1.3])
    for axis, size in enumerate((6.0, 4.5, 2.6)):
        mine = [(n * np.sign(n[axis]), d * np.sign(n[axis]), a) for n, d, a in planes if abs(n[axis]) > 0.9]
        offsets = np.array([d for *_, d, _ in mine])
        areas = np.array([a for *_, a in mine])
        outer = np.minimum(offsets.max() - offsets, offsets - offsets.min()) < 0.1  # less the cupboard's
        offsets, areas = offsets[outer], areas[outer]
        apart = [
            np.average(offsets[side], weights=areas[side]) for side in (offsets > middle[axis], offsets < middle[axis])
        ]
        assert apart[0] - apart[1] == pytest.approx(size, abs=0.02)
        assert min(n[axis] for (n, *_), counts in zip(mine, outer, strict=True) if counts) > np.cos(np.radians(0.5))
        full = 2 * np.prod([length for other, length in enumerate((6.0, 4.5, 2.6)) if other != axis])
        assert areas.sum() == pytest.approx(full, rel=0.03)
    assert by_name["floor"].vertices[:, 2].mean() == pytest.approx(0.0, abs=0.005)
    assert "turned level by 2.5" in found.report
    assert by_name["wall"].material == "concrete"
    assert by_name["wall"].thickness_m == 0.15
    # The ball and the rim of the cupboard are not plane: they block, and nothing is reflected there.
    rest = by_name["not plane"]
    assert rest.material == ABSORBER
    low, high = rest.vertices.min(axis=0), rest.vertices.max(axis=0)
    assert (low > [2.2, -2.0, -0.2]).all()
    assert (high < [5.8, 1.8, 2.1]).all()
    radar = t2d.Radar.preset("table2-uniform")
    behind, beside = np.array([4.4, 1.5, 0.6]), np.array([4.0, -0.4, 1.0])
    for place, seen in ((behind, False), (beside, True)):
        names = [name for name, _ in paths_to(found, radar, place, reflections=2)]
        assert ("direct" in names) == seen
        assert names
        assert not any("not plane" in name for name in names)


def test_names_and_thicknesses(tmp_path: Path) -> None:
    """Long names and those of several slabs are numbered; a material of values has the thickness of what it replaces."""
    room = t2d.Room(size_m=(4, 3, 2.5)).scene()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    ball.apply_translation((1.5, 0.0, 1.2))
    ball = replace(room.surfaces[0], name="ball", vertices=ball.vertices, faces=ball.faces)
    text = write(replace(room, surfaces=(*room.surfaces, ball)), tmp_path / "a.obj").read_text()
    for name, other in (("floor", "x" * 300), ("wall+x", "x" * 300), ("ceiling", "not plane"), ("wall-x", "window")):
        text = text.replace(f"o {name}\n", f"o {other}\n")
    (tmp_path / "a.obj").write_text(text.replace("usemtl plasterboard", "usemtl "))
    glass = t2d.Material(name="float glass", relative_permittivity=6.3, conductivity_s_per_m=0.5)
    found = t2d.Room.from_mesh(tmp_path / "a.obj", materials={"window": glass}, up="z")
    by_name = {each.name: each for each in found.surfaces}
    assert {name[-12:] for name in by_name if name[0] == "x"} == {"x" * 12, "x" * 10 + " 2"}
    assert by_name["not plane"].material == "concrete"
    assert by_name["not plane 2"].material == ABSORBER
    assert (by_name["window"].material, by_name["window"].thickness_m) == (glass, 0.006)
    assert "assumed 0.006 m of window" in found.report
    assert all(f"assumed {each} of {'x' * 194}" in found.report for each in ("concrete", "plasterboard"))


def test_rectangles_and_cubes() -> None:
    """An L of two squares less a hole is covered to within a cell; the cubes of a triangle are closed."""
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    shape = np.concatenate([square, square + [1, 0, 0], square + [0, 1, 0]])
    quads = rectangles(shape, Plane(np.array([0.0, 0.0, 1.0]), 0.0, np.arange(6)), np.array([0.0, 0.0, 1.0]))
    halves = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    area = 0.5 * np.linalg.norm(edge_cross(halves), axis=1).sum()
    assert area == pytest.approx(3.0, abs=4 * 0.05 + 0.05)
    assert len(quads) <= 4
    sides = voxels(square[:1] + 0.31)
    assert len(sides) % 2 == 0
    shown = np.unique(np.round(sides.reshape(-1, 3), 6), axis=0)
    assert (np.ptp(shown, axis=0) < [1.3, 1.3, 0.2]).all()
    middles = np.round(sides.mean(axis=1), 6)
    assert len(np.unique(middles, axis=0)) == len(middles)  # no side between two cubes


def test_what_is_no_room(tmp_path: Path, living: Scene) -> None:
    with pytest.raises(
        InputError, match=r"2\.6e\+03 m high along z, which is no room of 1\.8 to 12 m; give units='mm'"
    ):
        t2d.Room.from_mesh(write(living, tmp_path / "a.obj", scale=1e3))
    assert "1 unit = 0.001 m" in t2d.Room.from_mesh(tmp_path / "a.obj", units="mm").report
    with pytest.raises(InputError, match="give units='km'"):
        t2d.Room.from_mesh(write(living, tmp_path / "b.obj", scale=1e-3))
    wide = write(living, tmp_path / "c.obj", axes=np.diag([5.0, 5.0, 1.0]))
    with pytest.raises(InputError, match=r"is 26 m high along y, which is no room .* give up='z'"):
        t2d.Room.from_mesh(wide, up="y")
    assert "up z" in t2d.Room.from_mesh(wide).report
    with pytest.raises(InputError, match=r"has nothing called 'dor'; .*door"):
        t2d.Room.from_mesh(write(living, tmp_path / "d.obj"), materials={"dor": "wood"})
    with pytest.raises(InputError, match=r"a name and a thickness in metres as 'wood 0\.04', got 'wood 4cm'"):
        t2d.Room.from_mesh(tmp_path / "d.obj", materials={"door": "wood 4cm"})
    for door in (t2d.load_scene, t2d.Room.from_mesh):
        for name in ("door", "thing"):
            with pytest.raises(InputError, match="unknown material 'cheese'; ITU names are"):
                door(tmp_path / "d.obj", materials={name: "cheese"})
        for materials in ("wood", ["wood"], {"door": 0.04}, {1: "wood"}):
            with pytest.raises(InputError, match="materials must be a mapping"):
                door(tmp_path / "d.obj", materials=materials)  # type: ignore[arg-type]
    (tmp_path / "e.glb").write_bytes(b"glTF" + bytes(40))
    with pytest.raises(InputError, match=r"is not a \.glb file with triangles, or damaged"):
        t2d.Room.from_mesh(tmp_path / "e.glb")
    with pytest.raises(InputError, match=r"cannot read .* as a room"):
        t2d.Room.from_mesh(tmp_path / "e.stl")
    with pytest.raises(InputError, match="units and up are those of a mesh"):
        t2d.load_scene("living_room", units="mm")


def test_drawings_as_programs_write_them(tmp_path: Path, living: Scene) -> None:
    """Names after tabs, both sides of each face, furniture without a floor, a floor without a room."""
    text = write(living, tmp_path / "a.obj").read_text() + "\n"
    report = t2d.Room.from_mesh(tmp_path / "a.obj").report
    assert "up z, 1 unit = 1 m; x -0.50 to 6.00 m, y -2.60 to 2.60 m, 2.60 m high; 122 plane parts" in report
    faces = [line.split() for line in text.splitlines() if line.startswith("f ")]
    for first, *corners in faces:
        line = " ".join([first, *corners])
        text = text.replace(f"{line}\n", f"{line}\n{' '.join([first, *corners[::-1]])}\n", 1)
    (tmp_path / "a.obj").write_text(text.replace("o ", "o\t").replace("usemtl ", "usemtl\t"))
    found = t2d.Room.from_mesh(tmp_path / "a.obj")
    assert found.report == report.replace("= 1 m;", f"= 1 m; {len(faces)} triangles were there twice;", 1)
    assert [each.name for each in found.surfaces] == [each.name for each in living.surfaces]
    rest = [
        each for each in living.surfaces if not each.name.startswith(("floor", "ceiling", "wall", "door", "window"))
    ]
    found = t2d.Room.from_mesh(write(replace(living, surfaces=tuple(rest)), tmp_path / "b.obj"))
    assert "no floor, lowest place at 0.000 m put at 0" in found.report
    assert found.bounds_m[0][2] == 0
    with pytest.raises(InputError, match=r"0 m high along z, which is no room .* give up='y'"):
        t2d.Room.from_mesh(write(replace(living, surfaces=living.surfaces[:1]), tmp_path / "c.obj"))


def test_a_sloping_ceiling_is_no_floor(tmp_path: Path) -> None:
    """A ceiling that rises by 15 degrees is larger than the floor, and leaves it level."""
    attic = trimesh.creation.box((6.0, 3.0, 2.5))
    attic.vertices[attic.vertices[:, 2] > 0, 2] += np.tan(np.radians(15)) * (
        attic.vertices[attic.vertices[:, 2] > 0, 1] + 1.5
    )
    attic.export(tmp_path / "a.obj")
    assert "turned level" not in t2d.Room.from_mesh(tmp_path / "a.obj", up="z").report


def test_a_room_that_may_stand_either_way(tmp_path: Path) -> None:
    box = trimesh.creation.box((5.0, 3.0, 2.8))
    box.export(tmp_path / "a.obj")
    with pytest.warns(T2DWarning, match="may stand along y or z: up is taken as z"):
        t2d.Room.from_mesh(tmp_path / "a.obj")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "up y" in t2d.Room.from_mesh(tmp_path / "a.obj", up="y").report


def test_a_mesh_where_a_scene_is_named(tmp_path: Path, living: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    write(living, tmp_path / "room.obj")
    scene_file = "{file: room.obj, materials: {door: wood 0.05}, units: m, up: z}"
    text = f"targets: [{{kind: file, file: walk}}]\nradar: table2\nscene: {scene_file}\n"
    (tmp_path / "a.yaml").write_text(text)
    experiment = Experiment.from_yaml(tmp_path / "a.yaml")
    with reports_said():
        scene = experiment.scene_from({})
    assert "122 plane parts of 169.8 m^2 reflect" in capsys.readouterr().out
    assert isinstance(scene, Scene)
    door = next(each for each in scene.surfaces if each.name == "door")
    assert (door.material, door.thickness_m) == ("wood", 0.05)


def test_units_and_axis_on_the_command_line(tmp_path: Path, living: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write(living, tmp_path / "room.obj", scale=1e3))
    for words in (["scene", path], ["paths", "walk", "--stop-s", "0.1", "--scene", path]):
        for given, told in (
            ("", "2.6e+03 m high along z"),
            ("--scene-units mm --scene-up y", "inside floor of scene room"),
            ("--scene-units furlong", "units must be 'm', "),
            ("--scene-units 0", "units must be "),
        ):
            assert main([*words, *given.split()]) != 0
            assert told in capsys.readouterr().err
    assert main(["paths", "walk", "--scene-units", "mm"]) != 0
    assert "--scene-units is of a scene and there is none" in capsys.readouterr().err


@pytest.mark.slow
def test_a_picture_of_a_mesh(tmp_path: Path, living: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    write(living, tmp_path / "room.obj")
    words = ["scene", str(tmp_path / "room.obj"), "-o", str(tmp_path / "a.png")]
    assert main([*words, "--scene-material", "door=metal 0.002"]) == 0
    assert "122 plane parts of 169.8 m^2 reflect" in capsys.readouterr().out
