"""Scene files that are hostile or broken: only their own folder counts, no foreign code runs, every mesh is checked."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from builders import REF, ROOT, WALL, shape, walk
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.resources import resource
from t2d_rt.propagation import scenes
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import Material

Make = Callable[..., Path]


def with_transform(steps: str) -> str:
    return shape(inside=f'{REF}<transform name="to_world">{steps}</transform>')


# --- where meshes and plugins come from ---


def checksum(scene: str) -> str:
    """Of a short, coarse cube of that scene."""
    import t2d_rt as t2d

    motion = t2d.trim(walk(), 0, 0.1)
    options = {"method": "ellipsoid", "reflections": 1, "clutter": "none", "collisions": "ignore"}
    return hashlib.sha256(t2d.simulate(motion, scene=scene, **options).adc.values.tobytes()).hexdigest()


def checksum_from(folder: Path, scene: str) -> str:
    """The same, of a process of its own in that working directory."""
    here = os.pathsep.join(map(str, (Path(__file__).parent, ROOT / "tests", ROOT)))
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
        shape("../secret.ply"), shape("link.ply"), shape("folder/secret.ply"),
        '<default name="i" value="../secret.ply"/>' + shape("$i"),
        '<default name="a" value=".."/><default name="b" value="$a/secret"/>' + shape("$b.ply"),
        '<include filename="../secret.xml"/>', '<default name="i" value=".."/><include filename="$i/secret.xml"/>',
        '<include filename="inside.xml"/>',
    ],
)  # fmt: skip
def test_nothing_leads_out_of_the_folder(make: Make, tmp_path: Path, body: str) -> None:
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
    from t2d_rt.core.backend import select
    from t2d_rt.propagation.rays import mitsuba

    mi = mitsuba(select("cpu"))
    import sionna.rt

    # A name of its own: Mitsuba would take a wall.ply in the folder that was the working directory when it was imported.
    file = "as_in_sionna.ply"
    flipped = shape(
        file, inside=f'{REF}<transform name="to_world"><rotate y="1" angle="33"/><scale value="1.5"/></transform>'
    )
    path = make(flipped.replace('"wall"', '"turned"') + shape(file, inside='<ref id="pane"/>') + PANE)
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
        (
            f"<scene><bsdf type='diffuse' id='mat-itu_concrete'/>{shape('ring.ply')}</scene>",
            "cannot be found|does not exist",
        ),
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
        (shape(inside=PANE.replace('value="1"', 'value="1e39"')), "thickness_m of wall must be"),
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
        (with_transform('<scale value="1e30"/>'), "more than 3000 m; give it in metres"),
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
        ("t2d_rt.propagation.scenes.MAX_ELEMENTS", 5, three, "holds more than 5 elements"),
        ("t2d_rt.types.scene.MAX_TRIANGLES", 1, shape(), "wall has 2 triangles and 4 vertices, more than 1"),
        ("t2d_rt.types.scene.MAX_TRIANGLES", 5, three, "has 3 surfaces and 6 triangles, more than 20000 and 5"),
    ]
    for name, value, body, message in cases:
        with monkeypatch.context() as patch:
            patch.setattr(name, value)
            with pytest.raises(InputError, match=message):
                load_scene(make(body))
    for field, value, message in (
        ("triangles_left", 5, "more than 500000 triangles"),
        ("bytes_left", 300, "more than 16 MB in all"),
    ):
        file = scenes.SceneFile(make(three))
        _, *elements = file.read()
        reader = scenes.Shapes(file, {}, {}, **{field: value})
        with pytest.raises(InputError, match=message):
            [reader.surface(each, f"w{number}", "concrete", 0.1) for number, each in enumerate(elements)]


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
