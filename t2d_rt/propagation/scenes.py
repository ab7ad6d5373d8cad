"""Loads scenes of Sionna RT: the shipped ones by name, any by its file.

Neither Mitsuba nor Sionna sees a user's file: they look for meshes and for plugins, which are programs, in other folders, too, and
trust what a mesh says. What is read here is a list: shapes `ply`, `obj` and `cube` with their `to_world`, materials
`itu-radio-material`, `radio-material` and those named `itu_...`, `<ref>`, `<alias>`, `<default>` and `<include>`. What only a
picture needs (cameras, lights, textures) is left out unread; anything else is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, TreeBuilder

import numpy as np

from t2d_rt.core.checks import file_path, shown, unknown_name
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.files import read_bytes, size
from t2d_rt.core.resources import listing, resource
from t2d_rt.geometry.mesh_files import MAX_MESH_BYTES, Mesh, parsed_mesh
from t2d_rt.geometry.scan import MESHES, scene_from_mesh
from t2d_rt.propagation.materials import check_values
from t2d_rt.types import Material, Scene, Surface
from t2d_rt.types.material import known_itu, materials_by_name
from t2d_rt.types.scene import MAX_SURFACES, MAX_TRIANGLES

MAX_XML_BYTES = 4_000_000
MAX_ELEMENTS = 100_000
MAX_DEPTH = 30
MAX_INCLUDES = MAX_PARAMETERS = 20
MAX_VALUE = 4096
"""Greatest number of characters of an attribute once its parameters are filled in, which may hold one another."""


class _BoundedTree(TreeBuilder):
    """The elements of one file as they are parsed, counted with those of all files of the scene."""

    def __init__(self, file: SceneFile) -> None:
        super().__init__()
        self._file, self._depth = file, 0

    def start(self, tag: str, attrs: dict[str, str], /) -> Element:
        """Counts an element that begins, and how deep it lies; raises InputError for too many or too deep ones."""
        self._depth += 1
        self._file.elements += 1
        if self._depth > MAX_DEPTH or self._file.elements > MAX_ELEMENTS:
            raise InputError(
                f"it holds more than {MAX_ELEMENTS} elements or is nested deeper than {MAX_DEPTH} levels; make it simpler"
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        """Goes back by a level where an element ends."""
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_: object) -> None:
        """Refuses a document type before the entities that it declares are read."""
        raise InputError("it has a document type (<!DOCTYPE), which no scene needs; delete it")


@dataclass(slots=True)
class SceneFile:
    """An XML file and its folder, the only one that its meshes and includes may lie in."""

    path: Path
    parameters: dict[str, str] = field(default_factory=dict)
    """Values of <default> by name; the first one of a name counts, as in Mitsuba."""
    elements: int = 0
    includes: int = 0

    def inside(self, name: str | None) -> Path:
        """Path of a file that the scene names, links followed; raises InputError if it is not in the scene's folder or below."""
        home = self.path.resolve().parent
        try:
            path = (home / (name or "")).resolve()
        except (OSError, RuntimeError, ValueError):  # links in a ring
            raise InputError(f"it names {shown(name)}, which cannot be found; put the file beside the scene") from None
        if not name or not path.is_relative_to(home):
            raise InputError(f"it names {shown(name)}, which lies outside its folder; put the file beside the scene")
        try:
            exists = path.exists()
        except OSError:  # a name longer than names may be
            exists = False
        if not exists:
            raise InputError(f"it names {shown(name)}, which does not exist; put the file beside the scene")
        return path

    def read(self) -> list[Element]:
        """The elements of <scene>, with parameters filled in, and with the elements of included files in place of <include>."""
        return list(self._read(self.path))

    def _read(self, path: Path) -> Iterator[Element]:
        """The elements of one file, with those of the files that it includes in their place."""
        root = self._tree(read_bytes(path, limit=MAX_XML_BYTES, noun="scene file"))
        if root.tag != "scene":
            raise InputError(
                f"it is not a Mitsuba scene: it begins with <{shown(root.tag)[1:-1]}>, not <scene>; give a Mitsuba XML file"
            )
        for element in root:
            self._fill(element)
            if element.tag == "default":
                self._define(element.get("name", ""), element.get("value", ""))
            elif element.tag == "include":
                self.includes += 1
                if self.includes > MAX_INCLUDES:
                    raise InputError(f"it includes more than {MAX_INCLUDES} files; put them into one")
                yield from self._read(self.inside(element.get("filename")))
            else:
                yield element

    def _tree(self, data: bytes) -> Element:
        """The root of an XML text, which may have no document type: entities could grow without bound or name other files."""
        parser = ElementTree.XMLParser(target=_BoundedTree(self))
        try:
            parser.feed(data)
            return parser.close()
        except InputError:
            raise
        except (ElementTree.ParseError, LookupError, ValueError) as error:
            raise InputError(f"it is not XML ({error}); give a Mitsuba XML file") from None

    def _define(self, name: str, value: str) -> None:
        """Takes a <default>, for whose value $name stands from here on."""
        if not name or len(value) > MAX_VALUE or len(self.parameters) >= MAX_PARAMETERS:
            raise InputError(
                f"it has a <default> without a name, of more than {MAX_VALUE} characters, or more than {MAX_PARAMETERS} of them; "
                "write the values where they are used"
            )
        self.parameters.setdefault(name, value)

    def _fill(self, element: Element) -> None:
        """Puts the values of $parameters into an element's attributes and those of all that it holds."""
        for node in element.iter():
            for key, value in node.attrib.items():
                if "$" in value:
                    node.set(key, self._filled(value))

    def _filled(self, value: str) -> str:
        """A text with values in the place of $parameters, long names first: one may begin like another."""
        for name in sorted(self.parameters, key=len, reverse=True):
            value = value.replace(f"${name}", self.parameters[name]) if len(value) <= MAX_VALUE else value
        if "$" in value or len(value) > MAX_VALUE:
            raise InputError(
                f"it uses a parameter without a <default> before, or one of more than {MAX_VALUE} characters, in "
                f"{shown(value)}; give its value there"
            )
        return value


