"""`Experiment`: what there is, as plain data, with the arrays that it names kept beside it under the hash of their content."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, cast

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, field_validator

from t2d_rt.errors import InputError
from t2d_rt.files import read_bytes, read_yaml
from t2d_rt.motion import load_motion, place, trim
from t2d_rt.propagation.collisions import Collisions
from t2d_rt.room import Clutter
from t2d_rt.scene import CeilingFan, Curtain, Door, Mover, Pet, TableFan
from t2d_rt.targets import TargetLike, segments, skin
from t2d_rt.types import Ellipsoids, Material, Motion, MovingMesh, Radar, Scene, Surface
from t2d_rt.types.fields import Count, Fields, Number
from t2d_rt.types.target import Method

Inputs = Mapping[str, Mapping[str, np.ndarray]]
"""Arrays by name, by the hash of their content."""
Hash = Annotated[str, Field(pattern=r"[0-9a-f]{32}")]
LARGEST_INPUT_BYTES = 2 * 2**30
"""Of one file of arrays, unpacked."""
Substance = str | Material
Fraction = Annotated[Number, Field(ge=-1e6, le=1e6)]


class _Plain(Fields):
    model_config = ConfigDict(ser_json_inf_nan="constants")


class MotionFile(_Plain):
    """A motion of a file, cut and placed before the radar."""

    noun: ClassVar[str] = "motion"

    kind: Literal["file"] = "file"
    file: str
    """Path; in a YAML file relative to its folder."""
    start_s: Fraction = 0.0
    """First instant of the motion that is used [s]."""
    stop_s: Fraction | None = None
    """Last instant of the motion that is used [s]; all of it by default."""
    distance_m: Fraction | None = None
    """Range of the start [m]; by default the closest approach is 1.5 m."""
    angle_deg: Fraction = 0.0
    """Angle of the walk against the line to the radar [deg]."""


class MotionArrays(_Plain):
    """A motion whose joints are stored."""

    noun: ClassVar[str] = "motion"

    kind: Literal["motion"] = "motion"
    input: Hash
    """`joints` and `rotations`."""
    rate_hz: Number
    names: tuple[str, ...]
    parents: tuple[int, ...]
    placed: bool | None
    report: str
    """What the reader found in the file, and how the motion was placed."""
    origin: tuple[str, ...] = ()
    """The file's name and the SHA-256 of its content, then each edit since."""


class BodyMesh(_Plain):
    """A body's mesh, skinned from a motion."""

    noun: ClassVar[str] = "body"

    kind: Literal["skin", "segments"]
    motion: MotionArrays
    body: str
    material: Substance


class MoverMesh(_Plain):
    """The mesh of a mover between two times."""

    noun: ClassVar[str] = "mover's mesh"

    kind: Literal["mover_mesh"] = "mover_mesh"
    mover: Annotated[TableFan | CeilingFan | Curtain | Door | Pet, Discriminator("kind")]
    start_s: Number
    stop_s: Number


class MeshArrays(_Plain):
    """A mesh of the user, its vertices stored."""

    noun: ClassVar[str] = "mesh"

    kind: Literal["mesh"] = "mesh"
    input: Hash
    """`vertices`, `faces`, `times_s` and `sagitta_rad`."""
    material: Substance
    crease_deg: Number
    name: str


class EllipsoidArrays(_Plain):
    """Ellipsoids of the user, their places stored."""

    noun: ClassVar[str] = "ellipsoids"

    kind: Literal["ellipsoids"] = "ellipsoids"
    input: Hash
    """`semi_axes_m`, `centres`, `axes` and `times_s`."""
    material: Substance
    names: tuple[str, ...]


class Unknown(_Plain):
    """A target that a function of the user computes: it cannot be stored, nor the recording made again."""

    noun: ClassVar[str] = "target"

    kind: Literal["unknown"] = "unknown"
    description: str


class StoredSurface(_Plain):
    """One surface of a stored scene; its vertices and faces are parts of the scene's arrays."""

    noun: ClassVar[str] = "surface"

    name: str
    material: Substance
    thickness_m: Number
    vertices: Count
    """How many of the scene's vertices are its own, in order."""
    faces: Count
    """How many of the scene's faces are its own, in order."""


class StoredScene(_Plain):
    """A scene whose surfaces are stored."""

    noun: ClassVar[str] = "scene"

    name: str
    input: Hash
    """`vertices` and `faces` of all surfaces."""
    surfaces: tuple[StoredSurface, ...]


Source = Annotated[
    MotionFile | MotionArrays | BodyMesh | MoverMesh | MeshArrays | EllipsoidArrays | Unknown
    | TableFan | CeilingFan | Curtain | Door | Pet,
    Discriminator("kind"),
]  # fmt: skip
"""Where a target comes from."""


