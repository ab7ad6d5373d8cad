"""`t2d-rt motion`: a motion file from a sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.motion.descriptions.slots import Step

EXAMPLES = """examples:
  t2d-rt motion "a person walks slowly forward" -o walk.bvh
  t2d-rt motion "an old man walks to the left and sits down" --seed 7 -o sit.bvh
  t2d-rt motion "a child jumps three times" --stature-m 1.2 -o jump.bvh
  t2d-rt motion "a person dances" --provider files:results_of_mdm -o dance.bvh
  t2d-rt simulate walk.bvh                                   # and its radar data"""

LONGEST_NAME = 40


def parser() -> ArgumentParser:
    """Options of `t2d-rt motion`."""
    from t2d_rt.motion.generate import PROVIDERS

    found = command_parser(
        "motion",
        "Makes a motion file (.bvh) of what a sentence says that a person does.",
        config=False,
        noun="SENTENCE",
        file="The sentence, in quotes.",
        examples=EXAMPLES,
    )
    found.add_argument(
        "-o",
        "--output",
        type=str | None,
        help="File to write (.bvh); by default it has the words of the sentence for a name.",
    )
    found.add_argument(
        "--overwrite", type=bool, default=False, nargs="?", const=True, help="Whether a file of that name is replaced."
    )
    found.add_argument(
        "--seed",
        type=int,
        default=0,
        help="Seed of all that is drawn: person, clips, speed; the same seed gives the same motion.",
    )
    told = "; ".join(f"{name}: {words}" for name, words in PROVIDERS.items())
    found.add_argument("--provider", type=str, default="auto", help=f"How it is made. {told}.")
    found.add_argument(
        "--body", type=str | None, help="Body whose proportions are taken; by default one that suits the sentence."
    )
    found.add_argument(
        "--stature_m", type=float | None, help="Stature of the person [m]; by default drawn for the sentence."
    )
    found.add_argument(
        "--duration_s",
        type=float | None,
        help="Duration of the main action [s], where the sentence says nothing of it.",
    )
    found.add_argument(
        "--library",
        type=str | None,
        help="Index of clips of your own; by default the one that t2d-rt library add writes to, if there is one.",
    )
    return found


def run(options: Namespace) -> None:
    """Makes the motion, then writes it; nothing is written where it fails."""
    from t2d_rt.motion.generate import COMPOSED, motion_from_text, understood
    from t2d_rt.motion.generate.library.users import registry
    from t2d_rt.motion.write import check_target, save_motion

    sentence = options.file or ""
    description, left_out = understood(sentence)
    target = Path(options.output or f"{_stem(sentence)}.bvh")
    check_target(target, overwrite=options.overwrite)
    library = options.library
    if library is None and options.provider in COMPOSED and registry().is_file():
        library = registry()
    motion = motion_from_text(
        description, provider=options.provider, seed=options.seed, body=options.body, stature_m=options.stature_m,
        duration_s=options.duration_s, library=library,
    )  # fmt: skip
    save_motion(motion, target, overwrite=options.overwrite)
    say(
        f"class {description.activity}, {description.subject.replace('_', ' ')}: {'; then '.join(map(_words, description.steps))}"
    )
    if left_out:
        say(left_out)
    for line in motion.origin[1:]:
        say(f"  {line}")
    say(f"wrote {target}: {motion.duration_s:.2f} s at {motion.rate_hz:g} Hz")


def _words(step: Step) -> str:
    """A step's slots in words."""
    values = step.model_dump(include=set(type(step).model_fields) & STEP_FIELDS, exclude_defaults=True)
    action = values.pop("action").replace("_", " ")
    return action + "".join(
        f", {name.replace('_', ' ')} {str(value).replace('_', ' ')}" for name, value in values.items()
    )


STEP_FIELDS = {
    "action", "manner", "direction", "speed", "body_part", "object", "type", "side", "count", "duration_s",
}  # fmt: skip
"""Slots of a step."""


def _stem(sentence: str) -> str:
    """A file name of a sentence's words."""
    words = "_".join(re.findall(r"[a-z0-9]+", sentence.lower()))
    if not words:
        raise InputError("a sentence has words; write what a person does, as 'a person walks forward'")
    return words[:LONGEST_NAME].rstrip("_")
