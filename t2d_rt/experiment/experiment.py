"""`Experiment`: what is simulated, as plain data; arrays to which it refers are stored beside it (`inputs`)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from t2d_rt.body.outfit import Outfit
from t2d_rt.core.checks import instance, integer, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.core.stored_arrays import Inputs, Store, named_arrays
from t2d_rt.experiment.catalog import noise_named, radar_named
from t2d_rt.experiment.sources import (
    Plain,
    SceneFile,
    Source,
    StoredScene,
    Substance,
    Unknown,
    file_beside,
    found_beside,
    source_of,
    stored_scene,
    target_from,
    with_others,
)
from t2d_rt.geometry.scan import MESHES
from t2d_rt.pipeline.path_pairs import Clutter
from t2d_rt.pipeline.targets import TargetLike
from t2d_rt.propagation.collisions import Collisions
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import Material, Radar, Receiver, Scene, Surface
from t2d_rt.types.ellipsoids import Method
from t2d_rt.types.fields import Count
from t2d_rt.types.radar_track import with_track_beside

FILES = (".xml", *MESHES)
"""Endings of scene files, which are looked up relative to an experiment's file."""
SETTINGS = ".yaml", ".yml", ".cfg"
"""Endings of files of radars and receivers, which are looked up likewise."""


def _checked_material(value: Any) -> Any:
    """A checked material or outfit; refuses a mapping with the fields of neither."""
    if not isinstance(value, Mapping):
        return value
    material_fields, outfit_fields = ([field.name for field in fields_of(kind)] for kind in (Material, Outfit))
    unknown = [name for name in value if name not in (*material_fields, *outfit_fields)]
    if unknown:
        raise unknown_name(
            "field of a material or an outfit", unknown[0], list(dict.fromkeys((*material_fields, *outfit_fields)))
        )
    if not set(value) - {"name"}:
        raise InputError(
            f"a material must tell its relative_permittivity, an outfit its cloth or shoes, got {shown(value)}"
        )
    if set(value) <= set(outfit_fields):  # its error names the wrong field
        Outfit(**{name: setting for name, setting in value.items() if not isinstance(setting, Mapping)})
    return value


BodyMaterial = Annotated[Substance | Outfit | None, BeforeValidator(_checked_material)]
"""Material of bodies, or an outfit that they wear; None keeps each body's own."""


