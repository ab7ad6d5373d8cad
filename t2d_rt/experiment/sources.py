"""Sources of an experiment's targets and scene, as plain data; arrays to which they refer are stored beside them (`inputs`)."""

from __future__ import annotations

import functools
import inspect
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, cast

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    field_validator,
)

from t2d_rt.body.outfit import Outfit
from t2d_rt.core.checks import names_advice, shown
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.stored_arrays import Hash, Inputs, Store, named_arrays
from t2d_rt.experiment.catalog import found_from, motion_path
from t2d_rt.motion import aside, load_motion, place, trim
from t2d_rt.motion.carriers import wishes_of
from t2d_rt.motion.carry import carry
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate import COMPOSED, LONGEST_S, motion_from_text, understood
from t2d_rt.motion.vary import arc, hold, vary_gait
from t2d_rt.pipeline.targets import TargetLike, segments, skin
from t2d_rt.scene import CeilingFan, Curtain, Door, Mover, OwnMover, Pet, TableFan, mover
from t2d_rt.scene.movers import KINDS, kind_names
from t2d_rt.types import ByPart, Ellipsoids, Material, Motion, MovingMesh, Radar, Scene
from t2d_rt.types.carried import Carried
from t2d_rt.types.fields import Count, Fields, Number, later
from t2d_rt.types.motion import Breathing, Heartbeat

Substance = str | Material
Fraction = Annotated[Number, Field(ge=-1e6, le=1e6)]


class Plain(Fields):
    """Base of sources: plain data that YAML and JSON can hold."""

    model_config = ConfigDict(ser_json_inf_nan="constants")


def _things(value: Any) -> Any:
    """Checked list of the things that a person carries; a single thing becomes a list."""
    things = (value,) if isinstance(value, (str, Mapping)) else value
    if not isinstance(things, (list, tuple)):
        raise InputError(f'carries must be a text such as "bag", a mapping or a list of them, got {shown(value)}')
    for thing in things:
        wishes_of(thing)
    return things


Things = Annotated[tuple[str | dict[str, Any], ...], BeforeValidator(_things)]
"""What a person carries: texts as "bag" or "cane in the left hand", or mappings as {thing: box, size_m: [0.2, 0.3, 0.2]}."""


class _Placed(Plain):
    """Fields of a motion that is cut and placed before the radar."""

    model_config = ConfigDict(use_attribute_docstrings=True)  # options of the command line
    noun: ClassVar[str] = "motion"

    kind: str
    start_s: Fraction = 0.0
    """First instant of the motion that is used [s]."""
    stop_s: Fraction | None = None
    """Last instant of the motion that is used [s]; all of it by default."""
    distance_m: Fraction | None = None
    """Range of the start [m]; by default the closest approach is 1.5 m."""
    angle_deg: Fraction = 0.0
    """Angle of the walk against the line to the radar [deg]."""
    aside_m: Fraction = 0.0
    """How far left of the line along the boresight the motion starts, as the radar sees it [m]."""
    carries: Things = later(())
    """What the person carries: a text as "bag" or "cane in the left hand", or a mapping as {thing: box, size_m: [0.2, 0.3, 0.2]} in
    an experiment. The command line has the option once for each."""

    def cut(self, motion: Motion) -> Motion:
        """The piece of a motion that is used."""
        self._tell_of_end(motion)
        return self._trimmed(motion)

    def _tell_of_end(self, motion: Motion) -> None:
        end = motion.duration_s
        if self.stop_s is not None and self.stop_s > end:
            warn(f"the motion ends at {end:.6g} s, before stop_s of {self.stop_s:g} s; it is used to its end")

    def _trimmed(self, motion: Motion) -> Motion:
        if self.start_s or self.stop_s is not None:
            end = motion.duration_s
            return trim(motion, self.start_s, end if self.stop_s is None else min(self.stop_s, end))
        return motion

    def placed(self, motion: Motion, radar: Radar) -> Motion:
        """The piece of a motion that is used, placed before the radar."""
        return self.put(self.cut(motion), radar)

    def put(self, piece: Motion, radar: Radar) -> Motion:
        """A piece with what the person carries, placed before the radar."""
        motion = place(
            carry(piece, self.carries),
            distance_m=self.distance_m,
            angle_deg=self.angle_deg,
            radar_position_m=radar.position_m,
            boresight=radar.boresight,
        )
        return aside(motion, self.aside_m, radar.boresight) if self.aside_m else motion