NUMBERS = "0123456789+-.eE"


def to_world(transform: Element | None) -> np.ndarray:
    """The matrix (4, 4) of a <transform>, its steps one after another; the identity for None. Raises InputError if not affine."""
    steps = {"translate": _translate, "scale": _scale, "rotate": _rotate, "matrix": _matrix, "lookat": _lookat}
    matrix = np.eye(4)
    for step in [] if transform is None else transform:
        if step.tag not in steps:
            raise InputError(f"a transform holds <{shown(step.tag)[1:-1]}>; write it with {', '.join(steps)}")
        matrix = steps[step.tag](step) @ matrix
    if not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError("a transform is not finite, or not affine; its last row must be 0 0 0 1")
    return matrix


def moved(vertices: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) under an affine matrix (4, 4), rounded to float32 as ray tracers hold them."""
    if np.array_equal(matrix, np.eye(4)):
        return vertices
    with np.errstate(over="ignore", invalid="ignore"):  # what does not fit is found to be infinite where it is checked
        placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        return placed.astype(np.float32).astype(np.float64)


def numbers(text: str | None, *counts: int) -> list[float]:
    """Finite numbers of an attribute, separated by spaces or commas; raises InputError if their count is none of `counts`."""
    words = (text or "").replace(",", " ").split()
    try:
        if len(words) not in counts or not set("".join(words)) <= set(NUMBERS):
            raise ValueError
        values = [float(word) for word in words]
        if not np.isfinite(values).all():
            raise ValueError
    except ValueError:
        expected = " or ".join(str(count) for count in counts)
        raise InputError(f"{expected} finite numbers were expected, got {shown(text)}; correct it") from None
    return values


def _vector(step: Element, default: float, *, others: tuple[str, ...] = ()) -> np.ndarray:
    """x, y, z of a step, from `value` (one or three numbers) or one by one."""
    unknown = step.attrib.keys() - {"x", "y", "z", "value", *others}
    if unknown or ("value" in step.attrib and step.attrib.keys() & {"x", "y", "z"}):
        raise InputError(f"<{step.tag}> takes either value or x, y and z, got {shown(sorted(step.attrib))}; correct it")
    if "value" in step.attrib:
        return np.broadcast_to(numbers(step.get("value"), 1, 3), 3)
    return np.array([numbers(step.get(axis, str(default)), 1)[0] for axis in "xyz"])


def _translate(step: Element) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = _vector(step, 0.0)
    return matrix


def _scale(step: Element) -> np.ndarray:
    return np.diag([*_vector(step, 1.0), 1.0])


def _rotate(step: Element) -> np.ndarray:
    """The rotation (4, 4) about an axis, whose length does not count, by an angle in degrees (Rodrigues' formula)."""
    axis, angle = _vector(step, 0.0, others=("angle",)), math.radians(numbers(step.get("angle"), 1)[0])
    length = np.linalg.norm(axis)
    if not length:
        raise InputError("<rotate> has no axis; give x, y or z")
    x, y, z = axis / length
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    return matrix


def _matrix(step: Element) -> np.ndarray:
    """The matrix given, of 3 x 3 or 4 x 4 numbers, row by row."""
    values = np.array(numbers(step.get("value"), 9, 16))
    if len(values) == 16:
        return values.reshape(4, 4)
    matrix = np.eye(4)
    matrix[:3, :3] = values.reshape(3, 3)
    return matrix


def _lookat(step: Element) -> np.ndarray:
    """The matrix (4, 4) that turns the shape's z towards the target and its y as far up as may be, and moves it to `origin`."""
    origin, target, up = (np.array(numbers(step.get(name), 3)) for name in ("origin", "target", "up"))
    ahead = target - origin
    left = np.cross(up, ahead)
    if not np.linalg.norm(left) > 0:
        raise InputError("<lookat> looks nowhere, or along its up; give another target or up")
    ahead, left = ahead / np.linalg.norm(ahead), left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=1)
    return matrix


