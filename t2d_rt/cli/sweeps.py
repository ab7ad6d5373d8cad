"""`t2d-rt sweep`: options that hold ranges and alternatives, and a recording for each combination of their values."""

from __future__ import annotations

import itertools
import re
from decimal import Decimal
from pathlib import Path
from typing import Any

from t2d_rt.cli.experiments import OF_SCENE, Job, OfSweep, is_experiment, target_of
from t2d_rt.cli.options import Signal
from t2d_rt.cli.output import say, write_picture
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import load_yaml

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
RANGE = re.compile(rf"\s*({NUMBER}):({NUMBER}):({NUMBER})\s*")
"""First and last value, and step, of a range."""
ENTRY = re.compile(r"\s*[a-z_]+:")
"""Beginning of an entry of --add."""
MOST_VALUES = 1000
"""Greatest number of values of one range."""


def sweep(
    file: str,
    output: str | None = None,
    vary: list[str] | None = None,
    *,
    given: OfSweep,
    signal: Signal,
    varied: dict[str, list[str]],
) -> None:
    """Simulates a motion file, an experiment (.yaml) or a result (.zarr) again and again with some options varied, and compares the
    recordings with the first. Any option of motion, model, radar, accuracy or spectrogram may be a range, first:last:step, or
    alternatives with | between them; several make a grid. Recordings are stored as they are made, and a sweep that was stopped goes
    on; then come panels.png and panels.pdf on one scale, and table.csv; with --split also parts.png, parts.pdf and parts.csv: how
    strong each limb or path is in each of them. A target of --add is left out where it is none.

    output: folder of the recordings, the table and the pictures; by default it has FILE's name and ends in _sweep.
    vary: a field of the experiment and its values, as seed=0:9:1 or targets.1.rpm=0:900:300; the first target is number 0. Given
        once for each.

    examples:
      t2d-rt sweep walk --scene living_room --add fan:3,-1,1,rpm=0:900:300 -o fans      # four recordings, 300 rpm apart
      t2d-rt sweep walk --add "none|fan:3,-1,1,rpm=300|pet:3,-1,0" -o beside            # alternatives, quoted for the shell
      t2d-rt sweep walk --add "none|fan:2,0,1" --split segment -o hidden                # which limb does the fan hide?
      t2d-rt sweep walk --method "ellipsoid|mesh" --angle-deg 0:90:45 -o aspects        # a grid of six
      t2d-rt sweep room.yaml --vary targets.1.rpm=0:900:300 --vary seed=0:2:1 -o seeds  # fields of an experiment in YAML
    """
    from t2d_rt.sweeps import PARTS_PICTURES, PARTS_TABLE, PICTURES, TABLE
    from t2d_rt.sweeps import sweep as run_sweep

    source = Path(file)
    folder = Path(output or f"{source.name.partition('.')[0]}_sweep")
    if is_experiment(source) and set(varied) - {"file"}:
        reason = f"option {next(iter(varied))} is part of {source.name}"
        raise InputError(f"{reason}; vary the field of that name, as --vary {next(iter(varied))}=VALUES")
    values = _values(varied, vary or [], given)
    job = Job.of(file, given)
    processing = {**getattr(job.experiment, "processing", {}), **signal}
    result = run_sweep(
        job.experiment, values, folder, accuracy=job.accuracy, processing=processing, progress=True, **job.run
    )
    figures = {PICTURES: result.plot(source.name)}
    if result.parts is not None:
        figures[PARTS_PICTURES] = result.plot_parts(source.name)
    for names, figure in figures.items():
        for picture in names:
            write_picture(figure, folder / picture, overwrite=True)
    tables = [TABLE] if result.parts is None else [TABLE, PARTS_TABLE]
    say(result)
    files = [*tables, *itertools.chain(*figures)]
    say(f"wrote {', '.join(files[:-1])} and {files[-1]} beside {len(result.points)} recordings in {folder}")


