"""`Recipe`: everything that determines a data set, as plain data."""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from t2d_rt.body import template
from t2d_rt.core.checks import unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.dataset.products import Products
from t2d_rt.experiment.catalog import bodies
from t2d_rt.experiment.experiment import FILES, BodyMaterial
from t2d_rt.experiment.sources import Plain, Things
from t2d_rt.motion.carriers import wishes_of
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.noise.masks import OcclusionMask
from t2d_rt.pipeline.path_pairs import Clutter
from t2d_rt.propagation.scenes import SceneFile
from t2d_rt.signal.range import RangeGate
from t2d_rt.types import Accuracy, Radar, Receiver
from t2d_rt.types.ellipsoids import Method
from t2d_rt.types.fields import Count, Decibel, Fields, Number, later

FOLDER = Path(__file__).resolve().parent / "recipes"

BODY_KINDS = 6
"""Number of kinds of bodies, which subjects take in turn."""
OWN_BODY = "own"
"""Stands for a body's name: the body that suits the subject of the description."""

Beside = Literal["none", "fan", "curtain", "pet", "person"]
"""What moves in addition to the person."""


def _plain_name(value: str) -> str:
    if not re.fullmatch(r"[a-z0-9][a-z0-9_-]{0,63}", value):
        raise ValueError("a name has up to 64 small letters, digits, dashes and underscores")
    return value


def _named_radar(value: Any) -> Any:
    """The fields of a preset that is given by its name."""
    return Radar.preset(value) if isinstance(value, str) else value


NamedRadar = Annotated[Radar, BeforeValidator(_named_radar)]
Name = Annotated[str, AfterValidator(_plain_name)]
Many = Annotated[Count, Field(ge=1, le=1_000_000)]


WALKS: frozenset[Activity] = frozenset({"walking", "abnormal_walking"})
CARRIED_IN: Mapping[str, frozenset[Activity]] = {
    **dict.fromkeys(("ball", "backpack"), frozenset(ACTIVITIES) - {"falling"}),
    **dict.fromkeys(("bag", "box"), frozenset(ACTIVITIES) - {"falling", "sitting"}),
    **dict.fromkeys(("cane", "crutch", "walker", "wheelchair"), WALKS),
}
"""Classes in which a person may carry each thing. Hanging or hand-held things would touch the floor where people fall or sit
there."""


class Condition(Plain):
    """Conditions of a recording: scene, scattering model, radar, what people wear and carry, and what moves beside the person."""

    noun: ClassVar[str] = "condition"
    model_config = ConfigDict(use_attribute_docstrings=True)

    name: Name
    """Name by which records of its samples call the condition."""
    scene: str = "free_space"
    """"free_space", a room by name, or the path of an XML file or of a mesh."""
    method: Method = "mesh"
    """Scattering model of the bodies: "mesh" or "ellipsoid"."""
    radar: NamedRadar | None = None
    """Its fields or the name of a preset, in place of the recipe's radar."""
    beside: Beside = "none"
    """What moves beside the person: a "fan", a "curtain", a "pet" or a second "person", placed by chance, or "none"."""
    material: BodyMaterial = later(None)
    """Material of people, or an outfit that they wear, as "dressed", as in an experiment; by default each one's own."""
    carries: Things = later(())
    """What the person carries, as in an experiment: [bag, {thing: cane, hand: left}]. Motions that cannot are made anew; classes
    that hardly ever can are refused."""
    reflections: Annotated[Count, Field(ge=0, le=4)] = 2
    """Greatest number of reflections on the paths out and back together."""
    clutter: Clutter = "specular"
    """Echoes of the static scene: "specular", "diffuse" or "none"."""
    tolerance_db: Annotated[Number, Field(ge=-60, le=0)] | None = None
    """Greatest field error [dB], for which one plan is made for each class; by default there is no plan."""
    accuracy: Accuracy | None = None
    """How finely targets are modelled; with a tolerance the fields that it sets are kept."""
    weight: Annotated[Number, Field(gt=0, le=1e6)] = 1.0
    """Weight with which the condition is drawn, relative to the others."""

    def __hash__(self) -> int:
        return hash(self.name)  # things may be mappings, which have no hash


