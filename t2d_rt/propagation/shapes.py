"""Shapes and materials of a Mitsuba/Sionna XML file as surfaces, in the meaning that Sionna RT gives them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.files import read_bytes, size
from t2d_rt.geometry.mesh_files import MAX_MESH_BYTES, Mesh, parsed_mesh
from t2d_rt.propagation.materials import known_itu
from t2d_rt.propagation.scene_xml import SceneFile
from t2d_rt.propagation.transforms import moved, numbers, to_world
from t2d_rt.types import Material, Surface
from t2d_rt.types.scene import MAX_TRIANGLES

PICTURE = frozenset({
    "integrator", "sensor", "emitter", "film", "sampler", "rfilter", "texture", "medium", "phase", "volume", "spectrum", "rgb",
})  # fmt: skip
"""Elements that only a picture needs: left out unread."""
NORMALS = frozenset({"face_normals", "flip_normals", "flip_tex_coords"})
"""Switches of a shape that change neither its place nor its form; surfaces reflect from both sides."""
OWN_VALUES = ("relative_permittivity", "conductivity")
"""Of a radio material."""
FILES = {"ply": ".ply", "obj": ".obj"}
DEFAULT_THICKNESS_M = 0.1
"""Sionna's."""
CUBE: Mesh = (
    np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]),
    np.array([
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
        (1, 5, 7), (1, 7, 3),
    ]),
)  # fmt: skip
"""Mitsuba's, from -1 to 1."""


@dataclass(slots=True)
class Shapes:
    """Makes surfaces of shapes, as long as the scene's meshes stay within what one scene may hold."""

    file: SceneFile
    materials: dict[str, Element]
    substitutes: Mapping[str, str | Material]
    """What stands for materials of some names."""
    bytes_left: int = MAX_MESH_BYTES
    triangles_left: int = MAX_TRIANGLES
    known: dict[bytes, tuple[str | Material, float]] = field(default_factory=dict)
    """Materials that were read before."""

    def material(self, shape: Element, name: str) -> tuple[str | Material, float]:
        """What a shape of that name is made of and its thickness [m]."""
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
            found = properties(shape, {"boolean": NORMALS, "string": {"filename"}, "transform": {"to_world"}})
            vertices, faces = self._mesh(shape.get("type", ""), found.get("filename"))
            self.triangles_left -= len(faces)
            if self.triangles_left < 0:
                raise InputError(
                    f"the scene has more than {MAX_TRIANGLES} triangles; cut out what lies around the radar"
                )
            return Surface(
                name=name,
                vertices=moved(vertices, to_world(found.get("to_world"))),
                faces=faces,
                material=material,
                thickness_m=thickness_m,
            )
        except InputError as error:
            raise InputError(f"shape {shown(name)}: {error}") from None

    def _mesh(self, kind: str, filename: Element | None) -> Mesh:
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
        found = list(shape.findall("bsdf"))
        for reference in shape.findall("ref"):
            if reference.get("id") not in self.materials:
                raise InputError(f"it refers to {shown(reference.get('id'))}, which is no material of the scene")
            found.append(self.materials[reference.get("id", "")])
        if len(found) != 1:
            raise InputError(f"it has {len(found)} materials; give it one")
        return found[0]


def properties(element: Element, known: dict[str, set[str] | frozenset[str]]) -> dict[str, Element]:
    """Its named properties; `known` are the names of each kind."""
    found: dict[str, Element] = {}
    for each in element:
        if each.tag in PICTURE | {"bsdf", "ref"}:
            continue
        name = each.get("name", "")
        if name not in known.get(each.tag, ()) or name in found:
            names = ", ".join(sorted({name for names in known.values() for name in names}))
            raise InputError(f"it has a <{shown(each.tag)[1:-1]}> {shown(name)}, not one each of {names}; delete it")
        found[name] = each
    return found


def material_of(bsdf: Element, substitutes: Mapping[str, str | Material]) -> tuple[str | Material, float]:
    """An ITU name or values, and the thickness [m], of a <bsdf> as Sionna RT takes it; what stands for one of that name, by its id
    or by its ITU name, in its place.

    One whose id begins with itu_ or mat-itu_ is an ITU material whatever its type, as exporters of pictures write it.
    """
    name, itu = names_of(bsdf)
    kind = bsdf.get("type", "")
    for each in (name, itu):
        if each in substitutes:
            return substitutes[each], _thickness(bsdf)
    if name.startswith(("itu_", "itu-")):
        dropped = [each.get("name", "") for each in bsdf if each.get("name") in OWN_VALUES]
        rough = bsdf.find("float[@name='scattering_coefficient']")
        if rough is not None and _value({"rough": rough}, "rough", 0.0):
            dropped.append("scattering_coefficient")
        if dropped:
            warnings.warn(
                f"{' and '.join(dropped)} of {name} are left out: an id that begins with itu_ is that of an ITU material; give it "
                "another one to keep them",
                T2DWarning,
                stacklevel=2,
            )
        return known_itu(itu), _thickness(bsdf)
    if kind == "itu-radio-material":
        names = {"thickness", "scattering_coefficient", "xpd_coefficient"}
        found = properties(bsdf, {"string": {"type"}, "float": names, "integer": names})
        if _value(found, "scattering_coefficient", 0.0):
            warnings.warn(
                f"scattering_coefficient of {name} is left out: ITU materials are smooth; give a radio-material instead",
                T2DWarning,
                stacklevel=2,
            )
        return known_itu(itu), _value(found, "thickness", DEFAULT_THICKNESS_M)
    if kind == "radio-material":
        names = {"thickness", *OWN_VALUES, "scattering_coefficient", "xpd_coefficient"}
        found = properties(bsdf, {"float": names, "integer": names})
        return Material(
            name=name,
            relative_permittivity=_value(found, "relative_permittivity", 1.0),
            conductivity_s_per_m=_value(found, "conductivity", 0.0),
            scattering_coefficient=_value(found, "scattering_coefficient", 0.0),
        ), _value(found, "thickness", DEFAULT_THICKNESS_M)
    raise InputError(
        f"its material {shown(name)} is of type {shown(kind)}; take itu-radio-material or radio-material, "
        f"an id like mat-itu_concrete, or a substitute such as {name or 'NAME'}=concrete (--scene-material, load_scene's materials)"
    )


def names_of(bsdf: Element) -> tuple[str, str]:
    """A material's own name, and the ITU name that it gives, or would be taken for."""
    name = bsdf.get("id", "").removeprefix("mat-")
    chosen = bsdf.find("string[@name='type']")
    plain = name[4:] if name.startswith(("itu_", "itu-")) else ""
    return name, plain if chosen is None else chosen.get("value", "")


def _thickness(bsdf: Element) -> float:
    given = bsdf.find("float[@name='thickness']")
    return _value({} if given is None else {"thickness": given}, "thickness", DEFAULT_THICKNESS_M)


def _value(found: dict[str, Element], name: str, default: float) -> float:
    """A number in the float32 in which ray tracers hold it."""
    with np.errstate(over="ignore"):  # infinite ones are refused by the surface or the material
        return float(np.float32(numbers(found[name].get("value"), 1)[0] if name in found else default))
