"""`Material`: electrical properties and roughness of a surface."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import array, number, shown, text, unknown_name
from t2d_rt.core.constants import VACUUM_PERMITTIVITY
from t2d_rt.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A homogeneous half-space with a surface that may be rough."""

    name: str = "custom"
    relative_permittivity: float = 1.0
    """Real part of the relative permittivity; math.inf for a perfect conductor."""
    conductivity_s_per_m: float = 0.0
    """Conductivity at the carrier, all losses included."""
    scattering_coefficient: float = 0.0
    """S of the effective-roughness model (Degli-Esposti 2007): a fraction S^2 of the reflected power is scattered diffusely."""

    def __post_init__(self) -> None:
        text("name of a material", self.name)
        noun, permittivity = f"material {self.name}", self.relative_permittivity
        if not (isinstance(permittivity, (float, np.floating)) and permittivity == math.inf):
            number(f"{noun}: relative_permittivity", permittivity, 1, hint="only a perfect conductor has math.inf")
        number(f"{noun}: conductivity_s_per_m", self.conductivity_s_per_m, 0, hint="0 has no losses")
        number(f"{noun}: scattering_coefficient", self.scattering_coefficient, 0, 1, hint="0 is smooth")

    def permittivity(self, frequency_hz: float) -> complex:
        """Complex relative permittivity eps' - j sigma/(omega eps0), e^{+j omega t} convention."""
        return complex(self.relative_permittivity, -loss(self.conductivity_s_per_m, checked_frequency(frequency_hz)))

    def reflection(self, frequency_hz: float) -> complex:
        """Fresnel coefficient of the field at normal incidence, (1 - n)/(1 + n); -1 for a perfect conductor."""
        checked_frequency(frequency_hz)
        if math.isinf(self.relative_permittivity):
            return -1 + 0j
        n = cmath.sqrt(self.permittivity(frequency_hz))
        return (1 - n) / (1 + n)


def loss(conductivity_s_per_m: Any, frequency_hz: Any) -> Any:
    """Imaginary part sigma/(omega eps0) of the relative permittivity eps' - j eps'' for a conductivity sigma; of numbers or
    arrays."""
    return conductivity_s_per_m / (2 * math.pi * VACUUM_PERMITTIVITY * frequency_hz)


@dataclass(frozen=True, slots=True, eq=False)
class ByPart:
    """Several materials of one surface: each face of a mesh, or each ellipsoid, has one of them."""

    materials: tuple[str | Material, ...]
    """The materials: names or values."""
    part: np.ndarray
    """Index into `materials` for each face or ellipsoid, int (N,)."""

    def __post_init__(self) -> None:
        if not isinstance(self.materials, (tuple, list)) or not self.materials:
            raise InputError(
                f"materials by part must be a tuple of at least one, got {shown(self.materials)}; give names or Materials"
            )
        for material in self.materials:
            checked_material(material)
        part, count = array("part", self.part, ("face",)), len(self.materials)
        if not len(part):
            raise InputError("part must hold a number for each face or ellipsoid, got none; it numbers materials")
        if not np.array_equal(part, np.round(part)) or not 0 <= part.min() <= part.max() < count:
            raise InputError(
                f"part must be whole numbers in 0..{count - 1}, one for each face, got {shown(self.part)}; it numbers materials"
            )
        object.__setattr__(self, "materials", tuple(self.materials))
        object.__setattr__(self, "part", part.astype(np.int32))

    @property
    def name(self) -> str:
        """Names of the materials, for messages."""
        return ", ".join(material if isinstance(material, str) else material.name for material in self.materials)

    def resolved(self, resolve: Callable[[str | Material], Material]) -> Material | ByPart:
        """The material of each part with its values at one frequency, or a single material where all faces have the same."""
        resolved_materials = [resolve(material) for material in self.materials]
        used = list(dict.fromkeys(resolved_materials[number] for number in np.unique(self.part)))
        if len(used) == 1:
            return used[0]
        numbers = [used.index(material) if material in used else -1 for material in resolved_materials]
        return ByPart(tuple(used), np.array(numbers)[self.part])

    def of_faces(self, faces: np.ndarray) -> ByPart:
        """The materials of the faces of a refined mesh; `faces` (N,) are the indices of the original faces on which these lie."""
        return ByPart(self.materials, self.part[faces])


def values_of(material: Material | ByPart, count: int, value: Callable[[Material], complex]) -> np.ndarray:
    """A property of the material of each of `count` faces or ellipsoids, (count,); materials by part must be resolved."""
    if isinstance(material, Material):
        return np.full(count, value(material))
    return np.array([value(resolved) for resolved in _values(material)])[material.part]


