"""Loads scenes of Sionna RT: the shipped ones by name, any by its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from t2d_rt.backend import select
from t2d_rt.errors import InputError
from t2d_rt.resources import listing, resource
from t2d_rt.trace.mitsuba import mitsuba
from t2d_rt.types import Material, Scene, Surface


def scene_names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return [name for name in listing("scenes") if (resource("scenes", name) / f"{name}.xml").exists()]


def load_scene(source: str | Path) -> Scene:
    """A shipped scene by its name, or any Mitsuba/Sionna XML file.

    Surfaces keep their ITU materials, whose values follow from the radar's frequency, and their thickness; a custom radio material
    keeps its values.
    """
    path = _path(source)
    _check(path)
    mi = mitsuba(select("auto"))
    import sionna.rt

    try:
        loaded = sionna.rt.load_scene(str(path), merge_shapes=False)
    except Exception as error:
        raise InputError(
            f"cannot load scene {path}: {_first_line(error)}; give a Mitsuba XML file with radio materials"
        ) from error
    surfaces = [_surface(mi, name, each) for name, each in loaded.objects.items()]
    return Scene(name=path.stem, surfaces=tuple(surfaces))


def _path(source: str | Path) -> Path:
    if isinstance(source, str) and source in scene_names():
        return resource("scenes", source) / f"{source}.xml"
    path = Path(source)
    if path.suffix.lower() != ".xml":
        raise InputError(
            f"unknown scene {str(source)!r}; choose free_space or one of {', '.join(scene_names())}, or give a Mitsuba XML file"
        )
    if not path.is_file():
        raise InputError(
            f"there is no scene file {path}; choose one of {', '.join(scene_names())}, or give the path of one"
        )
    return path


def _check(path: Path) -> None:
    """Refuses what is not XML, and files outside the scene's own folder."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not XML ({error}); give a Mitsuba XML file") from error
    if root.tag != "scene":
        raise InputError(
            f"{path} is not a Mitsuba scene: it begins with <{root.tag}>, not <scene>; give a Mitsuba XML file"
        )
    home = path.resolve().parent
    named = [e.get("value") for e in root.iter("string") if e.get("name") == "filename"]
    named += [e.get("filename") for e in root.iter("include")] + [e.get("value") for e in root.iter("path")]
    for name in named:
        if name is None or not (home / name).resolve().is_relative_to(home):
            raise InputError(f"{path} names {name}, which lies outside its folder; put the file beside the scene")
        if not (home / name).exists():
            raise InputError(f"{path} names {name}, which does not exist; put the file beside the scene")


def _surface(mi: Any, name: str, thing: Any) -> Surface:
    values = mi.traverse(thing.mi_mesh)
    material = thing.radio_material
    itu = getattr(material, "_itu_type", None)
    return Surface(
        name=name,
        vertices=values["vertex_positions"].numpy().reshape(-1, 3),
        faces=values["faces"].numpy().reshape(-1, 3).astype(np.int64),
        material=itu if itu is not None else _own(material),
        thickness_m=_number(material.thickness),
    )


def _own(material: Any) -> Material:
    return Material(
        name=material.name,
        relative_permittivity=_number(material.relative_permittivity),
        conductivity_s_per_m=_number(material.conductivity),
        scattering_coefficient=_number(material.scattering_coefficient),
    )


def _number(value: Any) -> float:
    return float(np.asarray(value).ravel()[0])


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