_PICTURE = "integrator sensor emitter film sampler rfilter texture medium phase volume spectrum rgb"
PICTURE = frozenset(_PICTURE.split())
"""Elements that only a picture needs, which are left out unread."""
NORMALS = frozenset({"face_normals", "flip_normals", "flip_tex_coords"})
"""Switches of a shape that change neither its place nor its form; surfaces reflect from both sides."""
OWN_VALUES = ("relative_permittivity", "conductivity")
"""Numbers of a radio material."""
FILES = {"ply": ".ply", "obj": ".obj"}
DEFAULT_THICKNESS_M = 0.1
"""Thickness [m] of a material that gives none, as in Sionna RT."""
CUBE: Mesh = (
    np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]),
    np.array([
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
        (1, 5, 7), (1, 7, 3),
    ]),
)  # fmt: skip
"""Mitsuba's cube, from -1 to 1."""


@dataclass(slots=True)
class Shapes:
    """Makes surfaces of shapes, as long as the scene's meshes stay within what one scene may hold."""

    file: SceneFile
    materials: dict[str, Element]
    substitutes: Mapping[str, str | Material]
    """Substitutes for materials, by their names."""
    bytes_left: int = MAX_MESH_BYTES
    triangles_left: int = MAX_TRIANGLES
    known: dict[bytes, tuple[str | Material, float]] = field(default_factory=dict)
    """Materials that were read before, by their text."""

    def material(self, shape: Element, name: str) -> tuple[str | Material, float]:
        """Material of a shape of that name and its thickness [m]."""
        try:
            bsdf = self._bsdf(shape)
            text = ElementTree.tostring(bsdf)
            if text not in self.known:  # hundreds of shapes are of one, which is told of once
                self.known[text] = material_of(bsdf, self.substitutes)
            return self.known[text]
        except InputError as error:
            raise InputError(f"shape {shown(name)}: {error}") from None

    def surface(self, shape: Element, name: str, material: str | Material, thickness_m: float) -> Surface:
        """The surface of a shape of that material."""
        try:
            named = properties(shape, {"boolean": NORMALS, "string": {"filename"}, "transform": {"to_world"}})
            vertices, faces = self._mesh(shape.get("type", ""), named.get("filename"))
            self.triangles_left -= len(faces)
            if self.triangles_left < 0:
                raise InputError(
                    f"the scene has more than {MAX_TRIANGLES} triangles; cut out what lies around the radar"
                )
            return Surface(
                name=name,
                vertices=moved(vertices, to_world(named.get("to_world"))),
                faces=faces,
                material=material,
                thickness_m=thickness_m,
            )
        except InputError as error:
            raise InputError(f"shape {shown(name)}: {error}") from None

    def _mesh(self, kind: str, filename: Element | None) -> Mesh:
        """Vertices and triangles of a shape of a kind, from its file, before it is moved."""
        if kind == "cube" and filename is None:
            return CUBE
        if kind not in FILES:
            raise InputError(f"its type {shown(kind)} is none of ply, obj and cube; export it as a PLY mesh")
        path = self.file.inside(None if filename is None else filename.get("value"))
        if path.suffix.lower() != FILES[kind]:
            raise InputError(f"its type is {kind}, but its file is {shown(path.name)}; give a {FILES[kind]} file")
        data = read_bytes(path, limit=MAX_MESH_BYTES, noun="mesh file")
        self.bytes_left -= len(data)
        if self.bytes_left < 0:
            raise InputError(f"the scene's meshes have more than {size(MAX_MESH_BYTES)} in all; make them coarser")
        return parsed_mesh(data, path)

    def _bsdf(self, shape: Element) -> Element:
        """The only material of a shape, its own or the one that it refers to."""
        bsdfs = list(shape.findall("bsdf"))
        for reference in shape.findall("ref"):
            if reference.get("id") not in self.materials:
                raise InputError(f"it refers to {shown(reference.get('id'))}, which is no material of the scene")
            bsdfs.append(self.materials[reference.get("id", "")])
        if len(bsdfs) != 1:
            raise InputError(f"it has {len(bsdfs)} materials; give it one")
        return bsdfs[0]


