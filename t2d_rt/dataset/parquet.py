"""A data set as parquet files, which pandas, DuckDB and Hugging Face's `datasets` can read, and from which the same arrays can be
restored."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from t2d_rt.core.errors import InputError, install
from t2d_rt.core.memory import LastUsed, array_bytes
from t2d_rt.dataset.shards import RAGGED, array_of, check_array, read_record

if TYPE_CHECKING:
    from t2d_rt.dataset.dataset import Dataset, Product
    from t2d_rt.dataset.recipe import Recipe

ROWS = 2000
"""Number of samples in a file."""
GROUP, GROUP_BYTES = 64, 64_000_000
"""Greatest number of samples in a row group, which readers load at once, and its greatest size in bytes if it has more than one
sample."""

COLUMNS = {
    "index": "int64",
    "label": "class",
    "condition": "string",
    "description": "int64",
    "sentence": "string",
    "provider": "string",
    "body": "string",
    "seed": "int64",
    "distance_m": "float64",
    "angle_deg": "float64",
    "duration_s": "float64",
    "snr_db": "float64",
    "error_db": "float64",
    "passed": "bool",
}
"""Columns for each sample, except its arrays, and their types."""
RECORD = "record"
"""Name of the column with the whole record as JSON."""
DATA = "data"
"""Name of the folder with the files, beside the data card."""
EXTENSION = "datasets.features.features.Array{}DExtensionType"
"""Name of the type that `datasets` uses for a column of arrays; other readers see lists of lists."""


def write_parquet(dataset: Dataset, folder: Path, name: str, positions: np.ndarray, products: Sequence[Product]) -> int:
    """Writes samples as NAME-00000-of-00001.parquet and so on; returns the number of files."""
    pa, pq = pyarrow()
    files = max(1, -(-len(positions) // ROWS))
    schema, group = None, _group_samples(dataset, positions, products)
    for number in range(files):
        rows = positions[number * ROWS : (number + 1) * ROWS]
        path = folder / f"{name}-{number:05d}-of-{files:05d}.parquet"
        schema = schema or _schema(pa, dataset, products)
        with pq.ParquetWriter(path, schema, compression="zstd") as writer:
            for first in range(0, len(rows), group):
                writer.write_table(_table(pa, dataset, rows[first : first + group], products, schema))
    return files


def _group_samples(dataset: Dataset, positions: np.ndarray, products: Sequence[Product]) -> int:
    """Number of samples in a row group, judged by the size of the first one; ADC samples take tens of MB each."""
    if not len(positions):
        return GROUP
    size = sum(dataset.array(int(positions[0]), product).nbytes for product in products)
    return max(1, min(GROUP, GROUP_BYTES // max(1, size)))


class ParquetReader:
    """Reads files that `write_parquet` wrote; the last row groups are cached."""

    def __init__(self, folder: Path, recipe: Recipe, most_bytes: float) -> None:
        _, pq = pyarrow()
        entries = []
        for path in sorted(folder.glob("*.parquet")):
            with _opened(pq, path) as file:
                for group in range(file.num_row_groups):
                    texts = file.read_row_group(group, columns=[RECORD]).column(RECORD).to_pylist()
                    entries += [(read_record(recipe, text), path, group, row) for row, text in enumerate(texts)]
        entries.sort(key=lambda entry: int(entry[0]["index"]))
        self.records: tuple[dict[str, Any], ...] = tuple(entry[0] for entry in entries)
        self.failed: tuple[dict[str, Any], ...] = ()
        self._places = tuple(entry[1:] for entry in entries)
        self._recipe, self._kept = recipe, LastUsed[list[np.ndarray]](most_bytes, array_bytes)

    def array(self, position: int, product: str) -> np.ndarray:
        """The array of a product for one sample, as it was in its shard."""
        path, group, row = self._places[position]
        array = np.array(self._kept.get((path, group, product), partial(_read_arrays, path, group, product))[row])
        try:
            check_array(array, *array_of(self._recipe, self.records[position], product), product)
        except InputError as error:
            raise InputError(f"{path} is not of its recipe ({error}); export the data set again") from None
        return array


@contextmanager
def _opened(pq: Any, path: Path) -> Iterator[Any]:
    """Opens a file of `write_parquet`; errors become an InputError."""
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except Exception as error:  # pyarrow raises several types of errors for a damaged file, or one without the columns
        reason = " ".join(str(error).split())
        raise InputError(f"{path} cannot be read ({reason}); export the data set again") from None


def _read_arrays(path: Path, group: int, product: str) -> list[np.ndarray]:
    """The arrays of a product in a row group, in the type and shape given by Hugging Face's metadata."""
    _, pq = pyarrow()
    with _opened(pq, path) as file:
        feature = json.loads(file.schema_arrow.metadata[b"huggingface"])["info"]["features"][product]
        column = file.read_row_group(group, columns=[product]).column(product).combine_chunks()
        return [_complex(row, product) for row in _rows(getattr(column, "storage", column), feature)]


