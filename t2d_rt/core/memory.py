"""Memory of the process: how much it holds, the limit that a run keeps to, and giving back what nothing uses any more."""

from __future__ import annotations

import ctypes
import functools
import itertools
import math
import os
import sys
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from t2d_rt.core.checks import number
from t2d_rt.core.errors import InputError

Value = TypeVar("Value")

LIMIT_GB = 2.0
"""Memory that a run may take unless the user says otherwise [GB]."""
RELEASE_ABOVE = 0.7
"""Fraction of the limit above which unused memory is given back to the system between blocks of work."""
RELEASE_EVERY = 10
"""Calls of `simulate` and `plan` after which all unused memory is given back."""
LEFT_BYTES = 256 * 2**20
"""Memory that is kept for the next arrays, at most."""
LARGER, MUCH_LARGER = 1.2, 2.0
"""Kept memory is reused where it is at most so many times what is asked for: of arrays that a user may keep, and of others."""
REUSED_BYTES = 4 * 2**20
"""Size of an array from which it takes what others have left."""
SAMPLE_BYTES = 16
"""Memory that visibility of a point takes at an instant from one viewpoint."""
VISIBILITY_BYTES = 150e6
"""What visibility may take of all points and viewpoints, at the instants that are traced together."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Of glibc's `mallopt`; set to the greatest values that it would choose by itself."""
BLOCK_BYTES = 96 * 2**20
"""Size of the largest array that a block of work makes, such as a mesh's vertices at many instants."""


@dataclass(frozen=True, slots=True)
class MemoryLimit:
    """What a run may take beyond what the process held when it began; all that it holds tells when unused memory goes back."""

    limit_bytes: float
    held_bytes: float
    """Memory that the process held before."""

    @classmethod
    def of(cls, memory_gb: float = LIMIT_GB) -> MemoryLimit:
        """A budget that counts from now on."""
        memory_gb = number("memory_gb", memory_gb, 1, 1e6, unit="GB", hint=f"{LIMIT_GB:g} is the default")
        return cls(memory_gb * 1e9, resident_bytes())

    @property
    def taken_bytes(self) -> float:
        """Memory that the run has taken so far."""
        return max(0.0, resident_bytes() - self.held_bytes)

    def release(self) -> None:
        """Gives unused memory back to the system where the process holds a good part of the run's limit.

        All of it counts, what it held before as well: a worker that makes many recordings stays below the limit.
        """
        if resident_bytes() > RELEASE_ABOVE * self.limit_bytes:
            release()

    def check(self, bytes_needed: float, what: str, remedy: str) -> None:
        """Refuses what would take more than the limit."""
        if bytes_needed > self.limit_bytes:
            raise InputError(
                f"{what} takes about {bytes_needed / 1e9:.1f} GB of memory, more than the limit of {self.limit_bytes / 1e9:g} GB; "
                f"{remedy}, or raise memory_gb"
            )


def resident_bytes() -> int:
    """Memory that the process holds now; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", "rb") as file:  # noqa: PTH123 (read every few milliseconds)
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


_left: dict[int, np.ndarray] = {}
"""Memory of earlier arrays of `reused`, numbered; a dictionary, as threads take out and put in at any time."""
_numbers = itertools.count()


def reused(size: int, larger: float = LARGER) -> np.ndarray:
    """So many bytes that are not initialised, uint8: the memory of an earlier array of this function, once no view of it is left,
    which may be so many times `larger`; or new memory.

    A cube of 100 MB costs the system as much to hand out, page by page, as its samples cost to make.
    """
    fitting = [(block.size, key) for key, block in list(_left.items()) if size <= block.size <= larger * size]
    memory = _left.pop(min(fitting)[1], None) if fitting else None
    if memory is None or memory.size < size:  # a little more: the next one may be a little larger
        memory = np.empty(size + size // 8, np.uint8)
    return np.asarray(_Lent(memory))[:size]


def reused_empty(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An array that is not initialised, of `reused` where it is so large that the C library would ask the system for it; for those
    that no user keeps."""
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    return np.empty(shape, dtype) if size < REUSED_BYTES else reused(size, MUCH_LARGER).view(dtype).reshape(shape)