def _values(varied: dict[str, list[str]], vary: list[str], given: dict[str, Any]) -> dict[str, list[Any]]:
    """Values to vary by the names of the experiment's fields, in the order in which they were given."""
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.experiment.sources import MotionFile

    values: dict[str, list[Any]] = {}
    for name, texts in varied.items():
        if name.startswith("add "):
            targets = (target_of(entry) for entry in texts)
            values[f"targets.{int(name[4:]) + 1}"] = [target and target.model_dump(mode="json") for target in targets]
        elif name in MotionFile.model_fields or name == "motion.subject":
            is_text = name in ("file", "motion.subject")
            values[f"targets.0.{name.rpartition('.')[2]}"] = texts if is_text else [load_yaml(text) for text in texts]
        elif name == "scene" and any(map(given.get, OF_SCENE)):
            values["scene.file"] = texts
        elif name in ("only_paths", "without_paths"):
            values[name] = [[path] for path in texts]
        elif name in (*Experiment.model_fields, "tolerance_db") or name.startswith(("radar.", "accuracy.", "signal.")):
            values[name] = [load_yaml(value) for value in texts]
        else:
            advice = "those of motion, model, radar, accuracy and spectrogram can, and fields by --vary"
            raise InputError(f"option {name} cannot be varied; {advice}")
    for entry in vary:
        name, equals, text = entry.partition("=")
        if not equals:
            raise InputError(f"option vary takes a field and its values, as seed=0:9:1, got {entry!r:.60}")
        values[name.strip()] = [load_yaml(alternative) for alternative in alternatives(text)]
    if not values:
        raise InputError(
            "nothing is varied; give a range or alternatives, as --seed 0:9:1, --method 'ellipsoid|mesh' or --vary seed=0:9:1"
        )
    if "radar" in varied:
        from t2d_rt.cli.experiments import radar_of
        from t2d_rt.experiment.catalog import radar_named

        if radar_of(given) != radar_named(varied["radar"][0]):
            advice = "a sweep takes several radars or changes fields of one; leave --radar.FIELD out, or give one radar"
            raise InputError(advice)
    return values


def first_of(name: str, text: str, varied: dict[str, list[str]]) -> str:
    """The first value of an option, other than "none" if there is such a one; several values are noted in `varied`."""
    values = entries(text) if name.startswith("add ") else alternatives(text)
    if len(values) > 1:
        varied[name] = values
    return next((value for value in values if value != "none"), values[0])


def alternatives(text: str) -> list[str]:
    """The values that a text stands for: the numbers of a range first:last:step, or the texts between | signs.

    >>> alternatives("0:900:300"), alternatives("mesh|ellipsoid"), alternatives("0.1:0.3:0.1|1")
    (['0', '300', '600', '900'], ['mesh', 'ellipsoid'], ['0.1', '0.2', '0.3', '1'])
    """
    parts = text.split("|")
    return [value for part in parts for value in _range(part.strip() if len(parts) > 1 else part)]


def _range(part: str) -> list[str]:
    match = RANGE.fullmatch(part)
    if match is None:
        return [part]
    first, last, step = (Decimal(bound) for bound in match.groups())
    if not step or (last - first) / step < 0:
        raise InputError(f"the range {part.strip()} never arrives; write first:last:step, as 0:900:300")
    count = int((last - first) / step) + 1
    if count > MOST_VALUES:
        raise InputError(f"the range {part.strip()} has more than {MOST_VALUES} values; choose a larger step")
    reached = first + (count - 1) * step
    if reached != last:
        raise InputError(f"the range {part.strip()} steps past its last value; write {first}:{reached}:{step}")
    return [f"{(first + number * step).normalize():f}" for number in range(count)]


def entries(text: str) -> list[str]:
    """The entries that a text of --add stands for: "none", and movers or persons with every combination of their values.

    >>> entries("fan:3,-1,1,rpm=0:600:300|pet:3,-1,0")
    ['fan:3,-1,1,rpm=0', 'fan:3,-1,1,rpm=300', 'fan:3,-1,1,rpm=600', 'pet:3,-1,0']
    """
    entry_texts: list[str] = []
    for part in text.split("|"):
        if entry_texts and not ENTRY.match(part):
            entry_texts[-1] += f"|{part}"  # one more value of the entry's last field
        else:
            entry_texts.append(part)
    combinations = []
    for entry in entry_texts:
        kind, colon, rest = entry.partition(":")
        choices = []
        for word in rest.split(","):
            key, equals, value = word.rpartition("=")
            choices.append([f"{key}{equals}{alternative}" for alternative in alternatives(value)])
        combinations += [f"{kind}{colon}{','.join(words)}" for words in itertools.product(*choices)]
    return combinations
