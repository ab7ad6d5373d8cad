"""Arrays that were read last are kept, up to so many bytes, and go to no other process."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np


class Kept:
    """The last arrays, or lists of arrays, by their keys; the very last one whatever its size."""

    def __init__(self, most_bytes: float) -> None:
        self._most = most_bytes
        self._values: OrderedDict[Hashable, Any] = OrderedDict()
        self._bytes = 0

    def get(self, key: Hashable, read: Callable[[], np.ndarray | Sequence[np.ndarray]]) -> Any:
        """The value of a key, which is read where it is not there."""
        if key not in self._values:
            value = read()
            self._values[key] = value
            self._bytes += _size(value)
            while self._bytes > self._most and len(self._values) > 1:
                self._bytes -= _size(self._values.popitem(last=False)[1])
        self._values.move_to_end(key)
        return self._values[key]

    def __getstate__(self) -> dict[str, Any]:
        return {"_most": self._most, "_values": OrderedDict(), "_bytes": 0}


def _size(value: np.ndarray | Sequence[np.ndarray]) -> int:
    return value.nbytes if isinstance(value, np.ndarray) else sum(each.nbytes for each in value)