class _Lent:
    """Memory under an array: what its views refer to as long as there are any."""

    def __init__(self, memory: np.ndarray) -> None:
        self._memory = memory
        self.__array_interface__ = memory.__array_interface__

    def __del__(self) -> None:
        _left[next(_numbers)] = self._memory
        while sum(block.size for block in list(_left.values())) > LEFT_BYTES:
            _left.pop(next(iter(list(_left)), 0), None)


def release() -> None:
    """Gives unused memory back to the system.

    Dr.Jit keeps what its arrays have freed for the next ones, and the C library keeps free pieces between pieces in use; both add
    up over calls of different sizes.
    """
    _left.clear()
    if (dr := sys.modules.get("drjit")) is not None:
        dr.flush_malloc_cache()
    _trim()


@functools.cache
def keep_freed() -> None:
    """Lets the C library keep what arrays have freed for the next ones, as it does by itself, where the environment says otherwise.

    Workers of dask have MALLOC_TRIM_THRESHOLD_ at 64 kB: each array was then asked of the system page by page, and a sample of a
    data set took a third more of the processor's time (6.7 s for 5.0 s).
    """
    if "MALLOC_TRIM_THRESHOLD_" in os.environ:
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 32 * 2**20)
            ctypes.CDLL(None).mallopt(M_TRIM_THRESHOLD, 64 * 2**20)


class LastUsed(Generic[Value]):
    """Values by their keys, of which the last used ones are kept; a copy in another process begins with none.

    most: how many, or how much of what `size` gives of each; the very last one is kept whatever its size.

    >>> kept = LastUsed[int](2)
    >>> [kept.get(key, lambda key=key: ord(key)) for key in "abca"]
    [97, 98, 99, 97]
    """

    def __init__(self, most: float, size: Callable[[Value], float] | None = None) -> None:
        self._most, self._size = most, size
        self._values: OrderedDict[Hashable, Value] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"_most": self._most, "_size": self._size, "_values": OrderedDict()}

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value of a key, not None, made where it is not kept. Threads that ask for one at the same time may each make it."""
        # Taken out and put back: another thread may drop any key at any time.
        value = self._values.pop(key, None)
        if value is None:
            value = make()
        self._values[key] = value
        with suppress(KeyError):  # another thread has dropped the last one
            while len(self._values) > 1 and self._held() > self._most:
                self._values.popitem(last=False)
        return value

    def _held(self) -> float:
        return len(self._values) if self._size is None else sum(map(self._size, list(self._values.values())))

    def forget(self) -> None:
        """Drops all of them."""
        self._values.clear()


def array_bytes(value: np.ndarray | list[np.ndarray]) -> int:
    """Memory of an array, or of several."""
    return value.nbytes if isinstance(value, np.ndarray) else sum(part.nbytes for part in value)


def release_above(held_bytes: float) -> None:
    """Gives unused memory back where the process holds more."""
    if resident_bytes() > held_bytes:
        release()


_calls = itertools.count(1)


def after_call() -> None:
    """Keeps the memory of a process that makes many calls level.

    What Dr.Jit keeps serves the next call, and to ask the system for it again takes a tenth of that call's time; but calls of
    different sizes leave more and more of it. So it is given back every so many calls, and the C library's free pieces each time.
    """
    if next(_calls) % RELEASE_EVERY:
        _trim()
    else:
        release()


def _trim() -> None:
    """Gives the free pieces of the C library back to the system."""
    if (call := _malloc_trim()) is not None:
        call(0)


@functools.cache
def _malloc_trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc alone has it


def blocks(items: np.ndarray, vectors: int) -> Iterator[np.ndarray]:
    """Items (K, ...) in blocks, so that an array of so many vectors for each, float64 (k, V, 3), stays small.

    >>> [len(some) for some in blocks(np.zeros(5), BLOCK_BYTES // 48)]
    [2, 2, 1]
    """
    size = max(1, BLOCK_BYTES // (24 * max(1, vectors)))
    for first in range(0, len(items), size):
        yield items[first : first + size]
