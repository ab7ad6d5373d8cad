"""Shards on disk: `shards/00000.npz` holds arrays, `shards/00000.jsonl` a record for each sample; neither is ever half written.

They are read without unpickling. A data set may come from anybody, and its content decides on names of folders, scales and memory:
so each record and array that is read is checked against the recipe.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import os
import re
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import file_path, flag, integer, interval, number, positive, shown, text
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import npy_header, read_bytes, regular_file
from t2d_rt.dataset.products import POINT_COLUMNS, resized
from t2d_rt.dataset.recipe import Recipe, recipe_names, written_hash

SHARDS = "shards"
SPOOL = "spool"
"""Folder of finished samples whose shards are not complete, each stored like a shard of one: INDEX.npz and INDEX.jsonl."""
PART = ".part"
"""Ending of files that are still being written."""
TIME = 1980, 1, 1, 0, 0, 0
"""Date of the files in an archive; a constant, so that the same arrays give the same bytes."""
RAGGED = frozenset({"points", "adc", "truth"})
"""Products whose arrays differ in size from sample to sample, so that they are stored separately."""


@dataclass(frozen=True, slots=True)
class MadeSample:
    """A sample that was made or has failed."""

    record: dict[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Time of each stage [s], and the processor time of all, `cpu`."""
    machine: str = ""
    """Processor and kernels with which it was made; "" for one that was read."""
    common: bool = True
    """Whether these are the kernels common to all machines."""


def shard_name(number: int) -> str:
    """Name of a shard's files, without their ending."""
    return f"{number:05d}"


def packed(made: Sequence[MadeSample]) -> tuple[bytes, bytes]:
    """Content of the archive, and of the records, of a shard.

    Samples that failed have a record but no arrays; `row` is the position of the others in the stacked arrays.
    """
    arrays: dict[str, np.ndarray] = {}
    finished = [sample for sample in made if sample.arrays]
    for name in sorted({name for sample in finished for name in sample.arrays}):
        if name in RAGGED:
            arrays |= {f"{name}_{sample.record['index']}": sample.arrays[name] for sample in finished}
        else:
            arrays[name] = np.stack([sample.arrays[name] for sample in finished])
    arrays["index"] = np.array([sample.record["index"] for sample in finished], dtype=np.int64)
    rows = {sample.record["index"]: row for row, sample in enumerate(finished)}
    lines = [json.dumps({**sample.record, "row": rows.get(sample.record["index"])}) for sample in made]
    return archive(arrays), "".join(f"{line}\n" for line in lines).encode()


