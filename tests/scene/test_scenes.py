"""Rooms, their files, and scenes of others."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import shape
from measures import volume
from t2d_rt.core.backend import select
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import folder, resource
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.propagation.scenes import load_scene, scene_names
from t2d_rt.scene import Room, save_scene
from t2d_rt.scene.room import furniture, furniture_kinds
from t2d_rt.types import Scene, Surface

DOOR = {"name": "door", "wall": "-y", "along_m": 0.5, "width_m": 0.9, "height_m": 2.0}
WOOD = {"material": "wood", "thickness_m": 0.04}
BOX = {"name": "box", "size_m": (4, 3, 2.5)}


def area(surface: Surface) -> float:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def by_name(scene: Scene) -> dict[str, Surface]:
    return {surface.name: surface for surface in scene.surfaces}


def test_walls_surround_the_room_and_doors_are_cut_from_them() -> None:
    whole, cut = by_name(Room(**BOX).scene()), by_name(Room(**BOX, openings=[{**DOOR, "slab": WOOD}]).scene())
    assert sorted(whole) == ["ceiling", "floor", "wall+x", "wall+y", "wall-x", "wall-y"]
    assert area(whole["wall-y"]) == pytest.approx(10)
    assert area(cut["wall-y"]) == pytest.approx(10 - 1.8)
    assert area(cut["door"]) == pytest.approx(1.8)
    assert (cut["door"].material, cut["door"].thickness_m) == ("wood", 0.04)
    np.testing.assert_allclose(cut["door"].vertices.min(axis=0), [1.55, -1.5, 0])
    assert "door" not in by_name(Room(**BOX, openings=[DOOR]).scene())


def test_every_surface_faces_the_room() -> None:
    middle = np.array([1.5, 0, 1.25])
    for surface in Room(**BOX, openings=[{**DOOR, "slab": WOOD}]).scene().surfaces:
        a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
        assert (np.einsum("fi,fi->f", np.cross(b - a, c - a), middle - a) > 0).all(), surface.name


def test_a_wall_with_a_door_is_one_mirror() -> None:
    mirrors = Mirrors.of(Room(**BOX, openings=[{**DOOR, "slab": WOOD}]).scene(), select("cpu"))
    assert sorted(mirror.name for mirror in mirrors.parts) == [
        "ceiling", "door", "floor", "wall+x", "wall+y", "wall-x", "wall-y",
    ]  # fmt: skip
    wall = next(mirror for mirror in mirrors.parts if mirror.name == "wall-y")
    points = np.array([[2.0, -1.5, 1.0], [2.0, -1.5, 2.2], [1.0, -1.5, 1.0], [5.0, -1.5, 1.0]])
    assert wall.holds(points).tolist() == [False, True, True, False]


@pytest.mark.parametrize("kind", furniture_kinds())
def test_furniture_is_closed_and_stands_on_the_floor(kind: str) -> None:
    parts = furniture(kind)
    # Feet of up to 12 cm are left out.
    assert 0 <= min(vertices[:, 2].min() for vertices, _ in parts.values()) < 0.1201
    for vertices, faces in parts.values():
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
        assert 0 < volume(vertices, faces) < np.ptp(vertices, axis=0).prod() * (1 + 1e-6)


def test_furniture_rotates_and_keeps_its_names() -> None:
    room = Room(**BOX, furniture=[{"kind": "bedside_table", "name": "left", "x_m": 1, "y_m": 0, "heading_deg": 90}])
    piece = by_name(room.scene())["left"]
    np.testing.assert_allclose(np.ptp(piece.vertices, axis=0), [0.45, 0.40, 0.50], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size_m": (500, 3, 2.5)}, r"room key size_m: got 500.*less than or equal to 50"),
        ({"openings": [{**DOOR, "along_m": 2.0}]}, r"door reaches from 3.05 to 3.95 m .* in wall -y, which is -0.5 to 3.5 m"),
        ({"openings": [DOOR, {**DOOR, "name": "hatch"}]}, "hatch and door overlap in wall -y"),
        ({"furniture": [{"kind": "throne", "x_m": 1, "y_m": 0}]}, "unknown furniture 'throne'; choose one of armchair"),
        ({"furniture": [{"kind": "cupboard", "x_m": 1, "y_m": 1.4}]}, r"cupboard at \(1, 1.4\) m sticks out of room box"),
        ({"furniture": [{"kind": "cupboard", "x_m": x, "y_m": 0} for x in (0.5, 2.5)]}, "more than one object named 'cupboard'"),
        ({"walls": {"material": "wood", "thickness_m": 20}}, "thickness_m|walls"),
        ({"colour": "red"}, "unknown room key 'colour'"),
    ],
)  # fmt: skip
def test_rooms_that_cannot_be(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Room(**{**BOX, **change}).scene()


def test_a_scene_in_other_units_is_refused() -> None:
    plate = Surface(
        name="wall", vertices=np.eye(3) * 5000, faces=np.array([[0, 1, 2]]), material="metal", thickness_m=0.1
    )
    with pytest.raises(InputError, match="measures 5000 m, more than 3000 m; give it in metres"):
        Scene(name="millimetres", surfaces=(plate,))
    with pytest.raises(InputError, match="holds nothing that reflects"):
        Scene(name="empty", surfaces=())


# --- files ---


def test_a_room_comes_back_from_its_file(tmp_path: Path) -> None:
    room = Room(
        **BOX, openings=[{**DOOR, "slab": WOOD}], furniture=[{"kind": "coffee_table", "x_m": 1, "y_m": 0}]
    ).scene()
    path = save_scene(room, tmp_path / "box")
    again = load_scene(path)
    assert (again.name, len(again.surfaces)) == ("box", len(room.surfaces))
    for surface in room.surfaces:
        other = by_name(again)[surface.name.replace(" ", "-")]
        assert (other.material, area(other)) == (surface.material, pytest.approx(area(surface), rel=1e-5))
        assert other.thickness_m == pytest.approx(surface.thickness_m)
    assert t2d.load_scene(path).name == "box"
    save_scene(room, tmp_path / "box")  # a scene may be replaced
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("dear to somebody")
    with pytest.raises(InputError, match="exists and holds no scene"):
        save_scene(room, tmp_path / "other")


def test_shipped_scenes_are_those_of_their_script() -> None:
    rooms = runpy.run_path(str(folder("scenes") / "make_scenes.py"))["ROOMS"]
    assert scene_names() == sorted(room.name for room in rooms)
    for room in rooms:
        made, shipped = room.scene(), load_scene(room.name)
        assert [s.name for s in shipped.surfaces] == [s.name.replace(" ", "-") for s in made.surfaces]
        for one, other in zip(made.surfaces, shipped.surfaces, strict=True):
            assert area(other) == pytest.approx(area(one), rel=1e-5)


@pytest.mark.parametrize("name", scene_names())
def test_shipped_scenes_load_in_sionna_alone(name: str) -> None:
    mitsuba(select("cpu"))
    import sionna.rt

    loaded = sionna.rt.load_scene(str(resource("scenes", name) / f"{name}.xml"), merge_shapes=False)
    loaded.frequency = 77e9
    ours = load_scene(name).surfaces
    assert sorted(loaded.objects) == sorted(surface.name for surface in ours)
    thickness = {each.name: each.radio_material.thickness[0] for each in loaded.objects.values()}
    assert thickness == pytest.approx({surface.name: surface.thickness_m for surface in ours})


METAL = '<bsdf type="itu-radio-material" id="m"><string name="type" value="metal"/></bsdf>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no xml", "is not XML"), ("<room/>", "begins with <room>, not <scene>"),
        (f'<scene version="2.1.0">{shape("../../etc/passwd", METAL)}</scene>', "lies outside its folder"),
        (f'<scene version="2.1.0">{shape("gone.ply", METAL)}</scene>', "'gone.ply', which does not exist"),
        ('<scene version="2.1.0"><bsdf type="plastic-radio" id="m"/></scene>', "cannot load scene"),
    ],
)  # fmt: skip
def test_files_that_are_no_scenes(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_scene(path)


def test_a_room_of_too_many_things() -> None:
    with pytest.raises(InputError, match="0 openings and 201 pieces of furniture, more than 50 and 200"):
        Room(**BOX, furniture=[{"kind": "chair", "x_m": 1, "y_m": 0}] * 201)
    with pytest.raises(InputError, match="51 openings and 0 pieces"):
        Room(**BOX, openings=[DOOR] * 51)


def test_a_room_needs_no_name() -> None:
    """As the README makes one."""
    room = t2d.Room(size_m=(4, 3, 2.5), furniture=[{"kind": "cupboard", "x_m": 2, "y_m": 0}])
    assert room.scene().name == "room"
    assert room == t2d.Room(name="room", size_m=(4, 3, 2.5), furniture=room.furniture)
