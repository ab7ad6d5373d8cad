"""`t2d-rt motion`, `describe`, `check-motion`, `library`: motion files, descriptions, and the clips that motions are made of."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from t2d_rt.cli.options import Reading
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.atomic_write import check_file
from t2d_rt.core.checks import integer, names_advice, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity

if TYPE_CHECKING:
    from t2d_rt.motion.check import Verdict
    from t2d_rt.motion.descriptions.slots import Description, Step
    from t2d_rt.types import Motion

LONGEST_NAME = 40
STEP_FIELDS = {
    "action", "manner", "direction", "speed", "body_part", "object", "type", "side", "count", "duration_s",
}  # fmt: skip
"""Slots of a step that `t2d-rt motion` prints."""
FEWER = 1
"""Exit code where fewer descriptions were written than asked for."""
MOST_ROWS = 64
"""Greatest number of motions on one contact sheet; nobody can look through a picture of more."""
DEEP_M = 0.05
"""Depth [m] of the skin below the floor from which it is reported: files know their floor to some centimetres, flesh gives way."""
TOLD = "assumed", "turned level", "tilted by", "inclines", "never move", "root motion"
"""Words of a motion's report on which the verdict depends: a wrong rate is a wrong speed."""


# --- motion ---------------------------------------------------------------------------------------------------------


def motion(
    file: str,
    output: str | None = None,
    overwrite: bool = False,
    seed: int = 0,
    provider: str = "auto",
    body: str | None = None,
    stature_m: float | None = None,
    duration_s: float | None = None,
    library: str | None = None,
) -> None:
    """Makes a motion file (.bvh) of what a sentence says that a person does.

    file: the sentence, in quotes.
    output: file to write (.bvh); by default it has the words of the sentence for a name.
    seed: seed of all that is drawn: person, clips, speed; the same seed gives the same motion.
    provider: how it is made. auto: each step of the description by what suits it; library: recorded clips, changed gaits and key
        poses, everything but falls; physics: falls in a physics engine (extra [falls]); momask: your own checkout of MoMask
        (environment variables T2D_MOMASK and T2D_MOMASK_PYTHON); files:FOLDER, a folder of results of text-to-motion models.
    body: body whose proportions are taken; by default one that suits the sentence.
    stature_m: stature of the person [m]; by default drawn for the sentence.
    duration_s: duration of the main action [s], where the sentence says nothing of it.
    library: index of clips of your own; by default the one that t2d-rt library add writes to, if there is one.

    examples:
      t2d-rt motion "a person walks slowly forward" -o walk.bvh
      t2d-rt motion "an old man walks to the left and sits down" --seed 7 -o sit.bvh
      t2d-rt motion "a child jumps three times" --stature-m 1.2 -o jump.bvh
      t2d-rt motion "a person dances" --provider files:results_of_mdm -o dance.bvh
      t2d-rt simulate walk.bvh                                   # and its radar data
    """
    from t2d_rt.motion.generate import COMPOSED, motion_from_text, understood
    from t2d_rt.motion.generate.library.users import registry
    from t2d_rt.motion.write import check_target, save_motion

    description, left_out = understood(file)
    target = Path(output or f"{_stem(file)}.bvh")
    check_target(target, overwrite=overwrite)
    index = registry() if library is None and provider in COMPOSED and registry().is_file() else library
    new_motion = motion_from_text(
        description, provider=provider, seed=seed, body=body, stature_m=stature_m, duration_s=duration_s, library=index
    )
    save_motion(new_motion, target, overwrite=overwrite)
    steps = "; then ".join(map(_words, description.steps))
    say(f"class {description.activity}, {description.subject.replace('_', ' ')}: {steps}")
    if left_out:
        say(left_out)
    for line in new_motion.origin[1:]:
        say(f"  {line}")
    say(f"wrote {target}: {new_motion.duration_s:.2f} s at {new_motion.rate_hz:g} Hz")


def _words(step: Step) -> str:
    """The slots of a step in words."""
    values = step.model_dump(include=set(type(step).model_fields) & STEP_FIELDS, exclude_defaults=True)
    action = values.pop("action").replace("_", " ")
    slots = (f", {name.replace('_', ' ')} {str(value).replace('_', ' ')}" for name, value in values.items())
    return action + "".join(slots)


def _stem(sentence: str) -> str:
    """A file name made of a sentence's words."""
    words = "_".join(re.findall(r"[a-z0-9]+", sentence.lower()))
    if not words:
        raise InputError("a sentence has words; write what a person does, as 'a person walks forward'")
    return words[:LONGEST_NAME].rstrip("_")