class Experiment(Plain):
    """What there is: targets by their sources, radar, scene, and the physics that is modelled.

    >>> Experiment(targets=[{"kind": "fan", "position_m": (3, 0, 1)}], radar="table2").targets[0].kind
    'fan'
    """

    model_config = ConfigDict(use_attribute_docstrings=True)  # options of the command line
    noun: ClassVar[str] = "experiment"
    written: ClassVar[Mapping[str, str]] = {
        "targets": "a list of mappings with a kind, as in [{kind: file, file: walk}]",
        "scene": "a name, a path, or a mapping, as in {file: street.xml, materials: {brick: concrete}}",
        "material": "a name, a Material or an Outfit",
        "only_paths": "a list of names of path pairs, as in [direct]",
        "without_paths": "a list of names of path pairs, as in [direct]",
    }

    targets: Annotated[tuple[Source, ...], Field(min_length=1, max_length=1000)]
    """Motions, meshes, ellipsoids and movers by their sources."""
    radar: Radar
    """Fields of the radar, or the name of a preset."""
    scene: str | SceneFile | StoredScene = "free_space"
    """"free_space", a room by name, the path of an XML file or of a mesh, a mapping of its `file` and its `materials`, or a stored
    scene."""
    reflections: Annotated[Count, Field(ge=0, le=4)] = 2
    """Greatest number of reflections on the paths out and back together."""
    transmissions: Annotated[Count, Field(ge=0, le=4)] = 0
    """Greatest number of thin slabs that these paths pass through."""
    bounces: Annotated[Count, Field(ge=1, le=3)] = 1
    """Greatest number of bounces within and between targets, on the direct paths."""
    clutter: Clutter = "specular"
    """Echoes of the static scene: "specular", "diffuse" or "none"."""
    collisions: Collisions = "warn"
    """Treatment of targets that go through walls: "warn", "stop" the record just before, or "ignore"."""
    method: Method = "mesh"
    """Scattering model: physical optics of a "mesh", or "ellipsoid"."""
    body: str = "adult"
    """Name of the template of the bodies."""
    material: BodyMaterial = None
    """Material of all targets except movers and things that are carried, or an outfit, which bodies wear; by default each target's
    own."""
    phase_from: Literal["specular", "centre"] = "specular"
    """Point of an ellipsoid at which the phase of its echo is taken."""
    only_paths: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    """Names of the path pairs that have echoes; all by default."""
    without_paths: tuple[str, ...] = ()
    """Names of path pairs that have no echoes."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Seed of the diffuse points, and of noise whose receiver has no seed of its own."""
    noise: Literal["none"] | Receiver = "none"
    """What the receiver adds; "receiver" becomes the shipped values for the radar's band."""

    @field_validator("targets", mode="before")
    @classmethod
    def _movers_of_others(cls, value: Any) -> Any:
        return [with_others(mover) for mover in value] if isinstance(value, (list, tuple)) else value

    @field_validator("radar", mode="before")
    @classmethod
    def _named_radar(cls, value: Any) -> Any:
        return radar_named(value) if isinstance(value, str) else value

    @field_validator("noise", mode="before")
    @classmethod
    def _named_noise(cls, value: Any, info: ValidationInfo) -> Any:
        return noise_named(value, info.data["radar"]) if "radar" in info.data else "none"  # the radar's error is raised

    @classmethod
    def without_targets(cls, radar: Radar | str | Path | None = None, **fields: Any) -> Experiment:
        """The fields beside targets and scene, which are objects that `set_up` is given and puts into it (`stored_with`).

        radar: a `Radar`, a preset's name, a .yaml or a .cfg file; the `table2` preset by default.
        """
        # In Python, texts and floats (even 2.0) are not counts; YAML and the command line let pydantic convert them.
        counts = [name for name, field in cls.model_fields.items() if field.annotation is int and name in fields]
        fields |= {name: integer(name, fields[name]) for name in counts}
        named_radar = Radar.preset("table2") if radar is None else radar_named(radar)
        instance("radar", named_radar, Radar, "a Radar", hint="Radar.preset(name) makes one of a preset's name")
        return cls.from_options(
            targets=[Unknown(description="a target that is not stored yet")], radar=named_radar, **fields
        )

    def stored_with(self, targets: Sequence[TargetLike], scene: Scene | None, store: Store) -> Experiment:
        """The same experiment with these targets in this scene; their arrays go into the store."""
        sources = tuple(source_of(target, store) for target in targets)
        return self.model_copy(update={"targets": sources, "scene": stored_scene(scene, store)})

    @property
    def physics(self) -> dict[str, Any]:
        """Fields except targets, radar and scene, as options of `simulate`."""
        return {name: value for name, value in self if name not in ("targets", "radar", "scene")}

    @property
    def hash(self) -> str:
        """Hash of the content: equal for equal experiments. Without noise and path names it is that of older versions, which did
        not have these fields."""
        later = {"noise": "none", "only_paths": None, "without_paths": ()}
        values = self.model_dump(
            mode="json", exclude={name for name, none in later.items() if getattr(self, name) == none}
        )
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32]

    @property
    def lost(self) -> str | None:
        """Description of a target that could not be stored, so that a recording cannot be repeated; None where all were stored."""
        return next((target.description for target in self.targets if isinstance(target, Unknown)), None)

    def targets_from(self, inputs: Inputs) -> list[TargetLike]:
        """The targets themselves, made from their sources."""
        return [target_from(target, inputs, self.radar) for target in self.targets]

    def scene_from(self, inputs: Inputs) -> str | Scene:
        """The scene itself, or its name."""
        if isinstance(self.scene, str):
            return self.scene
        if isinstance(self.scene, SceneFile):
            return load_scene(
                self.scene.file,
                materials=self.scene.materials,
                frequency_hz=self.radar.mid_frequency_hz,
                units=self.scene.units,
                up=self.scene.up,
            )
        arrays = named_arrays(inputs, self.scene.input, ("vertices", "faces"))
        vertices, faces, surfaces = arrays["vertices"], arrays["faces"], []
        for surface in self.scene.surfaces:
            mine, vertices = vertices[: surface.vertices], vertices[surface.vertices :]
            triangles, faces = faces[: surface.faces], faces[surface.faces :]
            surfaces.append(
                Surface(
                    name=surface.name,
                    vertices=mine,
                    faces=triangles,
                    material=surface.material,
                    thickness_m=surface.thickness_m,
                )
            )
        return Scene(name=self.scene.name, surfaces=tuple(surfaces))

    @classmethod
    def from_yaml(cls, path: str | Path) -> Experiment:
        """Reads an experiment from a YAML file of its fields; files that it names are looked up relative to it, or are absolute."""
        return cls.read(read_yaml(path, noun="experiment", example="targets, radar and scene"), Path(path))

    @classmethod
    def read(cls, values: Mapping[str, Any], path: Path) -> Experiment:
        """An experiment from the fields of a file at `path`."""
        if "radars" in values:
            raise InputError(
                f"{path} has several radars, which t2d-rt simulate alone takes; give one of them as radar in place of radars"
            )
        folder = path.parent
        named = {name: values[name] for name in ("radar", "noise") if name in values}
        values = {**values, **{name: file_beside(value, folder, SETTINGS) for name, value in named.items()}}
        if isinstance(values.get("radar"), Mapping):
            values = {**values, "radar": with_track_beside(values["radar"], path)}
        experiment = cls.of_file(path, values)
        targets = tuple(found_beside(target, folder) for target in experiment.targets)
        scene = file_beside(experiment.scene, folder, FILES)
        if isinstance(scene, SceneFile):
            scene = scene.model_copy(update={"file": file_beside(scene.file, folder, FILES)})
        return experiment.model_copy(update={"targets": targets, "scene": scene})

    def to_yaml(self) -> str:
        """YAML text from which `from_yaml` reads an equal experiment."""
        return self.yaml_text()