class MotionFile(_Placed):
    """A motion that is read from a file."""

    if_missing: ClassVar[str] = "write file: walk.bvh, or person:walk.bvh on the command line"

    kind: Literal["file"] = "file"
    file: str
    """Path, in a YAML file relative to its folder; or the name of a bundled motion."""
    subject: str | None = None
    """Name of the person to take from a file with several persons; by default the first whose data is complete."""
    reading: dict[str, Any] = later({})
    """Further options of `load_motion`, such as {units: cm, up: z}; options that are not given are detected."""

    @field_validator("reading")
    @classmethod
    def _options_of_reading(cls, value: dict[str, Any]) -> dict[str, Any]:
        option_names = [name for name in inspect.signature(load_motion).parameters if name not in ("path", "subject")]
        for name in value:
            if name not in option_names:
                raise InputError(f"unknown option of reading {shown(name)}; {names_advice(name, option_names)}")
        return value

    def read(self) -> Motion:
        """Reads the motion from its file; what the reader found is logged."""
        motion = load_motion(motion_path(self.file), subject=self.subject, **self.reading)
        logging.getLogger("t2d_rt.motion").info(motion.report)
        return motion


NOWHERE: Mapping[str, object] = {"distance_m": None, "angle_deg": 0.0, "aside_m": 0.0, "carries": ()}
"""Values of the placement fields of a motion that is not placed and carries nothing."""
WHOLE: Mapping[str, object] = {"start_s": 0.0, "stop_s": None, "radius_m": 0.0}
"""Values of the fields of a motion that is neither cut nor bent."""


class MotionText(_Placed):
    """A motion that is made from a sentence."""

    kind: Literal["text"] = "text"
    text: str
    """What a person does, as "a person walks slowly forward, slips and falls backward"."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Seed of all random choices: person, clips, speed."""
    provider: str = "auto"
    """How it is made: auto, library, physics, momask, or files:FOLDER, in a YAML file relative to its folder."""
    body: str | None = None
    """Body whose proportions are taken; by default one that suits the subject."""
    stature_m: Number | None = None
    """Stature of the person [m]; by default drawn for the subject."""
    person_seed: Annotated[Count, Field(ge=0)] | None = later(None)
    """Seed of the person alone, that is of proportions, handedness, posture, tempo and breathing; by default the other one."""
    duration_s: Number | None = None
    """Duration of the main action [s], where the sentence says nothing of it."""
    gait_factor: Number = 1.0
    """Factor on the walking speed, applied step by step."""
    gait_spread: Number = 0.0
    """Standard deviation of the logarithm of an additional random factor for each step."""
    hold_s: Annotated[Number, Field(ge=0, le=LONGEST_S)] = 0.0
    """Time for which the last pose is held, before the motion is cut [s]."""
    stand_s: Annotated[Number, Field(ge=0, le=LONGEST_S)] = later(0.0)
    """Time for which the person stands after everything that the text says [s]."""
    radius_m: Fraction = later(0.0)
    """Radius of the arc to which the path of the piece is bent [m], to the left if positive; 0 leaves the path as it is."""

    def made(self) -> Motion:
        """The motion before it is held, cut and placed."""
        if self.provider not in COMPOSED:  # what those read may have changed
            return _generated(self)
        return _composed(self.model_copy(update={**NOWHERE, **WHOLE, "hold_s": 0.0}))

    def cut(self, motion: Motion) -> Motion:
        """The piece of a motion that is used, with its last pose held and its path bent."""
        held = self._held(motion)
        self._tell_of_end(held)
        return self._bent(held)

    def piece(self, made: Motion | None = None) -> Motion:
        """The result of `cut`; `made` saves making the motion where the caller has it. The last few are cached: a data set judges
        several pieces of a motion and then simulates one of them."""
        if self.provider not in COMPOSED:
            return self.cut(self.made() if made is None else made)
        self._tell_of_end(_piece(self.model_copy(update={**NOWHERE, **WHOLE})))
        return _piece(self.model_copy(update=NOWHERE))

    def _held(self, motion: Motion) -> Motion:
        return hold(motion, self.hold_s, sway_seed=self.seed) if self.hold_s else motion

    def _bent(self, motion: Motion) -> Motion:
        piece = self._trimmed(motion)
        return arc(piece, self.radius_m) if self.radius_m else piece