def pyarrow() -> tuple[Any, Any]:
    """The package pyarrow, and its module for parquet files."""
    with suppress(ImportError):
        import pyarrow as pa
        import pyarrow.parquet as pq

        return pa, pq
    raise InputError(
        f"parquet files need the package pyarrow, which is not installed; {install('export')}, or export to png or npz"
    )


def _schema(pa: Any, dataset: Dataset, products: Sequence[Product]) -> Any:
    """The columns in Arrow's types, with Hugging Face's description for `datasets` in the metadata."""
    features: dict[str, dict[str, Any]] = {}
    fields = []
    for name, kind in [*COLUMNS.items(), *((product, "array") for product in products), (RECORD, "string")]:
        if kind == "class":
            features[name] = {"names": list(dataset.classes), "_type": "ClassLabel"}
            fields.append(pa.field(name, "int64"))
        elif kind != "array":
            features[name] = {"dtype": kind, "_type": "Value"}
            fields.append(pa.field(name, kind))
        else:
            array = _real(dataset.array(0, cast("Product", name)))
            # only the first dimension may differ from sample to sample
            shape = [None if name in RAGGED else array.shape[0], *array.shape[1:]]
            features[name] = {"shape": shape, "dtype": str(array.dtype), "_type": f"Array{array.ndim}D"}
            nested = pa.from_numpy_dtype(array.dtype)
            for _ in shape:
                nested = pa.list_(nested)
            extension = {
                "ARROW:extension:name": EXTENSION.format(len(shape)),
                "ARROW:extension:metadata": json.dumps([shape, str(array.dtype)]),
            }
            fields.append(pa.field(name, nested, metadata=extension))
    return pa.schema(fields, metadata={"huggingface": json.dumps({"info": {"features": features}})})


def _table(pa: Any, dataset: Dataset, positions: np.ndarray, products: Sequence[Product], schema: Any) -> Any:
    """Samples as a table with the schema."""
    records = [dataset.records[place] for place in positions]
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        values = dataset.labels[positions].tolist() if name == "label" else [record[name] for record in records]
        columns[name] = pa.array(values, type=schema.field(name).type)
    for product in products:
        arrays = [_real(dataset.array(int(place), product)) for place in positions]
        columns[product] = _lists(pa, arrays)
    columns[RECORD] = pa.array([json.dumps(record) for record in records], type=pa.string())
    return pa.table(columns, schema=schema)


def _lists(pa: Any, arrays: Sequence[np.ndarray]) -> Any:
    """Arrays as lists of lists; they may differ in their first dimension."""
    inner = arrays[0].shape[1:]
    column = pa.array(np.concatenate([array.ravel() for array in arrays]))
    for length in inner[::-1]:
        column = pa.ListArray.from_arrays(pa.array(np.arange(0, len(column) + 1, length), type=pa.int32()), column)
    ends = np.cumsum([0, *(len(array) for array in arrays)])
    return pa.ListArray.from_arrays(pa.array(ends, type=pa.int32()), column)


def _rows(column: Any, feature: dict[str, Any]) -> list[np.ndarray]:
    """The arrays from a column that `_lists` made."""
    ends = np.asarray(column.offsets) - column.offsets[0].as_py()
    for _ in feature["shape"]:
        column = column.flatten()
    flat = column.to_numpy(zero_copy_only=False).astype(feature["dtype"], copy=False)
    inner = tuple(feature["shape"][1:])
    size = int(np.prod(inner))
    return [flat[first * size : last * size].reshape(-1, *inner) for first, last in pairwise(ends)]


def _real(array: np.ndarray) -> np.ndarray:
    """Complex samples with real and imaginary parts along a new last axis."""
    return array.view(np.float32).reshape(*array.shape, 2) if array.dtype == np.complex64 else array


def _complex(array: np.ndarray, product: str) -> np.ndarray:
    """ADC samples that were exported as real and imaginary parts, as complex numbers; other products unchanged."""
    if product == "adc" and array.dtype == np.float32:
        return np.ascontiguousarray(array).view(np.complex64)[..., 0]
    return array
