"""What the options of a simulation give: radar, accuracy, motion, targets, scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.output import say
from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import Namespace

    from t2d_rt.cli.add import Person
    from t2d_rt.scene import Mover
    from t2d_rt.types import Motion, Radar, Scene

MODEL = (
    "method", "scene", "tolerance_db", "reflections", "transmissions", "bounces", "clutter", "collisions", "seed", "noise", "body",
    "material", "phase_from", "only_paths", "without_paths", "measure_error", "device", "memory_gb",
)  # fmt: skip
"""Options that go to the pipeline by their names."""


def model_of(options: Namespace, radar: Radar, left: Sequence[str] = ()) -> dict[str, Any]:
    """Options of the pipeline that there are, but those that are left out."""
    found = {name: options[name] for name in MODEL if name in options and name not in left}
    found["scene"] = scene_of(options, radar)
    found["without_paths"] = options.without_paths or ()
    return found


def targets_of(motion: Motion, added: Sequence[Mover | Person], radar: Radar) -> list[Motion | Mover]:
    """The motion, and what `--add` puts beside it."""
    from t2d_rt.cli.add import Person

    return [motion, *(each.motion(radar) if isinstance(each, Person) else each for each in added)]


def radar_of(options: Namespace) -> Radar:
    """The radar of the options."""
    from t2d_rt.types import Radar

    return Radar(**options.radar.as_dict())


def accuracy_of(options: Namespace) -> dict[str, Any]:
    """The fields that were given."""
    return options.accuracy.as_dict() if "accuracy" in options else {}


def motion_of(options: Namespace, source: Path, radar: Radar) -> Motion:
    """The piece of the motion file that is used, in its place before the radar."""
    from t2d_rt.cli.add import cut
    from t2d_rt.experiment.catalog import motion_path
    from t2d_rt.motion import load_motion, place

    motion = load_motion(motion_path(source), **options.motion.as_dict())
    say(motion.report)
    motion = cut(motion, options.start_s, options.stop_s)
    return place(
        motion,
        distance_m=options.distance_m,
        angle_deg=options.angle_deg,
        radar_position_m=radar.position_m,
        boresight=radar.boresight,
    )


def scene_of(options: Namespace, radar: Radar) -> Scene | str:
    """The scene with its materials' substitutes; its name where there are none."""
    from t2d_rt.propagation.scenes import load_scene

    substitutes = substitutes_of(options)
    if not substitutes:
        return str(options.scene)
    check_scene(options)
    return load_scene(options.scene, materials=substitutes, frequency_hz=radar.mid_frequency_hz)


def check_scene(options: Namespace) -> None:
    """Refuses substitutes for the materials of no scene."""
    if options.scene == "free_space":
        raise InputError("--scene-material is of a scene and there is none; give --scene, or leave it out")


def substitutes_of(options: Namespace) -> dict[str, str]:
    """Materials of the scene and what stands in for them."""
    found = {}
    given = ",".join(options.scene_material or ())
    for each in given.split(",") if given else ():
        name, _, other = (part.strip() for part in each.partition("="))
        if not name or not other:
            raise InputError(
                f"option scene-material must name a material and its substitute, as brick=concrete, got {shown(each)}"
            )
        found[name] = other
    return found
