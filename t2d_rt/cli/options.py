"""A command is a function: its parameters are its options, its docstring their help, and jsonargparse checks what is given."""

from __future__ import annotations

import ast
import difflib
import inspect
import re
import sys
import textwrap
from collections import deque
from collections.abc import Callable, Collection, Sequence
from functools import cached_property, partial
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import load_yaml, read_yaml

Given = dict[str, Any]
"""Values of a group's options by their names; only those that differ from the defaults."""

SHORT = {"output": "-o", "count": "-n"}
NO_OPTIONS = "varied", "radar_is_named"
"""Parameters that are not options: what a sweep varies, and whether a radar is named at all."""
COMMON = {
    "file": "The file, or a name; the word --file may be left out.",
    "overwrite": "Whether what is there under that name is replaced; without it an existing one is an error.",
}
"""Help texts of options that many commands have."""
ENTRY = re.compile(r"^( *)(\w+): (.*(?:\n\1 +\S.*)*)", flags=re.MULTILINE)
"""A parameter's entry in a docstring: "name: text", with all further lines that are indented more than the name."""
PLAIN_TYPES = {
    "<class 'float'>": "a number",
    "<class 'int'>": "a whole number",
    "<class 'bool'>": "true or false",
    "<class 'str'>": "a text",
    "<class 'collections.abc.Sequence'>": "a list such as [1, -2, 1]",
    "<class 'list'>": "a list such as [fan:2,1,1, pet:3,0,0]",
    "<class 'dict'>": "a mapping such as {kind: fan, position_m: [2, 1, 1]}",
    "<class 'NoneType'>": "null",
}
"""Plain words for the types that the parser names."""
TUPLES = {
    "tuple[tuple[": "a list of positions such as [[0, 0, 0], [0, 0.002, 0]]",
    "tuple[float, float, float]": "a list of 3 numbers",
    "tuple[float, float]": "a list of 2 numbers",
}
"""Plain words for an option that the parser calls just a tuple, by a part of the option's type."""


