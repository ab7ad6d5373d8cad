"""The words of a command line as its parser takes them, config files and radars by name; the parser's complaints in plain words."""

from __future__ import annotations

import difflib
import itertools
import re
from collections import deque
from collections.abc import Collection, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import load_yaml, read_yaml

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

SHORT = {"-o": "--output", "-n": "--count"}

FLAGS = (
    "--overwrite",
    "--truth",
    "--align",
    "--animate",
    "--relative",
    "--help",
    "--print_config",
    "--strict",
    "--leave_out",
    "--augment",
    "--sliding",
)
"""Options that need no value."""

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
RANGE = re.compile(rf"\s*({NUMBER}):({NUMBER}):({NUMBER})\s*")
"""First, last and step of a range."""
ENTRY = re.compile(r"\s*[a-z_]+:")
"""How an entry of --add begins."""
MOST_VALUES = 1000
"""Values of one range."""

PLAIN_TYPES = {
    "<class 'float'>": "a number",
    "<class 'int'>": "a whole number",
    "<class 'bool'>": "true or false",
    "<class 'str'>": "a text",
    "<class 'tuple'>": "a list such as [1, 2.5]",
    "<class 'collections.abc.Sequence'>": "a list such as [1, -2, 1]",
    "<class 'list'>": "a list such as [fan:2,1,1, pet:3,0,0]",
    "<class 'dict'>": "a mapping such as {kind: fan, position_m: [2, 1, 1]}",
    "<class 'NoneType'>": "null",
}
"""Types as the parser names them, in words of its users."""


def resolved(
    arguments: Sequence[str], *, configurable: bool = True, several: bool = False, varied: dict[str, list[str]] | None = None
) -> list[str]:  # fmt: skip
    """Arguments as the parser wants them: --name_with_underscores=value, a bare word as --file, config files and radars first.

    A value may begin with a dash (--motion.up -z). Config files and --radar become texts for --config, in this order, so
    that a radar's fields can be overridden and a preset's name will do, in a config file too; only where the command is
    `configurable`. Where a command takes `several` files, they become one list.
    Of values that hold a range or alternatives the first is taken, and all are put into `varied`, where it is given.
    """
    files: list[str] = []
    configs: list[str] = []
    radars: list[str] = []
    added: list[str] = []
    rest: list[str] = []
    waiting = deque(arguments)
    while waiting:
        word = waiting.popleft()
        if word == "--":  # nothing after it is an option
            files.extend(waiting)
            break
        option = re.fullmatch(r"(-[on]|--[A-Za-z][\w.-]*)(?:=(.*))?", word, flags=re.DOTALL)
        if option is None:
            if re.match("-.", word) and word != "-h":
                raise InputError(f"unknown option {word[:60]}; t2d-rt COMMAND --help lists all")
            (rest if word == "-h" else files).append(word if word == "-h" else _one("--file", word, varied))
            continue
        name = SHORT.get(option[1]) or "--" + option[1][2:].replace("-", "_")
        value = option[2]
        if name == "--config" and not configurable:
            raise InputError(f"unknown option {name}; t2d-rt COMMAND --help lists all")
        if value is None and name not in FLAGS and waiting and not re.match(r"--[A-Za-z]|--$|-[onh]$", waiting[0]):
            value = waiting.popleft()
        if value is None:
            if name not in FLAGS:
                raise InputError(f"option {name} needs a value; t2d-rt COMMAND --help lists all")
            rest.append(name)
            continue
        value = _one(f"--add {len(added)}" if name == "--add" else name, value, varied)
        if name == "--config":
            configs.append(f"--config={_config_text(value)}")
        elif name == "--radar" and configurable:
            radars.append(f"--config={_yaml({'radar': _radar_fields(value)})}")
        elif name == "--add":
            if not value.isascii() and value != value.encode(errors="ignore").decode():
                raise InputError(f"option --add takes a text in UTF-8, got {shown(value)}; rename the file")
            added.append(value)
        elif name in ("--file", "--again"):
            files.append(value)
        else:
            rest.append(f"{name}={value}")
    if several:
        files = [_yaml(files)] if files else []
    if len(files) > 1:
        raise InputError(f"expected one file, got {len(files)} ({', '.join(files[:9])}); run once for each")
    rest += [f"--add={_yaml(added)}"] if added else []
    return [*configs, *radars, *(f"--file={name}" for name in files), *rest]


def _one(name: str, value: str, varied: dict[str, list[str]] | None) -> str:
    """The value that stands for an option whose values may be several, which are noted in `varied`."""
    if varied is None or name in ("--vary", "--config", "--output"):
        return value
    found = entries(value) if name.startswith("--add ") else alternatives(value)
    if len(found) > 1:
        varied[name] = found
    return next((each for each in found if each != "none"), found[0])


