"""Where kernels run: Dr.Jit on LLVM (CPU) or CUDA (GPU), chosen when first used and never at import."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeVar

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import BackendError, InputError

if TYPE_CHECKING:
    import numpy as np

P = ParamSpec("P")
R = TypeVar("R")
Item = TypeVar("Item")
Device = Literal["auto", "cpu", "gpu"]
"""Where to compute, as a user says it."""

OLDEST_LLVM = 17
"""LLVM 15 and 16 abort the process on CPUs with AVX-512 ("Cannot select ... fmaximum"), 14 is refused by Dr.Jit."""

ALIGNMENT = 64
"""Bytes: that of Dr.Jit's own arrays."""

_PATH_VARIABLE = "DRJIT_LIBLLVM_PATH"
_REMEDY = (
    "install LLVM (Debian, Ubuntu: apt-get install libllvm19; anywhere on x86-64: pip install 't2d-rt[llvm]') "
    f"or set {_PATH_VARIABLE} to a libLLVM of {OLDEST_LLVM} or newer"
)
_LLVM_WHEEL = "karellen-llvm-core"
_ROOT = Path("/")
_LIBRARY_GLOBS = (
    "usr/lib/*-linux-gnu*/libLLVM*.so*",
    "usr/lib64/libLLVM*.so*",
    "usr/lib/libLLVM*.so*",
    "usr/lib64/llvm*/lib*/libLLVM*.so*",
    "usr/lib/llvm*/lib/libLLVM*.so*",
    "usr/lib/wsl/lib/libLLVM*.so*",
)


YARDSTICK_SIZE, YARDSTICK_SINES, YARDSTICK_TRIES = 400_000, 20, 5
YARDSTICK_KEPT_S = 60.0
"""How long a measured yardstick serves [s]."""
_yardsticks: dict[tuple[str, int], tuple[float, float]] = {}
"""When the yardstick of a backend and a number of threads was measured, and what it was."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """Array types of one Dr.Jit backend, without automatic differentiation."""

    name: Literal["llvm", "cuda"]
    arrays: Any
    """The module the types come from, `drjit.llvm` or `drjit.cuda`."""
    UInt32: Any
    Float32: Any
    Float64: Any

    @property
    def mitsuba_variant(self) -> str:
        """The Mitsuba variant on the same backend; Sionna RT needs the polarised one, so both can share a process."""
        return f"{self.name}_ad_mono_polarized"

    def lanes(self, values: np.ndarray, kind: Any = None) -> Any:
        """Numbers that lanes read one each, as an array of `kind`: UInt32, which is the default, Float32 or Float64."""
        import numpy as np

        kind = self.UInt32 if kind is None else kind
        dtype = np.dtype({self.UInt32: np.uint32, self.Float32: np.float32, self.Float64: np.float64}[kind])
        return kind(aligned(values, dtype))


_recording = threading.RLock()


def one_thread_at_a_time(function: Callable[P, R]) -> Callable[P, R]:
    """Lets one thread at a time record and start kernels in functions that have this decorator.

    Echoes are made in one thread while earlier ones are summed in another. Dr.Jit 1.5 then fails now and then, as it takes one
    thread's writes for part of the other's loop ("variable remains dirty despite an attempt to evaluate it").
    """

    @functools.wraps(function)
    def alone(*args: P.args, **options: P.kwargs) -> R:
        with _recording:
            return function(*args, **options)

    return alone


def aligned(values: np.ndarray, dtype: Any) -> np.ndarray:
    """A flat copy that lies in memory as Dr.Jit's own arrays do: it takes arrays over uncopied, and compiles a kernel anew for each
    combination of alignments."""
    out = aligned_empty(values.size, dtype)
    out[:] = values.ravel()
    return out


def flat_on_device(values: np.ndarray, kind: Any) -> Any:
    """Complex64 numbers as an array of Float32 `kind`, real and imaginary parts in turn.

    It is their own memory where that lies as `aligned` says: they must not change before what is made of it is computed.
    """
    import numpy as np

    parts = np.ascontiguousarray(values, np.complex64).reshape(-1).view(np.float32)
    return kind(parts if parts.ctypes.data % ALIGNMENT == 0 else aligned(parts, np.float32))


def aligned_zeros(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Zeros in memory that lies as `aligned` says, which the system gives when they are written."""
    import numpy as np

    length = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.zeros(length + ALIGNMENT, np.uint8)
    skipped = -raw.ctypes.data % ALIGNMENT
    return raw[skipped : skipped + length].view(dtype).reshape(shape)


def aligned_empty(size: int, dtype: Any, memory: Callable[[int], np.ndarray] | None = None) -> np.ndarray:
    """Flat memory for that many numbers, that lies as `aligned` says; `memory` gives so many bytes, by default new ones."""
    import numpy as np

    length = size * np.dtype(dtype).itemsize
    raw = np.empty(length + ALIGNMENT, np.uint8) if memory is None else memory(length + ALIGNMENT)
    skipped = -raw.ctypes.data % ALIGNMENT
    return raw[skipped : skipped + length].view(dtype)