def _generated(source: MotionText) -> Motion:
    description = understood(source.text)[0]
    if source.stand_s:
        stand = Step(action="stand", duration_s=source.stand_s)
        description = description.model_copy(update={"after": (*description.after, stand)})
    motion = motion_from_text(
        description,
        provider=source.provider,
        seed=source.seed,
        body=source.body,
        stature_m=source.stature_m,
        person_seed=source.person_seed,
        duration_s=source.duration_s,
    )
    if source.gait_factor == 1.0 and source.gait_spread == 0.0:
        return motion
    return vary_gait(motion, source.gait_factor, spread=source.gait_spread, seed=source.seed)


_composed = functools.lru_cache(maxsize=8)(_generated)
"""The last few are cached: a data set inspects a motion before it simulates it, perhaps under several conditions."""


@functools.lru_cache(maxsize=8)
def _piece(source: MotionText) -> Motion:
    """The piece of a motion, not placed; all pieces are cut from the held motion, which is computed once."""
    whole = source.model_copy(update=WHOLE)
    return source._held(source.made()) if source == whole else source._bent(_piece(whole))


class MotionArrays(Plain):
    """A motion whose joints are stored as arrays."""

    noun: ClassVar[str] = "motion"

    kind: Literal["motion"] = "motion"
    input: Hash
    """Hash of the arrays `joints` and `rotations`."""
    rate_hz: Number
    names: tuple[str, ...]
    parents: tuple[int, ...]
    placed: bool | None
    report: str
    """What the reader found in the file, and how the motion was placed, as text."""
    origin: tuple[str, ...] = ()
    """The file's name and the SHA-256 of its content, then each edit made since."""
    activities: tuple[tuple[str, Number], ...] = later(())
    """What the person does, and from when on [s]."""
    breathing: Breathing | None = later(None)
    """How the person breathes; None for a motion without breathing."""
    heartbeat: Heartbeat | None = later(None)
    """How the person's heart moves the skin; None where it does not."""
    carries: tuple[Carried, ...] = later(())
    """What the person carries."""


class BodyMesh(Plain):
    """The mesh of a body, skinned from a motion."""

    noun: ClassVar[str] = "body"

    kind: Literal["skin", "segments"]
    motion: MotionArrays
    body: str
    material: Substance | Outfit


class MoverMesh(Plain):
    """The mesh of a mover between two times."""

    noun: ClassVar[str] = "mover's mesh"

    kind: Literal["mover_mesh"] = "mover_mesh"
    mover: Annotated[TableFan | CeilingFan | Curtain | Door | Pet, Discriminator("kind")]
    start_s: Number
    stop_s: Number


class OtherMover(Plain):
    """A mover that another package defines, by its fields."""

    noun: ClassVar[str] = "mover"

    kind: Literal["mover"] = "mover"
    fields: dict[str, Any]
    """Fields of the mover, with `kind` among them."""


class MeshArrays(Plain):
    """A mesh of the user with stored vertices."""

    noun: ClassVar[str] = "mesh"

    kind: Literal["mesh"] = "mesh"
    input: Hash
    """Hash of the arrays `vertices`, `faces`, `times_s` and `sagitta_rad`, and `part` if the mesh has several materials."""
    material: Substance | tuple[Substance, ...]
    crease_deg: Number
    curved: bool = False
    name: str


class EllipsoidArrays(Plain):
    """Ellipsoids of the user with stored positions."""

    noun: ClassVar[str] = "ellipsoids"

    kind: Literal["ellipsoids"] = "ellipsoids"
    input: Hash
    """Hash of the arrays `semi_axes_m`, `centres`, `axes` and `times_s`, and `part` if there are several materials."""
    material: Substance | tuple[Substance, ...]
    names: tuple[str, ...]


