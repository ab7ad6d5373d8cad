"""Make motions from descriptions, by several providers behind one interface.

>>> motion = motion_from_text("a person walks forward", seed=3)
>>> motion.rate_hz
60.0
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from t2d_rt.core.checks import instance, integer, number, shown, unknown_name
from t2d_rt.core.errors import InputError, warn
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.types.motion import Motion

__all__ = ["PROVIDERS", "Provider", "motion_from_text", "provider_named", "understood"]


class Provider(Protocol):
    """A function that turns a description into a motion; the same seed gives the same motion."""

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """The motion of a description."""
        ...


PROVIDERS: Mapping[str, str] = {
    "auto": "each step of the description by what suits it: clips, key poses, changed gaits, physics",
    "library": "recorded clips, changed gaits and key poses: everything but falls",
    "physics": "falls in a physics engine (extra [falls])",
    "momask": "your own checkout of MoMask (environment variables T2D_MOMASK and T2D_MOMASK_PYTHON)",
    "files": "a folder of results of text-to-motion models, given as files:FOLDER",
}
"""Providers by name."""

COMPOSED = "auto", "library", "physics"
"""Providers that make motions of what ships, one person throughout."""

LONGEST_S = 600.0
"""Longest motion that is made."""

NOT_MADE = "not made: "
"""Beginning of a line of a motion's origin that tells what its description asks for but nothing makes."""


def motion_from_text(
    description: str | Description,
    *,
    provider: str | Provider = "auto",
    seed: int = 0,
    body: str | None = None,
    stature_m: float | None = None,
    person_seed: int | None = None,
    duration_s: float | None = None,
    library: str | Path | None = None,
) -> Motion:
    """A motion that a sentence or a description asks for; its origin tells the sentence, the provider, the clips and every edit.

    provider: how it is made, one of auto, library, physics, momask and files:FOLDER, or a function of your own.
    seed: seed of all that is drawn: person, clips, speed, pauses; the same seed gives the same motion.
    body: body whose proportions are taken; by default one that suits the subject of the sentence.
    stature_m: stature of the person [m]; by default drawn for the subject.
    person_seed: seed of the person alone, that is of proportions, handedness, posture, tempo and breathing; by default `seed`.
    duration_s: duration of the main action [s], where the sentence says nothing of it; files last as long as they do.
    library: index file of clips of your own that join those that ship (`t2d-rt library add` writes one); without it, those that
        ship alone, so that a sentence and a seed give the same motion on every machine.

    The options body, stature_m, person_seed and library are for auto, library and physics: other providers choose the person
    themselves.
    A warning tells what a sentence says that is not in the motion; for a Description the origin tells it ("not made").
    Raises an InputError for wrong options, and for what the provider does not make.
    """
    seed = integer("seed", seed, 0, 2**63 - 1)
    if duration_s is not None:
        duration_s = number("duration_s", duration_s, 0.5, LONGEST_S, unit="s")
    parsed, left_out = understood(description) if isinstance(description, str) else (description, "")
    instance("description", parsed, Description, "a sentence or a Description")
    if person_seed is not None:
        person_seed = integer("person_seed", person_seed, 0, 2**63 - 1)
    options = {"body": body, "stature_m": stature_m, "person_seed": person_seed, "library": library}
    _refuse_unused(provider, **options, duration_s=duration_s)
    if duration_s is not None and parsed.duration_s is None:
        parsed = parsed.model_copy(update={"duration_s": duration_s})
    lasting_s = sum(step.duration_s or 0.0 for step in parsed.steps)
    if lasting_s > LONGEST_S:
        raise InputError(
            f"the description asks for {lasting_s:g} s, a motion lasts {LONGEST_S:g} s at most; ask for less"
        )
    make: Provider | Callable[..., Motion]
    if isinstance(provider, str):
        make = provider_named(provider, **options)
    elif callable(provider):
        make = provider
    else:
        raise InputError(
            f"provider must be a name or a function, got {provider!r}; choose one of {', '.join(PROVIDERS)}"
        )
    motion = make(parsed, seed=seed)
    if isinstance(description, str) and provider in COMPOSED:  # what others understand is theirs to say
        not_made = dict.fromkeys(line.removeprefix(NOT_MADE) for line in motion.origin if line.startswith(NOT_MADE))
        remarks = [remark for remark in (left_out, f"{NOT_MADE}{', '.join(not_made)}" if not_made else "") if remark]
        if remarks:
            warn(f"of {shown(description)}: {'; '.join(remarks)}")
    return motion


def _refuse_unused(provider: str | Provider, **options: object) -> None:
    """Raises an InputError for options that a provider would ignore: only those of `COMPOSED` choose people and clips."""
    kind = provider.partition(":")[0] if isinstance(provider, str) else "of your own"
    if kind in COMPOSED or (isinstance(provider, str) and kind not in PROVIDERS):
        return
    heeded = ("duration_s",) if kind != "files" else ()
    unused = [name for name, value in options.items() if value is not None and name not in heeded]
    if unused:
        raise InputError(f"provider {kind} takes no {' nor '.join(unused)}; leave it out, or the provider")


def understood(sentence: str) -> tuple[Description, str]:
    """A sentence's slots, and a text about what was not understood or was read as something else, empty if there is nothing."""
    from t2d_rt.motion.descriptions.parse import parse_description

    parsed = parse_description(sentence)
    return parsed.description, str(parsed)


def provider_named(name: str, **options: Any) -> Provider:
    """A provider by its name; `options` are those of `Composer`. Raises an InputError for an unknown name."""
    kind, _, folder = name.partition(":")
    if kind in COMPOSED:
        from t2d_rt.motion.generate.compose import Composer

        return Composer(only=None if kind == "auto" else kind, **options)
    if kind == "momask":
        from t2d_rt.motion.generate.momask import MoMask

        return MoMask.from_environment()
    if kind == "files":
        from t2d_rt.motion.generate.files import Files

        if not folder:
            raise InputError("provider files needs the folder of results; give files:FOLDER")
        return Files(folder=Path(folder))
    raise unknown_name("provider", name, PROVIDERS)