def select(device: str = "auto") -> Backend:
    """The backend for a device: "cpu" (LLVM), "gpu" (CUDA) or "auto" (CUDA where there is one)."""
    if not isinstance(device, str) or device not in ("auto", "cpu", "gpu"):
        raise InputError(f"device must be auto, cpu or gpu, got {shown(device)}")
    if device != "cpu" and _has_cuda():
        return _backend("cuda")
    if device == "gpu":
        raise BackendError(
            "device gpu was asked for, but no CUDA device was found; use device cpu or install its driver"
        )
    require_llvm()
    return _backend("llvm")


def yardstick_s(backend: Backend) -> float:
    """Time that a fixed piece of work takes here [s], the best of a few tries: what the seconds of the laws are counted in.

    Half of it are sines on the backend, half a sparse product in one thread.
    """
    import drjit as dr
    import numpy as np
    from scipy import sparse

    rng = np.random.default_rng(0)
    rows = YARDSTICK_SIZE // 8
    matrix = sparse.csr_matrix(
        (
            np.ones(YARDSTICK_SIZE, np.float32),
            rng.integers(rows, size=YARDSTICK_SIZE),
            np.arange(0, YARDSTICK_SIZE + 1, 8),
        ),
        shape=(rows, rows),
    )
    values, lanes = np.ones((rows, 30), np.float32), backend.lanes(rng.random(YARDSTICK_SIZE * 4), backend.Float32)
    durations_s = []
    for _ in range(YARDSTICK_TRIES):
        start = time.perf_counter()
        sines = lanes
        for _ in range(YARDSTICK_SINES):
            sines = dr.sin(sines + lanes)
        np.asarray(sines)
        matrix @ values
        durations_s.append(time.perf_counter() - start)
    return min(durations_s[1:])


def recent_yardstick_s(backend: Backend) -> float:
    """`yardstick_s`, measured at most once a minute for a backend and a number of threads: it takes as long as the rest of a plan
    of a short record."""
    key, now = (backend.name, thread_count()), time.monotonic()
    measured, seconds = _yardsticks.get(key, (-math.inf, math.nan))
    if now - measured > YARDSTICK_KEPT_S:
        measured, seconds = now, yardstick_s(backend)
        _yardsticks[key] = measured, seconds
    return seconds


@functools.cache
def require_llvm() -> None:
    """Check, before Dr.Jit loads it, that the LLVM library is there and new enough; the newest one installed is taken.

    A path that the user gave in DRJIT_LIBLLVM_PATH is checked, not replaced.
    """
    path = os.environ.get(_PATH_VARIABLE)
    if path:
        _check_library(path)
    elif sys.platform.startswith("linux"):  # elsewhere Dr.Jit's own search is all there is
        os.environ[_PATH_VARIABLE] = _newest_installed()
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.LLVM):
        raise BackendError(f"Dr.Jit found no usable LLVM; {_REMEDY}")
    version = dr.detail.llvm_version()
    if version[0] < OLDEST_LLVM:  # Dr.Jit had loaded its LLVM before this check could choose one
        raise BackendError(f"Dr.Jit runs on LLVM {version[0]}, which is too old; {_REMEDY}")


@functools.cache
def _backend(name: Literal["llvm", "cuda"]) -> Backend:
    import importlib

    arrays = importlib.import_module(f"drjit.{name}")
    kinds = ("UInt32", "Float32", "Float64")
    return Backend(name=name, arrays=arrays, **{kind: getattr(arrays, kind) for kind in kinds})


def _has_cuda() -> bool:
    if sys.platform.startswith("linux") and _PATH_VARIABLE not in os.environ:
        with contextlib.suppress(BackendError):  # a machine with CUDA needs no LLVM
            os.environ[_PATH_VARIABLE] = _newest_installed()  # Dr.Jit takes its choice when it is imported
    import drjit as dr

    return bool(dr.has_backend(dr.JitBackend.CUDA))


def _check_library(path: str) -> None:
    try:
        version = _llvm_version(path)
    except OSError as error:
        raise BackendError(f"{_PATH_VARIABLE} is {path}, which cannot be loaded ({error}); {_REMEDY}") from None
    if version < OLDEST_LLVM:
        raise BackendError(f"{_PATH_VARIABLE} is {path}, which is too old ({_named(version)}); {_REMEDY}")


def _newest_installed() -> str:
    """Path of the newest good library; raises where there is none."""
    too_old = []
    for path in _installed():
        try:
            version = _llvm_version(path)
        except OSError:
            continue
        if version >= OLDEST_LLVM:
            return path
        too_old.append(f"{path} ({_named(version)})")
    if too_old:
        raise BackendError(f"LLVM is too old: found {', '.join(too_old)}; {_REMEDY}")
    raise BackendError(f"LLVM was not found; {_REMEDY}")