class Unknown(Plain):
    """A target that a function of the user computes: it cannot be stored, so the recording cannot be repeated."""

    noun: ClassVar[str] = "target"

    kind: Literal["unknown"] = "unknown"
    description: str


class StoredSurface(Plain):
    """One surface of a stored scene; its vertices and faces are consecutive parts of the scene's arrays."""

    noun: ClassVar[str] = "surface"

    name: str
    material: Substance
    thickness_m: Number
    vertices: Count
    """Number of the scene's vertices that belong to this surface."""
    faces: Count
    """Number of the scene's faces that belong to this surface."""


class StoredScene(Plain):
    """A scene whose surfaces are stored as arrays."""

    noun: ClassVar[str] = "scene"

    name: str
    input: Hash
    """Hash of the arrays `vertices` and `faces`, which hold all surfaces."""
    surfaces: tuple[StoredSurface, ...]


class SceneFile(Plain):
    """A scene from a file, with substitutes for its materials."""

    noun: ClassVar[str] = "scene"

    file: str
    """Path of an XML file or a mesh (.obj, .ply, .glb), in a YAML file relative to its folder; or a room by name."""
    materials: dict[str, Substance] = Field(default_factory=dict)
    """Substitutes by the names of what they stand for, as {brick: concrete}; of a mesh, materials of its objects, as
    {door: wood 0.04}."""
    units: Number | str | None = later(None)
    """Unit of a mesh, as a number of metres or a name; metres by default."""
    up: str | None = later(None)
    """Upward axis of a mesh, y or z; found by default."""


Source = Annotated[
    MotionFile
    | MotionText
    | MotionArrays
    | BodyMesh
    | MoverMesh
    | MeshArrays
    | EllipsoidArrays
    | Unknown
    | OtherMover
    | TableFan
    | CeilingFan
    | Curtain
    | Door
    | Pet,
    Discriminator("kind"),
]
"""A source of a target; `kind` distinguishes them."""
MOTION_FIELDS = (
    "rate_hz", "names", "parents", "placed", "report", "origin", "activities", "breathing", "heartbeat", "carries",
)  # fmt: skip
"""Fields of a `Motion`, except its arrays, that are stored unchanged."""
MESH_FIELDS = "crease_deg", "curved", "name"
"""Fields of a `MovingMesh`, except its arrays, that are stored unchanged."""
OWN_KINDS = "file", "text", "motion", "skin", "segments", "mover_mesh", "mesh", "ellipsoids", "unknown", "mover"
"""Kinds of sources that are not movers."""


def with_others(source: Any) -> Any:
    """Converts a mover of another package, or a mapping of its fields, to the source that is stored; returns anything else
    unchanged."""
    if isinstance(source, OwnMover):
        return OtherMover(fields=source.model_dump(mode="json"))
    kind = source.get("kind") if isinstance(source, Mapping) else None
    if not isinstance(kind, str) or kind in (*KINDS, *OWN_KINDS) or kind not in kind_names():
        return source
    return OtherMover(fields=mover(source).model_dump(mode="json"))


def file_beside(value: Any, folder: Path, endings: tuple[str, ...]) -> Any:
    """The path of a file with one of these endings relative to a folder; anything else unchanged."""
    return str(folder / value) if isinstance(value, str) and value.lower().endswith(endings) else value


def found_beside(source: Any, folder: Path) -> Any:
    """A source whose file, or folder of results, is given relative to a folder, with its path resolved."""
    if isinstance(source, MotionFile):
        return source.model_copy(update={"file": str(found_from(folder, source.file))})
    if isinstance(source, MotionText) and source.provider.startswith("files:"):
        results = folder / source.provider.removeprefix("files:")
        return source.model_copy(update={"provider": f"files:{results}"})
    return source


