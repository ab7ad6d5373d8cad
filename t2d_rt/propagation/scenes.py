"""Loads scenes of Sionna RT: the shipped ones by name, any by its file.

Neither Mitsuba nor Sionna sees a user's file: they look for meshes and for plugins, which are programs, in other folders, too, and
trust what a mesh says. What is read here is a list: shapes `ply`, `obj` and `cube` with their `to_world`, materials
`itu-radio-material`, `radio-material` and those named `itu_...`, `<ref>`, `<alias>`, `<default>` and `<include>`. What only a
picture needs (cameras, lights, textures) is left out unread; anything else is refused.
"""

from __future__ import annotations

from itertools import count
from pathlib import Path
from xml.etree.ElementTree import Element

from t2d_rt.checks import file_path, shown, unknown_name
from t2d_rt.errors import InputError
from t2d_rt.propagation.scene_xml import SceneFile
from t2d_rt.propagation.shapes import PICTURE, Shapes
from t2d_rt.resources import listing, resource
from t2d_rt.types import Scene, Surface
from t2d_rt.types.scene import MAX_SURFACES

VALUES = frozenset({"boolean", "integer", "float", "string"})
"""Elements that a scene of Mitsuba may hold beside its objects; none of them changes a shape."""


def scene_names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return [name for name in listing("scenes") if (resource("scenes", name) / f"{name}.xml").exists()]


def load_scene(source: str | Path) -> Scene:
    """A shipped scene by its name, or any Mitsuba/Sionna XML file, whose meshes lie in its own folder or below.

    Surfaces keep their ITU materials, whose values follow from the radar's frequency, and their thickness; a custom radio material
    keeps its values.
    """
    path = _path(source)
    try:
        return Scene(name=path.stem, surfaces=tuple(_surfaces(SceneFile(path))))
    except InputError as error:
        raise InputError(f"cannot load scene {path}: {error}") from None


def _path(source: str | Path) -> Path:
    path = file_path("scene", source)
    if isinstance(source, str) and source in scene_names():
        return resource("scenes", source) / f"{source}.xml"
    if path.suffix.lower() != ".xml":
        known = ("free_space", *scene_names())
        raise unknown_name("scene", str(source), known, hint=", or give a Mitsuba XML file")
    try:
        found = path.exists()
    except OSError:  # a folder that may not be searched
        found = False
    if not found:
        raise InputError(
            f"there is no scene file {path}; choose one of {', '.join(scene_names())}, or give the path of one"
        )
    return path


def _surfaces(file: SceneFile) -> list[Surface]:
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
    materials |= {other: materials[name] for name, other in aliases if name in materials}
    reader, nameless = Shapes(file, materials), count(1)
    return [reader.surface(shape, shape.get("id") or f"no-name-{next(nameless)}") for shape in shapes]