# --- describe -------------------------------------------------------------------------------------------------------


def describe(
    file: str | None = None, class_: list[str] | None = None, count: int = 200, output: str | None = None,
    overwrite: bool = False, seed: int = 0, source: Literal["grammar", "openai"] = "grammar", model: str | None = None,
    base_url: str | None = None, budget: int | None = None, budget_tokens: int | None = None, timeout_s: float = 60.0,
) -> int:  # fmt: skip
    """Writes descriptions of activities, with their properties in slots, as JSON lines; or prints the slots of a sentence. The
    exit code is 1 where a language model gave fewer descriptions than asked for. Its key comes from T2D_API_KEY or OPENAI_API_KEY
    in the environment; a local endpoint needs none.

    file: a sentence whose slots are printed; the word --file may be left out.
    class_: class of activity, several with commas between them, or all: walking, abnormal_walking, running, falling, sitting,
        bending, jumping, dancing.
    count: descriptions of each class.
    output: file to write (.jsonl); by default they are printed.
    seed: seed of all choices; the same one gives the same descriptions.
    source: who writes them: grammar, or openai (any OpenAI-compatible endpoint).
    model: name of the language model, as the endpoint knows it.
    base_url: address of the endpoint, such as http://localhost:8000/v1.
    budget: most requests for each class; by default 6 for every 10 descriptions.
    budget_tokens: most tokens for each class; by default as many as it takes.
    timeout_s: longest time that a reply may take [s].

    examples:
      t2d-rt describe --class falling -n 200 -o falls.jsonl      # by the grammar, without network
      t2d-rt describe --class all -n 200 --seed 1 -o all.jsonl
      t2d-rt describe --class "normal walking, sitting" -n 5     # printed
      t2d-rt describe "a man slips on the stairs and falls back" # the slots of a sentence, and what was not understood
      t2d-rt describe --class running -n 50 -o runs.jsonl --source openai --model NAME --base-url http://localhost:8000/v1
    """
    from t2d_rt.motion.descriptions.diversity import NEAREST, diversity
    from t2d_rt.motion.descriptions.grammar import MOST_DESCRIPTIONS, grammar_descriptions
    from t2d_rt.motion.descriptions.parse import parse_description
    from t2d_rt.motion.descriptions.slots import as_json, json_lines, write_descriptions

    if file is not None:
        if class_ is not None or output is not None:
            raise InputError("give either a sentence, whose slots are printed, or --class with -n and -o")
        parsed = parse_description(file)
        say(json.dumps(as_json(parsed.description), ensure_ascii=False))
        if str(parsed):
            say(f"t2d-rt: {parsed}", file=sys.stderr)
        return 0
    if class_ is None:
        raise InputError(f"no class given; name one with --class ({', '.join(ACTIVITIES)} or all), or give a sentence")
    activities = activities_of(",".join(class_))
    integer("count", count, 1, MOST_DESCRIPTIONS)
    model_options = {"model": model, "base_url": base_url, "budget": budget, "budget_tokens": budget_tokens}
    if source == "grammar" and any(value is not None for value in model_options.values()):
        option = next(name.replace("_", "-") for name, value in model_options.items() if value is not None)
        raise InputError(f"--{option} is for a language model; add --source openai, or leave it out")
    if source == "openai" and model is None:
        raise InputError("no model given; name one with --model, as the endpoint knows it")
    if output is not None:
        check_file(Path(output), "a file of descriptions", ".jsonl", overwrite=overwrite)
    written: list[Description] = []
    shortages: list[str] = []
    for activity in activities:
        if source == "openai":
            of_activity, reason = _by_model(
                activity, count, seed, str(model), base_url, timeout_s, budget, budget_tokens
            )
            shortages += [reason] if reason else []
        else:
            of_activity = grammar_descriptions(activity, count, seed=seed)
        say(f"{activity}: {diversity(of_activity)}", file=sys.stderr)
        written += of_activity
    if output is None:
        say(json_lines(written).rstrip("\n"))
    else:
        write_descriptions(Path(output), written, overwrite=overwrite)
        say(f"{output}: {len(written)} descriptions, no two of a class {NEAREST:.0%} alike in their words or more")
    for reason in shortages:
        say(f"t2d-rt: {reason}", file=sys.stderr)
    return FEWER if shortages else 0


