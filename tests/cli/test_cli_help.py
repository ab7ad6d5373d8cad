"""Help of the command line: every option of every command has one, and it is a whole one."""

from __future__ import annotations

import argparse
import inspect
import re

import pytest

from t2d_rt import cli
from t2d_rt.cli.options import parameter_help
from t2d_rt.motion import load_motion
from t2d_rt.simulate import simulate
from t2d_rt.types import Radar


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_option_has_a_help_that_ends(command: str) -> None:
    known = cli._command(command).parser._actions
    actions = [each for each in known if "--help" not in each.option_strings and each.help != argparse.SUPPRESS]
    told = {next(name for name in each.option_strings if name.startswith("--")): each.help or "" for each in actions}
    assert "--file" in told
    assert not {name: text for name, text in told.items() if not re.match(r"[A-Z\"]", text)}, "begin in mid-sentence"
    assert not {name: text for name, text in told.items() if not re.search(r"\w[()'\"`\]]*\.$", text)}, "do not end"
    assert not {name: text for name, text in told.items() if len(text.split()) < 3}, "say nothing"
    assert not {name: text for name, text in told.items() if text.count("(") != text.count(")")}, "lack a parenthesis"


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_says_what_it_does_and_has_examples(command: str) -> None:
    parser = cli._command(command).parser
    assert parser.description.endswith(".")
    assert parser.epilog.startswith("examples:\n  t2d-rt ")
    assert all(line.startswith("  t2d-rt ") for line in parser.epilog.splitlines()[1:])


def test_a_help_over_several_lines_is_whole() -> None:
    told = parameter_help(simulate)
    assert set(inspect.signature(simulate).parameters) <= set(told)
    entry = re.search(r"^accuracy: (.*?)^reflections: ", inspect.getdoc(simulate) or "", re.DOTALL | re.MULTILINE)
    assert entry[1].count("\n") > 2
    assert told["accuracy"].split() == ["An", *entry[1].split()[1:]]
    assert told["collisions"].endswith("unless there are `transmissions`.")
    assert parameter_help(load_motion)["floor"] == "Height of the floor in the file [m]."


def test_lines_of_another_entry_or_paragraph_do_not_belong_to_it() -> None:
    def function() -> None:
        """Do it.

        Note: nothing.

        first: one
            and more: of it,
            100 % of it.
        second: two.

        Afterwards.
        """

    assert parameter_help(function) == {
        "Note": "Nothing.", "first": "One and more: of it, 100 % of it.", "second": "Two.",
    }  # fmt: skip


def test_every_field_of_a_radar_says_its_unit() -> None:
    units = {"hz": "[Hz]", "s": "[s]", "m": "[m]", "dbm": "[dBm]", "dbi": "[dBi]", "db": "[dB]", "deg": "[deg]"}
    for name, field in Radar.model_fields.items():
        text = field.description or ""
        unit = "[Hz/s]" if name == "slope_hz_per_s" else units.get(name.rpartition("_")[2], "")
        assert unit in text, name