class Command:
    """A command of the program: the function that it calls, and the parser of its options."""

    def __init__(self, name: str, function: Callable[..., int | None], noun: str) -> None:
        from argparse import RawDescriptionHelpFormatter

        import yaml
        from jsonargparse import ArgumentParser, DefaultHelpFormatter, set_loader

        class Formatter(DefaultHelpFormatter, RawDescriptionHelpFormatter):
            pass

        set_loader("bounded yaml", bounded_yaml, (yaml.YAMLError,))
        description, _, examples = _docstring(function).partition("\nexamples:\n")
        self.name, self.function = name, function
        self.parser = ArgumentParser(
            parser_mode="bounded yaml",
            prog=f"t2d-rt {name}",
            usage=f"t2d-rt {name} {noun} [options]",
            description=description.partition("\n\n")[0].strip(),
            epilog=f"examples:\n{examples}" if examples else None,
            formatter_class=Formatter,
            exit_on_error=False,
            default_env=False,
            allow_abbrev=False,
        )
        self.hints: dict[str, Any] = {}
        self.groups: dict[str, list[str]] = {}
        """Names of the options of each parameter that stands for a group of options."""
        help_texts, hints = COMMON | parameter_help(function), get_type_hints(function, include_extras=True)
        for parameter in inspect.signature(function).parameters.values():
            if get_origin(hints[parameter.name]) is Annotated:
                before = set(self.hints)
                hints[parameter.name].__metadata__[0](self)
                self.groups[parameter.name] = [option for option in self.hints if option not in before]
            elif parameter.name not in NO_OPTIONS:
                option = "file" if parameter.name == "files" else parameter.name.rstrip("_")
                self.add(option, hints[parameter.name], parameter.default, help_texts[parameter.name])

    def add(self, name: str, hint: Any, default: Any, told: str, group: Any = None) -> None:
        """Adds one option. It is required if its default is empty, and needs no value if it is a bool whose default is False."""
        more: Given = {"required": True} if default is inspect.Parameter.empty else {"default": default}
        more |= {"nargs": "?", "const": True} if hint is bool and default is False else {}
        names = [SHORT[name], f"--{name}"] if name in SHORT else [f"--{name}"]
        told = _one_line(told).replace("%", "%%")
        action = (group or self.parser).add_argument(*names, type=hint, help=told, **more)
        action.option_strings = names  # leaves out the parser's --name+ for lists, which `words` does not take
        self.hints[name] = hint

    def add_fields(
        self, told: dict[str, str], hints: Given, defaults: Given, *, prefix: str = "", group: Any = None
    ) -> None:
        """Adds an option for each name that has a default."""
        for name, default in defaults.items():
            self.add(f"{prefix}{name}", hints[name], default, told[name], group)

    def add_config(self) -> None:
        """Adds --config, and with it --print_config, which the parser adds by itself."""
        help_text = "YAML file of options; options on the command line override those in the file."
        self.parser.add_argument("--config", action="config", help=help_text)
        for action in self.parser._actions:
            if action.dest == "print_config":
                action.help = "Prints all options with their values as a config file; skip_default leaves out defaults."

    @cached_property
    def default(self) -> Given:
        """Default values by the names of the options."""
        return dict(self.parser.get_defaults().items())

    def run(self, arguments: Sequence[str]) -> int | None:
        """Calls the function with what the arguments say; raises InputError for arguments that the parser refuses."""
        from jsonargparse import ArgumentError

        varied: dict[str, list[str]] | None = {} if "varied" in inspect.signature(self.function).parameters else None
        try:
            words = self.words(arguments, varied)
            options = self.parser.parse_args(words)
        except ArgumentError as error:
            raise InputError(
                one_sentence(str(error), self.name, self.parser._option_string_actions, self.hints)
            ) from None
        except OverflowError:  # an integer that no float holds
            advice = f"an option of {self.name} got a number of more than 300 digits; give it in SI units, as in 77e9"
            raise InputError(advice) from None
        for name, value in options.items():  # the parser takes null in a config file for no value
            if value is None and self.default.get(name) is not None and type(None) not in get_args(self.hints[name]):
                raise InputError(f"option {name} cannot be null; leave it out to have its default")
        named = any(re.search(r"^(--config=)?radar:", word, re.MULTILINE) for word in words)
        beside_options: Given = {"varied": varied, "radar_is_named": named, "files": options.get("file") or []}
        given = {name: value for name, value in options.items() if value != self.default.get(name)}
        values: Given = {}
        for name in inspect.signature(self.function).parameters:
            if name in self.groups:
                group = _nested({option: given[option] for option in self.groups[name] if option in given})
                values[name] = (
                    group.get(name, {}) if all(option.startswith(f"{name}.") for option in self.groups[name]) else group
                )
            else:
                values[name] = beside_options[name] if name in beside_options else options[name.rstrip("_")]
        return self.function(**values)

    def words(self, arguments: Sequence[str], varied: dict[str, list[str]] | None = None) -> list[str]:
        """Arguments as the parser wants them: --name_with_underscores=value, a bare word as --file, config files and radars first.

        A value may begin with a dash (--motion.up -z). Config files and --radar become texts for --config, so that a radar's fields
        can be overridden and a preset's name will do, in a config file too. The values of an option that takes several become one
        list. Of values that hold a range or alternatives the first is taken, and all are put into `varied`, where it is given.
        """
        actions = self.parser._option_string_actions
        configs: list[str] = []
        radars: list[str] = []
        rest: list[str] = []
        lists: dict[str, list[str]] = {"file": []}
        waiting = deque(arguments)
        while waiting:
            word = waiting.popleft()
            if word == "--":  # nothing after it is an option
                lists["file"].extend(waiting)
                break
            option = re.fullmatch(r"(-[on]|--[A-Za-z][\w.-]*)(?:=(.*))?", word, flags=re.DOTALL)
            if word == "-h":
                rest.append(word)
                continue
            if option is None and re.match("-.", word):
                raise InputError(f"unknown option {word[:60]}; t2d-rt {self.name} --help lists all")
            name, value = "file", word if option is None else option[2]
            if option is not None:
                typed = option[1][2:].replace("-", "_") or {short: name for name, short in SHORT.items()}[option[1]]
                name = {"again": "file", "radar_file": "radar"}.get(typed, typed)
            if (
                value is None and getattr(actions.get(f"--{name}"), "nargs", None) in (0, "?")
            ) or name == "print_config":
                rest.append(f"--{name}" if value is None else f"--{name}={value}")
                continue
            if value is None and waiting and not re.match(r"--[A-Za-z]|--$|-[onh]$", waiting[0]):
                value = waiting.popleft()
            if value is None and (f"--{name}" in actions or name == "radar"):
                raise InputError(f"option --{name} needs a value; t2d-rt {self.name} --help lists all")
            if value is None:  # a misspelt option, which the parser reports
                value = ""
            if varied is not None and name not in ("vary", "config", "output"):
                from t2d_rt.cli.sweeps import first_of

                value = first_of(f"add {len(lists.get('add', ()))}" if name == "add" else name, value, varied)
            if name in ("config", "radar") and "--config" in actions:
                text = _yaml({"radar": _radar_fields(value)}) if name == "radar" else _config_text(value)
                (radars if name == "radar" else configs).append(f"--config={text}")
            elif name == "file" or "list[str" in str(self.hints.get(name)):
                lists.setdefault(name, []).append(value)
            else:
                rest.append(f"--{name}={value}")
        files = lists["file"]
        if files and self.hints["file"] in (str, str | None):
            if len(files) > 1:
                raise InputError(f"expected one file, got {len(files)} ({', '.join(files[:9])}); run once for each")
            rest.insert(0, f"--file={lists.pop('file')[0]}")
        for name, values in lists.items():
            if any(text != text.encode(errors="ignore").decode() for text in values):
                raise InputError(f"option --{name} takes texts in UTF-8, got {shown(values)}; rename the file")
        return [*configs, *radars, *(f"--{name}={_yaml(values)}" for name, values in lists.items() if values), *rest]


