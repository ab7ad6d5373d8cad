"""A data set for other programs: parquet with a data card, folders of PNG, or NumPy's .npz."""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from t2d_rt.core.atomic_write import check_place, check_taken, replacing
from t2d_rt.core.checks import choice, file_path, flag, positive
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.card import data_card
from t2d_rt.dataset.parquet import DATA, pyarrow, write_parquet
from t2d_rt.dataset.read import RECIPE
from t2d_rt.dataset.shards import RAGGED, SHARDS
from t2d_rt.dataset.splits import Split, check_split
from t2d_rt.dataset.stored import Dataset, Product
from t2d_rt.recording.truth import TRUTH_COLUMNS

if TYPE_CHECKING:
    from t2d_rt.dataset.products import SpectrogramProduct

Format = Literal["parquet", "png", "npz"]
FORMATS: tuple[Format, ...] = get_args(Format)

ALL = "all"
"""Name of the one side of a data set that is not split."""
LABELS = (
    "file", "index", "class", "label", "condition", "description", "sentence", "seed", "distance_m", "angle_deg", "snr_db",
    "passed",
)  # fmt: skip
"""Columns of labels.csv, before those of the picture's axes and levels."""


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
    """Writes finished samples to a folder, which then stands there whole or not at all.

    to: "parquet" for Hugging Face's `datasets` and for pandas, with a data card; "png" for pictures of spectrograms by class, with
        labels.csv; "npz" for one file of arrays for each side of the split.
    products: which arrays; all that there are by default, and spectrograms only as pictures.
    split: whose sides get files or folders of their own; by default all samples are on one side.
    dynamic_range_db: of pictures: white is the greatest cell of a spectrogram, black is what lies so far below it [dB].
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
    with replacing(target, lambda: check_taken(target, overwrite=overwrite)) as new:
        new.mkdir()
        (new / RECIPE).write_bytes((source.path / RECIPE).read_bytes())
        if to == "parquet":
            (new / DATA).mkdir()
            for name, positions in sides.items():
                write_parquet(source, new / DATA, name, positions, chosen)
            (new / "README.md").write_text(data_card(source, sides, chosen, split), encoding="utf-8")
        elif to == "png":
            _write_pictures(source, new, sides, range_db)
        else:
            for name, positions in sides.items():
                _write_npz(source, new / name, positions, chosen)
    return target


def _check_apart(source: Path, target: Path) -> None:
    """Refuses a place that overlaps the data set, or that an export would replace though none wrote it."""
    one, other = source.resolve(), target.resolve()
    if one.is_relative_to(other) or other.is_relative_to(one):
        raise InputError(f"{target} overlaps the data set {source} that is exported; choose another folder")
    if target.is_dir() and any(target.iterdir()) and ((target / SHARDS).exists() or not (target / RECIPE).is_file()):
        raise InputError(f"{target} holds something else than an export, which would be lost; choose another folder")


def _products(dataset: Dataset, to: Format, products: Collection[str] | None) -> tuple[Product, ...]:
    wanted = ("spectrogram",) if to == "png" else dataset.products
    given = wanted if products is None else tuple(products)
    for each in given:
        dataset.checked(each)
    if not given:
        raise InputError(f"products names nothing; give some of {', '.join(dataset.products)}")
    if to == "png" and set(given) != {"spectrogram"}:
        raise InputError(
            f"pictures are made of spectrograms, got products {', '.join(given)}; export others to parquet or npz"
        )
    return tuple(dataset.checked(each) for each in dict.fromkeys(given))


# --- Pictures ---


def _write_pictures(dataset: Dataset, folder: Path, sides: Mapping[str, np.ndarray], range_db: float) -> None:
    """SIDE/CLASS/INDEX.png of 8 bits, approaching on top, and labels.csv."""
    kept: SpectrogramProduct = dataset.recipe.products.kept["spectrogram"]
    if kept.dtype == "uint8" and range_db > kept.dynamic_range_db:
        raise InputError(
            f"the spectrograms hold {kept.dynamic_range_db:g} dB and dynamic_range_db asks for {range_db:g} dB; ask for less"
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
                told = record["products"]["spectrogram"]
                values = {
                    **record,
                    "file": path.relative_to(folder).as_posix(),
                    "label": dataset.classes.index(record["class"]),
                }
                row = [values[each] for each in LABELS]
                row += [*told["velocity_mps"], *told["time_s"], -range_db, 0.0, told["peak_db"]]
                table.writerow([*([] if home == folder else [name]), *row])


def picture(levels_db: np.ndarray, range_db: float) -> np.ndarray:
    """Levels (speed, time), 0 dB at the greatest, as grey levels 0..255 with the greatest speed in the first row."""
    return np.rint(255.0 * np.clip(1.0 + levels_db[::-1].astype(np.float64) / range_db, 0.0, 1.0)).astype(np.uint8)


def write_png(path: Path, grey: np.ndarray) -> None:
    """Writes grey levels (rows, columns), uint8, as a picture."""
    from PIL import Image

    Image.fromarray(grey).save(path, format="PNG")


# --- NumPy ---


def _write_npz(dataset: Dataset, path: Path, positions: np.ndarray, products: Sequence[Product]) -> None:
    """PATH.npz with arrays by product, and PATH.jsonl with the records."""
    records = [dataset.records[place] for place in positions]
    small: dict[str, Any] = {
        "label": dataset.labels[positions], "classes": np.array(dataset.classes), "index": dataset.indices[positions],
        "sentence": np.array([each["sentence"] for each in records]),
    }  # fmt: skip
    if "truth" in products:
        small["truth_columns"] = np.array(TRUTH_COLUMNS)
    for product in products:
        for name in ("velocity_mps", "time_s", "range_m"):
            edges = [each["products"][product].get(name) for each in records]
            if None not in edges:
                small[f"{product}_{name}"] = np.array(edges)
    with zipfile.ZipFile(path.with_name(f"{path.name}.npz"), "w", zipfile.ZIP_DEFLATED, allowZip64=True) as archive:
        for name, array in small.items():
            _member(archive, name, _array(array))
        for product in products:
            _write_product(archive, dataset, positions, product)
    lines = "".join(f"{json.dumps(each)}\n" for each in records)
    path.with_name(f"{path.name}.jsonl").write_text(lines, encoding="utf-8")


def _write_product(archive: zipfile.ZipFile, dataset: Dataset, positions: np.ndarray, product: Product) -> None:
    """One array (sample, ...), sample by sample; of what differs in size an array for each sample, PRODUCT_INDEX."""

    def stacked(file: Any) -> None:
        first = dataset.array(int(positions[0]), product)
        about = {
            "descr": np.lib.format.dtype_to_descr(first.dtype),
            "fortran_order": False,
            "shape": (len(positions), *first.shape),
        }
        np.lib.format.write_array_header_2_0(file, about)
        for place in positions:
            file.write(np.ascontiguousarray(dataset.array(int(place), product)).data)

    if product not in RAGGED:
        _member(archive, product, stacked)
        return
    for place in positions:
        name = f"{product}_{dataset.records[place]['index']}"
        _member(archive, name, _array(dataset.array(int(place), product)))


def _member(archive: zipfile.ZipFile, name: str, write: Callable[[Any], None]) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
        write(file)


def _array(array: np.ndarray) -> Callable[[Any], None]:
    """Writes an array to a file."""
    return lambda file: np.lib.format.write_array(file, array, allow_pickle=False)
