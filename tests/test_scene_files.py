"""Scene files that are hostile or broken: only their own folder counts, no foreign code runs, every mesh is checked."""

from __future__ import annotations

import hashlib
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from builders import walk
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.geometry import mesh_files
from t2d_rt.geometry.mesh_files import parsed_mesh
from t2d_rt.propagation import scene_xml, shapes
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.resources import resource
from t2d_rt.scene import Room, save_scene
from t2d_rt.types import Material, Scene, Surface
from t2d_rt.types import scene as scene_types

HEADER = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
"""
POINTS, FACES = "0 0 0\n1 0 0\n1 2 0\n0 2 0\n", "3 0 1 2\n3 0 2 3\n"
WALL = HEADER + POINTS + FACES
REF = '<ref id="mat-itu_concrete" name="bsdf"/>'
Make = Callable[..., Path]


def shape(file: str = "wall.ply", inside: str = REF, kind: str = "ply", name: str = "wall") -> str:
    return f'<shape type="{kind}" id="{name}"><string name="filename" value="{file}"/>{inside}</shape>'


def with_transform(steps: str) -> str:
    return shape(inside=f'{REF}<transform name="to_world">{steps}</transform>')


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Writes a scene of that body, with one material and wall.ply, and gives its path."""

    def made(body: str, wall: str | bytes = WALL) -> Path:
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        (home / "wall.ply").write_bytes(wall if isinstance(wall, bytes) else wall.encode())
        path = home / "scene.xml"
        path.write_text(f'<scene version="2.1.0"><bsdf type="diffuse" id="mat-itu_concrete"/>{body}</scene>')
        return path

    return made


# --- where meshes and plugins come from ---


def checksum(scene: str) -> str:
    """Of a short, coarse cube of that scene."""
    import t2d_rt as t2d

    motion = t2d.trim(walk(), 0, 0.1)
    options = {"method": "ellipsoid", "reflections": 1, "clutter": "none", "collisions": "ignore"}
    return hashlib.sha256(t2d.simulate(motion, scene=scene, **options).adc.values.tobytes()).hexdigest()