def _nested(values: Given) -> Given:
    """Values by dotted names, as mappings within mappings."""
    nested: Given = {}
    for name, value in values.items():
        *outer, last = name.split(".", 1)
        (nested.setdefault(outer[0], {}) if outer else nested)[last] = value
    return nested


def parameter_help(function: Callable[..., Any]) -> dict[str, str]:
    """What a function's docstring says about each of its parameters, as a sentence on one line.

    >>> def sail(knots):
    ...     '''Sail.
    ...
    ...     knots: how fast,
    ...         over ground.
    ...     '''
    >>> parameter_help(sail)
    {'knots': 'How fast, over ground.'}
    """
    return {name: _one_line(text[0].upper() + text[1:]) for _, name, text in ENTRY.findall(_docstring(function))}


def _docstring(function: Callable[..., Any]) -> str:
    """A function's docstring, read from the source where `python -OO` has dropped it."""
    if function.__doc__ is not None or not sys.flags.optimize:
        return inspect.getdoc(function) or ""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    return (ast.get_docstring(tree) or "") if isinstance(tree, ast.FunctionDef) else ""


def defaults_of(function: Callable[..., Any], skip: Collection[str] = ()) -> Given:
    """Defaults of the parameters that may be left out, by name."""
    parameters = inspect.signature(function).parameters.values()
    return {
        parameter.name: parameter.default
        for parameter in parameters
        if parameter.name not in skip and parameter.default is not parameter.empty
    }


def _one_line(text: str, width: int | None = None) -> str:
    line = " ".join(text[: None if width is None else 10 * width].split())
    return line if width is None or len(line) <= width else line[: width - 3] + "..."


def yaml_kind(values: Given) -> str:
    """What a YAML file describes, by the keys that only one kind has: "experiment", "radar" or "options", or "" if it has none of
    these keys."""
    marks = {
        "experiment": {"targets"},
        "radar": {"carrier_hz"},
        "options": {"file", "add", "motion", "signal", "output"},
    }
    return next((kind for kind, keys in marks.items() if keys & values.keys()), "")


def _config_text(path: str) -> str:
    example = "options and values such as 'seed: 3'; --print_config shows all"
    values = read_yaml(path, noun="config file", example=example)
    if (kind := yaml_kind(values)) in ("experiment", "radar"):
        content = "an experiment: give it in the place of the motion file"
        content = content if kind == "experiment" else f"a radar: give it as --radar {path}"
        raise InputError(f"{path} holds no options, it is {content}")
    if isinstance(values.get("radar"), str):
        values["radar"] = _radar_fields(values["radar"])
    for section in ("radar", "motion", "signal", "accuracy"):
        if section in values and not isinstance(values[section], dict):
            message = f"'{section}' in config file {path} must hold options and values, got {shown(values[section])}"
            raise InputError(message)
    return _yaml(values)


