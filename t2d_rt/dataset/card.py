"""The data card of an exported data set: what it holds, how it was made, in which units, and how to read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from t2d_rt.core.versions import versions
from t2d_rt.dataset.read import UNITS
from t2d_rt.recording.truth import TRUTH_COLUMNS

if TYPE_CHECKING:
    from t2d_rt.dataset.splits import Split
    from t2d_rt.dataset.stored import Dataset, Product


def data_card(
    dataset: Dataset, sides: Mapping[str, np.ndarray], products: Sequence[Product], split: Split | None
) -> str:
    """README.md of a folder of parquet files: front matter for Hugging Face, then the text."""
    recipe = dataset.recipe
    front = {
        "pretty_name": f"t2d-rt {recipe.name}",
        "tags": ["radar", "FMCW", "micro-Doppler", "human activity recognition", "synthetic"],
        "size_categories": [_size(len(dataset))],
        "configs": [
            {
                "config_name": "default",
                "data_files": [{"split": name, "path": f"data/{name}-*.parquet"} for name in sides],
            }
        ],
    }
    parts = [
        f"---\n{yaml.safe_dump(front, sort_keys=False)}---\n",
        f"# {recipe.name}\n",
        f"{recipe.about}\n" if recipe.about else "",
        "Simulated FMCW radar recordings of human motion, made by t2d-rt from descriptions in words; none of it was measured. The "
        f"file recipe.yaml makes the same samples again (hash {recipe.hash}, t2d-rt {versions()['t2d-rt']}).\n",
        _counts(dataset, sides),
        _splitting(split),
        _radar(dataset),
        _arrays(dataset, products),
        _quality(dataset),
        _reading(next(iter(sides)), products[0]),
    ]
    return "\n".join(part for part in parts if part)


def _size(count: int) -> str:
    for limit, words in ((1000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")):
        if count < limit:
            return words
    return "1M<n<10M"


def _counts(dataset: Dataset, sides: Mapping[str, np.ndarray]) -> str:
    labels = dataset.labels
    head = f"| label | class | {' | '.join(sides)} |\n|---|---|{'---|' * len(sides)}\n"
    rows = (
        f"| {number} | {name} | " + " | ".join(f"{np.sum(labels[each] == number)}" for each in sides.values()) + " |"
        for number, name in enumerate(dataset.classes)
    )
    return "## Samples\n\n" + head + "\n".join(rows) + "\n"


def _splitting(split: Split | None) -> str:
    if split is None:
        return "The samples are not split; `t2d-rt dataset split` does so without leaks.\n"
    text = f"No {', '.join(split.apart[:-1])}{' or ' if len(split.apart) > 1 else ''}{split.apart[-1]} is on two sides."
    text += "".join(f" {count} {kind}s are on two sides." for kind, count in split.shared.items())
    return text + (f" {len(split.left_out)} samples were left out for it.\n" if split.left_out else "\n")


def _radar(dataset: Dataset) -> str:
    recipe = dataset.recipe
    radars = {each.name: each.radar or recipe.radar for each in recipe.conditions}
    head = "## Radar and scene\n\n| condition | scene | model | carrier [GHz] | bandwidth [GHz] | speeds [m/s] | range bin [cm] |\n"
    rows = []
    for each in recipe.conditions:
        radar = radars[each.name]
        rows.append(
            f"| {each.name} | {each.scene} | {each.method} | {radar.mid_frequency_hz / 1e9:.2f} | {radar.bandwidth_hz / 1e9:.2f} | "
            f"+-{radar.max_speed_mps:.2f} | {100 * radar.range_resolution_m:.2f} |"
        )
    return head + "|---|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n"


def _arrays(dataset: Dataset, products: Sequence[Product]) -> str:
    lines = ["## Columns\n"]
    for product in products:
        array, told = dataset.array(0, product), dataset.records[0]["products"][product]
        axes = ", ".join(
            f"{name.rpartition('_')[0]} {told[name][0]:.4g} to {told[name][1]:.4g} {unit}"
            for name, unit in UNITS.items()
            if name in told
        )
        lines.append(f"- `{product}`: {array.dtype}, {_meaning(dataset, product)}{f'; {axes}' if axes else ''}")
    lines += [
        "- `label`: number of the class; `sentence`: what the person does; `description`: its number in the class",
        "- `seed`, `provider`, `body`, `distance_m`, `angle_deg` (of the motion against the line to the radar), `condition`",
        "- `snr_db`: what moves in the echoes over all noise of an ADC sample; `error_db`: error of the field, where measured",
        "- `passed`: whether the filter of motions takes the motion for one of its class",
        "- `record`: all of this and the origin of the motion, as JSON; of a map its `peak_db` [dB re 1 W] and edges of axes",
    ]
    return "\n".join(lines) + "\n"


def _meaning(dataset: Dataset, product: Product) -> str:
    kept: Any = dataset.recipe.products.kept[product]
    if product == "adc":
        return "(chirp, antenna, sample) of the ADC in sqrt(W), real and imaginary part last" + (
            ", over `greatest` of the record" if kept.dtype == "float16" else ""
        )
    if product == "points":
        return "(point, 6): time [s], range [m], azimuth [rad], elevation [rad], speed [m/s], SNR [dB]"
    if product == "truth":
        return (
            f"(time, {len(TRUTH_COLUMNS)}) of the labelled person at {kept.rate_hz:g} Hz: time [s], 22 joints forward, left and up "
            "from the radar [m], then range [m], speed [m/s], azimuth [rad], elevation [rad] and visible fraction of 17 segments, "
            "and whether heel and ball of the left and the right foot stand"
        )
    axes = "(speed, time)" if product == "spectrogram" else "(frame, speed, range)"
    static = ", without the mean over the record (MTI)" if kept.mti == "mean" else ""
    if kept.dtype == "uint8":
        return f"{axes}, 255 at the greatest cell, 0 at {kept.dynamic_range_db:g} dB below it{static}"
    return f"{axes} in dB, 0 at the greatest cell{static}"


def _quality(dataset: Dataset) -> str:
    snr = np.array([each["snr_db"] for each in dataset.records if each["snr_db"] is not None])
    errors = np.array([each["error_db"] for each in dataset.records if each["error_db"] is not None])
    passed = np.mean([each["passed"] for each in dataset.records])
    lines = [
        f"- {passed:.0%} of the motions pass the filter; samples that failed and are not here: {len(dataset.failed)}"
    ]
    if len(snr):
        lines.append(f"- SNR {np.median(snr):.1f} dB (median), {snr.min():.1f} to {snr.max():.1f} dB")
    if len(errors):
        lines.append(
            f"- measured error of the field {np.median(errors):.1f} dB (median of {len(errors)}), {errors.max():.1f} dB at most"
        )
    return "## Quality\n\n" + "\n".join(lines) + "\n"


def _reading(side: str, product: str) -> str:
    return (
        "## Reading\n\n```python\nfrom datasets import load_dataset\n\n"
        'data = load_dataset("FOLDER").with_format("numpy")  # where this file lies\n'
        f'sample = data["{side}"][0]\nsample["{product}"], sample["label"]\n```\n'
    )
