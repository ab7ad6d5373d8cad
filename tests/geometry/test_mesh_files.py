"""Mesh files and surfaces that are broken: every one is checked before it is used."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from builders import WALL, shape
from t2d_rt.core.errors import InputError
from t2d_rt.geometry import mesh_files
from t2d_rt.geometry.mesh_files import parsed_mesh
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.scene import Room, save_scene
from t2d_rt.types import Scene, Surface
from t2d_rt.types import scene as scene_types

Make = Callable[..., Path]


def binary(
    vertices: list[tuple[float, ...]], faces: list[tuple[int, ...]], order: str = "<", real: str = "float"
) -> bytes:
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {name} 1.0\ncomment end_header \xfc\nelement vertex {len(vertices)}\n"
        + "".join(f"property {real} {axis}\n" for axis in "zyx")
        + f"property uchar red\nelement face {len(faces)}\nproperty uchar flag\nproperty list uchar int vertex_index\nend_header\n"
    )
    code = order + {"float": "fff", "double": "ddd"}[real] + "B"
    body = b"".join(struct.pack(code, *vertex[::-1], 7) for vertex in vertices)
    return head.encode("latin-1") + body + b"".join(struct.pack(f"{order}BB{len(f)}i", 9, len(f), *f) for f in faces)


CORNERS = [(0.1, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 2.0, 0.0), (0.0, 2.0, 0.3)]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("real", ["float", "double"])
def test_binary_ply(order: str, real: str) -> None:
    """Of both byte orders; a quadrangle is two triangles, coordinates are float32."""
    vertices, faces = parsed_mesh(binary(CORNERS, [(0, 1, 2), (0, 1, 2, 3)], order, real), Path("a.ply"))
    assert vertices.tolist() == np.array(CORNERS, np.float32).astype(float).tolist()
    assert faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    assert (vertices.dtype, faces.dtype) == (np.float64, np.int64)


def test_obj() -> None:
    text = (
        b"mtllib ../secret.mtl\no a\nv 0.5 0 0 1\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nf 1/2/3 2//1 3\nv 0 1 0\nf -4 -3 -2 -1\n"
    )
    vertices, faces = parsed_mesh(text, Path("a.OBJ"))
    assert vertices[0].tolist() == [0.5, 0, 0]
    assert faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (WALL.replace("3 0 2 3", "3 0 2 4"), "a face at vertex 4, which does not exist: its vertices are 0..3"),
        (WALL.replace("3 0 2 3", "3 0 2 -1"), "a face at vertex -1, which does not exist"),
        (WALL.replace("3 0 2 3", "3 0 2 99999999999999999999"), "which does not exist"),
        (WALL.replace("3 0 2 3", "3 0 2 1e3"), "cut short or damaged"),
        (WALL.replace("3 0 2 3", "2 0 2"), "a face of 2 corners instead of 3 or 4"),
        (WALL.replace("3 0 2 3", "5 0 2 3 1 1"), "a face of 5 corners"),
        (WALL.replace("3 0 2 3", "0"), "a face of 0 corners"),
        (WALL.replace("3 0 2 3", "-3 0 2 3"), "cut short or damaged"),
        (WALL.replace("3 0 2 3", "3 0 2"), "cut short or damaged"),
        (WALL.replace("1 2 0", "nan 2 0"), "1 NaN or infinite coordinates"),
        (WALL.replace("1 2 0", "1e39 2 0"), "1 NaN or infinite coordinates"),
        (WALL.replace("1 2 0", "x 2 0"), "cut short or damaged"),
        (WALL.replace("1 2 0", "1_0 2 0"), "cut short or damaged"),
        (WALL.replace("vertex 4", "vertex 2000000000"), "has 2000000000 rows of element 'vertex', more than 500000"),
        (WALL.replace("face 2", "face 2000000000"), "has 2000000000 rows of element 'face', more than 500000"),
        (WALL.replace("face 2", "face 29999"), "cut short or damaged"),
        (WALL.replace("vertex 4", "vertex -4"), "whose line 'element vertex -4' cannot be read"),
        (WALL.replace("vertex 4", "vertex " + "9" * 30), "cannot be read"),
        (WALL.replace("face 2", "face 0"), "holds no face"),
        (WALL.replace("vertex 4", "vertex 0"), "a face of 0 corners"),
        (WALL.replace("element face 2\nproperty list uchar int vertex_indices\n", ""), "element vertex and then element face"),
        (WALL.replace("float x", "int x"), "without x, y and z of type float or double"),
        (WALL.replace("float x", "float y"), "gives a property of element vertex twice"),
        (WALL.replace("float x", "list uchar float x"), "lists in element vertex"),
        (WALL.replace("uchar int vertex_indices", "float int vertex_indices"), "cannot be read"),
        (WALL.replace("uchar int vertex_indices", "uchar float vertex_indices"), "a list vertex_indices of whole numbers"),
        (WALL.replace("ascii", "ternary"), "whose line 'format ternary 1.0' cannot be read"),
        (WALL.replace("format ascii 1.0\n", ""), "without a format"),
        ("ply\n" + "comment x\n" * 10_000 + WALL[4:], "no header from 'ply' to 'end_header'"),
        ("", "no header"),
        (b"\0" * 100, "no header"),
        (binary(CORNERS, [(0, 1, 4)]), "a face at vertex 4"),
        (binary(CORNERS, [(0, 1, 2)])[:-1], "cut short or damaged"),
        (binary(CORNERS, [(0, 1, 2)])[:-30], "cut short or damaged"),
        (binary([*CORNERS[:3], (float("inf"), 0.0, 0.0)], [(0, 1, 2)]), "NaN or infinite"),
        (binary(CORNERS, [(0, 1, 2)]).replace(b"list uchar int", b"list int int"), "cut short or damaged|corners"),
    ],
)  # fmt: skip
def test_meshes_that_are_broken(make: Make, data: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as told:
        load_scene(make(shape(), data))
    assert "wall.ply" in str(told.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\nf 1 2 3", "has a line 1 that cannot be read"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2", "a line 4 that cannot be read, 'f 1 2'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2", "a line 4 that cannot be read"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4", "a face at vertex 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 2 1", "a face at vertex -1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0", "holds no face"),
        ("f 1 1 1", "holds no vertex"),
        ("v a b c", "a line 1 that cannot be read"),
    ],
)
def test_obj_files_that_are_broken(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parsed_mesh(text.encode(), Path("a.obj"))


def test_limits_of_a_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_files, "MAX_ROWS", 3)
    for data, name in (
        (WALL.encode(), "a.ply"),
        (b"v 0 0 0\n" * 4 + b"f 1 2 3", "a.obj"),
        (b"v 0 0 0\n" * 3 + b"f" + b" 1" * 6, "a.obj"),
    ):
        with pytest.raises(InputError, match="more than 3"):
            parsed_mesh(data, Path(name))


# --- surfaces that are handed in ---

GOOD = {"name": "a", "vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "material": "metal", "thickness_m": 0.1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vertices": np.ma.masked_array(np.eye(3), np.eye(3) > 0)}, "vertices of a must not be a masked array"),
        ({"faces": np.ma.masked_array([[0, 1, 2]], [[0, 1, 0]])}, "faces of a must not be a masked array"),
        ({"vertices": np.zeros((3, 3))}, "a has no area"),
        ({"vertices": np.array([[0, 0, 0], [1, 0, 0], [2.0, 0, 0]])}, "a has no area"),
        ({"vertices": [[0, 0, 0], [1, 0]]}, "must be an array of numbers"),
        ({"vertices": np.full((3, 3), "x")}, "must be an array of numbers"),
        ({"vertices": np.eye(3) * 1j}, "must hold real numbers"),
        ({"vertices": np.eye(3) * np.nan}, "NaN or infinite"),
        ({"vertices": None}, "must be an array of numbers, got None"),
        ({"faces": np.array([[0.0, 1, 2]])}, "must be integers"),
        ({"faces": np.array([[0, 1, 3]], np.uint64)}, r"must name vertices 0\.\.2, got 0\.\.3"),
        ({"faces": np.array([[0, 1, -1]])}, r"must name vertices 0\.\.2, got -1\.\.1"),
        ({"faces": np.zeros((0, 3), int)}, r"must have shape \(face, 3\) with at least one face"),
        ({"faces": np.zeros((500_001, 3), int)}, "500001 triangles and 3 vertices, more than 500000"),
        ({"thickness_m": "0.1"}, r"thickness_m of a must be a number, got '0\.1'"),
        ({"thickness_m": True}, "thickness_m of a must be a number"),
        ({"thickness_m": 0}, "thickness_m of a must be positive"),
        ({"thickness_m": 2.5}, "thickness_m of a must be 2 m or less"),
        ({"thickness_m": float("nan")}, "thickness_m of a must be finite"),
        ({"material": 3}, "must be an ITU name or a Material, got 3"),
        ({"name": ""}, "printable characters"),
        ({"name": 7}, "printable characters"),
        ({"name": "a\x1b[0m"}, "printable characters"),
    ],
)
def test_surfaces_that_cannot_be(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Surface(**{**GOOD, **change})  # type: ignore[arg-type]


def test_a_triangle_without_area_among_others_reflects_nothing() -> None:
    surface = Surface(**{**GOOD, "faces": np.array([[0, 1, 2], [0, 0, 1]])})  # type: ignore[arg-type]
    assert len(surface.faces) == 2


def test_a_surface_keeps_its_own_arrays() -> None:
    vertices, faces = np.eye(3), np.array([[0, 1, 2]])
    surface = Surface(**{**GOOD, "vertices": vertices, "faces": faces})  # type: ignore[arg-type]
    vertices[:], faces[:] = np.nan, 7
    assert np.array_equal(surface.vertices, np.eye(3))
    assert surface.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("surfaces", [None, 3, "wall", ({"name": "a"},), (None,)])
def test_scenes_are_made_of_surfaces(surfaces: object) -> None:
    with pytest.raises(InputError, match="surfaces of scene s must be Surface objects"):
        Scene(name="s", surfaces=surfaces)  # type: ignore[arg-type]


def test_a_scene_of_too_many_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_types, "MAX_SURFACES", 2)
    many = tuple(Surface(**{**GOOD, "name": str(k)}) for k in range(3))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="scene s has 3 surfaces and 3 triangles, more than 2"):
        Scene(name="s", surfaces=many)


def test_a_saved_room_is_read_as_it_was(tmp_path: Path) -> None:
    room = Room(name="cell", size_m=(4, 3, 2.5), furniture=({"kind": "sofa", "x_m": 1, "y_m": 0},)).scene()
    again = load_scene(save_scene(room, tmp_path / "cell"))
    for one, other in zip(room.surfaces, again.surfaces, strict=True):
        assert np.array_equal(one.vertices.astype(np.float32), other.vertices)
        assert np.array_equal(one.faces, other.faces)
