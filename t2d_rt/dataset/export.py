"""Exports a data set for other programs: parquet with a data card, folders of PNG pictures, or NumPy's .npz."""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import yaml

from t2d_rt.core.atomic_write import check_place, check_taken, replacing
from t2d_rt.core.checks import choice, file_path, flag, positive
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import versions
from t2d_rt.dataset.dataset import Dataset, Product
from t2d_rt.dataset.parquet import DATA, pyarrow, write_parquet
from t2d_rt.dataset.shards import RAGGED, RECIPE, SHARDS, UNITS, mixed_kernels
from t2d_rt.dataset.splits import Split, check_split

if TYPE_CHECKING:
    from t2d_rt.dataset.products import SpectrogramProduct
    from t2d_rt.dataset.recipe import Recipe


Format = Literal["parquet", "png", "npz"]
FORMATS: tuple[Format, ...] = get_args(Format)

CARD = Path(__file__).with_name("data_card.md")
"""Template of the data card, with $ where figures are inserted."""
ALL = "all"
"""Name of the only side of a data set that is not split."""
LABELS = (
    "file", "index", "class", "label", "condition", "description", "sentence", "seed", "distance_m", "angle_deg", "snr_db",
    "passed",
)  # fmt: skip
"""First columns of labels.csv, followed by those of the picture's axes and levels."""


def export_dataset(
    dataset: Dataset | str | Path,
    folder: str | Path,
    to: Format,
    *,
    products: Collection[str] | None = None,
    split: Split | None = None,
    dynamic_range_db: float = 60.0,
    overwrite: bool = False,
) -> Path:
    """Writes finished samples to a folder, whole or not at all.

    to: "parquet" for Hugging Face's `datasets` and for pandas, with a data card; "png" for pictures of spectrograms by class, with
        labels.csv; "npz" for one file of arrays for each side of the split.
    products: names of the arrays; all that are stored by default; for pictures only spectrograms.
    split: split whose sides get separate files or folders; by default all samples are on one side.
    dynamic_range_db: range of pictures: white is the greatest cell of a spectrogram, black is this level below it [dB].
    """
    source = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    target = file_path("the folder to export to", folder)
    choice("to", to, FORMATS)
    flag("overwrite", overwrite)
    range_db = positive("dynamic_range_db", dynamic_range_db, 200, unit="dB")
    chosen = _products(source, to, products)
    if split is not None:
        check_split(source.records, split.sides, apart=split.apart)
    sides = {
        name: source.positions(indices)
        for name, indices in ({ALL: source.indices.tolist()} if split is None else split.sides).items()
    }
    for name, positions in sides.items():
        if not len(positions):
            raise InputError(f"side {name} of the split has no samples; split anew, or take that side out of the split")
    if to == "parquet":
        pyarrow()
    if target.is_file():
        raise InputError(f"{target} is a file and an export is a folder; choose another name")
    _check_apart(source.path, target)
    check_place(target, overwrite=overwrite)
    with replacing(target, partial(check_taken, target, overwrite=overwrite)) as temporary:
        temporary.mkdir()
        (temporary / RECIPE).write_bytes((source.path / RECIPE).read_bytes())
        if to == "parquet":
            (temporary / DATA).mkdir()
            for name, positions in sides.items():
                write_parquet(source, temporary / DATA, name, positions, chosen)
            (temporary / "README.md").write_text(data_card(source, sides, chosen, split), encoding="utf-8")
        elif to == "png":
            _write_pictures(source, temporary, sides, range_db)
        else:
            for name, positions in sides.items():
                _write_npz(source, temporary / name, positions, chosen)
    return target


