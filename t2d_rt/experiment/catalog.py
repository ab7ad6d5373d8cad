"""Radar presets, scenes, bodies, movers and example motions by their names.

>>> "walk" in examples(), "table2" in presets(), "living_room" in scenes()
(True, True, True)
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from t2d_rt import body, motion
from t2d_rt.core.checks import file_path, names_advice, shown, text, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.propagation.scenes import scene_names
from t2d_rt.scene.movers import kind_names
from t2d_rt.types import Motion, Radar, Receiver
from t2d_rt.types.radar import preset_names, radar_from

EXAMPLES: dict[str, tuple[str, str]] = {
    "walk": ("12_01_walk.bvh", "a walk of 4.4 s (CMU 12_01)"),
    "run": ("iclone_002_03_run_jog.bvh.gz", "a run of 1.4 s (CMU 2_03 on iClone's skeleton)"),
    "jumping_jacks": ("14_14_jumping_jacks.bvh", "jumping jacks of 4 s on the spot (CMU 14_14)"),
    "stylised_walk": ("131_01_walk_300frames.bvh", "the start of a stylised walk, 2.5 s (CMU 131_01)"),
    "short_walk": ("bvhtoolbox_walk01.bvh", "a walk of 4.2 s at 24 frames a second (bvh-toolbox)"),
    "momask": ("momask_22j_120frames.bvh", "2 s of dancing (the template of MoMask's files)"),
}
"""Files of the bundled motions, and a description of each."""

FREE_SPACE = "free_space"


def presets() -> list[str]:
    """Names of the radar presets, for `Radar.preset` and `simulate(..., radar=)`."""
    return preset_names()


def scenes() -> list[str]:
    """Names that `simulate(..., scene=)` takes: free space and the shipped rooms."""
    return [FREE_SPACE, *scene_names()]


def bodies() -> list[str]:
    """Names of the shipped bodies, for `skin` and `simulate(..., body=)`."""
    return body.bodies()


def movers() -> list[str]:
    """Kinds that `mover` makes: "fan", "pet" and others."""
    return kind_names()


def examples() -> list[str]:
    """Names of the bundled motions, for `example` and `simulate`."""
    return list(EXAMPLES)


def example(name: str) -> Motion:
    """A bundled motion by its name, e.g. "walk", or by the name of its file."""
    path = _example_path(text("name", name, hint="examples() lists them"))
    if path is None:
        raise unknown_name("example motion", name, EXAMPLES)
    return motion.load_motion(path)


def motion_path(source: str | Path) -> Path:
    """The path of a motion file or, where there is none, of the bundled motion of that name."""
    path = file_path("a motion file", source)
    bundled = None if os.path.lexists(path) else _example_path(str(source))
    if bundled is not None:
        return bundled
    if not path.suffix and not path.exists():  # it must be a bundled motion's name, not a path
        advice = names_advice(source, EXAMPLES, hint=", or give a .bvh file")
        raise InputError(f"there is no motion file {shown(str(source))} and no bundled motion of that name; {advice}")
    return path


def found_from(folder: Path, source: str) -> Path:
    """The path of a motion file relative to a folder; a bundled motion's name stays as it is, unless a file of that name exists."""
    path = folder / source
    return Path(source) if _example_path(source) is not None and not os.path.lexists(path) else path


def target_named(target: Any) -> Any:
    """A target of a simulation, or a list of them; files and names of motions are read."""
    if isinstance(target, (str, os.PathLike)):
        return motion.load_motion(motion_path(file_path("target", target)))
    if isinstance(target, Sequence):
        return [target_named(item) if isinstance(item, (str, os.PathLike)) else item for item in target]
    return target


def radar_named(radar: Any) -> Any:
    """A radar, from a preset's name, a .yaml or a .cfg file if it is not one already."""
    if not isinstance(radar, (str, os.PathLike)):
        return radar
    return radar_from(file_path("radar", radar))


def noise_named(noise: Any, radar: Radar) -> Literal["none"] | Receiver:
    """A receiver: from "receiver" (the shipped values for the radar's band), a .yaml file or a mapping; "none" stays as it is."""
    if isinstance(noise, Receiver):
        return noise
    if isinstance(noise, Mapping):
        return Receiver.model_validate(noise)
    if isinstance(noise, (str, os.PathLike)):
        path = file_path("noise", noise)
        if path.suffix.lower() in (".yaml", ".yml"):
            return Receiver.from_yaml(path)
        if noise == "none":
            return "none"
        if noise == "receiver":
            return Receiver.preset(radar)
    raise InputError(
        f"noise must be 'none', 'receiver', a YAML file, a mapping or a Receiver, got {shown(noise)}; 'receiver' takes the shipped "
        "values for the radar's band"
    )


def _example_path(name: str) -> Path | None:
    """The file of the bundled motion of that name, with or without its ending; None where there is none."""
    for short, (file, _) in EXAMPLES.items():
        if name in (short, file, file.removesuffix(".gz").removesuffix(".bvh")):
            return resource("motions", file)
    return None
