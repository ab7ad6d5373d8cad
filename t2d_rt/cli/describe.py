"""`t2d-rt describe`: descriptions of activities as JSON lines, by the grammar or by a language model; or one sentence's slots."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.checks import integer, names_advice, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.diversity import NEAREST, diversity
from t2d_rt.motion.descriptions.grammar import MOST_DESCRIPTIONS, grammar_descriptions
from t2d_rt.motion.descriptions.parse import parse_description
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity, Description, as_json, json_lines, write_descriptions

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.motion.descriptions.language_model import Written

ALL = "all"
SOURCES = "grammar", "openai"
FEWER = 1
"""Exit code where fewer descriptions were written than asked for."""

EXAMPLES = """examples:
  t2d-rt describe --class falling -n 200 -o falls.jsonl      # by the grammar, without network
  t2d-rt describe --class all -n 200 --seed 1 -o all.jsonl
  t2d-rt describe --class "normal walking, sitting" -n 5     # printed
  t2d-rt describe "a man slips on the stairs and falls back" # the slots of a sentence, and what was not understood
  t2d-rt describe --class running -n 50 -o runs.jsonl --source openai --model NAME --base-url http://localhost:8000/v1"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt describe`."""
    found = command_parser(
        "describe",
        "Writes descriptions of activities, with their properties in slots, as JSON lines; or prints the slots of a sentence. "
        "The exit code is 1 where a language model gave fewer descriptions than asked for.",
        config=False,
        noun="[SENTENCE]",
        file="A sentence whose slots are printed; the word --file may be left out.",
        examples=EXAMPLES,
    )
    found.add_argument(
        "--class",
        dest="class",
        action="append",
        type=str,
        help=f"Class of activity, several with commas between them, or all: {', '.join(ACTIVITIES)}.",
    )
    found.add_argument("-n", "--count", type=int, default=200, help="Descriptions of each class.")
    found.add_argument("-o", "--output", type=str | None, help="File to write (.jsonl); by default they are printed.")
    told = "Whether a file of that name is replaced; without it an existing one is an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    found.add_argument(
        "--seed", type=int, default=0, help="Seed of all choices; the same one gives the same descriptions."
    )
    found.add_argument(
        "--source",
        type=str,
        default="grammar",
        help="Who writes them: grammar, or openai (any OpenAI-compatible endpoint).",
    )
    model = found.add_argument_group(
        "language model",
        "The key comes from T2D_API_KEY or OPENAI_API_KEY in the environment; a local endpoint needs none.",
    )
    model.add_argument("--model", type=str | None, help="Name of the model, as the endpoint knows it.")
    model.add_argument("--base_url", type=str | None, help="Address of the endpoint, such as http://localhost:8000/v1.")
    model.add_argument(
        "--budget", type=int | None, help="Most requests for each class; by default 6 for every 10 descriptions."
    )
    model.add_argument(
        "--budget_tokens", type=int | None, help="Most tokens for each class; by default as many as it takes."
    )
    model.add_argument("--timeout_s", type=float, default=60.0, help="Longest time that a reply may take [s].")
    return found


def run(options: Namespace) -> int:
    """Makes all descriptions before it writes them, and says how different they are."""
    if options.file is not None:
        return _sentence(options)
    if options["class"] is None:
        raise InputError(f"no class given; name one with --class ({', '.join(ACTIVITIES)} or all), or give a sentence")
    activities = activities_of(",".join(options["class"]))
    integer("count", options.count, 1, MOST_DESCRIPTIONS)
    output = _checked_output(options)
    made: list[Description] = []
    short: list[str] = []
    for activity in activities:
        if options.source == "openai":
            found, reason = _by_model(activity, options)
            short += [reason] if reason else []
        else:
            found = grammar_descriptions(activity, options.count, seed=options.seed)
        say(f"{activity}: {diversity(found)}", file=sys.stderr)
        made += found
    if output is None:
        say(json_lines(made).rstrip("\n"))
    else:
        write_descriptions(output, made, overwrite=options.overwrite)
        say(f"{output}: {len(made)} descriptions, no two of a class {NEAREST:.0%} alike in their words or more")
    for reason in short:
        say(f"t2d-rt: {reason}", file=sys.stderr)
    return FEWER if short else 0


def activities_of(names: str) -> list[Activity]:
    """The classes that a text names, with dashes, underscores or spaces, in the paper's words too ("normal walking").

    >>> activities_of("Normal walking, abnormal-walking")
    ['walking', 'abnormal_walking']
    """
    known: dict[str, Sequence[Activity]] = {each: (each,) for each in ACTIVITIES}
    known |= {ALL: ACTIVITIES, "normal_walking": ("walking",), "abnormal_gait": ("abnormal_walking",)}
    found: list[Activity] = []
    for name in names.strip().strip("[]").split(","):
        plain = re.sub(r"[\s_-]+", "_", name.strip().strip("'\"").lower())
        if plain not in known:
            raise InputError(f"unknown class {shown(name.strip())}; {names_advice(plain, (*ACTIVITIES, ALL))}")
        found += [each for each in known[plain] if each not in found]
    return found


def _sentence(options: Namespace) -> int:
    if options["class"] is not None or options.output is not None:
        raise InputError("give either a sentence, whose slots are printed, or --class with -n and -o")
    parsed = parse_description(options.file)
    say(json.dumps(as_json(parsed.description), ensure_ascii=False))
    if str(parsed):
        say(f"t2d-rt: {parsed}", file=sys.stderr)
    return 0


def _checked_output(options: Namespace) -> Path | None:
    from t2d_rt.core.atomic_write import check_place

    if options.source not in SOURCES:
        raise InputError(f"source must be {' or '.join(SOURCES)}, got {shown(options.source)}")
    given = [name for name in ("model", "base_url", "budget", "budget_tokens") if options[name] is not None]
    if options.source == "grammar" and given:
        raise InputError(
            f"--{given[0].replace('_', '-')} is for a language model; add --source openai, or leave it out"
        )
    if options.source == "openai" and options.model is None:
        raise InputError("no model given; name one with --model, as the endpoint knows it")
    if options.output is None:
        return None
    output = Path(options.output)
    if output.suffix.lower() != ".jsonl":
        raise InputError(f"descriptions are written as .jsonl, got '{output}'; change the file's ending")
    check_place(output, overwrite=options.overwrite)
    return output


def _by_model(activity: Activity, options: Namespace) -> tuple[list[Description], str]:
    """Descriptions of a class by a language model, and why there are fewer than asked for, if there are."""
    from t2d_rt.core.progress import ProgressBar
    from t2d_rt.motion.descriptions.language_model import Budget, LanguageModel, model_descriptions

    model = LanguageModel(model=options.model, base_url=options.base_url, timeout_s=options.timeout_s)
    budget = Budget(requests=options.budget, tokens=options.budget_tokens)
    with ProgressBar(f"{activity} by {options.model}") as bar:
        written: Written = model_descriptions(
            activity, options.count, model=model, seed=options.seed, budget=budget, progress=bar
        )
    say(f"{activity}: {written}", file=sys.stderr)
    reason = (
        f"only {len(written.descriptions)} of {written.wanted} descriptions of {activity} were made: {written.stopped}"
    )
    return list(written.descriptions), reason if written.stopped else ""