def _check_apart(source: Path, target: Path) -> None:
    """Refuses a target that overlaps the data set, or a folder that an export would replace although no export wrote it."""
    source_path, target_path = source.resolve(), target.resolve()
    if source_path.is_relative_to(target_path) or target_path.is_relative_to(source_path):
        raise InputError(f"{target} overlaps the data set {source} that is exported; choose another folder")
    if target.is_dir() and any(target.iterdir()) and ((target / SHARDS).exists() or not (target / RECIPE).is_file()):
        raise InputError(f"{target} holds something else than an export, which would be lost; choose another folder")


def _products(dataset: Dataset, to: Format, products: Collection[str] | None) -> tuple[Product, ...]:
    """The products to export, each once; pictures are made of spectrograms only."""
    default = ("spectrogram",) if to == "png" else dataset.products
    chosen = default if products is None else tuple(products)
    for product in chosen:
        dataset.checked(product)
    if not chosen:
        raise InputError(f"products names nothing; give some of {', '.join(dataset.products)}")
    if to == "png" and set(chosen) != {"spectrogram"}:
        raise InputError(
            f"pictures are made of spectrograms, got products {', '.join(chosen)}; export others to parquet or npz"
        )
    return tuple(dataset.checked(product) for product in dict.fromkeys(chosen))


# --- Pictures ---


def _write_pictures(dataset: Dataset, folder: Path, sides: Mapping[str, np.ndarray], range_db: float) -> None:
    """Writes SIDE/CLASS/INDEX.png with 8 bits, approaching speeds on top, and labels.csv."""
    spectrogram: SpectrogramProduct = dataset.recipe.products.kept["spectrogram"]
    if spectrogram.dtype == "uint8" and range_db > spectrogram.dynamic_range_db:
        raise InputError(
            f"the spectrograms hold {spectrogram.dynamic_range_db:g} dB and dynamic_range_db asks for {range_db:g} dB; ask for less"
        )
    with (folder / "labels.csv").open("w", newline="", encoding="utf-8") as file:
        axes = ("least_mps", "greatest_mps", "first_s", "last_s", "black_db", "white_db", "white_db_re_1w")
        table = csv.writer(file)
        table.writerow([*([] if [*sides] == [ALL] else ["side"]), *LABELS, *axes])
        for name, positions in sides.items():
            home = folder if [*sides] == [ALL] else folder / name
            for place in positions:
                record = dataset.records[place]
                path = home / record["class"] / f"{record['index']:06d}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                write_png(path, picture(dataset.values(int(place), "spectrogram"), range_db))
                entry = record["products"]["spectrogram"]
                values = {
                    **record,
                    "file": path.relative_to(folder).as_posix(),
                    "label": dataset.classes.index(record["class"]),
                }
                row = [values[column] for column in LABELS]
                row += [*entry["velocity_mps"], *entry["time_s"], -range_db, 0.0, entry["peak_db"]]
                table.writerow([*([] if home == folder else [name]), *row])


def picture(levels_db: np.ndarray, range_db: float) -> np.ndarray:
    """Grey levels 0..255 for levels (speed, time), 0 dB at the greatest; the greatest speed is in the first row."""
    return np.rint(255.0 * np.clip(1.0 + levels_db[::-1].astype(np.float64) / range_db, 0.0, 1.0)).astype(np.uint8)


def write_png(path: Path, grey: np.ndarray) -> None:
    """Writes grey levels (rows, columns), uint8, as a PNG file."""
    from PIL import Image

    Image.fromarray(grey).save(path, format="PNG")


# --- NumPy ---