def stored_scene(scene: Scene | None, store: Store) -> str | StoredScene:
    """A scene in its stored form; its arrays go into the store."""
    if scene is None:
        return "free_space"
    surfaces = scene.surfaces
    key = store.keep(
        vertices=np.concatenate([surface.vertices for surface in surfaces]),
        faces=np.concatenate([surface.faces for surface in surfaces]),
    )
    stored = tuple(
        StoredSurface(
            name=surface.name,
            material=surface.material,
            thickness_m=float(surface.thickness_m),
            vertices=len(surface.vertices),
            faces=len(surface.faces),
        )
        for surface in surfaces
    )
    return StoredScene(name=scene.name, input=key, surfaces=stored)


def source_of(target: TargetLike, store: Store) -> Any:
    """The source of a target in its stored form; its arrays go into the store."""
    if isinstance(target, OwnMover):
        return OtherMover(fields=target.model_dump(mode="json"))
    if isinstance(target, Mover):
        return target
    if isinstance(target, Motion):
        key = store.keep(joints=target.joints, rotations=target.rotations)
        return MotionArrays(input=key, **{name: getattr(target, name) for name in MOTION_FIELDS})
    made = target.made
    if made is not None and made.by == "mover":
        return MoverMesh(**made.arguments)
    if made is not None and made.by in ("skin", "segments"):
        return BodyMesh(kind=made.by, **{**made.arguments, "motion": source_of(made.arguments["motion"], store)})
    if made is None or made.by != "arrays":
        return Unknown(description=repr(target))
    target_material, part = target.material, dict[str, np.ndarray]()
    if isinstance(target_material, ByPart):
        part["part"] = target_material.part
    material = target_material.materials if isinstance(target_material, ByPart) else target_material
    if isinstance(target, MovingMesh):
        sagitta = np.asarray(target.sagitta_rad, float)
        key = store.keep(**made.arguments, faces=target.faces, times_s=target.times_s, sagitta_rad=sagitta, **part)
        return MeshArrays(input=key, material=material, **{name: getattr(target, name) for name in MESH_FIELDS})
    key = store.keep(**made.arguments, semi_axes_m=target.semi_axes_m, times_s=target.times_s, **part)
    return EllipsoidArrays(input=key, material=material, names=target.names)


def target_from(source: Any, inputs: Inputs, radar: Radar) -> TargetLike:
    """The target that a source describes."""
    if isinstance(source, OtherMover):
        return mover(source.fields)
    if isinstance(source, Mover):
        return source
    if isinstance(source, MotionFile):
        return source.placed(source.read(), radar)
    if isinstance(source, MotionText):
        return source.put(source.piece(), radar)
    if isinstance(source, MotionArrays):
        arrays = named_arrays(inputs, source.input, ("joints", "rotations"))
        motion_fields: dict[str, Any] = {name: getattr(source, name) for name in MOTION_FIELDS}
        return Motion(joints=arrays["joints"], rotations=arrays["rotations"], **motion_fields)
    if isinstance(source, BodyMesh):
        motion = cast(Motion, target_from(source.motion, inputs, radar))
        return (skin if source.kind == "skin" else segments)(motion, source.body, material=source.material)
    if isinstance(source, MoverMesh):
        return source.mover.mesh(source.start_s, source.stop_s)
    if isinstance(source, MeshArrays):
        arrays, material = _with_material(source, inputs, ("vertices", "faces", "times_s", "sagitta_rad"))
        sagitta = arrays.pop("sagitta_rad")
        fields: dict[str, Any] = arrays | {name: getattr(source, name) for name in MESH_FIELDS} | {"material": material}
        return MovingMesh(**fields, sagitta_rad=sagitta if sagitta.ndim else float(sagitta))
    if isinstance(source, EllipsoidArrays):
        arrays, material = _with_material(source, inputs, ("semi_axes_m", "centres", "axes", "times_s"))
        return Ellipsoids(**arrays, material=material, names=source.names)
    raise InputError(f"{source.description} was computed by a function and is not stored; give it again")


def _with_material(
    source: MeshArrays | EllipsoidArrays, inputs: Inputs, names: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], str | Material | ByPart]:
    """The stored arrays of these names, and the material or materials of the surface."""
    if not isinstance(source.material, tuple):
        return named_arrays(inputs, source.input, names), source.material
    arrays = named_arrays(inputs, source.input, (*names, "part"))
    return arrays, ByPart(source.material, arrays.pop("part"))
