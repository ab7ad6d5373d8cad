"""Scenes: a small room of three meshes, its XML and PLY files damaged; beside it lie files and plugins that must not be opened."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    Wrong,
    chance,
    check_finite,
    check_recording,
    command,
    corrupted,
    leaving_nothing,
    no_raw_warnings,
    pick,
    quick_ball,
    quick_radar,
    untouched,
)
from validation.robustness.fuzz.ply import BOX, FLOOR, FOUR, TWO, WALL, mesh, ply

BODY = """<scene version="2.1.0">
  <bsdf type="itu-radio-material" id="concrete">
    <string name="type" value="concrete"/>
    <float name="thickness" value="0.2"/>
  </bsdf>
  <bsdf type="radio-material" id="own">
    <float name="relative_permittivity" value="4"/>
    <float name="conductivity" value="0.05"/>
    <float name="thickness" value="0.1"/>
  </bsdf>
  <shape type="ply" id="floor">
    <string name="filename" value="meshes/floor.ply"/>
    <boolean name="face_normals" value="true"/>
    <ref id="concrete" name="bsdf"/>
  </shape>
  <shape type="ply" id="wall">
    <string name="filename" value="meshes/wall.ply"/>
    <boolean name="face_normals" value="true"/>
    <ref id="concrete" name="bsdf"/>
  </shape>
  <shape type="ply" id="box">
    <string name="filename" value="meshes/box.ply"/>
    <ref id="own" name="bsdf"/>
  </shape>
