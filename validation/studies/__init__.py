"""Studies of what simulation is worth to classifiers: `python -m validation study NAME`. They need the extra [learn]."""

from __future__ import annotations

import sys
import warnings
from argparse import ArgumentParser
from collections.abc import Sequence
from importlib import import_module

from t2d_rt.core.errors import T2DError, T2DWarning
from t2d_rt.learn.pytorch import require_learning

STUDIES = {
    "benchmark": "Table III of the paper: all models on Simple and Hard, by splits that leak and that do not",
    "conditions": "trained under one condition of data sets, tested under another",
    "fidelity": "what ellipsoids, mesh, noise and room are worth to a classifier",
    "twins": "makes simulated twins of PARrad's real recordings, for gap and transfer",
    "gap": "how twins differ from real recordings, before any training",
    "mars": "points of MARS's IWR1443 beside simulated ones of the same movements",
    "points": "points of a simulated IWR6843 beside recorded ones: people who sit, squat and stand",
    "walks": "recorded spectrograms of walks beside simulated ones, at several fidelities",
    "vital": "vital signs of simulated people at rest and of recordings, by one measure",
    "transfer": "Table IV: what learning from twins first is worth",
    "nested": "real events alone, by repeated grouped folds, with all that is tuned chosen within the training",
}
"""Each is a module of this folder that has `add_options(parser)` and `run(options)`, which gives a line about what was written."""


def main(words: Sequence[str]) -> int:
    """Runs one study; exit code 2 and one sentence where its input cannot be used."""
    parser = ArgumentParser(prog="python -m validation study", description=__doc__)
    chosen = parser.add_subparsers(dest="study", required=True, metavar="NAME")
    for name, text in STUDIES.items():
        import_module(f"validation.studies.{name}").add_options(chosen.add_parser(name, help=text, description=text))
    options = parser.parse_args(words)
    try:
        require_learning()
        with warnings.catch_warnings():
            warnings.simplefilter("always", T2DWarning)
            print(import_module(f"validation.studies.{options.study}").run(options))
    except T2DError as error:
        print(f"study {options.study}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0