class Side(Fields):
    """A side of a split that a recipe defines: it has its own descriptions and subjects, and optionally its own conditions and
    views."""

    noun: ClassVar[str] = "side"
    model_config = ConfigDict(use_attribute_docstrings=True)

    name: Literal["train", "val", "test"]
    weight: Annotated[Count, Field(ge=1, le=1000)]
    """Weight of the side: how many descriptions of a class, and subjects of a kind, belong to it, of as many as all weights add up
    to."""
    conditions: Annotated[tuple[Name, ...], Field(min_length=1, max_length=1000)]
    """Names of the conditions under which its samples are recorded."""
    angles_deg: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1, max_length=100)]
    """Ranges of the angle, as in `angles_deg` of the recipe, from which it is drawn uniformly [deg]."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        for low, high in self.angles_deg:
            if not LIMITS["angles_deg"][0] <= low < high <= LIMITS["angles_deg"][1]:
                raise InputError(f"angles_deg of side {self.name} must rise within -360..360, got [{low:g}, {high:g}]")
        return self


class Recipe(Fields):
    """A data set: its descriptions, how their motions are varied and recorded, and which products are stored."""

    noun: ClassVar[str] = "recipe"
    written: ClassVar[Mapping[str, str]] = {
        "classes": "a list, as in [walking, falling]",
        "conditions": "a list of mappings with a name, as in [{name: mesh, method: mesh}]",
    }
    model_config = ConfigDict(use_attribute_docstrings=True)

    name: Name
    """Name of the recipe."""
    about: str = ""
    """Purpose of the recipe in a sentence; nothing depends on it."""
    classes: Annotated[tuple[Activity, ...], Field(min_length=1, max_length=len(ACTIVITIES))] = ACTIVITIES
    """Classes of the samples, in the order in which they alternate."""
    descriptions_per_class: Annotated[Count, Field(ge=1, le=10_000)]
    """Number of different descriptions for each class, made by the grammar."""
    samples_per_description: Many
    """Number of motions for each description, each with another person, view and gait."""
    providers: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)] = ("auto",)
    """Providers of motions; one is drawn for each motion, so that one that is listed twice is twice as likely."""
    bodies: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)] = (OWN_BODY,)
    """Bodies, drawn likewise; "own" is the body that suits the subject of the description."""
    subjects: Annotated[Count, Field(ge=BODY_KINDS, le=100_000)] | None = None
    """Number of persons, each of whom has the same body, stature, gait and breathing in many samples; by default every motion is
    that of another person."""
    angles_deg: tuple[Number, Number] = (-180.0, 180.0)
    """Least and greatest angle of the motion's main direction against the line to the radar [deg]; at 0 the person comes nearer."""
    heights_m: tuple[Number, Number] = (1.0, 1.0)
    """Least and greatest height of the radar [m]."""
    distances_m: tuple[Number, Number] = (2.5, 5.0)
    """Least and greatest mean range of the person [m]."""
    moving_fractions: tuple[Number, Number] = (0.6, 0.8)
    """Least and greatest fraction of a record during which the person moves, as far as the motion has such a piece."""
    gait_factors: tuple[Number, Number] = (1.0, 1.0)
    """Least and greatest tempo of the motion, relative to what was made."""
    gait_spread: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Standard deviation of the logarithm of an additional random tempo for each step."""
    attempts: Annotated[Count, Field(ge=1, le=20)] = 3
    """Number of motions with different seeds that are made until one passes the filter; if none does, the first one is used."""
    radar: NamedRadar
    """Fields of a radar, or the name of a preset."""
    noise: Literal["none", "receiver"] | Receiver = "receiver"
    """What the receiver adds: "receiver" is typical of each radar's band, "none" nothing, or the fields of a receiver."""
    background: str | None = None
    """Learned background that is added to the spectrogram: "default", or the file of a model (.safetensors)."""
    background_level_db: Decibel | None = None
    """Level of its noise floor [dB re 1 W]; by default that of one of the recordings that it was learned from."""
    masks: OcclusionMask | None = None
    """Time windows of the spectrogram that are occluded: they show only the background, or nothing if there is none."""
    conditions: Annotated[tuple[Condition, ...], Field(min_length=1, max_length=1000)]
    """Conditions under which motions are recorded."""
    sides: Annotated[tuple[Side, ...], Field(max_length=3)] = ()
    """Train, val and test sides that share no description, motion or subject; none by default."""
    frozen: tuple[tuple[Count, Annotated[str, Field(pattern="^[0-9a-f]{64}$")]], ...] = ()
    """Numbers of first samples, each with their `content_hash`, which `dataset check` compares; no sample depends on it."""
    each_condition: bool = False
    """Whether every motion is recorded under each condition; by default one is drawn for it."""
    duration_s: Annotated[Number, Field(ge=0.7, le=60)] = 5.0
    """Length of every record [s]: longer motions are cut, shorter ones held at their end."""
    products: Products = Products()
    """Products that are stored of each recording."""
    error_fraction: Annotated[Number, Field(ge=0, le=1)] = 0.0
    """Fraction of the samples whose field error is measured."""
    samples_per_shard: Annotated[Count, Field(ge=1, le=10_000)] = 32
    """Number of samples in a file."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Seed of all random draws."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuses fields that are valid by themselves but contradict one another or what is shipped."""
        for name, (low, high) in LIMITS.items():
            least, greatest = getattr(self, name)
            if not low <= least <= greatest <= high:
                raise InputError(
                    f"recipe key {name} must be two numbers, least and greatest, within {low:g}..{high:g}, got "
                    f"[{least:g}, {greatest:g}]"
                )
        if isinstance(self.noise, Receiver) and self.noise.seed is not None:
            raise InputError(
                f"recipe key noise has seed {self.noise.seed}, so that all samples would have the same noise; leave it out"
            )
        if self.background_level_db is not None and self.background is None:
            raise InputError("recipe key background_level_db belongs to a background; give background, too")
        for key, names in (
            ("classes", self.classes),
            ("conditions", [condition.name for condition in self.conditions]),
        ):
            if len(set(names)) < len(names):
                raise InputError(f"recipe key {key} names one of them twice; give each once")
        if self.subjects is not None and self.bodies != (OWN_BODY,):
            raise InputError("recipe key subjects gives each person a body of their own; leave bodies out")
        if any(
            radar is not None and radar.track is not None
            for radar in (self.radar, *(condition.radar for condition in self.conditions))
        ):
            raise InputError("recipe key radar has a track, and radars of data sets stand still; leave it out")
        self._check_sides()
        self._check_things()
        gate = self.products.spectrogram.range_gate_m if self.products.spectrogram else None
        if isinstance(gate, tuple):
            for radar in {
                self.radar,
                *(condition.radar for condition in self.conditions if condition.radar is not None),
            }:
                RangeGate.of(radar, gate)  # raises an error for a gate without a range cell
        for body in self.bodies:
            if body != OWN_BODY and "@" in body:
                template(body)  # raises an error for an unknown body, and for a body mass index that it cannot have
            elif body != OWN_BODY and body not in bodies():
                raise unknown_name("body", body, (OWN_BODY, *bodies()))
        return self

    def _check_things(self) -> None:
        """Refuses things that people of a class cannot carry."""
        for condition in self.conditions:
            for wish in [wish for carried in condition.carries for wish in wishes_of(carried)]:
                allowed = [name for name in ACTIVITIES if name in CARRIED_IN[wish.thing]]
                if wrong := [name for name in self.classes if name not in allowed]:
                    raise InputError(
                        f"condition {condition.name} has people carry a {wish.thing}, which {wrong[0]} leaves no room for; "
                        f"give classes of {', '.join(allowed)}, or leave it out"
                    )

    def _check_sides(self) -> None:
        """Refuses sides that cannot be held apart, or that name unknown conditions."""
        condition_names = [condition.name for condition in self.conditions]
        names = [side.name for side in self.sides]
        for side in self.sides:
            for condition in side.conditions:
                if condition not in condition_names:
                    raise unknown_name(f"condition of side {side.name}", condition, condition_names)
        if names and ("train" not in names or "test" not in names or len(set(names)) < len(names)):
            raise InputError(f"recipe key sides needs train and test, each side once, got {', '.join(names)}")
        if names and (self.subjects is None or self.each_condition):
            raise InputError("recipe key sides needs subjects to hold apart, and no each_condition; change one of them")
        total = sum(side.weight for side in self.sides)
        if names and (total > self.descriptions_per_class or total > (self.subjects or 0) // BODY_KINDS):
            raise InputError(
                f"the weights of the sides add up to {total}, more than descriptions of a class "
                f"({self.descriptions_per_class}) or subjects of a shape ({(self.subjects or 0) // BODY_KINDS}); lower the weights"
            )

    def side_at(self, number: int) -> Side | None:
        """The side of a description, or of a subject among those of one kind, by its number: sides alternate according to their
        weights. None where the recipe has no sides."""
        order = [side for side in self.sides for _ in range(side.weight)]
        return order[number % len(order)] if order else None

    def files(self) -> dict[str, str | None]:
        """Checksums of the files, in addition to the recipe, on which samples depend; None for a missing file."""
        names = {condition.scene for condition in self.conditions if condition.scene.lower().endswith(FILES)}
        names |= {str(mesh) for scene in names if scene.lower().endswith(".xml") for mesh in _meshes(Path(scene))}
        if self.background is not None and self.background.lower().endswith(".safetensors"):
            names.add(self.background)
        return {
            name: hashlib.sha256(Path(name).read_bytes()).hexdigest() if Path(name).is_file() else None
            for name in sorted(names)
        }

    @functools.cached_property
    def hash(self) -> str:
        """Hash of everything on which samples depend; equal recipes have equal hashes. Truth, subjects and sides are left out where
        they are absent."""
        return _hash(self.model_dump(mode="json"))

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some fields changed; its hash is computed anew."""
        copy = super().model_copy(update=update, deep=deep)
        if update:
            copy.__dict__.pop("hash", None)
        return copy

    def hashed_as(self, written: str) -> Self:
        """A copy with the hash that an older version gave the recipe, from which its samples were seeded."""
        copy = super().model_copy()
        copy.__dict__["hash"] = written  # where functools.cached_property stores it
        return copy

    def seeds(self, number: int, purpose: str) -> np.random.SeedSequence:
        """Seeds for one purpose, such as "view", of a motion or sample by its number.

        They include the hash of the recipe, so that data sets of two recipes with the same seed are independent.
        """
        words = [int(self.hash[at : at + 8], 16) for at in range(0, len(self.hash), 8)]
        return np.random.SeedSequence([self.seed, *words, number, *purpose.encode()])

    @property
    def motions(self) -> int:
        """Number of motions."""
        return len(self.classes) * self.descriptions_per_class * self.samples_per_description

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.motions * (len(self.conditions) if self.each_condition else 1)

    def to_yaml(self) -> str:
        """YAML text from which `read` restores the recipe."""
        return self.yaml_text()

    @classmethod
    def read(cls, source: str | Path) -> Recipe:
        """A shipped recipe by its name, or one from a YAML file."""
        path = Path(source)
        if path.suffix.lower() not in (".yaml", ".yml"):
            shipped = recipe_names()
            name = str(source).lower().replace("_", "-")
            if name not in shipped:
                raise unknown_name("recipe", str(source), shipped, hint=", or give a YAML file")
            path = FOLDER / f"{name}.yaml"
        values = read_yaml(path, noun="recipe", example="classes, conditions and a radar")
        return cls.of_file(path, {"name": path.stem.lower(), **values})._beside(path.parent)

    def _beside(self, folder: Path) -> Recipe:
        """The recipe with full paths of scenes and models that are files, which are given relative to the folder of the recipe."""
        scenes = [_whole(folder, condition.scene, FILES) for condition in self.conditions]
        conditions = tuple(
            condition.model_copy(update={"scene": scene})
            for condition, scene in zip(self.conditions, scenes, strict=True)
        )
        background = None if self.background is None else _whole(folder, self.background, ".safetensors")
        return self.model_copy(update={"conditions": conditions, "background": background})


def _whole(folder: Path, name: str, ending: str | tuple[str, ...]) -> str:
    """The full path of a file with such an ending, relative to a folder; other names unchanged."""
    return str((folder / name).resolve()) if name.lower().endswith(ending) else name


def _meshes(scene: Path) -> list[Path]:
    """Files of the meshes that a scene's XML file names; none if that file does not exist."""
    if not scene.is_file():
        return []
    file = SceneFile(scene)
    try:
        values = [string.get("value", "") for element in file.read() for string in element.iter("string")]
        return [file.inside(name) for name in values if name.lower().endswith((".ply", ".obj"))]
    except InputError as error:
        raise InputError(f"{scene}: {error}") from None


LIMITS = {
    "angles_deg": (-360.0, 360.0),
    "heights_m": (0.05, 10.0),
    "distances_m": (0.5, 100.0),
    "moving_fractions": (0.0, 1.0),
    "gait_factors": (0.25, 4.0),
}
"""Least and greatest value of each range of a recipe."""


def _hash(values: dict[str, Any]) -> str:
    """Hash of a recipe's plain values; absent fields are treated as in versions that did not have them."""
    hashed = {name: value for name, value in values.items() if name not in ("name", "about", "frozen")}
    if hashed.get("products", {}).get("truth") is None:
        hashed["products"] = {name: value for name, value in hashed["products"].items() if name != "truth"}
    for name in ("subjects", "sides"):
        if not hashed.get(name):
            hashed.pop(name, None)
    return hashlib.sha256(json.dumps(hashed, sort_keys=True).encode()).hexdigest()[:32]


def written_hash(path: Path) -> str | None:
    """The hash over the keys with which a data set's recipe was written, perhaps by an older version; None for an incomplete
    recipe."""
    values = read_yaml(path, noun="recipe", example="classes, conditions and a radar")
    return _hash(values) if isinstance(values.get("products"), dict) else None


def integer_seed(sequence: np.random.SeedSequence) -> int:
    """A seed below 2^31, for functions that take integers."""
    return int(sequence.generate_state(1, np.uint32)[0] >> 1)


def recipe_names() -> list[str]:
    """Names of the shipped recipes."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))
