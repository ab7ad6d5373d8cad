"""Ray-traced human micro-Doppler: skeleton motion in, coherent FMCW radar data out.

import t2d_rt as t2d
motion = t2d.load_motion("walk.bvh")
result = t2d.simulate(motion, radar=t2d.Radar.preset("table2"), method="mesh", seed=0)
result.save("walk.zarr")
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from t2d_rt.core.calls import public

if TYPE_CHECKING:
    from t2d_rt.accuracy import plan
    from t2d_rt.body.outfit import Outfit
    from t2d_rt.core.errors import BackendError, InputError, T2DError, T2DWarning
    from t2d_rt.experiment.catalog import bodies, example, examples, movers, presets, scenes
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.motion import (
        describe,
        load_motion,
        load_motions,
        motion_from_joints,
        place,
        place_together,
        repeat,
        resample,
        smooth,
        trim,
    )
    from t2d_rt.motion.carry import carry
    from t2d_rt.motion.check import check_motion
    from t2d_rt.motion.generate import motion_from_text
    from t2d_rt.motion.vary import mirror, vary_gait, vary_view
    from t2d_rt.motion.write import save_motion
    from t2d_rt.noise.background import add_background, load_background
    from t2d_rt.noise.masks import OcclusionMask, occlude
    from t2d_rt.pipeline.targets import segments, skin
    from t2d_rt.propagation.scenes import load_scene
    from t2d_rt.radar.synthesize import synthesize
    from t2d_rt.recording.compare import compare
    from t2d_rt.recording.read import load_recording
    from t2d_rt.recording.recording import Recording
    from t2d_rt.recording.remake import add_noise
    from t2d_rt.scene import CeilingFan, Curtain, Door, Pet, Room, TableFan, mover, save_scene
    from t2d_rt.simulate import run, simulate, simulate_radars
    from t2d_rt.sweeps import sweep
    from t2d_rt.types import (
        Accuracy,
        Breathing,
        ByPart,
        Echoes,
        EchoStream,
        Ellipsoids,
        Heartbeat,
        Material,
        Motion,
        MovingMesh,
        PathTier,
        Radar,
        RadarTrack,
        Receiver,
        Scene,
        Surface,
    )
    from t2d_rt.view import Viewer
    from t2d_rt.view.animation import animate

# Everything loads when first used: `import t2d_rt` must not wait for a ray tracer.
_HOMES = {
    "t2d_rt.core.errors": ("BackendError", "InputError", "T2DError", "T2DWarning"),
    "t2d_rt.motion": (
        "describe", "load_motion", "load_motions", "motion_from_joints", "place", "place_together", "repeat", "resample",
        "smooth", "trim",
    ),
    "t2d_rt.motion.carry": ("carry",),
    "t2d_rt.motion.check": ("check_motion",),
    "t2d_rt.motion.generate": ("motion_from_text",),
    "t2d_rt.motion.vary": ("mirror", "vary_gait", "vary_view"),
    "t2d_rt.motion.write": ("save_motion",),
    "t2d_rt.noise.background": ("add_background", "load_background"),
    "t2d_rt.noise.masks": ("OcclusionMask", "occlude"),
    "t2d_rt.radar.synthesize": ("synthesize",),
    "t2d_rt.recording.read": ("load_recording",),
    "t2d_rt.recording.recording": ("Recording",),
    "t2d_rt.scene": ("CeilingFan", "Curtain", "Door", "Pet", "Room", "TableFan", "mover", "save_scene"),
    "t2d_rt.view.animation": ("animate",),
    "t2d_rt.recording.compare": ("compare",),
    "t2d_rt.experiment.experiment": ("Experiment",),
    "t2d_rt.experiment.catalog": ("bodies", "example", "examples", "movers", "presets", "scenes"),
    "t2d_rt.accuracy": ("plan",),
    "t2d_rt.body.outfit": ("Outfit",),
    "t2d_rt.pipeline.targets": ("segments", "skin"),
    "t2d_rt.recording.remake": ("add_noise",),
    "t2d_rt.simulate": ("run", "simulate", "simulate_radars"),
    "t2d_rt.sweeps": ("sweep",),
    "t2d_rt.propagation.scenes": ("load_scene",),
    "t2d_rt.view": ("Viewer",),
    "t2d_rt.types": (
        "Accuracy", "Breathing", "ByPart", "PathTier", "EchoStream", "Echoes", "Ellipsoids", "Heartbeat", "Material",
        "Motion", "MovingMesh", "Radar", "RadarTrack", "Receiver", "Scene", "Surface",
    ),
}  # fmt: skip
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Accuracy", "BackendError", "Breathing", "ByPart", "CeilingFan", "Curtain", "Door", "EchoStream", "Echoes", "Ellipsoids",
    "Experiment", "Heartbeat", "InputError", "Material", "Motion", "MovingMesh", "OcclusionMask", "Outfit", "PathTier", "Pet",
    "Radar", "RadarTrack", "Receiver", "Recording", "Room", "Scene", "Surface", "T2DError", "T2DWarning", "TableFan", "Viewer",
    "add_background", "add_noise", "animate", "bodies", "carry", "check_motion", "compare", "describe", "example", "examples",
    "load_background", "load_motion", "load_motions", "load_recording", "load_scene", "mirror", "motion_from_joints",
    "motion_from_text", "mover", "movers", "occlude", "place", "place_together", "plan", "presets", "repeat", "resample", "run",
    "save_motion", "save_scene", "scenes", "segments", "simulate", "simulate_radars", "skin", "smooth", "sweep", "synthesize",
    "trim", "vary_gait", "vary_view",
]  # fmt: skip


class _Package(ModuleType):
    """Keeps `t2d_rt.simulate` the function, also once the module of that name has been imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(
            name, public(value.simulate) if name == "simulate" and isinstance(value, ModuleType) else value
        )


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from t2d_rt.core.plugins import versions

        return versions()["t2d-rt"]
    if name not in _HOME:
        raise AttributeError(f"module 't2d_rt' has no attribute '{name}'")
    value = public(getattr(import_module(_HOME[name]), name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