</scene>
"""
CANARY_M = 12.345
"""A coordinate that only the file outside the scene's folder holds."""
TYPES = (
    "rectangle", "cube", "sphere", "cylinder", "disk", "obj", "serialized", "bitmap", "shapegroup", "instance", "evil", "ply",
    "path",
    "perspective", "spot", "point", "envmap", "blendbsdf", "twosided", "diffuse", "mask", "../evil", "/nowhere/evil", "", "merge",
    "heightfield",
    "hair", "sdfgrid", "bsplinecurve", "itu-radio-material", "radio-material", "holder-material", "linearcurve",
    "ellipsoidsmesh", "stokes",
)  # fmt: skip
FILES = (
    "../outside/secret.ply", "meshes/../../outside/secret.ply", "{folder}/outside/secret.ply",
    "file://{folder}/outside/secret.ply",
    "$i", "${i}", "meshes", "", ".", "meshes/none.ply", "meshes/pipe.ply", "meshes/link.ply", "meshes/zero.ply", "/dev/zero",
    "/dev/stdin",
    "meshes/floor.obj", "room.xml", "meshes/floor.ply\n", "MESHES/FLOOR.PLY", "~/x.ply", "x\x85.ply", "a" * 5000,
    "meshes/loop.ply",
    "/etc/passwd", "meshes/floor.ply", "outside/secret.ply", "secret.ply", "meshes/wall.ply",
)  # fmt: skip
VALUES = (
    "nan", "inf", "-inf", "1e400", "-1", "0", "1e-40", "1e30", "", "x", "true", "1 2 3", "1,2,3", "99999999999999999999",
    "$i", "0x10", "1e",
    "٣", "\x85", "brick", "vacuum", "metal", "marble", "very_dry_ground", "concrete", "a" * 5000, "%s", "{}", "../x", "0.5",
)  # fmt: skip
TRANSFORMS = (
    '<scale value="0"/>', '<scale value="nan"/>', '<scale x="0"/>', '<scale value="1e30"/>', '<scale value="-1"/>',
    '<scale value="1e-30"/>',
    '<translate x="1e30"/>', '<translate x="nan"/>', '<rotate x="0" y="0" z="0" angle="30"/>', '<rotate x="1" angle="nan"/>',
    '<matrix value="0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"/>', '<matrix value="1 0 0"/>',
    '<matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0"/>',
    '<lookat origin="0,0,0" target="0,0,0" up="0,0,1"/>', '<lookat origin="0,0,0" target="0,0,1" up="0,0,1"/>', '<skew/>',
    '<translate z="0.1"/>',
)  # fmt: skip


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One scene and what is done with it; the traps lie beside it and in the working directory."""
    room = folder / "room"
    _planted(folder, room)
    _trapped(rng.spawn(1)[0], folder, room)
    told, text, bad = "", BODY, False
    if chance(rng, 0.55):
        told, text = pick(rng, (_attribute, _attribute, _element, _element, _reached, _document, _document))(
            rng, text, folder
        )
    if not told or chance(rng, 0.2):
        name, vertices, faces = pick(rng, (("floor", FLOOR, TWO), ("wall", WALL, TWO), ("box", BOX, FOUR)))
        damage, data, impossible = mesh(rng, vertices, faces)
        bad = impossible and not told
        (room / "meshes" / f"{name}.ply").write_bytes(data)
        told += f" {name}.ply: {damage}"
    (room / "room.xml").write_bytes(text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text)
    use, act = _used(rng, room / "room.xml", sound=told in SOUND, bad=bad)
    return Attempt(f"{told.strip()[:300]}: {use}", _guarded(act, folder))


def _planted(folder: Path, room: Path) -> None:
    """The room, and files outside it that must not be opened."""
    for place in (room / "meshes", room / "plugins", folder / "plugins", folder / "outside", folder / "meshes"):
        place.mkdir(parents=True)
    secret = np.full((3, 3), CANARY_M) + np.eye(3)
    for name, vertices, faces in (("floor", FLOOR, TWO), ("wall", WALL, TWO), ("box", BOX, FOUR)):
        (room / "meshes" / f"{name}.ply").write_bytes(ply(vertices, faces))
    (folder / "outside" / "secret.ply").write_bytes(ply(secret, np.array([[0, 1, 2]])))
    (folder / "outside" / "more.xml").write_text('<scene version="2.1.0"/>')
    for name in ("$i", "$k", "$filename", "meshes/$i", "secret.ply"):  # so that a check by name finds a file
        (room / name).write_bytes(ply(FLOOR, TWO))
    os.mkfifo(room / "meshes" / "pipe.ply")
    for name, aim in (("link", "../../outside/secret.ply"), ("zero", "/dev/zero"), ("loop", "loop.ply")):
        (room / "meshes" / f"{name}.ply").symlink_to(aim)


def _trapped(rng: np.random.Generator, folder: Path, room: Path) -> None:
    """In some of the inputs each: plugins, and meshes of the same names in the working directory."""
    for place, names in (
        (room / "plugins", ("evil", "ply", "radio-material", "scene", "path")), (folder / "plugins", ("evil", "ply", "scene",
        "hdrfilm")),
        (folder / "plugins", ("evil",)), (room / "plugins", ("evil",)),
    ):  # fmt: skip
        if chance(rng, 0.2):
            for name in names:
                (place / f"{name}.so").write_bytes(b"no library")
    if chance(rng, 0.4):
        for name in ("floor", "wall", "box", "only"):
            (folder / "meshes" / f"{name}.ply").write_bytes(ply(np.full((3, 3), CANARY_M) + np.eye(3), TWO[:1]))


# --- what is made of the XML ----------------------------------------------------------------------------------------

SOUND = ("a comment", "an instruction", "UTF-8 declared", "an alias")
"""Changes after which the scene has to load as before."""


def _attribute(rng: np.random.Generator, text: str, folder: Path) -> tuple[str, str]:
    """One to three attributes get another value, or another name."""
    told = []
    for _ in range(int(rng.integers(1, 4))):
        found = list(re.finditer(r'(\w+)="([^"]*)"', text))
        each = found[int(rng.integers(1, len(found)))]
        if chance(rng, 0.1):
            new = f'{pick(rng, ("id", "name", "value", "type", "x", "filename"))}="{each[2]}"'
        else:
            values = TYPES if each[1] == "type" else FILES if each[2].endswith(".ply") else VALUES
            value = pick(rng, values if chance(rng, 0.85) else TYPES + FILES + VALUES)
            value = value.replace("{folder}", str(folder))
            new = f'{each[1]}="{value}"'
        told.append(f"{each[0][:40]} -> {new[:60]}")
        text = text[: each.start()] + new + text[each.end() :]
    return "; ".join(told), text


def _element(rng: np.random.Generator, text: str, _: Path) -> tuple[str, str]:
    """Elements dropped, doubled, renamed, put in."""
    lines, told = text.splitlines(), []
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(1, len(lines) - 1))
        how = pick(rng, ("drop", "double", "rename", "put in", "put in", "transform", "transform"))
        if how == "drop":
            told.append(f"no {lines.pop(at).strip()}")
        elif how == "double":
            told.append(f"twice {lines[at].strip()}")
            lines.insert(at, lines[at])
        elif how == "rename":
            tag = pick(
                rng,
                (
                    "shape", "bsdf", "string", "float", "include", "default", "integer", "boolean", "rgb", "spectrum", "point",
                    "sensor",
                ),
            )  # fmt: skip
            told.append(f"{lines[at].strip()} as {tag}")
            lines[at] = re.sub(r"(</?)\w+", rf"\g<1>{tag}", lines[at])
        elif how == "transform":
            inner = pick(rng, TRANSFORMS)
            told.append(f"transform {inner}")
            places = [i for i, line in enumerate(lines) if "filename" in line] or [at]
            lines.insert(pick(rng, places), f'<transform name="to_world">{inner}</transform>')
        else:
            extra = pick(rng, EXTRA)
            told.append(f"put in {extra}")
            lines.insert(at, extra)
    return "; ".join(told), "\n".join(lines)


EXTRA = (
    '<shape type="rectangle"/>', '<shape type="cube"/>', '<shape type="sphere"/>', '<shape type="evil"/>',
    '<bsdf type="evil"/>',
    '<shape type="rectangle" id="r"><ref id="own" name="bsdf"/></shape>',
    '<shape type="sphere" id="s"><ref id="own" name="bsdf"/></shape>',
    '<shape type="cube" id="floor"><ref id="own" name="bsdf"/></shape>', '<integrator type="path"/>',
    '<sensor type="perspective"/>',
    '<emitter type="constant"/>', '<default name="i" value="../outside/secret.ply"/>',
    '<default name="i" value="meshes/floor.ply"/>',
    '<default name="spp" value="$spp"/>', '<path value="../outside"/>', '<path value="meshes"/>', '<path value="plugins"/>',
    '<include filename="../outside/more.xml"/>', '<include filename="room.xml"/>', '<alias id="own" as="floor"/>',
    '<alias id="none" as="x"/>',
    '<float name="thickness" value="-1"/>', '<float name="scattering_coefficient" value="2"/>',
    '<float name="xpd_coefficient" value="nan"/>',
    '<texture type="bitmap"><string name="filename" value="../outside/secret.ply"/></texture>', '<ref id="none"/>', "text",
    "<x/>",
    '<shape type="obj"><string name="filename" value="meshes/floor.ply"/><ref id="own" name="bsdf"/></shape>',
    '<shape type="serialized"><string name="filename" value="meshes/floor.ply"/><integer name="shape_index" value="-1"/></shape>',
    '<medium type="homogeneous" id="m"/>',
    '<shape type="ply" id="again"><string name="filename" value="meshes/floor.ply"/></shape>',
    '<string name="filename" value="meshes/wall.ply"/>', '<bsdf type="radio-material" id="a\x1b[31m"/>',
    '<shape type="shapegroup" id="g"/>',
)  # fmt: skip


def _reached(rng: np.random.Generator, text: str, folder: Path) -> tuple[str, str]:
    """Ways to files outside the folder."""
    cases = (
        ("default and $i", text.replace("<bsdf", '<default name="i" value="../outside/secret.ply"/><bsdf',
        1).replace("meshes/floor.ply", "$i")),
        ("default in part", text.replace("<bsdf", '<default name="i" value="../outside"/><bsdf',
        1).replace("meshes/floor.ply", "$i/secret.ply")),
        ("default of a default", text.replace(
            "<bsdf", '<default name="i" value="../outside/secret.ply"/><default name="k" value="$i"/><bsdf', 1
        ).replace("meshes/floor.ply", "$k")),
        ("a path", text.replace("<bsdf", '<path value="../outside"/><bsdf', 1).replace("meshes/floor.ply", "secret.ply")),
        ("default as a path", text.replace(
            "<bsdf", '<default name="i" value="../outside"/><path value="$i"/><bsdf', 1).replace("meshes/floor.ply",
            "secret.ply")),
        ("an absolute name", text.replace("meshes/floor.ply", f"{folder}/outside/secret.ply")),
        ("up and down", text.replace("meshes/floor.ply", "meshes/../../outside/secret.ply")),
        ("a link", text.replace("meshes/floor.ply", "meshes/link.ply")),
        ("an include", text.replace("<bsdf", '<include filename="../outside/more.xml"/><bsdf', 1)),
        ("an include by default", text.replace("<bsdf",
        '<default name="i" value="../outside/more.xml"/><include filename="$i"/><bsdf', 1)),
        ("an entity", f'<!DOCTYPE scene [<!ENTITY e SYSTEM "file://{folder}/outside/more.xml">]>' + text.replace("<bsdf",
        "&e;<bsdf", 1)),
        ("an entity in a name", '<!DOCTYPE scene [<!ENTITY e "../outside/secret.ply">]>' + text.replace("meshes/floor.ply",
        "&e;")),
        ("a character reference", text.replace("meshes/floor.ply", "&#46;&#46;/outside/secret.ply")),
        ("another attribute first", text.replace('name="filename" value="meshes/floor.ply"',
        'value="../outside/secret.ply" name="filename"')),
        ("the name twice", text.replace(
            '<string name="filename" value="meshes/floor.ply"/>',
            '<string name="filename" value="meshes/floor.ply"/><string name="filename" value="../outside/secret.ply"/>', 1)),
        ("by default of its own name", text.replace("<bsdf", '<default name="filename" value="../outside/secret.ply"/><bsdf',
        1).replace(
            "meshes/floor.ply", "$filename")),
        ("meshes that are only in the working directory", text.replace("meshes/floor.ply", "meshes/only.ply")),
        ("plugin evil", text.replace('<shape type="ply" id="floor"', '<shape type="evil" id="floor"')),
        ("a pipe", text.replace("meshes/floor.ply", "meshes/pipe.ply")),
        ("zeros", text.replace("meshes/floor.ply", "meshes/zero.ply")),
    )  # fmt: skip
    return pick(rng, cases)


def _document(rng: np.random.Generator, text: str, _: Path) -> tuple[str, str]:
    """The document as a whole."""
    count = int(10 ** rng.uniform(1.5, 4.5))
    laughs = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 9))
    damaged = corrupted(rng, text.encode())
    shape = text[text.index("  <shape") : text.index("</shape>") + 9]
    cases: tuple[Callable[[], tuple[str, str | bytes]], ...] = (
        lambda: damaged,
        lambda: damaged,
        lambda: ("entities of entities", f'<!DOCTYPE scene [<!ENTITY l0 "x">{laughs}]>' + text.replace("meshes/floor.ply",
        "&l8;")),
        lambda: (f"depth {count}", text.replace("</scene>", "<x>" * count + "</x>" * count + "</scene>")),
        lambda: (f"depth {count} of shapes", text.replace("</scene>",
        '<shape type="ply">' * count + "</shape>" * count + "</scene>")),
        lambda: (f"{min(count, 80)} shapes", text.replace("</scene>", "".join(
            shape.replace('id="floor"', f'id="f{i}"') for i in range(min(count, 80))) + "</scene>")),
        lambda: (f"{count} attributes", text.replace("<shape", "<shape " + " ".join(f'a{i}="1"' for i in range(count)), 1)),
        lambda: (f"{count} materials", text.replace("<shape", "".join(
            f'<bsdf type="radio-material" id="m{i}"/>' for i in range(min(count, 2000))) + "<shape", 1)),
        lambda: ("UTF-16", text.encode("utf-16")),
        lambda: ("UTF-16 declared", '<?xml version="1.0" encoding="utf-16"?>' + text),
        lambda: ("UTF-8 declared", '<?xml version="1.0" encoding="utf-8"?>\n' + text),
        lambda: ("an unknown encoding", '<?xml version="1.0" encoding="klingon"?>' + text),
        lambda: ("a comment", "<!-- note -->\n" + text),
        lambda: ("an instruction", text.replace("<bsdf", "<?note x?><bsdf", 1)),
        lambda: ("an alias", text.replace("<shape", '<alias id="own" as="other"/><shape', 1)),
        lambda: ("another root", text.replace("scene", "shape")),
        lambda: ("no version", text.replace(' version="2.1.0"', "")),
        lambda: ("an old version", text.replace("2.1.0", "0.5.0")),
        lambda: ("a strange version", text.replace("2.1.0", pick(rng, ("x", "", "99.0.0", "-1.0.0", "3", "$i")))),
        lambda: ("nothing in it", '<scene version="2.1.0"></scene>'),
        lambda: ("two roots", text + text),
        lambda: ("a namespace", text.replace("<scene", '<scene xmlns="http://x"')),
        lambda: ("a terminal escape", text.replace('id="floor"', 'id="a&#x9b;31m"')),
        lambda: ("a name over two lines", text.replace('id="floor"', 'id="a&#10;b"')),
        lambda: ("a name with a slash", text.replace('id="floor"', 'id="a/../b $x$"')),
    )  # fmt: skip
    return pick(rng, cases)()  # type: ignore[return-value]


# --- what is done with it -------------------------------------------------------------------------------------------


def _used(rng: np.random.Generator, path: Path, *, sound: bool, bad: bool) -> tuple[str, Callable[[], object]]:
    use = pick(rng, ("load", "load", "load", "simulate", "mesh", "scene", "command"))
    if use == "load" or sound or bad:
        return f"load_scene({path.name!r})", lambda: _loaded(path, sound, bad)
    if use == "scene":
        words = ["scene", str(path), "-o", "x.png", "--radar", "ci4r"]
        return f"t2d-rt {' '.join(words)}", leaving_nothing(command(words), path.parent.parent)
    if use == "command":
        words = [
            "simulate", str(MOTIONS / "momask_22j_120frames.bvh"), "--scene", str(path), "--stop-s", "0.1", "--method",
            "ellipsoid",
            "--reflections", "1", "--radar", "ci4r", "--radar.samples", "32", "--radar.prf-hz", "2000", "-o", "x.zarr",
            "--signal.n-window=64",
        ]  # fmt: skip
        return f"t2d-rt {' '.join(words)}", leaving_nothing(command(words), path.parent.parent)
    return f"simulate(ball, scene={path.name!r}), {use}", lambda: _simulated(path, use)


def _loaded(path: Path, sound: bool, bad: bool) -> None:
    try:
        scene = t2d.load_scene(path)
    except t2d.T2DError:
        if sound:
            raise Wrong("refused, although nothing was changed that matters") from None
        raise
    if bad:
        raise Wrong("loaded, although a face names a vertex that is not there, or a vertex is not finite")
    for surface in scene.surfaces:
        check_finite(surface.vertices, f"surface {surface.name}")
        if (np.abs(surface.vertices - CANARY_M) < 1e-3).any():
            raise Wrong(f"surface {surface.name} comes from outside the scene's folder")
        a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
        if not np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() > 0:
            raise Wrong(f"surface {surface.name} has no area")
    if sound and not np.allclose(scene.surfaces[0].vertices, FLOOR):
        raise Wrong("loaded as another scene")


def _simulated(path: Path, use: str) -> None:
    with no_raw_warnings():
        if use == "mesh":
            result = t2d.simulate(quick_ball(), radar=quick_radar(), scene=path, reflections=1)
        else:
            ball = t2d.Ellipsoids(np.full((1, 3), 0.1), np.array([[[2.0, 0, 1]], [[1.9, 0, 1]]]), np.array([0, 0.2]))
            result = t2d.simulate(ball, radar=quick_radar(), scene=path, reflections=1, method="ellipsoid")
    check_recording(result)


def _guarded(act: Callable[[], object], folder: Path) -> Callable[[], None]:
    """The same; wrong where a file outside the scene's folder or a plugin was opened."""

    def guarded() -> None:
        _begun_here()
        with untouched(folder / "outside", folder / "plugins", folder / "room" / "plugins", folder / "meshes"):
            act()

    return guarded


def _begun_here() -> None:
    """Mitsuba searches files and plugins in the working directory of its start: that of this input, not of the parent."""
    mi: Any = import_module("mitsuba")
    resolver = mi.file_resolver()
    resolver.clear()
    for place in (Path.cwd(), Path(mi.__file__).parent):
        resolver.append(str(place))