def _radar_fields(name: str) -> Given:
    from t2d_rt.types.radar import radar_from

    return radar_from(name).model_dump(mode="json")


def _yaml(values: Given | list[str]) -> str:
    import yaml

    return str(yaml.safe_dump(values, sort_keys=False))


def bounded_yaml(text: str) -> Any:
    """A value or a config, read by the parser's own loader within the limits of `load_yaml`."""
    from jsonargparse import get_loader

    load_yaml(text)
    return get_loader("yaml")(text)


def one_sentence(message: str, command: str, options: Collection[str] = (), hints: Given | None = None) -> str:
    """What the parser found wrong, in one plain sentence; `hints` are the types of the options."""
    help_command = f"t2d-rt {command} --help"
    key_match = re.match(r'Parser key "(.+?)":', message)
    value_match = re.search(r"(?:Got|Given) value: (.*)", message, flags=re.DOTALL)
    nested_match = value_match and re.match(r"NestedArg\(key='([^']*)'", value_match[1])
    if key_match and nested_match:
        return (
            f"unknown option {key_match[1]}.{nested_match[1]}; {key_match[1]} takes one value here, see {help_command}"
        )
    if key_match and value_match:
        kinds = re.findall(r"Expected an? (.+?)(?:\. Got value|\n|$)", message)
        hint = str((hints or {}).get(key_match[1]))
        expected = dict.fromkeys(word for kind in kinds for word in _plain_type(kind, hint))
        return f"option {key_match[1]} must be {' or '.join(expected)}, got '{_one_line(value_match[1], 100)}'; see {help_command}"
    if "are required: file" in message:
        return f"no file given; name one, as in the examples of {help_command}"
    unknown = re.search(r"unrecognized arguments: (\S+)|Option '(.+)' is not accepted", message)
    if unknown:
        name = (unknown[1] or unknown[2]).partition("=")[0][:60]
        close = difflib.get_close_matches(name, options, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        return f"unknown option {name}; {hint}{help_command} lists all"
    return f"{_one_line(message, 300)}; see {help_command}"


def _plain_type(kind: str, hint: str) -> list[str]:
    """Plain words for a type that the parser names, of an option of type `hint`: one text, or each of the values that it allows."""
    if kind.startswith("typing.Literal"):
        return re.findall(r"'([^']*)'", kind)
    if kind == "<class 'tuple'>":
        return [next((words for form, words in TUPLES.items() if form in hint), "a list")]
    count = re.match(r"tuple with (\d+) elements", kind)
    return [f"a list of {count[1]} numbers" if count else PLAIN_TYPES.get(kind, kind)]


def capture(command: Command, *, radar: bool = True) -> None:
    """Adds the options of measured samples that `load_recording` takes, with their radar unless there is one already."""
    from t2d_rt.recording.read import load_recording

    hints, defaults, texts = get_type_hints(load_recording), defaults_of(load_recording), parameter_help(load_recording)
    texts["radar"] = (
        "Radar of measured samples: a preset's name, a .yaml file or a .cfg file; --radar_file is the same."
    )
    if not radar:
        del defaults["radar"]
    command.add_fields(texts, hints | {"radar": str | None}, defaults)


def reading(command: Command) -> None:
    """Adds the options for reading a motion file."""
    from t2d_rt.motion import load_motion

    _of_function(command, load_motion, "motion.", "reading the motion file (what is not given is detected)")


def signal(command: Command) -> None:
    """Adds the options for making a spectrogram."""
    from t2d_rt.signal import spectrogram

    _of_function(command, spectrogram, "signal.", "spectrogram")


def _of_function(command: Command, function: Callable[..., Any], prefix: str, title: str) -> None:
    """Adds a group of options, one for each parameter of a function that has a default."""
    group = command.parser.add_argument_group(title)
    hints, help_texts = get_type_hints(function), parameter_help(function)
    command.add_fields(help_texts, hints, defaults_of(function), prefix=prefix, group=group)


Capture = Annotated[Given, capture]
Samples = Annotated[Given, partial(capture, radar=False)]
Reading = Annotated[Given, reading]
Signal = Annotated[Given, signal]