def alternatives(text: str) -> list[str]:
    """What a text stands for: the numbers of a range first:last:step, or the texts between | signs.

    >>> alternatives("0:900:300"), alternatives("mesh|ellipsoid"), alternatives("0.1:0.3:0.1|1")
    (['0', '300', '600', '900'], ['mesh', 'ellipsoid'], ['0.1', '0.2', '0.3', '1'])
    """
    return [each for part in text.split("|") for each in _values(part)]


def _values(part: str) -> list[str]:
    found = RANGE.fullmatch(part)
    if found is None:
        return [part.strip() if "|" in part else part]
    first, last, step = (Decimal(each) for each in found.groups())
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
    whole: list[str] = []
    for part in text.split("|"):
        if whole and not ENTRY.match(part):
            whole[-1] += f"|{part}"  # one more value of the entry's last field
        else:
            whole.append(part)
    found = []
    for entry in whole:
        kind, colon, rest = entry.partition(":")
        choices = []
        for word in rest.split(","):
            key, equals, value = word.rpartition("=")
            choices.append([f"{key}{equals}{each}" for each in alternatives(value)])
        found += [f"{kind}{colon}{','.join(words)}" for words in itertools.product(*choices)]
    return found


def check_nulls(parser: ArgumentParser, options: Namespace) -> None:
    """Refuses null for options that do not take it: the parser lets it pass in config files, as if it were no value."""
    for name, value in options.items():
        if value is None and parser.get_default(name) is not None:
            again = parser.parse_args(["--file=[any]", f"--{name}=null"])
            if again[name] is not None:
                raise InputError(f"option {name} must be a text, got null; leave it out to have its default")


def _config_text(path: str) -> str:
    values = read_yaml(
        path, noun="config file", example="options and values such as 'seed: 3'; --print_config shows all"
    )
    if isinstance(values.get("radar"), str):
        values["radar"] = _radar_fields(values["radar"])
    for section in ("radar", "motion", "signal", "accuracy"):
        if section in values and not isinstance(values[section], dict):
            raise InputError(
                f"'{section}' in config file {path} must hold options and values, got {shown(values[section])}"
            )
    return _yaml(values)


def _radar_fields(name: str) -> dict[str, Any]:
    from t2d_rt.types import Radar

    own = Path(name).suffix.lower() in (".yaml", ".yml")
    return (Radar.from_yaml(name) if own else Radar.preset(name)).model_dump(mode="json")


def _yaml(values: dict[str, Any] | list[str]) -> str:
    import yaml

    return str(yaml.safe_dump(values, sort_keys=False))


def bounded_yaml(text: str) -> Any:
    """A value or config as the parser's own loader reads it, within the limits of `load_yaml`."""
    from jsonargparse import get_loader

    load_yaml(text)
    return get_loader("yaml")(text)


def one_sentence(message: str, command: str, options: Collection[str] = ()) -> str:
    """What the parser found wrong, in plain words."""
    help_command = f"t2d-rt {command} --help"
    wrong = re.match(r'Parser key "(.+?)":', message)
    given = re.search(r"(?:Got|Given) value: (.*)", message, flags=re.DOTALL)
    if wrong and given:
        kinds = re.findall(r"Expected an? (.+?)(?:\. Got value|\n|$)", message)
        expected = dict.fromkeys(word for kind in kinds for word in _plain_type(kind))
        return f"option {wrong[1]} must be {' or '.join(expected)}, got '{_one_line(given[1])}'; see {help_command}"
    if "are required: file" in message:
        return f"no file given; name one, as in the examples of {help_command}"
    unknown = re.search(r"unrecognized arguments: (\S+)|Option '(.+)' is not accepted", message)
    if unknown:
        name = (unknown[1] or unknown[2]).partition("=")[0]
        close = difflib.get_close_matches(name, options, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        return f"unknown option {name}; {hint}{help_command} lists all"
    return f"{_one_line(message, 300)}; see {help_command}"


def _one_line(text: str, width: int = 100) -> str:
    line = " ".join(text[: 10 * width].split())
    return line if len(line) <= width else line[: width - 3] + "..."


def _plain_type(kind: str) -> list[str]:
    """The parser's word for a type in words of its users: one, or the values there are."""
    if kind.startswith("typing.Literal"):
        return re.findall(r"'([^']*)'", kind)
    count = re.match(r"tuple with (\d+) elements", kind)
    return [f"a list of {count[1]} numbers" if count else PLAIN_TYPES.get(kind, kind)]