def activities_of(names: str) -> list[Activity]:
    """The classes that a text names, with dashes, underscores or spaces, also in the paper's words ("normal walking").

    >>> activities_of("Normal walking, abnormal-walking")
    ['walking', 'abnormal_walking']
    """
    activities_by_name: dict[str, Sequence[Activity]] = {activity: (activity,) for activity in ACTIVITIES}
    activities_by_name |= {"all": ACTIVITIES, "normal_walking": ("walking",), "abnormal_gait": ("abnormal_walking",)}
    activities: list[Activity] = []
    for name in names.strip().strip("[]").split(","):
        key = re.sub(r"[\s_-]+", "_", name.strip().strip("'\"").lower())
        if key not in activities_by_name:
            raise InputError(f"unknown class {shown(name.strip())}; {names_advice(key, (*ACTIVITIES, 'all'))}")
        activities += [activity for activity in activities_by_name[key] if activity not in activities]
    return activities


def _by_model(
    activity: Activity,
    count: int,
    seed: int,
    name: str,
    base_url: str | None,
    timeout_s: float,
    requests: int | None,
    tokens: int | None,
) -> tuple[list[Description], str]:
    """Descriptions of a class by a language model, and a sentence that says why there are too few, or an empty text."""
    from t2d_rt.core.progress import ProgressBar
    from t2d_rt.motion.descriptions.language_model import LanguageModel, TokenBudget, model_descriptions

    model = LanguageModel(model=name, base_url=base_url, timeout_s=timeout_s)
    budget = TokenBudget(requests=requests, tokens=tokens)
    with ProgressBar(f"{activity} by {name}") as bar:
        written = model_descriptions(activity, count, model=model, seed=seed, budget=budget, progress=bar)
    say(f"{activity}: {written}", file=sys.stderr)
    shortage = f"only {len(written.descriptions)} of {written.wanted} descriptions of {activity} were made"
    return list(written.descriptions), f"{shortage}: {written.stopped}" if written.stopped else ""


# --- check-motion ---------------------------------------------------------------------------------------------------


def check_motion(
    files: list[str] | None = None,
    class_: Activity | None = None,
    strict: bool = False,
    sheet: str | None = None,
    body: str = "adult",
    overwrite: bool = False,
    *,
    motion: Reading,
) -> int:
    """Judges motion files by limits of recorded motion (sliding feet, floor, flight, jerk, joints, jumps), tells falls, and
    which of several files repeats another one. The exit code is 0 when all files were judged, whatever the verdicts (see
    --strict), and 2 where one cannot be read.

    files: motion files of any format that simulate reads; the word --file may be left out.
    class_: what the motions should be: walking, abnormal_walking, running, falling, sitting, bending, jumping or dancing.
    strict: whether the exit code is 1 where a motion does not pass.
    sheet: picture to write (.png, .pdf or .svg): each motion's skinned body over time.
    body: body on the sheet, whose skin is looked for below the floor (t2d-rt list bodies).

    examples:
      t2d-rt check-motion walk.bvh                               # passed, or why not; whether there is a fall in it
      t2d-rt check-motion made/*.bvh --class falling --strict    # exit code 1 where one is not a sound fall
      t2d-rt check-motion made/*.bvh --sheet made.png            # and a picture of each, skinned, over time
    """
    from t2d_rt.motion import load_motion
    from t2d_rt.motion.check import check_motion as checked
    from t2d_rt.motion.check import copies

    if not files:
        raise InputError("check-motion needs a motion file; t2d-rt check-motion FILE...")
    if sheet is not None:
        check_picture(Path(sheet), overwrite=overwrite)
        if len(files) > MOST_ROWS:
            limit = f"a sheet has {MOST_ROWS} motions at most"
            raise InputError(f"{limit}, got {len(files)}; give fewer, or leave out --sheet")
    judged: list[tuple[Path, Motion, Verdict]] = []
    for path in map(Path, files):
        try:
            loaded = load_motion(path, **motion)
        except InputError as error:  # a line says why; the other files are judged
            say(f"t2d-rt: {' '.join(str(error).split())}", file=sys.stderr)
        else:
            judged.append((path, loaded, checked(loaded, expected=class_)))
    if sheet is not None and judged:
        from t2d_rt.view.contact_sheet import contact_sheet

        labels = [f"{path.name}\n{'passed' if verdict.passed else 'refused'}" for path, _, verdict in judged]
        figure = contact_sheet([loaded for _, loaded, _ in judged], labels=labels, body=body)
        write_picture(figure, Path(sheet), overwrite=overwrite)
    copied_from = {second: first for first, second in reversed(copies([loaded for _, loaded, _ in judged]))}
    for number, (path, loaded, verdict) in enumerate(judged):
        say(
            _verdict(
                path, verdict, loaded, body, repeats=judged[copied_from[number]][0] if number in copied_from else None
            )
        )
    passed = sum(verdict.passed and number not in copied_from for number, (*_, verdict) in enumerate(judged))
    if len(judged) > 1:
        say(f"{passed} of {len(judged)} pass")
    if sheet is not None and judged:
        say(f"wrote {sheet}")
    return 2 if len(judged) < len(files) else int(strict and passed < len(judged))