def properties(element: Element, allowed: dict[str, set[str] | frozenset[str]]) -> dict[str, Element]:
    """Properties of an element by name; raises InputError for others than those of each kind that are `allowed`."""
    named: dict[str, Element] = {}
    for child in element:
        if child.tag in PICTURE | {"bsdf", "ref"}:
            continue
        name = child.get("name", "")
        if name not in allowed.get(child.tag, ()) or name in named:
            names = ", ".join(sorted({name for names in allowed.values() for name in names}))
            raise InputError(f"it has a <{shown(child.tag)[1:-1]}> {shown(name)}, not one each of {names}; delete it")
        named[name] = child
    return named


def material_of(bsdf: Element, substitutes: Mapping[str, str | Material]) -> tuple[str | Material, float]:
    """ITU name or values, and thickness [m], of a <bsdf> as Sionna RT takes it, or the substitute for its id or its ITU name.

    One whose id begins with itu_ or mat-itu_ is an ITU material whatever its type, as exporters of pictures write it.
    """
    name, itu = names_of(bsdf)
    kind = bsdf.get("type", "")
    for key in (name, itu):
        if key in substitutes:
            return substitutes[key], _thickness(bsdf)
    if name.startswith(("itu_", "itu-")):
        dropped = [child.get("name", "") for child in bsdf if child.get("name") in OWN_VALUES]
        rough = bsdf.find("float[@name='scattering_coefficient']")
        if rough is not None and _value({"rough": rough}, "rough", 0.0):
            dropped.append("scattering_coefficient")
        if dropped:
            warn(
                f"{' and '.join(dropped)} of {name} are left out: an id that begins with itu_ is that of an ITU material; give it "
                "another one to keep them"
            )
        return known_itu(itu), _thickness(bsdf)
    if kind == "itu-radio-material":
        names = {"thickness", "scattering_coefficient", "xpd_coefficient"}
        named = properties(bsdf, {"string": {"type"}, "float": names, "integer": names})
        if _value(named, "scattering_coefficient", 0.0):
            warn(
                f"scattering_coefficient of {name} is left out: ITU materials are smooth; give a radio-material instead"
            )
        return known_itu(itu), _value(named, "thickness", DEFAULT_THICKNESS_M)
    if kind == "radio-material":
        names = {"thickness", *OWN_VALUES, "scattering_coefficient", "xpd_coefficient"}
        named = properties(bsdf, {"float": names, "integer": names})
        return Material(
            name=name,
            relative_permittivity=_value(named, "relative_permittivity", 1.0),
            conductivity_s_per_m=_value(named, "conductivity", 0.0),
            scattering_coefficient=_value(named, "scattering_coefficient", 0.0),
        ), _value(named, "thickness", DEFAULT_THICKNESS_M)
    raise InputError(
        f"its material {shown(name)} is of type {shown(kind)}; take itu-radio-material or radio-material, "
        f"an id like mat-itu_concrete, or a substitute such as {name or 'NAME'}=concrete (--scene-material, load_scene's materials)"
    )


def names_of(bsdf: Element) -> tuple[str, str]:
    """A material's own name, and the ITU name that it gives, or would be taken for."""
    name = bsdf.get("id", "").removeprefix("mat-")
    chosen = bsdf.find("string[@name='type']")
    itu = name[4:] if name.startswith(("itu_", "itu-")) else ""
    return name, itu if chosen is None else chosen.get("value", "")


def _thickness(bsdf: Element) -> float:
    thickness = bsdf.find("float[@name='thickness']")
    return _value({} if thickness is None else {"thickness": thickness}, "thickness", DEFAULT_THICKNESS_M)


def _value(named: dict[str, Element], name: str, default: float) -> float:
    """A number in the float32 in which ray tracers hold it."""
    with np.errstate(over="ignore"):  # infinite ones are refused by the surface or the material
        return float(np.float32(numbers(named[name].get("value"), 1)[0] if name in named else default))


VALUES = frozenset({"boolean", "integer", "float", "string"})
"""Elements that a scene of Mitsuba may hold beside its objects; none of them changes a shape."""


