"""Shards on disk: `shards/00000.npz` holds arrays, `shards/00000.jsonl` a record for each sample; none is half written."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.files import regular_file
from t2d_rt.dataset.work import Made

SHARDS = "shards"
SPOOL = "spool"
"""Folder of the finished samples of shards that are not finished, each a shard of one: INDEX.npz and INDEX.jsonl."""
PART = ".part"
"""Ending of what is not yet written to its end."""
BLOCK = 2**20
"""Bytes that are read at once of a file that is only compared."""
TIME = 1980, 1, 1, 0, 0, 0
"""Of files in an archive: the same bytes whenever it is written."""
RAGGED = frozenset({"points", "adc", "truth"})
"""Products whose arrays differ in size from sample to sample: each has an array of its own."""


def shard_name(number: int) -> str:
    """Name of a shard's files without their ending."""
    return f"{number:05d}"


def packed(made: Sequence[Made]) -> tuple[bytes, bytes]:
    """Content of the archive and of the records of a shard."""
    arrays: dict[str, np.ndarray] = {}
    good = [each for each in made if each.arrays]
    for name in sorted({name for each in good for name in each.arrays}):
        if name in RAGGED:
            arrays |= {f"{name}_{each.record['index']}": each.arrays[name] for each in good}
        else:
            arrays[name] = np.stack([each.arrays[name] for each in good])
    arrays["index"] = np.array([each.record["index"] for each in good], dtype=np.int64)
    rows = {each.record["index"]: row for row, each in enumerate(good)}
    lines = [json.dumps({**each.record, "row": rows.get(each.record["index"])}) for each in made]
    return archive(arrays), "".join(f"{line}\n" for line in lines).encode()


def archive(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Arrays as an .npz file that is the same for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, array in sorted(arrays.items()):
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.ascontiguousarray(array), allow_pickle=False)
            about = zipfile.ZipInfo(f"{name}.npy", date_time=TIME)
            about.compress_type = zipfile.ZIP_DEFLATED
            file.writestr(about, entry.getvalue(), compresslevel=6)
    return buffer.getvalue()


def write_shard(folder: Path, number: int, made: Sequence[Made]) -> dict[str, str]:
    """Writes a shard and gives the SHA-256 of its files by their names; the records come last, and a shard without them is none.

    Records of a smaller shard that it replaces go first: a process that is killed between the two files leaves no shard, not half
    of each.
    """
    data, records = packed(made)
    name = shard_name(number)
    (folder / SHARDS / f"{name}.jsonl").unlink(missing_ok=True)
    write_whole(folder / SHARDS / f"{name}.npz", data)
    write_whole(folder / SHARDS / f"{name}.jsonl", records)
    return {f"{name}.npz": sha256(data), f"{name}.jsonl": sha256(records)}


def write_spooled(folder: Path, made: Made) -> None:
    """Keeps a finished sample of a shard that is not finished, as a shard of one; the record comes last, as there."""
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
    """Takes away samples that are in their shard."""
    for index in indices:
        for ending in (".jsonl", ".npz"):
            (folder / SPOOL / f"{index}{ending}").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # others are still there, or none was
        (folder / SPOOL).rmdir()


def unwritten(path: Path, error: OSError) -> InputError:
    """What to say of a file that cannot be written."""
    return InputError(
        f"cannot write {path}: {error.strerror or error}; free space or choose a writable place, and run it again: what is "
        "finished stays"
    )


def write_whole(path: Path, data: bytes) -> None:
    """Writes a file that stands at its place whole or not at all, even if the machine stops."""
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
    with contextlib.suppress(OSError):  # a file system that syncs no folders
        place = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(place)
        finally:
            os.close(place)


def sweep(folder: Path) -> None:
    """Removes what killed processes left half written."""
    for path in [each for place in (folder, folder / SHARDS, folder / SPOOL) for each in place.glob(f".*{PART}")]:
        path.unlink(missing_ok=True)


def sha256(data: bytes) -> str:
    """Checksum of a file's content."""
    return hashlib.sha256(data).hexdigest()


def file_sha256(path: Path) -> str:
    """The same of a file, which is not taken into memory."""
    digest = hashlib.sha256()
    with regular_file(path, noun="shard") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def numbers(folder: Path) -> Iterator[int]:
    """Numbers of the shards that have records, in order."""
    yield from sorted(int(path.stem) for path in (folder / SHARDS).glob("*.jsonl") if path.stem.isdecimal())


def damaged(path: Path, why: object) -> InputError:
    """What to say of a shard that cannot be used."""
    return InputError(
        f"{path} is damaged ({why}); remove {path.stem}.npz and {path.stem}.jsonl and run the recipe again, which makes them anew"
    )