def is_rough(material: Material | ByPart) -> bool:
    """Whether any of the materials scatters diffusely; materials by part must be resolved."""
    return any(one.scattering_coefficient > 0 for one in _values(material))


def _values(material: Material | ByPart) -> tuple[Material, ...]:
    """The materials of a surface, resolved."""
    materials = (material,) if isinstance(material, Material) else material.materials
    names = [name for name in materials if not isinstance(name, Material)]
    if names:
        raise InputError(f"materials by part must be Materials here, got the names {shown(names)}; resolve them first")
    return cast(tuple[Material, ...], materials)


def checked_material(material: Any) -> str | Material:
    """A checked material: the name of one, or a `Material`."""
    if not isinstance(material, (str, Material)) or (isinstance(material, str) and not 0 < len(material) <= 200):
        raise InputError(f"material must be a name or a Material, got {shown(material)}; 'skin' is a body's")
    return material


def known_material(noun: str, material: Any, *, others: Collection[str] = ()) -> str | Material:
    """A checked material: a `Material`, or the name of a material of bodies, of ITU-R P.2040 or of `others`; refuses any other
    name, which the error calls by this noun."""
    names = (*others, *BODY_NAMES, *ITU_NAMES)
    if isinstance(checked_material(material), str) and material not in names and short_name(material) not in ITU_NAMES:
        raise unknown_name(noun, material, names, hint=", or give a Material")
    return cast(str | Material, material)


def checked_materials(material: Any, count: int) -> str | Material | ByPart:
    """The checked material of a surface, or the materials of its parts, to which its `count` faces or ellipsoids must be
    assigned."""
    if not isinstance(material, ByPart):
        return checked_material(material)
    if len(material.part) != count:
        raise InputError(f"part must hold a number for each of {count} faces or ellipsoids, got {len(material.part)}")
    return material


def short_name(name: str) -> str:
    """The name of an ITU material as P.2040 writes it: "itu_concrete" is "concrete"."""
    return name.removeprefix("itu_").replace("-", "_")


def known_itu(name: str) -> str:
    """The name of an ITU material; raises an InputError for any other."""
    if name not in ITU_NAMES:
        raise InputError(f"unknown material {shown(name)}; ITU names are {', '.join(ITU_NAMES)}")
    return name


def materials_by_name(materials: Any) -> Mapping[str, str | Material]:
    """Substitutes for a scene's materials by name, each a name or a `Material`; an empty mapping for None."""
    by_name = {} if materials is None else materials
    if not isinstance(by_name, Mapping) or not all(
        isinstance(name, str) and isinstance(material, str | Material) for name, material in by_name.items()
    ):
        raise InputError(f'materials must be a mapping like {{"brick": "concrete"}}, got {shown(materials)}')
    return by_name


def checked_frequency(frequency_hz: Any) -> float:
    """A checked frequency [Hz], between radio and light."""
    return number("frequency_hz", frequency_hz, 1, 1e15, unit="Hz", hint="77e9 is 77 GHz")


PEC = Material(name="pec", relative_permittivity=math.inf)
"""Perfect conductor, smooth."""


ABSORBER = Material(name="absorber", relative_permittivity=1.0, conductivity_s_per_m=0.25)
"""Material that absorbs and does not reflect: a slab of 10 cm attenuates by 40 dB, and paths end at it (`absorbs`)."""

BODY_NAMES = "pec", "skin", "clothed", "shoe"
"""Materials of bodies; `body.materials` has their values."""

THING_NAMES = "plastic", "fabric"
"""Materials of movers and of what is carried; `scene.movers.solids` has their values."""

ITU_NAMES = (
    "asphalt_concrete", "brick", "carpet_tile", "ceiling_board", "chipboard", "clear_acrylic", "concrete", "floorboard", "glass",
    "marble", "medium_dry_ground", "metal", "plasterboard", "plywood", "vacuum", "very_dry_ground", "vinyl_tile", "wet_ground",
    "wood",
)  # fmt: skip
"""Materials of ITU-R P.2040; `propagation.materials` has their values."""

THICKNESS_M = {
    "wood": 0.02,
    "chipboard": 0.018,
    "plasterboard": 0.0125,
    "glass": 0.006,
    "metal": 0.001,
    "ceiling_board": 0.015,
    "floorboard": 0.02,
    "concrete": 0.2,
}
"""Thickness [m] of furniture, and of walls without a thickness of their own, by their material."""


def absorbs(material: str | Material) -> bool:
    """Whether a material is the absorber, with any scattering coefficient, at which paths end."""
    return isinstance(material, Material) and replace(material, scattering_coefficient=0.0) == ABSORBER