def _write_npz(dataset: Dataset, path: Path, positions: np.ndarray, products: Sequence[Product]) -> None:
    """Writes PATH.npz with the arrays by product, and PATH.jsonl with the records."""
    records = [dataset.records[place] for place in positions]
    small: dict[str, Any] = {
        "label": dataset.labels[positions],
        "classes": np.array(dataset.classes),
        "index": dataset.indices[positions],
        "sentence": np.array([record["sentence"] for record in records]),
    }
    if "truth" in products:
        small["truth_columns"] = np.array(dataset.recipe.products.kept["truth"].columns)
    if "parts" in products:
        small["part_names"] = np.array(dataset.parts)
    for product in products:
        for name in ("velocity_mps", "time_s", "range_m"):
            edges = [record["products"][product].get(name) for record in records]
            if None not in edges:
                small[f"{product}_{name}"] = np.array(edges)
    with zipfile.ZipFile(path.with_name(f"{path.name}.npz"), "w", zipfile.ZIP_DEFLATED, allowZip64=True) as archive:
        for name, array in small.items():
            _write_array(archive, name, array)
        for product in products:
            _write_product(archive, dataset, positions, product)
    lines = "".join(f"{json.dumps(record)}\n" for record in records)
    path.with_name(f"{path.name}.jsonl").write_text(lines, encoding="utf-8")


def _write_product(archive: zipfile.ZipFile, dataset: Dataset, positions: np.ndarray, product: Product) -> None:
    """Writes an array (sample, ...), sample by sample; for products of varying size an array for each sample, called
    PRODUCT_INDEX."""
    if product in RAGGED:
        for place in positions:
            name = f"{product}_{dataset.records[place]['index']}"
            _write_array(archive, name, dataset.array(int(place), product))
        return
    first = dataset.array(int(positions[0]), product)
    header = {
        "descr": np.lib.format.dtype_to_descr(first.dtype),
        "fortran_order": False,
        "shape": (len(positions), *first.shape),
    }
    with archive.open(f"{product}.npy", "w", force_zip64=True) as file:
        np.lib.format.write_array_header_2_0(file, header)
        for place in positions:
            file.write(np.ascontiguousarray(dataset.array(int(place), product)).data)


def _write_array(archive: zipfile.ZipFile, name: str, array: np.ndarray) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
        np.lib.format.write_array(file, array, allow_pickle=False)


# --- Data card ---


def data_card(
    dataset: Dataset, sides: Mapping[str, np.ndarray], products: Sequence[Product], split: Split | None
) -> str:
    """README.md of a folder of parquet files: front matter for Hugging Face, followed by the text."""
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
    about = f"{recipe.about}\n\n" if recipe.about else ""
    return Template(CARD.read_text(encoding="utf-8")).substitute(
        front=yaml.safe_dump(front, sort_keys=False),
        name=recipe.name,
        about=about,
        hash=recipe.hash,
        version=versions()["t2d-rt"],
        counts=_counts(dataset, sides),
        splitting=_splitting(split),
        radars=_radars(dataset.recipe),
        arrays="\n".join(_array_line(dataset, product) for product in products),
        quality=_quality(dataset),
        side=next(iter(sides)),
        product=products[0],
    )


