"""Memory of the process: how much it holds, the limit of a run, and returning unused memory to the system."""

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
"""Default memory limit of a run [GB]."""
RELEASE_ABOVE = 0.7
"""Fraction of the limit above which unused memory is returned to the system between blocks of work."""
RELEASE_EVERY = 10
"""Number of calls of `simulate` and `plan` after which all unused memory is returned."""
LEFT_BYTES = 256 * 2**20
"""Greatest amount of memory that is kept for the next arrays [bytes]."""
LARGER, MUCH_LARGER = 1.2, 2.0
"""Kept memory is reused for an array that needs less, by a factor of at most `LARGER` where a user may keep the array, and of at
most `MUCH_LARGER` where none does."""
REUSED_BYTES = 4 * 2**20
"""Least size of arrays that reuse memory of earlier ones [bytes]."""
SAMPLE_BYTES = 16
"""Memory that the visibility of one point takes, for each instant and viewpoint [bytes]."""
VISIBILITY_BYTES = 150e6
"""Greatest memory for the visibility of all points and viewpoints at the instants that are traced together [bytes]."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`; they are set to the greatest values that it would choose by itself."""
BLOCK_BYTES = 96 * 2**20
"""Size of the largest array in a block of work, such as a mesh's vertices at many instants [bytes]."""


@dataclass(frozen=True, slots=True)
class MemoryLimit:
    """Memory that a run may take in addition to what the process held when it began. The total decides when unused memory is
    returned."""

    limit_bytes: float
    held_bytes: float
    """Memory that the process held before [bytes]."""

    @classmethod
    def of(cls, memory_gb: float = LIMIT_GB) -> MemoryLimit:
        """A limit that counts from now on."""
        memory_gb = number("memory_gb", memory_gb, 1, 1e6, unit="GB", hint=f"{LIMIT_GB:g} is the default")
        return cls(memory_gb * 1e9, resident_bytes())

    @property
    def taken_bytes(self) -> float:
        """Memory that the run has taken so far [bytes]."""
        return max(0.0, resident_bytes() - self.held_bytes)

    def release(self) -> None:
        """Returns unused memory to the system where the process holds a good part of the run's limit.

        All its memory counts, including that held before: so a worker that makes many recordings stays below the limit.
        """
        if resident_bytes() > RELEASE_ABOVE * self.limit_bytes:
            release()

    def check(self, bytes_needed: float, what: str, remedy: str) -> None:
        """Refuses a step that would exceed the limit; `remedy` is the advice in the error."""
        if bytes_needed > self.limit_bytes:
            raise InputError(
                f"{what} takes about {bytes_needed / 1e9:.1f} GB of memory, more than the limit of {self.limit_bytes / 1e9:g} GB; "
                f"{remedy}, or raise memory_gb"
            )


def resident_bytes() -> int:
    """Memory that the process holds now [bytes]; 0 where the system does not report it."""
    try:
        with open("/proc/self/statm", "rb") as file:  # noqa: PTH123 (read every few milliseconds)
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


_left: dict[int, np.ndarray] = {}
"""Memory of earlier arrays of `reused`, by a running number; a dictionary, as threads add and remove entries at any time."""
_numbers = itertools.count()