def _verdict(path: Path, verdict: Verdict, motion: Motion, body: str, *, repeats: Path | None) -> str:
    from t2d_rt.body import depth_m

    lines = [f"{path}: {'passed' if verdict.passed and repeats is None else 'refused'}"]
    lines += [] if repeats is None else [f"  it repeats {repeats}"]
    lines += [f"  {clause}" for clause in motion.report.split("; ") if any(word in clause for word in TOLD)]
    lines += [f"  {reason}" for reason in verdict.reasons]
    if (deep_m := depth_m(motion, body)) > DEEP_M:
        lines.append(f"  skin: body {body} reaches {100 * deep_m:.1f} cm below the floor at z = 0")
    if verdict.fall.happened:
        lines.append(f"  fall: {verdict.fall.reason}")
    return "\n".join(lines)


# --- library --------------------------------------------------------------------------------------------------------


def library(files: list[str] | None = None, index: str | None = None, library: str | None = None) -> None:
    """Adds motion files of yours to the clips that t2d-rt motion chooses from, by path, without copying; lists, removes.

    files: one of add, list and remove, and the folder or file: add DIR --index FILE.csv, list, or remove PATH.
    index: table of the clips in DIR (.csv): columns file, class, action, and any of start_s, stop_s, direction, speed, text.
    library: index that holds your clips; by default t2d-rt/library.csv in your folder for data.

    examples:
      t2d-rt library add recordings --index clips.csv            # file,class,action[,start_s,stop_s,direction,speed,text]
      t2d-rt library list                                        # what there is: clips that ship, and yours
      t2d-rt library remove recordings                           # takes them out of the library; the files stay
    """
    from t2d_rt.motion.generate.library.users import add, registry, remove

    verb, *paths = files or [""]
    if verb not in ("add", "list", "remove"):
        raise InputError(
            f"library needs one of add, list, remove, got {verb or 'nothing'}; t2d-rt library --help shows examples"
        )
    if len(paths) != (verb != "list"):
        raise InputError(f"library {verb} takes {'no path' if verb == 'list' else 'one path'}, got {len(paths)}")
    if index is None and verb == "add":
        raise InputError("library add needs the table of clips; give --index FILE.csv")
    if index is not None and verb != "add":
        raise InputError("--index belongs to library add")
    place = library or registry()
    if verb == "list":
        _list_clips(library)
    elif verb == "remove":
        say(f"removed {remove(paths[0], library=library)} clips from {place}; their files stay")
    else:
        rows, replaced = add(paths[0], str(index), library=library)
        instead = f", in place of {replaced} that it had of the same files" if replaced else ""
        say(f"added {len(rows)} clips ({_counted(row['action'] for row in rows)}) to {place}{instead}")


def _list_clips(library: str | None) -> None:
    from t2d_rt.motion.generate.library.store import RATE_HZ, shipped
    from t2d_rt.motion.generate.library.users import registry, with_users

    index = library or registry()
    store = with_users(shipped(), index) if library or Path(index).is_file() else shipped()
    shipped_segments = [segment for segment in store.segments if segment.clip not in store.own]
    say(f"{len(shipped_segments)} clips ship: {_counted(segment.action for segment in shipped_segments)}")
    for segment in store.segments:
        if segment.clip in store.own:
            times = (
                f"{segment.start / RATE_HZ:.2f} to {(segment.stop - 1) / RATE_HZ:.2f} s, {segment.speed_mps:.2f} m/s"
            )
            say(f"{store.own[segment.clip]}: {segment.action}, {times}")


def _counted(actions: Iterable[str]) -> str:
    return ", ".join(f"{count} {action.replace('_', ' ')}" for action, count in sorted(Counter(actions).items()))