def archive(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Arrays as an .npz file whose bytes depend on the arrays only; `numpy.savez` would include the time of day."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, array in sorted(arrays.items()):
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.ascontiguousarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", date_time=TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            file.writestr(info, entry.getvalue(), compresslevel=6)
    return buffer.getvalue()


def write_shard(folder: Path, number: int, made: Sequence[MadeSample]) -> dict[str, str]:
    """Writes a shard and returns the SHA-256 of its files by name. The records are written last; without them a shard does not
    count.

    The records of a smaller shard that is replaced are removed first: so a process that is killed between the two files leaves no
    shard instead of a mixture.
    """
    data, records = packed(made)
    name = shard_name(number)
    (folder / SHARDS / f"{name}.jsonl").unlink(missing_ok=True)
    write_whole(folder / SHARDS / f"{name}.npz", data)
    write_whole(folder / SHARDS / f"{name}.jsonl", records)
    return {f"{name}.npz": sha256(data), f"{name}.jsonl": sha256(records)}


def write_spooled(folder: Path, made: MadeSample) -> None:
    """Stores a finished sample of an incomplete shard like a shard of one; its record is written last, too."""
    place, name = folder / SPOOL, str(made.record["index"])
    try:
        place.mkdir(exist_ok=True)
        for ending, data in zip((".npz", ".jsonl"), packed([made]), strict=True):
            part = place / f".{name}{ending}{PART}"
            part.write_bytes(data)
            part.replace(place / f"{name}{ending}")
    except OSError as error:
        raise unwritten(place, error) from error


def remove_spooled(folder: Path, indices: Iterable[int]) -> None:
    """Removes stored samples that are now in their shard."""
    for index in indices:
        for ending in (".jsonl", ".npz"):
            (folder / SPOOL / f"{index}{ending}").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # the folder still holds others, or does not exist
        (folder / SPOOL).rmdir()


def unwritten(path: Path, error: OSError) -> InputError:
    """The error for a file that cannot be written."""
    return InputError(
        f"cannot write {path}: {error.strerror or error}; free space or choose a writable place, and run it again: what is "
        "finished stays"
    )


def write_whole(path: Path, data: bytes) -> None:
    """Writes a file completely or not at all, even if the machine stops."""
    try:
        descriptor, part = tempfile.mkstemp(prefix=f".{path.name}-", suffix=PART, dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            Path(part).chmod(0o644)
            Path(part).replace(path)
        except BaseException:
            Path(part).unlink(missing_ok=True)
            raise
        _sync(path.parent)
    except OSError as error:
        raise unwritten(path, error) from error


def _sync(folder: Path) -> None:
    """Flushes a folder's entries to disk; only then does a renamed file survive a power cut."""
    with contextlib.suppress(OSError):  # a file system that cannot flush folders
        place = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(place)
        finally:
            os.close(place)


def sweep(folder: Path) -> None:
    """Removes what killed processes left: files that are half written, and arrays of single samples without their record."""
    halves = [path for place in (folder, folder / SHARDS, folder / SPOOL) for path in place.glob(f".*{PART}")]
    halves += [path for path in (folder / SPOOL).glob("*.npz") if not path.with_suffix(".jsonl").exists()]
    for path in halves:
        path.unlink(missing_ok=True)


def sha256(data: bytes) -> str:
    """Checksum of a file's content."""
    return hashlib.sha256(data).hexdigest()


def file_sha256(path: Path) -> str:
    """Checksum of a file, which is read block by block, as one with ADC samples may have gigabytes."""
    with regular_file(path, noun="shard") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def numbers(folder: Path) -> Iterator[int]:
    """Numbers of the shards that have records, in order."""
    yield from sorted(int(path.stem) for path in (folder / SHARDS).glob("*.jsonl") if path.stem.isdecimal())


def damaged(path: Path, why: object) -> InputError:
    """The error for a shard that cannot be used."""
    return InputError(
        f"{path} is damaged ({why}); remove {path.stem}.npz and {path.stem}.jsonl and run the recipe again, which makes them anew"
    )


Sizes = tuple[int | None, ...]
"""Expected shape of an array; None is a length that may vary."""

MAPS = {"spectrogram": ("velocity_mps", "time_s"), "range_doppler": ("velocity_mps", "range_m")}
"""Axes of maps; records contain the ends of these axes."""
BEYOND = 1e-3
"""Tolerance by which the sum of the parts in a cell, as power relative to the greatest cell, may lie outside of 0..1."""
APART = 1e-6
"""Tolerance between that sum and the spectrogram's cell, relative to the greatest cell, in addition to the rounding of the map."""
LARGEST_BYTES = 4e9
"""Greatest size of an array that is unpacked [bytes]; its compressed form may be a thousand times smaller."""
LEAST_ABOVE_DB = 1e-3
"""Tolerance for the greatest cell of a map, which must be at 0 dB."""


def read_record(recipe: Recipe, line: str | bytes) -> dict[str, Any]:
    """The record in a line of JSON; raises an InputError that names what does not fit the recipe."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"it is no JSON ({'nested too deeply' if isinstance(error, RecursionError) else error})"
        ) from None
    if not isinstance(record, dict):
        raise InputError(f"a record must be an object of JSON, got {shown(record)}")
    index = integer("index", record.get("index"), 0, recipe.samples - 1)
    _check_text(record, "class", recipe.classes[index % len(recipe.classes)])
    _check_text(record, "condition", *(condition.name for condition in recipe.conditions))
    integer("description", record.get("description"), 0, recipe.descriptions_per_class - 1)
    _check_text(record, "sentence")
    if record.get("row") is None:
        if record.get("failure") is not None:
            _check_text(record, "failure")
        return record
    integer("row", record["row"])
    _check_numbers(record)
    products = record.get("products")
    for name in recipe.products.kept:
        if not isinstance(products, dict) or not isinstance(products.get(name), dict):
            raise InputError(f"products must tell of {name}, got {shown(products)}")
        _check_product(recipe, name, products[name])
    if recipe.products.parts is not None and isinstance(products, dict):
        expected = {name: products["spectrogram"][name] for name in ("velocity_mps", "time_s", "peak_db")}
        expected["names"] = [*recipe.products.parts.names]
        for key, value in expected.items():
            if products["parts"].get(key) != value:
                raise InputError(f"{key} of parts must be {shown(value)}, got {shown(products['parts'].get(key))}")
    return record


def _check_numbers(record: Mapping[str, Any]) -> None:
    """Checks the figures in the record of a sample that did not fail, except its position and products."""
    integer("seed", record.get("seed"))
    flag("passed", record.get("passed"))
    for name in ("provider", "body"):
        _check_text(record, name)
    for name in ("distance_m", "angle_deg", "duration_s"):
        number(name, record.get(name))
    for name in ("snr_db", "error_db"):
        if record.get(name, "nothing") is not None:
            number(name, record.get(name, "nothing"))
    for name in ("sources", "reasons"):
        _check_texts(name, record.get(name))
    second = record.get("second_person")
    if second is not None:
        if not isinstance(second, dict):
            raise InputError(f"second_person must be an object of JSON, got {shown(second)}")
        _check_texts("sources", second.get("sources"))
        integer("seed", second.get("seed"))


def _check_text(record: Mapping[str, Any], name: str, *allowed: str) -> None:
    """Refuses a value that is no text, or not one of those that the recipe allows."""
    value = text(name, record.get(name))
    if allowed and value not in allowed:
        raise InputError(f"{name} must be {' or '.join(allowed)}, got {shown(value)}")


def _check_texts(name: str, value: Any) -> None:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise InputError(f"{name} must be a list of texts, got {shown(value)}")


def _check_product(recipe: Recipe, name: str, entry: Mapping[str, Any]) -> None:
    """Checks the ends of a product's axes, and its scales."""
    for axis in MAPS.get(name, ()):
        first, last = interval(f"{axis} of {name}", entry.get(axis))
        if not -1e6 < first < last < 1e6:
            raise InputError(f"{axis} of {name} must rise, got {shown(entry[axis])}")
    if name in MAPS:
        number(f"peak_db of {name}", entry.get("peak_db"))
    if name == "adc" and recipe.products.kept[name].dtype == "float16":
        positive("greatest of adc", entry.get("greatest"))


def array_of(recipe: Recipe, record: Mapping[str, Any], name: str) -> tuple[np.dtype[Any], Sizes]:
    """Type and shape of a sample's array, as they follow from the recipe and the condition; None is a length that may vary."""
    definition = recipe.products.kept[name]
    if name == "points":
        return np.dtype(np.float32), (None, len(POINT_COLUMNS))
    if name == "truth":
        return np.dtype(np.float32), (None, len(definition.columns))
    if name == "parts":
        return np.dtype(np.float32), (len(definition.names), *definition.size)
    if name == "adc":
        condition = next(condition for condition in recipe.conditions if condition.name == record["condition"])
        radar = condition.radar or recipe.radar
        cube = (None, radar.antennas, radar.samples)
        return np.dtype(definition.dtype), cube if definition.dtype == "complex64" else (*cube, 2)
    return np.dtype(definition.dtype), (*((definition.frames,) if name == "range_doppler" else ()), *definition.size)


def check_array(array: np.ndarray, dtype: np.dtype[Any], shape: Sizes, name: str) -> None:
    """Refuses an array of another type or shape, or with values that no sample can have."""
    _check_kind(array.dtype, array.shape, dtype, shape, name)
    if not np.isfinite(array).all():
        raise InputError(f"{name} has NaN or infinite values")
    if name in MAPS and dtype.kind == "f" and array.max(initial=-np.inf) > LEAST_ABOVE_DB:
        raise InputError(f"{name} has levels above 0 dB, its greatest cell")
    if name == "parts":
        total = array.sum(axis=-3)
        if min(total.min(initial=0.0), 1.0 - total.max(initial=0.0)) < -BEYOND:
            raise InputError("parts do not add up to 0..1, powers over that of the greatest cell")


def _check_kind(actual: np.dtype[Any], sizes: tuple[int, ...], dtype: np.dtype[Any], shape: Sizes, name: str) -> None:
    """Refuses an array of another type or shape; None in the shape is any length."""
    matches = len(sizes) == len(shape) and all(
        expected in (None, size) for expected, size in zip(shape, sizes, strict=True)
    )
    if actual != dtype or not matches:
        expected_sizes = ", ".join("any" if length is None else str(length) for length in shape)
        raise InputError(f"{name} must be {dtype} of shape ({expected_sizes}), got {actual} of shape {sizes}")


def read_array(path: Path, member: str, dtype: np.dtype[Any], shape: Sizes) -> np.ndarray:
    """Reads an array from an .npz file; its header is compared with the known type and shape before any memory is allocated."""
    with (
        regular_file(path, noun="shard") as file,
        zipfile.ZipFile(file) as zip_file,
        zip_file.open(f"{member}.npy") as stream,
    ):
        sizes, _, actual = npy_header(stream)
        _check_kind(actual, sizes, dtype, shape, member)
        length = stream.tell() + dtype.itemsize * math.prod(sizes)
        if length > LARGEST_BYTES:
            raise InputError(f"{member} takes {length / 1e9:.3g} GB, more than {LARGEST_BYTES / 1e9:g} GB")
        if zip_file.getinfo(f"{member}.npy").file_size != length:
            raise InputError(f"{member} is not as long as it tells")
        stream.seek(0)
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


RECIPE, PLANS, MANIFEST = "recipe.yaml", "plans.json", "manifest.json"
UNITS = {"velocity_mps": "m/s", "time_s": "s", "range_m": "m"}
"""Units of the axes of maps."""
FILE = re.compile(r"[0-9]{5,9}\.(npz|jsonl)")
"""Pattern for the names of a shard's files."""
MOST_BYTES = 500_000_000
"""Greatest size of a manifest, or a file of records, that is read [bytes]."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One shard: its records, and its arrays by product, both checked against the recipe."""

    path: Path
    """File of the arrays; that of the records has the same name with the ending .jsonl."""
    records: tuple[dict[str, Any], ...]
    """A record for each sample, including those that failed."""
    recipe: Recipe

    @property
    def good(self) -> list[dict[str, Any]]:
        """Records of the samples that did not fail."""
        return [record for record in self.records if record["row"] is not None]

    @classmethod
    def of(cls, folder: Path, number: int, recipe: Recipe) -> Shard:
        """A shard of a folder, by its number."""
        path = folder / SHARDS / f"{shard_name(number)}.jsonl"
        try:
            lines = read_bytes(path, limit=MOST_BYTES, noun="file of records").splitlines()
            records = tuple(read_record(recipe, line) for line in lines)
            shard = cls(path.with_suffix(".npz"), records, recipe)
            rows = [record["row"] for record in shard.good]
            if rows != [*range(len(rows))] or len({record["index"] for record in records}) < len(records):
                raise InputError("a sample is there twice, or a row is missing")
        except (InputError, KeyError) as error:
            raise damaged(path, error) from None
        return shard

    def rows(self, name: str) -> np.ndarray:
        """The stacked array of a product of fixed size, (samples that did not fail, ...); or their indices, by the name `index`."""
        finished = self.good
        if name == "index" or not finished:
            dtype, shape = np.dtype(np.int64), tuple[int | None, ...]()
        else:
            dtype, shape = array_of(self.recipe, finished[0], name)
        return self._read(name, name, dtype, (len(finished), *shape))

    def array(self, record: Mapping[str, Any], name: str) -> np.ndarray:
        """The array of one sample, for a product of varying size."""
        return self._read(f"{name}_{record['index']}", name, *array_of(self.recipe, record, name))

    def _read(self, member: str, name: str, dtype: np.dtype[Any], shape: Sizes) -> np.ndarray:
        """An array of the archive, checked; any fault is reported as damage of this shard."""
        try:
            array = read_array(self.path, member, dtype, shape)
            check_array(array, dtype, shape, name)
        except Exception as error:  # NumPy and zipfile may raise anything for a damaged file
            raise damaged(self.path, error) from None
        return array

    def samples(self) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
        """Record and arrays by product, for each sample that did not fail."""
        names = self.recipe.products.kept if self.good else ()
        stacked = {name: self.rows(name) for name in names if name not in RAGGED}
        for record in self.good:
            ragged = {name: self.array(record, name) for name in names if name in RAGGED}
            yield record, {**{name: rows[record["row"]] for name, rows in stacked.items()}, **ragged}


def spooled(folder: Path, recipe: Recipe) -> Iterator[MadeSample]:
    """Finished samples of incomplete shards; one that is damaged, or of another recipe, is left out and made again."""
    for path in (folder / SPOOL).glob("*.jsonl"):
        with suppress(InputError):
            record = read_record(recipe, read_bytes(path, limit=MOST_BYTES, noun="record").strip())
            if path.stem == str(record["index"]):
                shard = Shard(path.with_suffix(".npz"), (record,), recipe)
                arrays = next((arrays for _, arrays in shard.samples()), {})
                yield MadeSample({name: value for name, value in record.items() if name != "row"}, arrays)


def read_shards(path: str | Path) -> Iterator[Shard]:
    """The shards of a data set's folder, in order."""
    folder = dataset_folder(path)
    recipe = recipe_of(folder)
    for shard_number in numbers(folder):
        yield Shard.of(folder, shard_number, recipe)


def dataset_folder(path: str | Path) -> Path:
    """The checked folder of a data set."""
    folder = file_path("the folder of a data set", path)
    if not (folder / RECIPE).is_file():
        raise InputError(f"{folder} is no data set: it holds no {RECIPE}; give the folder that t2d-rt dataset wrote")
    return folder


def recipe_of(folder: Path) -> Recipe:
    """The recipe in a data set's folder, with the hash that seeded its samples.

    A recipe that an older version wrote lacks newer fields, and its hash is over the fields that it has. Missing fields get today's
    defaults, on which no existing sample depends; adding further samples is refused, as for another recipe.
    """
    recipe = Recipe.read(folder / RECIPE)
    recipe_hash = read_manifest(folder).get("recipe_hash")
    if recipe_hash is not None and recipe_hash != recipe.hash and recipe_hash == written_hash(folder / RECIPE):
        return recipe.hashed_as(recipe_hash)
    return recipe


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder; empty where there is none yet."""
    path = folder / MANIFEST
    if not path.exists():
        return {}
    try:
        manifest = json.loads(read_bytes(path, limit=MOST_BYTES, noun="manifest"))
        if not all(isinstance(manifest.get(name, {}), dict) for name in ("files", "inputs", "versions")):
            raise ValueError("files, inputs and versions must be objects")
        made_on = manifest.get("made_on", [])
        if not isinstance(made_on, list) or not all(isinstance(machine, str) for machine in made_on):
            raise ValueError("made_on must be a list of texts")
        if not all(FILE.fullmatch(name) for name in manifest["files"]):
            raise ValueError("files must be those of shards")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} cannot be read ({error!r}); remove it and run the recipe again") from None
    return dict(manifest)


def faults(folder: Path, recipe: Recipe) -> Iterator[str]:
    """Faults of the shards in a folder, a sentence each."""
    files = read_manifest(folder).get("files", {})
    present = {f"{shard_name(shard_number)}.{kind}" for shard_number in numbers(folder) for kind in ("npz", "jsonl")}
    for name in sorted(present | files.keys()):
        path = folder / SHARDS / name
        try:
            checksum = file_sha256(path)
        except InputError as error:
            yield str(error)
            continue
        if name not in files:
            yield f"{path} is not in the manifest"
        elif checksum != files[name]:
            yield f"{path} does not match its checksum"
    for shard_number in numbers(folder):
        yield from shard_faults(folder, shard_number, recipe)


def _check_parts(shard: Shard, index: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Refuses parts of a sample that do not add up to its map, as far as the stored ones allow the check."""
    spectrogram = shard.recipe.products.spectrogram
    if "parts" not in arrays or spectrogram is None:
        return
    power = 10.0 ** (spectrogram.levels(arrays["spectrogram"]).astype(np.float64) / 10.0)
    relative, least = spectrogram.rounding
    total = arrays["parts"].sum(axis=0, dtype=np.float64)
    power = resized(power, (total.shape[0], total.shape[1]))
    if np.any(np.abs(total - power) > relative * power + least + APART):
        raise damaged(shard.path, f"parts of sample {index} do not add up to its spectrogram")


def shard_faults(folder: Path, shard_number: int, recipe: Recipe) -> Iterator[str]:
    """Faults of one shard, apart from its checksums."""
    try:
        shard = Shard.of(folder, shard_number, recipe)
        indices = shard.rows("index").tolist()
        for record, arrays in shard.samples():
            _check_parts(shard, record["index"], arrays)
    except InputError as error:
        yield str(error)
        return
    if indices != [record["index"] for record in shard.good]:
        yield f"{shard.path} holds other samples than its records tell"


def content_hash(folder: Path, recipe: Recipe, count: int) -> tuple[str, int]:
    """SHA-256 over the records and arrays of the first `count` samples, whatever shards and archives hold them; and how many there
    are.

    For each sample: its record as JSON without its row, then name, type, shape and bytes of each array by name.
    """
    digest, samples = hashlib.sha256(), 0
    for shard_number in numbers(folder):
        shard = Shard.of(folder, shard_number, recipe)
        arrays = {record["index"]: sample_arrays for record, sample_arrays in shard.samples()}
        for record in shard.records:
            if record["index"] >= count:
                return digest.hexdigest(), samples
            content = {name: value for name, value in record.items() if name != "row"}
            digest.update(json.dumps(content, sort_keys=True).encode())
            for name, array in sorted(arrays.get(record["index"], {}).items()):
                digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
                digest.update(np.ascontiguousarray(array).tobytes())
            samples += 1
    return digest.hexdigest(), samples


def frozen_differences(folder: Path, recipe: Recipe) -> Iterator[str]:
    """Differences between the first samples and those that a shipped recipe declares frozen, a sentence each."""
    shipped = Recipe.read(recipe.name) if recipe.name in recipe_names() else recipe
    for count, frozen_hash in shipped.frozen if shipped.hash == recipe.hash else recipe.frozen:
        actual_hash, samples = content_hash(folder, recipe, count)
        if samples == count and actual_hash != frozen_hash:
            made_on = "; ".join(read_manifest(folder).get("made_on", [])) or "a machine that the manifest does not tell"
            yield (
                f"the first {count} samples of {folder} are not those of {recipe.name} that are frozen ({actual_hash[:12]} in "
                f"place of {frozen_hash[:12]}): another version made them, or other kernels; they were made on {shown(made_on)}; "
                "say so beside any score"
            )


def mixed_kernels(folder: Path) -> str | None:
    """A sentence if samples of a data set were made with different kernels; else None."""
    kernels = {machine.partition(", ")[2] or machine for machine in read_manifest(folder).get("made_on", [])}
    if len(kernels) < 2:
        return None
    return (
        f"samples were made with {len(kernels)} kinds of kernels ({', '.join(map(shown, sorted(kernels)))}), which round "
        "differently: some differ in a last bit from what the others would have made"
    )


def check_dataset(path: str | Path) -> list[str]:
    """Faults in a data set's folder, a sentence each; an empty list where there are none.

    All files are read: their checksums are compared with the manifest, their content with the recipe. Raises InputError where the
    folder is no data set or its recipe or manifest cannot be read.
    """
    folder = dataset_folder(path)
    recipe = recipe_of(folder)
    manifest = read_manifest(folder)
    problems = list(faults(folder, recipe))
    if manifest.get("recipe_hash") != recipe.hash:
        problems.insert(0, f"{folder / MANIFEST} is of another recipe than {RECIPE}, or missing")
    if not problems:
        failures = [
            record["failure"] for number in numbers(folder) for record in Shard.of(folder, number, recipe).records
        ]
        for name, count in (("samples", len(failures)), ("failed", len(failures) - failures.count(None))):
            if (stated := manifest.get(name, count)) != count:
                problems.append(
                    f"{folder / MANIFEST} tells {stated} for {name}, and the shards hold {count}; samples were lost or it was "
                    "edited"
                )
    return problems