class Experiment(_Plain):
    """What there is: targets by their sources, radar, scene, and the physics that is modelled.

    >>> Experiment(targets=[{"kind": "fan", "position_m": (3, 0, 1)}], radar="table2").targets[0].kind
    'fan'
    """

    noun: ClassVar[str] = "experiment"

    targets: Annotated[tuple[Source, ...], Field(min_length=1, max_length=1000)]
    """Motions, meshes, ellipsoids and movers by their sources."""
    radar: Radar
    """Its fields, or the name of a preset."""
    scene: str | StoredScene = "free_space"
    """"free_space", a room by name, the path of an XML file, or a stored scene."""
    reflections: Annotated[Count, Field(ge=0, le=4)] = 2
    """Greatest number of reflections on the paths out and back together."""
    transmissions: Annotated[Count, Field(ge=0, le=4)] = 0
    """Greatest number of thin slabs passed on them."""
    clutter: Clutter = "specular"
    """Echoes of the static scene: "specular", "diffuse" or "none"."""
    collisions: Collisions = "warn"
    """What becomes of targets that go through walls: "warn", "stop" just before, or "ignore"."""
    method: Method = "mesh"
    """Scattering model: physical optics of a "mesh", or "ellipsoid"."""
    body: str = "adult"
    """Template of the bodies."""
    material: Substance | None = None
    """Of everything but movers; by default each target's own."""
    phase_from: Literal["specular", "centre"] = "specular"
    """Point of an ellipsoid that its phase comes from."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Of the diffuse points."""

    @field_validator("radar", mode="before")
    @classmethod
    def _named_radar(cls, value: Any) -> Any:
        if isinstance(value, str):
            own = Path(value).suffix.lower() in (".yaml", ".yml")
            return Radar.from_yaml(value) if own else Radar.preset(value)
        return value

    @property
    def physics(self) -> dict[str, Any]:
        """Fields beside targets, radar and scene."""
        return {name: value for name, value in self if name not in ("targets", "radar", "scene")}

    @property
    def hash(self) -> str:
        """Of its content: the same for equal experiments."""
        return hashlib.sha256(json.dumps(self.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()[:32]

    @property
    def lost(self) -> str | None:
        """What of it was not stored, so that a recording cannot be made again; None where all was."""
        return next((each.description for each in self.targets if isinstance(each, Unknown)), None)

    def targets_from(self, inputs: Inputs, folder: Path | None = None) -> list[TargetLike]:
        """The targets themselves; files are looked for from `folder`."""
        return [_target(each, inputs, self.radar, folder) for each in self.targets]

    def scene_from(self, inputs: Inputs) -> str | Scene:
        """The scene, or its name."""
        if isinstance(self.scene, str):
            return self.scene
        arrays = _arrays(inputs, self.scene.input, ("vertices", "faces"))
        vertices, faces, surfaces = arrays["vertices"], arrays["faces"], []
        for each in self.scene.surfaces:
            mine, vertices = vertices[: each.vertices], vertices[each.vertices :]
            triangles, faces = faces[: each.faces], faces[each.faces :]
            surfaces.append(
                Surface(
                    name=each.name, vertices=mine, faces=triangles, material=each.material, thickness_m=each.thickness_m
                )
            )
        return Scene(name=self.scene.name, surfaces=tuple(surfaces))

    @classmethod
    def from_yaml(cls, path: str | Path) -> Experiment:
        """An experiment from a YAML file of its fields; files that it names lie beside it, or are given whole."""
        return cls.read(read_yaml(path, noun="experiment", example="targets, radar and scene"), Path(path))

    @classmethod
    def read(cls, values: Mapping[str, Any], path: Path) -> Experiment:
        """An experiment from the fields that a file holds."""
        try:
            found = cls.model_validate(values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        beside = path.parent
        targets = tuple(
            each.model_copy(update={"file": str(beside / each.file)}) if isinstance(each, MotionFile) else each
            for each in found.targets
        )
        scene = found.scene
        if isinstance(scene, str) and scene.lower().endswith(".xml"):
            scene = str(beside / scene)
        return found.model_copy(update={"targets": targets, "scene": scene})

    def to_yaml(self) -> str:
        """Text that `from_yaml` reads back as the same."""
        import yaml

        return str(yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False))


@dataclass(slots=True)
class Store:
    """Arrays that an experiment names, as they are collected."""

    inputs: dict[str, dict[str, np.ndarray]]

    def keep(self, **arrays: np.ndarray) -> str:
        """Their hash."""
        digest = hashlib.sha256()
        for name, array in arrays.items():
            digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.hexdigest()[:32]
        self.inputs[key] = dict(arrays)
        return key


def sources_of(targets: Sequence[TargetLike], store: Store) -> tuple[Any, ...]:
    """Sources of targets, their arrays in the store."""
    return tuple(_source(each, store) for each in targets)


def stored_scene(scene: Scene | None, store: Store) -> str | StoredScene:
    """A scene as it is stored."""
    if scene is None:
        return "free_space"
    surfaces = scene.surfaces
    key = store.keep(
        vertices=np.concatenate([each.vertices for each in surfaces]),
        faces=np.concatenate([each.faces for each in surfaces]),
    )
    stored = tuple(
        StoredSurface(
            name=each.name, material=each.material, thickness_m=float(each.thickness_m), vertices=len(each.vertices),
            faces=len(each.faces),
        )
        for each in surfaces
    )  # fmt: skip
    return StoredScene(name=scene.name, input=key, surfaces=stored)


def _source(target: TargetLike, store: Store) -> Any:
    if isinstance(target, Mover):
        return target
    if isinstance(target, Motion):
        key = store.keep(joints=target.joints, rotations=target.rotations)
        return MotionArrays(
            input=key, rate_hz=float(target.rate_hz), names=target.names, parents=target.parents, placed=target.placed,
            report=target.report, origin=target.origin,
        )  # fmt: skip
    made = target.made
    if made is not None and made.by == "mover":
        return MoverMesh(**made.arguments)
    if made is not None and made.by in ("skin", "segments"):
        return BodyMesh(kind=made.by, **{**made.arguments, "motion": _source(made.arguments["motion"], store)})
    if made is None or made.by != "arrays":
        return Unknown(description=repr(target))
    if isinstance(target, MovingMesh):
        sagitta = np.asarray(target.sagitta_rad, float)
        key = store.keep(**made.arguments, faces=target.faces, times_s=target.times_s, sagitta_rad=sagitta)
        return MeshArrays(input=key, material=target.material, crease_deg=float(target.crease_deg), name=target.name)
    key = store.keep(**made.arguments, semi_axes_m=target.semi_axes_m, times_s=target.times_s)
    return EllipsoidArrays(input=key, material=target.material, names=target.names)


def _target(source: Any, inputs: Inputs, radar: Radar, folder: Path | None) -> TargetLike:
    if isinstance(source, Mover):
        return source
    if isinstance(source, MotionFile):
        motion = load_motion((folder or Path()) / source.file)
        if source.start_s or source.stop_s is not None:
            motion = trim(motion, source.start_s, motion.duration_s if source.stop_s is None else source.stop_s)
        return place(
            motion, distance_m=source.distance_m, angle_deg=source.angle_deg, radar_position_m=radar.position_m,
            boresight=radar.boresight,
        )  # fmt: skip
    if isinstance(source, MotionArrays):
        arrays = _arrays(inputs, source.input, ("joints", "rotations"))
        fields = source.model_dump(include={"rate_hz", "names", "parents", "placed", "report", "origin"})
        return Motion(**fields, joints=arrays["joints"], rotations=arrays["rotations"])
    if isinstance(source, BodyMesh):
        motion = cast(Motion, _target(source.motion, inputs, radar, folder))
        return (skin if source.kind == "skin" else segments)(motion, source.body, material=source.material)
    if isinstance(source, MoverMesh):
        return source.mover.mesh(source.start_s, source.stop_s)
    if isinstance(source, MeshArrays):
        arrays = _arrays(inputs, source.input, ("vertices", "faces", "times_s", "sagitta_rad"))
        sagitta = arrays["sagitta_rad"]
        return MovingMesh(
            arrays["vertices"], arrays["faces"], arrays["times_s"], source.material, crease_deg=source.crease_deg,
            sagitta_rad=sagitta if sagitta.ndim else float(sagitta), name=source.name,
        )  # fmt: skip
    if isinstance(source, EllipsoidArrays):
        arrays = _arrays(inputs, source.input, ("semi_axes_m", "centres", "axes", "times_s"))
        return Ellipsoids(**arrays, material=source.material, names=source.names)
    raise InputError(f"{source.description} was computed by a function and is not stored; give it again")


def _arrays(inputs: Inputs, key: str, names: Sequence[str]) -> dict[str, np.ndarray]:
    found = inputs.get(key)
    if found is None or set(found) != set(names):
        raise InputError(
            f"the experiment names arrays {key} of {', '.join(names)}, and they are not there; give the recording's whole folder"
        )
    return dict(found)


def packed(arrays: Mapping[str, np.ndarray]) -> bytes:
    """A compressed .npz file."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def unpacked(path: Path) -> dict[str, np.ndarray]:
    """What `packed` wrote, checked against the hash that is the file's name."""
    data = read_bytes(path, limit=LARGEST_INPUT_BYTES, noun="file of arrays")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as members:
            size = sum(each.file_size for each in members.infolist())
        if size > LARGEST_INPUT_BYTES:
            raise InputError(f"{path} unpacks to {size / 1e9:.1f} GB, more than {LARGEST_INPUT_BYTES / 1e9:.1f} GB")
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except InputError:
        raise
    except Exception as error:  # files of any content
        raise InputError(f"{path} is not a whole file of arrays ({error}); simulate the recording again") from None
    if Store({}).keep(**arrays) != path.stem:
        raise InputError(f"{path} is damaged: its arrays are not those that its name is the hash of; simulate it again")
    return arrays