def checksum_from(folder: Path, scene: str) -> str:
    """The same, of a process of its own in that working directory."""
    here = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[1])])
    done = subprocess.run(
        [sys.executable, "-c", f"import test_scene_files; print(test_scene_files.checksum({scene!r}))"],
        cwd=folder, env={**os.environ, "PYTHONPATH": here}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.strip()


def plant(folder: Path, names: tuple[str, ...], marker: Path) -> None:
    """Plugins that write a file when they are loaded; where there is no compiler, files that no loader takes."""
    (folder / "plugins").mkdir(parents=True)
    source = folder / "evil.c"
    source.write_text(
        f'#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fclose(fopen("{marker}", "w")); }}\n'
    )
    library = folder / "evil.so"
    if shutil.which("cc") is None:
        library.write_text("no library")
    else:
        subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    for name in names:
        shutil.copy(library, folder / "plugins" / f"{name}.so")


@pytest.mark.slow
def test_a_working_directory_changes_nothing(tmp_path: Path) -> None:
    """Neither meshes of the same names there, nor plugins."""
    hostile, marker = tmp_path / "hostile", tmp_path / "marker"
    plant(hostile, ("ply", "diffuse", "scene", "merge", "itu-radio-material"), marker)
    shutil.copytree(resource("scenes", "living_room") / "meshes", hostile / "meshes")
    assert checksum_from(hostile, "corridor") == checksum("corridor")
    assert not marker.exists()


def test_meshes_come_from_the_scenes_folder_alone(make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    (there / "wall.ply").write_text(WALL.replace("2 0\n", "9 0\n"))
    path = make(shape())
    monkeypatch.chdir(there)
    for given in (path, os.path.relpath(path), Path("..") / "home" / "scene.xml"):
        assert load_scene(given).surfaces[0].vertices[:, 1].max() == 2
    (path.parent / "wall.ply").unlink()
    with pytest.raises(InputError, match=r"names 'wall\.ply', which does not exist; put the file beside the scene"):
        load_scene(path)


@pytest.mark.parametrize(
    "kind", ["evil", "rectangle", "sphere", "instance", "merge", "serialized", "", "../home/plugins/evil"]
)
def test_only_shapes_on_the_list(make: Make, kind: str, tmp_path: Path) -> None:
    path, marker = make(shape(kind=kind)), tmp_path / "marker"
    plant(path.parent, ("evil",), marker)
    with pytest.raises(InputError, match=r"its type '.*' is none of ply, obj and cube"):
        load_scene(path)
    assert not marker.exists()


@pytest.mark.parametrize(
    "body",
    [
        '<integrator type="evil"/>' + shape(),
        '<emitter type="evil"><string name="filename" value="/etc/passwd"/></emitter>' + shape(),
        shape(inside=REF + '<emitter type="evil"/>'),
        shape(inside='<bsdf type="evil" id="mat-itu_concrete"/>'),
    ],
)
def test_what_a_picture_needs_is_not_loaded(make: Make, body: str, tmp_path: Path) -> None:
    path, marker = make(body), tmp_path / "marker"
    plant(path.parent, ("evil",), marker)
    assert len(load_scene(path).surfaces) == 1
    assert not marker.exists()


@pytest.mark.parametrize(
    "body",
    [
        shape("../secret.ply"),
        shape("link.ply"),
        shape("folder/secret.ply"),
        '<default name="i" value="../secret.ply"/>' + shape("$i"),
        '<default name="a" value=".."/><default name="b" value="$a/secret"/>' + shape("$b.ply"),
        '<include filename="../secret.xml"/>',
        '<default name="i" value=".."/><include filename="$i/secret.xml"/>',
        '<include filename="inside.xml"/>',
    ],
)
def test_no_way_leads_out_of_the_folder(make: Make, tmp_path: Path, body: str) -> None:
    path = make(body)
    (tmp_path / "secret.ply").write_text(WALL)
    (tmp_path / "secret.xml").write_text("<scene/>")
    (path.parent / "link.ply").symlink_to(tmp_path / "secret.ply")
    (path.parent / "folder").symlink_to(tmp_path)
    (path.parent / "inside.xml").write_text(f"<scene>{shape('../secret.ply')}</scene>")
    with pytest.raises(InputError, match="lies outside its folder"):
        load_scene(path)


# --- what users bring ---


def test_parameters_aliases_and_includes(make: Make) -> None:
    path = make(
        '<default name="a" value="wall"/><default name="ab" value="$a.ply"/><default name="a" value="other"/>'
        '<alias id="mat-itu_concrete" as="stone"/><include filename="more.xml"/>'
        + shape("$ab", '<ref id="stone"/>', name="mesh-first")
    )
    second = shape("$a.ply", '<ref id="pane"/>', name="second")
    (path.parent / "more.xml").write_text(f"<scene>{second}{PANE}</scene>")
    glazed, first = load_scene(path).surfaces
    assert (first.name, first.material, first.thickness_m) == ("first", "concrete", float(np.float32(0.1)))
    assert (glazed.name, glazed.thickness_m) == ("second", 1.0)
    assert glazed.material == Material(
        name="pane", relative_permittivity=float(np.float32(6.3)), scattering_coefficient=0.25
    )


PANE = (
    '<bsdf type="radio-material" id="pane"><float name="relative_permittivity" value="6.3"/><integer name="thickness" value="1"/>'
    '<float name="scattering_coefficient" value="0.25"/><rgb name="color" value="0 0 1"/></bsdf>'
)


def test_a_scattering_coefficient_of_an_itu_material_is_told_to_be_left_out(make: Make) -> None:
    rough = PANE.replace("radio-material", "itu-radio-material").replace("relative_permittivity", "xpd_coefficient")
    rough = rough.replace("<integer", '<string name="type" value="wood"/><integer')
    with pytest.warns(T2DWarning, match="scattering_coefficient of pane is left out: ITU materials are smooth"):
        assert load_scene(make(shape(inside=rough))).surfaces[0].material == "wood"


@pytest.mark.parametrize(
    ("steps", "corner"),
    [
        ('<translate x="1" y="2"/><scale value="2"/>', (4, 8, 0)),
        ('<scale value="2, 3 4"/><translate value="1"/>', (3, 7, 1)),
        ('<rotate z="2" angle="90"/>', (-2, 1, 0)),
        ('<matrix value="1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1"/>', (6, 2, 0)),
        ('<matrix value="2 0 0 0 2 0 0 0 2"/>', (2, 4, 0)),
        ('<lookat origin="1,0,0" target="2,0,0" up="0,0,1"/>', (1, 1, 2)),
    ],
)  # fmt: skip
def test_to_world(make: Make, steps: str, corner: tuple[float, float, float]) -> None:
    """Where the corner (1, 2, 0) goes; as Sionna RT has it, but that the length of a rotation's axis does not count."""
    (surface,) = load_scene(make(with_transform(steps))).surfaces
    np.testing.assert_allclose(surface.vertices[2], corner, atol=1e-6)


def test_the_users_features_are_as_in_sionna(make: Make) -> None:
    """Bit for bit without a transform, to rounding with one."""
    from t2d_rt.backend import select
    from t2d_rt.propagation.mitsuba import mitsuba

    mi = mitsuba(select("cpu"))
    import sionna.rt

    # A name of its own: Mitsuba would take a wall.ply in the folder that was the working directory when it was imported.
    file = "as_in_sionna.ply"
    turned = shape(
        file, inside=f'{REF}<transform name="to_world"><rotate y="1" angle="33"/><scale value="1.5"/></transform>'
    )
    path = make(turned.replace('"wall"', '"turned"') + shape(file, inside='<ref id="pane"/>') + PANE)
    (path.parent / "wall.ply").rename(path.parent / file)
    theirs = sionna.rt.load_scene(str(path), merge_shapes=False).objects
    for surface in load_scene(path).surfaces:
        other, values = theirs[surface.name], mi.traverse(theirs[surface.name].mi_mesh)
        vertices = values["vertex_positions"].numpy().reshape(-1, 3)
        np.testing.assert_allclose(surface.vertices, vertices, rtol=0, atol=2e-7 if surface.name == "turned" else 0)
        assert surface.faces.ravel().tolist() == values["faces"].numpy().tolist()
        assert surface.thickness_m == other.radio_material.thickness[0]


# --- XML that is broken or grows ---

LAUGHS = (
    '<!DOCTYPE scene [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    '<scene version="2.1.0"><default name="x" value="&b;"/></scene>'
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAUGHS, "it has a document type"),
        (LAUGHS.encode("utf-16"), "it has a document type"),
        (b'<?xml version="1.0" encoding="klingon"?><scene/>', "is not XML"),
        (b"<scene>\xff\xfe</scene>", "is not XML"),
        ("<scene>" + "<a>" * 40 + "</a>" * 40 + "</scene>", "nested deeper than 30 levels"),
        ("<scene>" + "<a>" * 100_000 + "</scene>", "nested deeper than 30 levels"),
        ("", "is not XML"),
        ("<scene/>", "holds nothing that reflects"),
        ("<scene><path value='meshes'/></scene>", "it holds <path>, which is not read"),
        (
            "<scene><default name='a' value='x'/></scene>" + " " * 4_000_000,
            "larger than the 4 MB that a scene file may have",
        ),
        ("<scene><default value='x'/></scene>", "a <default> without a name"),
        (
            "<scene><default name='a' value='" + "x" * 4000 + "'/><default name='b' value='$a$a$a'/></scene>",
            "one of more than 4096 characters",
        ),
        ("<scene><default name='a' value='$a'/></scene>", "uses a parameter without a <default> before"),
        (f"<scene>{shape('$i.ply')}</scene>", "uses a parameter without a <default> before"),
        ("<scene><include filename='scene.xml'/></scene>", "it includes more than 20 files"),
        (f"<scene>{shape('ring.ply')}</scene>", "cannot be found|does not exist"),
    ],
)
def test_xml_that_is_no_scene(make: Make, text: str | bytes, message: str) -> None:
    path = make("")
    (path.parent / "ring.ply").symlink_to("ring.ply")
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError, match=message):
        load_scene(path)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (shape(inside=""), "it has 0 materials; give it one"),
        (shape(inside=REF + REF), "it has 2 materials; give it one"),
        (shape(inside='<ref id="gold"/>'), "refers to 'gold', which is no material"),
        (shape(inside='<bsdf type="diffuse" id="paint"/>'), "its material 'paint' is of type 'diffuse'"),
        (shape(inside='<bsdf type="absorber-radio-material" id="foam"/>'), "its material 'foam' is of type"),
        (shape(inside='<bsdf type="diffuse" id="mat-itu_cheese"/>'), "unknown material 'cheese'; ITU names are"),
        (shape(inside='<bsdf type="itu-radio-material" id="a"/>'), "unknown material ''"),
        (shape(inside=PANE.replace("6.3", "0.3")), "relative_permittivity must be 1 or more"),
        (shape(inside=PANE.replace("6.3", "1_0")), "1 finite numbers were expected, got '1_0'"),
        (shape(inside=PANE.replace('value="1"', 'value="nan"')), "1 finite numbers were expected, got 'nan'"),
        (shape(inside=PANE.replace('value="1"', 'value="1e39"')), "thickness_m of wall must lie in 0..2 m"),
        (shape(inside=PANE.replace("</bsdf>", '<float name="foo" value="1"/></bsdf>')), "a <float> 'foo'"),
        (shape(inside=REF + '<string name="filename" value="b.ply"/>'), "a <string> 'filename', not one each of"),
        (shape(inside=REF + '<default name="filename" value="b.ply"/>'), "a <default> 'filename'"),
        (shape().replace('"filename"', '"Filename"'), "a <string> 'Filename'"),
        (shape("wall.ply", kind="obj"), r"its type is obj, but its file is 'wall\.ply'"),
        (shape("."), "its type is ply, but its file is"),
        ("".join(shape(name="twice") for _ in "ab"), "more than one object named 'twice'"),
        (shape(name="a&#10;b"), "must be a text of 1..200 printable characters"),
        (shape(name="x" * 201), "must be a text of 1..200 printable characters"),
        (PANE + PANE + shape(), "more than one 'pane'"),
        ('<bsdf type="diffuse"/>' + shape(), "a material without an id"),
        (with_transform('<scale value="0"/>'), "wall has no area"),
        (with_transform('<scale x="0"/><scale value="1e-9"/>'), "wall has no area"),
        (with_transform('<scale value="1e300"/>'), "NaN or infinite"),
        (with_transform('<scale value="1e30"/>'), "more than 100 m; give it in metres"),
        (with_transform('<rotate angle="9"/>'), "<rotate> has no axis"),
        (with_transform('<translate x="1" value="1"/>'), "either value or x, y and z"),
        (with_transform('<matrix value="1 2 3"/>'), "9 or 16 finite numbers were expected"),
        (with_transform('<matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1"/>'), "not affine"),
        (with_transform('<lookat origin="0,0,0" target="0,0,1" up="0,0,1"/>'), "<lookat> looks nowhere"),
        (with_transform('<lookat origin="0,0,0" target="0,0,1"/>'), "3 finite numbers were expected, got None"),
        (with_transform("<skew/>"), "a transform holds <skew>"),
    ],
)
def test_shapes_that_cannot_be(make: Make, body: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as told:
        load_scene(make(body))
    assert "\n" not in str(told.value)


def test_limits_of_a_scene(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    three = "".join(shape(name=f"wall{k}") for k in range(3))
    cases = [
        ("t2d_rt.propagation.scenes.MAX_SURFACES", 2, three, "it has 3 shapes, more than 2"),
        ("t2d_rt.propagation.scene_xml.MAX_ELEMENTS", 5, three, "holds more than 5 elements"),
        ("t2d_rt.types.scene.MAX_TRIANGLES", 1, shape(), "wall has 2 triangles and 4 vertices, more than 1"),
        ("t2d_rt.types.scene.MAX_TRIANGLES", 5, three, "has 3 surfaces and 6 triangles, more than 2000 and 5"),
    ]
    for name, value, body, message in cases:
        with monkeypatch.context() as patch:
            patch.setattr(name, value)
            with pytest.raises(InputError, match=message):
                load_scene(make(body))
    for field, value, message in (
        ("triangles_left", 5, "more than 10000 triangles"),
        ("bytes_left", 300, "more than 16 MB in all"),
    ):
        path = make(three)
        file = scene_xml.SceneFile(path)
        _, *elements = file.read()
        reader = shapes.Shapes(file, {"mat-itu_concrete": _}, **{field: value})
        with pytest.raises(InputError, match=message):
            [reader.surface(each, f"w{number}") for number, each in enumerate(elements)]


def test_scenes_that_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "folder.xml").mkdir()
    (tmp_path / "zero.xml").symlink_to("/dev/zero")
    with (tmp_path / "sparse.xml").open("wb") as file:
        file.truncate(20 << 30)
    for name, message in (
        ("pipe.xml", "is a pipe"), ("folder.xml", r"(?i)is a directory"), ("zero.xml", "is a device"),
        ("sparse.xml", "larger than the 4 MB"), ("none.xml", "there is no scene file"), ("a\0b.xml", "not a valid file name"),
        ("x" * 300 + ".xml", "it is too long"), ("\x1b[31mred.xml", r"there is no scene file .*\\x1b\[31mred.xml"),
        ("corridor", "unknown scene"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message):
            load_scene(tmp_path / name)
    for given in (None, 3, b"corridor", ["corridor"], ""):
        with pytest.raises(InputError, match=r"scene must be a path|scene '' is not a valid file name"):
            load_scene(given)  # type: ignore[arg-type]


def test_a_mesh_may_be_no_pipe(make: Make) -> None:
    path = make(shape("pipe.ply"))
    os.mkfifo(path.parent / "pipe.ply")
    with pytest.raises(InputError, match=r"pipe\.ply is a pipe"):
        load_scene(path)


# --- meshes ---


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
        (WALL.replace("vertex 4", "vertex 2000000000"), "has 2000000000 rows of element 'vertex', more than 30000"),
        (WALL.replace("face 2", "face 2000000000"), "has 2000000000 rows of element 'face', more than 30000"),
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
        ({"vertices": np.eye(3) * 1j}, "must be finite and of shape"),
        ({"vertices": np.eye(3) * np.nan}, "NaN or infinite"),
        ({"vertices": None}, "must be an array of numbers, got None"),
        ({"faces": np.array([[0.0, 1, 2]])}, "must be integers"),
        ({"faces": np.array([[0, 1, 3]], np.uint64)}, r"must name vertices 0\.\.2, got 0\.\.3"),
        ({"faces": np.array([[0, 1, -1]])}, r"must name vertices 0\.\.2, got -1\.\.1"),
        ({"faces": np.zeros((0, 3), int)}, "must be integers of shape"),
        ({"faces": np.zeros((10_001, 3), int)}, "10001 triangles and 3 vertices, more than 10000"),
        ({"thickness_m": "0.1"}, r"thickness_m of a must lie in 0\.\.2 m, got '0\.1'"),
        ({"thickness_m": True}, r"thickness_m of a must lie in 0\.\.2 m"),
        ({"thickness_m": float("nan")}, r"thickness_m of a must lie in 0\.\.2 m"),
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
