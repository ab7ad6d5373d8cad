"""The benchmark: makes the first samples of its recipe, checks them, trains the baselines, writes the table of docs/benchmark.md.

`python -m validation.datasets.frozen DIR --limit 320` makes, trains and prints; with `--freeze` the table and the hash of the
content go into docs/benchmark.md and into the recipe that ships, from where `t2d-rt dataset check` compares. A stopped run goes
on: samples and lines that are there stay.
"""

from __future__ import annotations

import json
import re
import sys
import warnings
from argparse import ArgumentParser
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import T2DWarning
from t2d_rt.dataset import Dataset, Recipe, check_dataset, make_dataset
from t2d_rt.dataset.recipe import FOLDER
from t2d_rt.dataset.shards import content_hash, frozen_differences
from t2d_rt.learn import TrainOptions, benchmark, maps_of, train_model
from t2d_rt.learn.baselines import BASELINES, baseline_probabilities
from t2d_rt.learn.benchmark_line import line

RECIPE = "benchmark-3"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "benchmark.md"
BEGIN, END = "<!-- table -->", "<!-- end of the table -->"
HEAD = "| model | train / val / test | accuracy | macro-F1 | accuracy by condition |\n|---|---|---|---|---|"
OPTIONS = TrainOptions(epochs=24, batch=32, schedule="cosine", precision="bfloat16")
"""Of networks: the protocol of Table III with 6400 samples, in twice the epochs, since there are half as many maps; chosen for no
score."""
NETWORKS = ("streaming", "vgg-7")
SEEDS = (0, 1)
QUICK = 8
"""So many first samples are frozen as well, for a test that makes them again."""


def told(name: str, dataset: Dataset) -> str:
    """The line of a baseline."""
    from sklearn.dummy import DummyClassifier
    from sklearn.ensemble import ExtraTreesClassifier

    model, _, seed = name.partition(", seed ")
    if model == "the commonest class":
        return str(benchmark(dataset.path, DummyClassifier(), name=name))
    if model == "extra trees on cells":
        return str(benchmark(dataset.path, ExtraTreesClassifier(300, random_state=0, n_jobs=1), name=name))
    maps, sides = maps_of(dataset), dataset.sides
    train, val, test = (maps.take(sides[each]) for each in ("train", "val", "test"))
    if model in BASELINES:
        probabilities = baseline_probabilities(model, train.joined(val), test)
    else:
        saved = train_model(model, train, val, OPTIONS.model_copy(update={"seed": int(seed)}))
        probabilities = saved.probabilities(test.levels)
    return str(line(name, dataset, probabilities.argmax(axis=1)))


def lines(dataset: Dataset, kept: Path) -> list[str]:
    """The lines of all baselines; those in the file are not computed again."""
    found: dict[str, str] = json.loads(kept.read_text("utf-8")) if kept.exists() else {}
    networks = [f"{name}, seed {seed}" for name in NETWORKS for seed in SEEDS]
    for name in ("the commonest class", *BASELINES, "extra trees on cells", *networks):
        if name not in found:
            found[name] = told(name, dataset)
            kept.write_text(json.dumps(found, indent=1), encoding="utf-8")
            print(found[name], flush=True)
    return list(found.values())


def freeze(contents: dict[int, str], table: str) -> None:
    """Writes the table into the page, and hashes by the number of first samples into the recipe that ships."""
    page = PAGE.read_text("utf-8")
    begin, end = page.index(BEGIN) + len(BEGIN), page.index(END)
    PAGE.write_text(f"{page[:begin]}\n{table}\n{page[end:]}", encoding="utf-8")
    recipe = FOLDER / f"{RECIPE}.yaml"
    known = dict(Recipe.read(RECIPE).frozen) | contents
    text = re.sub(r"^frozen:\n(?:  .*\n)*", "", recipe.read_text("utf-8"), flags=re.MULTILINE)
    rows = "".join(f"  - [{number}, {each}]\n" for number, each in sorted(known.items()))
    recipe.write_text(f"{text}frozen:\n{rows}", encoding="utf-8")


def main(words: list[str]) -> int:
    """Exit code: 1 where the content is damaged, or not what is frozen and not to be frozen anew."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, default=None)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--freeze", action="store_true", help="write docs/benchmark.md and the recipe")
    options = parser.parse_args(words)
    warnings.simplefilter("ignore", T2DWarning)
    recipe = Recipe.read(RECIPE)
    count = make_dataset(recipe, options.folder, limit=options.limit, workers=options.workers).samples
    if faults := check_dataset(options.folder) or (
        [] if options.freeze else [*frozen_differences(options.folder, recipe)]
    ):
        print(*faults, sep="\n")
        return 1
    content, samples = content_hash(options.folder, recipe, count)
    dataset = Dataset(options.folder)
    overlaps = [each["overlap_m"] for each in dataset.records]
    told_of = f"The first {samples} of {recipe.samples} samples, content `{content}`."
    print(
        told_of, f"{np.mean(np.array(overlaps) > 0.1):.1%} overlap walls or furniture by more than 10 cm.", flush=True
    )
    table = "\n".join(
        [told_of, "", HEAD, *lines(dataset, options.folder.with_name(f"{options.folder.name}_{content[:12]}.json"))]
    )
    print(table)
    if options.freeze:
        quick, _ = content_hash(options.folder, recipe, QUICK)
        freeze({QUICK: quick, count: content}, table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