def scene_names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return [name for name in listing("scenes") if (resource("scenes", name) / f"{name}.xml").exists()]


def load_scene(
    source: str | Path,
    *,
    materials: Mapping[str, str | Material] | None = None,
    frequency_hz: float | None = None,
    units: float | str | None = None,
    up: str | None = None,
) -> Scene:
    """A shipped scene by its name, any Mitsuba/Sionna XML file, whose meshes lie in its own folder or below, or a mesh of a room.

    Surfaces keep their ITU materials, whose values follow from the radar's frequency, and their thickness; a custom radio material
    keeps its values. `materials` are substitutes by name, as {"brick": "concrete"}, for what ITU-R P.2040 has no values for at that
    frequency or does not know at all. With a `frequency_hz` [Hz], materials without values there are refused before any mesh of an
    XML file is read. For a mesh of a room (.obj, .ply, .glb) `materials`, `units` and `up` are as in `scene_from_mesh`. Raises
    InputError for a scene that cannot be read.
    """
    if str(source).lower().endswith(MESHES):
        scene = scene_from_mesh(source, materials=materials, units=units, up=up)
        if frequency_hz is not None:
            check_values((surface.material for surface in scene.surfaces), frequency_hz)
        return scene
    if units is not None or up is not None:
        raise InputError("units and up are those of a mesh (.obj, .ply, .glb); a scene file is in metres, z up")
    path = _path(source)
    substitutes = {
        name: known_itu(material.removeprefix("itu_")) if isinstance(material, str) else material
        for name, material in materials_by_name(materials).items()
    }
    try:
        return Scene(name=path.stem, surfaces=tuple(_surfaces(SceneFile(path), substitutes, frequency_hz)))
    except InputError as error:
        raise InputError(f"cannot load scene {path}: {error}") from None


def _path(source: str | Path) -> Path:
    """The file of a scene that is named or given by its path; raises an InputError that tells what there is."""
    path = file_path("scene", source)
    if isinstance(source, str) and source in scene_names():
        return resource("scenes", source) / f"{source}.xml"
    if path.suffix.lower() != ".xml":
        choices = ("free_space", *scene_names())
        raise unknown_name(
            "scene", str(source), choices, hint=", or give a Mitsuba XML file or a mesh (.obj, .ply, .glb)"
        )
    try:
        exists = path.exists()
    except OSError:  # a folder that may not be searched
        exists = False
    if not exists:
        raise InputError(
            f"there is no scene file {path}; choose one of {', '.join(scene_names())}, or give the path of one"
        )
    return path


def _surfaces(file: SceneFile, substitutes: Mapping[str, str | Material], frequency_hz: float | None) -> list[Surface]:
    """All surfaces of a file: its shapes with their materials; aliases stand for materials that come before or after."""
    shapes: list[Element] = []
    materials: dict[str, Element] = {}
    aliases: list[tuple[str, str]] = []
    for element in file.read():
        name = element.get("id", "")
        if element.tag == "shape":
            shapes.append(element)
        elif element.tag == "bsdf":
            if not name or name in materials:
                raise InputError(
                    f"it has a material without an id, or more than one {shown(name)}; give each an id of its own"
                )
            materials[name] = element
        elif element.tag == "alias":
            aliases.append((name, element.get("as", "")))
        elif element.tag not in PICTURE | VALUES:
            raise InputError(f"it holds <{shown(element.tag)[1:-1]}>, which is not read; write out what it stands for")
    if len(shapes) > MAX_SURFACES:
        raise InputError(f"it has {len(shapes)} shapes, more than {MAX_SURFACES}; join those of one material")
    held = {name for bsdf in materials.values() for name in names_of(bsdf)}
    held |= {name for shape in shapes for bsdf in shape.findall("bsdf") for name in names_of(bsdf)}
    for name in substitutes:
        if name not in held:
            raise InputError(f"it has no material {shown(name)} to substitute; it has {', '.join(sorted(held - {''}))}")
    materials |= {other: materials[name] for name, other in aliases if name in materials}
    reader, nameless = Shapes(file, materials, substitutes), count(1)
    # mesh- before a name is Blender's exporter's.
    names = [(shape.get("id") or f"no-name-{next(nameless)}").removeprefix("mesh-") for shape in shapes]
    of_surfaces = [reader.material(shape, name) for shape, name in zip(shapes, names, strict=True)]
    if frequency_hz is not None:
        check_values((material for material, _ in of_surfaces), frequency_hz)
    return [reader.surface(shape, name, *of) for shape, name, of in zip(shapes, names, of_surfaces, strict=True)]
