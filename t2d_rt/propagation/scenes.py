"""Loads scenes of Sionna RT: the shipped ones by name, any by its file.

Neither Mitsuba nor Sionna sees a user's file: they look for meshes and for plugins, which are programs, in other folders, too, and
trust what a mesh says. What is read here is a list: shapes `ply`, `obj` and `cube` with their `to_world`, materials
`itu-radio-material`, `radio-material` and those named `itu_...`, `<ref>`, `<alias>`, `<default>` and `<include>`. What only a
picture needs (cameras, lights, textures) is left out unread; anything else is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from xml.etree.ElementTree import Element

from t2d_rt.core.checks import file_path, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing, resource
from t2d_rt.propagation.materials import check_values, known_itu
from t2d_rt.propagation.scene_xml import SceneFile
from t2d_rt.propagation.shapes import PICTURE, Shapes, names_of
from t2d_rt.types import Material, Scene, Surface
from t2d_rt.types.scene import MAX_SURFACES

VALUES = frozenset({"boolean", "integer", "float", "string"})
"""Elements that a scene of Mitsuba may hold beside its objects; none of them changes a shape."""


def scene_names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return [name for name in listing("scenes") if (resource("scenes", name) / f"{name}.xml").exists()]


def load_scene(
    source: str | Path, *, materials: Mapping[str, str | Material] | None = None, frequency_hz: float | None = None
) -> Scene:
    """A shipped scene by its name, or any Mitsuba/Sionna XML file, whose meshes lie in its own folder or below.

    Surfaces keep their ITU materials, whose values follow from the radar's frequency, and their thickness; a custom radio material
    keeps its values. `materials` are substitutes by name, as {"brick": "concrete"}, for what ITU-R P.2040 has no values for at that
    frequency or does not know at all. With a `frequency_hz` materials without values there are told before any mesh is read.
    """
    path = _path(source)
    substitutes = {} if materials is None else materials
    if not isinstance(substitutes, Mapping) or not all(
        isinstance(each, str | Material) for each in substitutes.values()
    ):
        raise InputError(f'materials must be a mapping like {{"brick": "concrete"}}, got {shown(materials)}')
    substitutes = {
        name: known_itu(each.removeprefix("itu_")) if isinstance(each, str) else each
        for name, each in substitutes.items()
    }
    try:
        return Scene(name=path.stem, surfaces=tuple(_surfaces(SceneFile(path), substitutes, frequency_hz)))
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


def _surfaces(file: SceneFile, substitutes: Mapping[str, str | Material], frequency_hz: float | None) -> list[Surface]:
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
    held = {name for each in materials.values() for name in names_of(each)}
    held |= {name for shape in shapes for each in shape.findall("bsdf") for name in names_of(each)}
    for name in substitutes:
        if name not in held:
            raise InputError(f"it has no material {shown(name)} to substitute; it has {', '.join(sorted(held - {''}))}")
    materials |= {other: materials[name] for name, other in aliases if name in materials}
    reader, nameless = Shapes(file, materials, substitutes), count(1)
    # mesh- before a name is Blender's exporter's.
    names = [(shape.get("id") or f"no-name-{next(nameless)}").removeprefix("mesh-") for shape in shapes]
    made = [reader.material(*each) for each in zip(shapes, names, strict=True)]
    if frequency_hz is not None:
        check_values((material for material, _ in made), frequency_hz)
    return [reader.surface(shape, name, *of) for shape, name, of in zip(shapes, names, made, strict=True)]