def _size(count: int) -> str:
    """Hugging Face's size category for that number of samples."""
    for limit, words in ((1000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")):
        if count < limit:
            return words
    return "1M<n<10M"


def _counts(dataset: Dataset, sides: Mapping[str, np.ndarray]) -> str:
    """A table of the numbers of samples of each class on each side."""
    rows = [["label", "class", *sides], ["---"] * (2 + len(sides))]
    for number, name in enumerate(dataset.classes):
        rows.append([str(number), name, *(f"{np.sum(dataset.labels[side] == number)}" for side in sides.values())])
    return _table(rows)


def _table(rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the second row must be dashes."""
    lines = [f"|{'|'.join(row)}|" if row[0] == "---" else f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(lines)


def _splitting(split: Split | None) -> str:
    """Text on the split: what is held apart, what is on two sides nevertheless, and which samples were left out."""
    if split is None:
        return "The samples are not split; `t2d-rt dataset split` does so without leaks."
    *first, last = split.apart
    text = f"No {', '.join(first)}{' or ' if first else ''}{last} is on two sides."
    text += "".join(f" {count} {kind}s are on two sides." for kind, count in split.shared.items())
    return text + (f" {len(split.left_out)} samples were left out for it." if split.left_out else "")


def _radars(recipe: Recipe) -> str:
    """A table of the conditions and their radars."""
    rows: list[Sequence[str]] = [
        ["condition", "scene", "model", "carrier [GHz]", "bandwidth [GHz]", "speeds [m/s]", "range bin [cm]"],
        ["---"] * 7,
    ]
    for condition in recipe.conditions:
        radar = condition.radar or recipe.radar
        figures = (
            f"{radar.mid_frequency_hz / 1e9:.2f}",
            f"{radar.bandwidth_hz / 1e9:.2f}",
            f"+-{radar.max_speed_mps:.2f}",
        )
        rows.append(
            [condition.name, condition.scene, condition.method, *figures, f"{100 * radar.range_resolution_m:.2f}"]
        )
    return _table(rows)


def _array_line(dataset: Dataset, product: Product) -> str:
    """A line with type, meaning and axes of a product."""
    array, entry = dataset.array(0, product), dataset.records[0]["products"][product]
    axes = ", ".join(
        f"{name.rpartition('_')[0]} {entry[name][0]:.4g} to {entry[name][1]:.4g} {unit}"
        for name, unit in UNITS.items()
        if name in entry
    )
    return f"- `{product}`: {array.dtype}, {_meaning(dataset, product)}{f'; {axes}' if axes else ''}"


def _meaning(dataset: Dataset, product: Product) -> str:
    """Text on the axes, units and scale of a product."""
    definition: Any = dataset.recipe.products.kept[product]
    if product == "adc":
        return "(chirp, antenna, sample) of the ADC in sqrt(W), real and imaginary part last" + (
            ", over `greatest` of the record" if definition.dtype == "float16" else ""
        )
    if product == "points":
        return "(point, 6): time [s], range [m], azimuth [rad], elevation [rad], speed [m/s], SNR [dB]"
    if product == "truth":
        visible = ", visible fraction" if definition.visible else ""
        return (
            f"(time, {len(definition.columns)}) of the labelled person at {definition.rate_hz:g} Hz: time [s], 22 joints "
            f"forward, left and up from the radar [m], then range [m], speed [m/s], azimuth [rad], elevation [rad]{visible} "
            "of 17 segments, whether heel and ball of the left and the right foot stand, and breathing [m]"
        )
    if product == "parts":
        return (
            f"(part, speed, time), what {', '.join(dataset.parts)} add to the power of the spectrogram, over its greatest cell; "
            "they add up to it, and one that lowers it by interference is negative"
        )
    axes = "(speed, time)" if product == "spectrogram" else "(frame, speed, range)"
    static = ", without the mean over the record (MTI)" if definition.mti == "mean" else ""
    if definition.dtype == "uint8":
        return f"{axes}, 255 at the greatest cell, 0 at {definition.dynamic_range_db:g} dB below it{static}"
    return f"{axes} in dB, 0 at the greatest cell{static}"


def _quality(dataset: Dataset) -> str:
    """A Markdown list with the filter's verdicts, SNR and field errors over all samples."""
    snr = np.array([record["snr_db"] for record in dataset.records if record["snr_db"] is not None])
    errors = np.array([record["error_db"] for record in dataset.records if record["error_db"] is not None])
    passed = np.mean([record["passed"] for record in dataset.records])
    lines = [
        f"- {passed:.0%} of the motions pass the filter; samples that failed and are not here: {len(dataset.failed)}"
    ]
    if len(snr):
        lines.append(f"- SNR {np.median(snr):.1f} dB (median), {snr.min():.1f} to {snr.max():.1f} dB")
    if len(errors):
        lines.append(
            f"- measured error of the field {np.median(errors):.1f} dB (median of {len(errors)}), {errors.max():.1f} dB at most"
        )
    if (mixed := mixed_kernels(dataset.path)) is not None:
        lines.append(f"- {mixed}")
    return "\n".join(lines)
