"""The arrays to which an experiment refers, stored under the hash of their content: collecting, finding, writing and reading
them."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes

Inputs = Mapping[str, Mapping[str, np.ndarray]]
"""Arrays by name, for each hash of their content."""
Hash = Annotated[str, Field(pattern=r"[0-9a-f]{32}")]
LARGEST_INPUT_BYTES = 2 * 2**30
"""Greatest size of one file of arrays, unpacked [bytes]."""


@dataclass(slots=True)
class Store:
    """Collects the arrays to which an experiment refers."""

    inputs: dict[str, dict[str, np.ndarray]]

    def keep(self, **arrays: np.ndarray) -> str:
        """Stores arrays by name and returns their hash."""
        digest = hashlib.sha256()
        for name, array in arrays.items():
            digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.hexdigest()[:32]
        self.inputs[key] = dict(arrays)
        return key


def named_arrays(inputs: Inputs, key: str, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays with that hash, checked to have these names."""
    arrays = inputs.get(key)
    if arrays is None or set(arrays) != set(names):
        raise InputError(
            f"the experiment names arrays {key} of {', '.join(names)}, and they are not there; give the recording's whole folder"
        )
    return dict(arrays)


def packed(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a compressed .npz file."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def unpacked(path: Path) -> dict[str, np.ndarray]:
    """Reads a file that `packed` wrote, and checks its content against the hash in the file's name."""
    data = read_bytes(path, limit=LARGEST_INPUT_BYTES, noun="file of arrays")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > LARGEST_INPUT_BYTES:
            raise InputError(f"{path} unpacks to {size / 1e9:.1f} GB, more than {LARGEST_INPUT_BYTES / 1e9:.1f} GB")
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except InputError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise InputError(f"{path} is not a whole file of arrays ({error}); simulate the recording again") from None
    if Store({}).keep(**arrays) != path.stem:
        raise InputError(f"{path} is damaged: its arrays are not those that its name is the hash of; simulate it again")
    return arrays