def _installed() -> list[str]:
    """Libraries of this machine, newest first by file name, so that no old one need be loaded to be passed over."""
    paths = {str(path.resolve()) for pattern in _LIBRARY_GLOBS for path in _ROOT.glob(pattern)} | _from_wheel()
    # a bare name lets the loader search LD_LIBRARY_PATH and an environment's own folder, as Dr.Jit does
    return [*sorted(paths, key=_version_in_name, reverse=True), "libLLVM.so"]


def _from_wheel() -> set[str]:
    """The libraries that the extra [llvm] brings, wherever pip put them: the environment's own folder, or the user's."""
    from importlib import metadata

    try:
        files = metadata.files(_LLVM_WHEEL) or []
    except metadata.PackageNotFoundError:
        return set()
    return {str(Path(file.locate()).resolve()) for file in files if file.name.startswith("libLLVM.so")}


def _version_in_name(path: str) -> tuple[int, ...]:
    """(19, 1) of libLLVM.so.19.1 or libLLVM-19.1.so."""
    return tuple(int(number) for number in re.findall(r"\d+", Path(path).name))


def _llvm_version(path: str) -> int:
    """Major version of an LLVM library; 0 for one older than 16, which cannot tell. OSError where it does not load."""
    library = ctypes.CDLL(path)
    if not hasattr(library, "LLVMGetVersion"):  # new in LLVM 16
        return 0
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    library.LLVMGetVersion(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    return major.value


def _named(version: int) -> str:
    return f"LLVM {version}" if version else "older than LLVM 16"


@contextlib.contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Lets this process compute on so many threads of Dr.Jit, BLAS and OpenMP, and on as many as before at the end; what it
    computes stays the same. It holds for the whole process, so that two of its threads must not use it at the same time."""
    import threadpoolctl

    if not _has_cuda():
        require_llvm()
    import drjit as dr

    before = dr.thread_count()
    with threadpoolctl.threadpool_limits(count):
        try:
            if before != count:
                dr.set_thread_count(count)
            yield
        finally:
            if before != count:
                dr.set_thread_count(before)


class _OneBlasThread(contextlib.ContextDecorator):
    """One thread of BLAS in this process, for all threads of Python, until the last of those within has left.

    The bits of a product may depend on how many threads share it, and threads that wait for the next product take the kernels'
    cores.
    """

    def __init__(self) -> None:
        self._lock, self._users = threading.Lock(), 0
        self._limits: Any = None

    def __enter__(self) -> None:
        import scipy.linalg  # noqa: F401  # a BLAS of its own, which would come with as many threads as there are cores
        from threadpoolctl import threadpool_limits

        with self._lock:
            if self._users == 0:
                _anyone_limits_blas()
                self._limits = threadpool_limits(1, user_api="blas")
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                _anyone_limits_blas()
                self._limits.restore_original_limits()
                _anyone_limits_blas()


def _anyone_limits_blas() -> None:
    """threadpoolctl lets the thread that was first limit OpenBLAS, and does nothing, without a word, for all others."""
    from threadpoolctl import OpenBLASController

    OpenBLASController.clear_controlling_thread(force=True)


one_blas_thread = _OneBlasThread()
"""For a `with`, and to decorate a function that promises the same bits."""


def thread_count() -> int:
    """Threads that this process computes on: as many as there are cores, or those of `limited_threads`."""
    import drjit as dr

    return int(dr.thread_count())


def in_threads(work: Callable[[int], None], items: Sequence[int]) -> None:
    """Does the work of all items in as many threads as this process computes on."""
    threads = min(thread_count(), len(items))
    if threads <= 1:  # memory that a thread of a pool asks for comes from the system anew, a fifth slower
        for item in items:
            work(item)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, items))


def prefetched(items: Iterable[Item]) -> Iterator[Item]:
    """The same items in the same order; another thread makes the next one while one is worked on."""
    source, end = iter(items), object()
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, source, end)
        while (item := coming.result()) is not end:
            coming = pool.submit(next, source, end)
            yield item  # type: ignore[misc]


@one_thread_at_a_time
def normal_numbers(count: int, *, key: int, scale: float = 1.0) -> np.ndarray:
    """Normal numbers of a standard deviation, float32 (count,): those of Philox4x32 (Salmon et al. 2011) by a key of 64 bits; the
    first ones do not depend on how many there are. NumPy's generators take ten times as long."""
    import drjit as dr
    import numpy as np

    backend = select("cpu")  # the same bits on a machine with a GPU
    arrays = backend.arrays
    lane = dr.arange(backend.UInt32, -(-count // 4))
    normals = arrays.Philox4x32(dr.opaque(arrays.UInt64, key), lane).next_float32x4_normal()
    numbers: Any = dr.ravel(normals * dr.opaque(backend.Float32, scale))
    return np.asarray(numbers.numpy()[:count])