def reused(size: int, larger: float = LARGER) -> np.ndarray:
    """An uninitialised uint8 array of `size` bytes: the memory of an earlier such array of which no view is left, up to `larger`
    times as large; or new memory.

    For the system, providing a cube of 100 MB page by page costs as much time as computing its samples.
    """
    fitting = [(block.size, key) for key, block in list(_left.items()) if size <= block.size <= larger * size]
    memory = _left.pop(min(fitting)[1], None) if fitting else None
    if memory is None or memory.size < size:  # a little more, since the next array may be slightly larger
        memory = np.empty(size + size // 8, np.uint8)
    return np.asarray(_Lent(memory))[:size]


def reused_empty(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An uninitialised array that no user keeps; its memory is from `reused` if it is so large that the C library would get it from
    the system."""
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    return np.empty(shape, dtype) if size < REUSED_BYTES else reused(size, MUCH_LARGER).view(dtype).reshape(shape)


class _Lent:
    """Owner of the memory of an array, referred to by all its views; when the last of them is gone the memory can be reused."""

    def __init__(self, memory: np.ndarray) -> None:
        self._memory = memory
        self.__array_interface__ = memory.__array_interface__

    def __del__(self) -> None:
        _left[next(_numbers)] = self._memory
        while sum(block.size for block in list(_left.values())) > LEFT_BYTES:
            _left.pop(next(iter(list(_left)), 0), None)


def release() -> None:
    """Returns unused memory to the system.

    Dr.Jit keeps freed memory for its next arrays, and the C library keeps free blocks between used ones; both add up over calls of
    different sizes.
    """
    _left.clear()
    if (dr := sys.modules.get("drjit")) is not None:
        dr.flush_malloc_cache()
    _trim()


@functools.cache
def keep_freed() -> None:
    """Lets the C library keep freed memory for the next arrays, which is its default, where the environment says otherwise.

    Workers of dask set MALLOC_TRIM_THRESHOLD_ to 64 kB: then each array is requested from the system page by page, and a sample of
    a data set takes a third more processor time (6.7 s instead of 5.0 s).
    """
    if "MALLOC_TRIM_THRESHOLD_" in os.environ:
        with suppress(OSError, AttributeError):  # another C library than glibc
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 32 * 2**20)
            ctypes.CDLL(None).mallopt(M_TRIM_THRESHOLD, 64 * 2**20)


class LastUsed(Generic[Value]):
    """A cache of the last used values by their keys; a copy in another process is empty.

    most: greatest number of values, or greatest total of what `size` returns for each; the last value is kept whatever its size.

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
        """The value of a key (never None), computed by `make` where it is not cached. Threads that ask for one at the same time may
        each compute it."""
        # Removed and inserted again, as other threads may remove any key at any time.
        value = self._values.pop(key, None)
        if value is None:
            value = make()
        self._values[key] = value
        with suppress(KeyError):  # another thread has removed the last one
            while len(self._values) > 1 and self._held() > self._most:
                self._values.popitem(last=False)
        return value

    def _held(self) -> float:
        return len(self._values) if self._size is None else sum(map(self._size, list(self._values.values())))

    def forget(self) -> None:
        """Removes all values."""
        self._values.clear()


def array_bytes(value: np.ndarray | list[np.ndarray]) -> int:
    """Memory of an array, or of several [bytes]."""
    return value.nbytes if isinstance(value, np.ndarray) else sum(part.nbytes for part in value)


def release_above(held_bytes: float) -> None:
    """Returns unused memory where the process holds more than `held_bytes`."""
    if resident_bytes() > held_bytes:
        release()


_calls = itertools.count(1)


def after_call() -> None:
    """Keeps memory from growing in a process that makes many calls.

    Memory that Dr.Jit has kept serves the next call; getting it from the system again would take a tenth of that call's time. But
    calls of different sizes leave more and more of it, so it is returned every few calls, and the free blocks of the C library
    after each.
    """
    if next(_calls) % RELEASE_EVERY:
        _trim()
    else:
        release()


def _trim() -> None:
    """Returns the free blocks of the C library to the system."""
    if (call := _malloc_trim()) is not None:
        call(0)


@functools.cache
def _malloc_trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)  # only glibc has it


def blocks(items: np.ndarray, vectors: int) -> Iterator[np.ndarray]:
    """Splits items (K, ...) into blocks such that an array with `vectors` float64 vectors for each item, (k, V, 3), stays small.

    >>> [len(some) for some in blocks(np.zeros(5), BLOCK_BYTES // 48)]
    [2, 2, 1]
    """
    size = max(1, BLOCK_BYTES // (24 * max(1, vectors)))
    for first in range(0, len(items), size):
        yield items[first : first + size]
