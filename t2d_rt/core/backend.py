"""Selects where kernels run: Dr.Jit on LLVM (CPU) or CUDA (GPU), chosen at first use and never at import."""

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
"""Device on which to compute, as users name it."""

OLDEST_LLVM = 17
"""Oldest version of LLVM that works: 15 and 16 abort the process on CPUs with AVX-512 ("Cannot select ... fmaximum"), and Dr.Jit
refuses 14."""

ALIGNMENT = 64
"""Alignment of arrays [bytes], that of Dr.Jit's own."""

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
"""How long a measured duration of the reference computation is used [s]."""
_yardsticks: dict[tuple[str, int], tuple[float, float]] = {}
"""For a backend and a number of threads: when the reference computation was measured, and its duration [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """Array types of one Dr.Jit backend, without automatic differentiation."""

    name: Literal["llvm", "cuda"]
    arrays: Any
    """The module of the array types, `drjit.llvm` or `drjit.cuda`."""
    UInt32: Any
    Float32: Any
    Float64: Any

    @property
    def mitsuba_variant(self) -> str:
        """The Mitsuba variant for the same backend. It is the polarised one, which Sionna RT needs, so that both can share a
        process."""
        return f"{self.name}_ad_mono_polarized"

    def lanes(self, values: np.ndarray, kind: Any = None) -> Any:
        """An array from which each lane of a kernel reads one number; `kind` is UInt32 (the default), Float32 or Float64."""
        import numpy as np

        kind = self.UInt32 if kind is None else kind
        dtype = np.dtype({self.UInt32: np.uint32, self.Float32: np.float32, self.Float64: np.float64}[kind])
        return kind(aligned(values, dtype))


_recording = threading.RLock()


def one_thread_at_a_time(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator that lets only one thread at a time record and start kernels in the functions that have it.

    One thread computes echoes while another sums earlier ones. Dr.Jit 1.5 then fails now and then, because it mistakes the writes
    of one thread for part of a loop of the other ("variable remains dirty despite an attempt to evaluate it").
    """

    @functools.wraps(function)
    def alone(*args: P.args, **options: P.kwargs) -> R:
        with _recording:
            return function(*args, **options)

    return alone


def aligned(values: np.ndarray, dtype: Any) -> np.ndarray:
    """A flat copy with the alignment of Dr.Jit's own arrays: Dr.Jit uses such arrays without copying, and compiles a kernel anew
    for each combination of alignments."""
    out = aligned_empty(values.size, dtype)
    out[:] = values.ravel()
    return out


def flat_on_device(values: np.ndarray, kind: Any) -> Any:
    """Complex64 numbers as an array of Float32 `kind`, real and imaginary parts alternating.

    Aligned numbers are not copied: they must not change before everything computed from them has been evaluated.
    """
    import numpy as np

    parts = np.ascontiguousarray(values, np.complex64).reshape(-1).view(np.float32)
    return kind(parts if parts.ctypes.data % ALIGNMENT == 0 else aligned(parts, np.float32))


def aligned_zeros(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Zeros in `aligned` memory, which the system provides only when it is written."""
    import numpy as np

    return aligned_empty(math.prod(shape), dtype, lambda size: np.zeros(size, np.uint8)).reshape(shape)


def aligned_empty(size: int, dtype: Any, memory: Callable[[int], np.ndarray] | None = None) -> np.ndarray:
    """Flat uninitialised array of `size` numbers in `aligned` memory; `memory` provides a number of bytes, by default new ones."""
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
    """Duration of a fixed reference computation on this machine [s], the best of a few tries; the laws of run time are relative to
    it.

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
    """`yardstick_s`, measured at most once a minute for a backend and a number of threads, because it takes as long as the rest of
    a plan for a short record."""
    key, now = (backend.name, thread_count()), time.monotonic()
    measured, seconds = _yardsticks.get(key, (-math.inf, math.nan))
    if now - measured > YARDSTICK_KEPT_S:
        measured, seconds = now, yardstick_s(backend)
        _yardsticks[key] = measured, seconds
    return seconds


@functools.cache
def require_llvm() -> None:
    """Checks, before Dr.Jit loads it, that the LLVM library exists and is new enough; chooses the newest one installed.

    A path that the user gave in DRJIT_LIBLLVM_PATH is checked, not replaced.
    """
    path = os.environ.get(_PATH_VARIABLE)
    if path:
        _check_library(path)
    elif sys.platform.startswith("linux"):  # on other systems only Dr.Jit's own search is available
        os.environ[_PATH_VARIABLE] = _newest_installed()
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.LLVM):
        raise BackendError(f"Dr.Jit found no usable LLVM; {_REMEDY}")
    version = dr.detail.llvm_version()
    if version[0] < OLDEST_LLVM:  # Dr.Jit had loaded an LLVM before this check could choose one
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
            os.environ[_PATH_VARIABLE] = _newest_installed()  # Dr.Jit reads the choice when it is imported
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
    """Path of the newest usable library; raises a BackendError where there is none."""
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
    """LLVM libraries of this machine, newest first by file name, so that old ones need not be loaded."""
    paths = {str(path.resolve()) for pattern in _LIBRARY_GLOBS for path in _ROOT.glob(pattern)} | _from_wheel()
    # given a bare name, the loader searches LD_LIBRARY_PATH and the environment's own folder, as Dr.Jit does
    return [*sorted(paths, key=_version_in_name, reverse=True), "libLLVM.so"]


def _from_wheel() -> set[str]:
    """The libraries of the extra [llvm], wherever pip has put them: in the environment's own folder, or the user's."""
    from importlib import metadata

    try:
        files = metadata.files(_LLVM_WHEEL) or []
    except metadata.PackageNotFoundError:
        return set()
    return {str(Path(file.locate()).resolve()) for file in files if file.name.startswith("libLLVM.so")}


def _version_in_name(path: str) -> tuple[int, ...]:
    """The version in the name of a library: (19, 1) for libLLVM.so.19.1 or libLLVM-19.1.so."""
    return tuple(int(number) for number in re.findall(r"\d+", Path(path).name))


def _llvm_version(path: str) -> int:
    """Major version of an LLVM library; 0 for versions before 16, which have no function for it. Raises OSError where it does not
    load."""
    library = ctypes.CDLL(path)
    if not hasattr(library, "LLVMGetVersion"):  # this function is new in LLVM 16
        return 0
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    library.LLVMGetVersion(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    return major.value


def _named(version: int) -> str:
    return f"LLVM {version}" if version else "older than LLVM 16"


@contextlib.contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Lets this process compute with `count` threads of Dr.Jit, BLAS and OpenMP, and with as many as before afterwards; results
    stay the same. It applies to the whole process, so two threads must not use it at the same time."""
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
    """Context in which BLAS uses a single thread, in all Python threads of this process, until the last one has left it.

    The bits of a matrix product may depend on the number of threads that share it, and idle BLAS threads take cores from the
    kernels.
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
    """Makes threadpoolctl work in any thread: for OpenBLAS it lets only the thread that used it first set a limit, and silently
    does nothing in others."""
    from threadpoolctl import OpenBLASController

    OpenBLASController.clear_controlling_thread(force=True)


one_blas_thread = _OneBlasThread()
"""For `with`, or as a decorator of functions that promise the same bits."""


def thread_count() -> int:
    """Number of threads that this process computes with: that of the cores, or that of `limited_threads`."""
    import drjit as dr

    return int(dr.thread_count())


def in_threads(work: Callable[[int], None], items: Sequence[int]) -> None:
    """Calls `work` for all items, in as many threads as this process computes with."""
    threads = min(thread_count(), len(items))
    if threads <= 1:  # threads of a pool would get their memory from the system anew, which is a fifth slower
        for item in items:
            work(item)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, items))


def prefetched(items: Iterable[Item]) -> Iterator[Item]:
    """Yields the same items in the same order, while another thread computes the next one."""
    source, end = iter(items), object()
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, source, end)
        while (item := coming.result()) is not end:
            coming = pool.submit(next, source, end)
            yield item  # type: ignore[misc]


@one_thread_at_a_time
def normal_numbers(count: int, *, key: int, scale: float = 1.0) -> np.ndarray:
    """Normally distributed numbers with standard deviation `scale`, float32 (count,), from Philox4x32 (Salmon et al. 2011) with a
    64-bit key. The first numbers do not depend on `count`. NumPy's generators take ten times as long."""
    import drjit as dr
    import numpy as np

    backend = select("cpu")  # on the CPU even if there is a GPU, for the same bits
    arrays = backend.arrays
    lane = dr.arange(backend.UInt32, -(-count // 4))
    normals = arrays.Philox4x32(dr.opaque(arrays.UInt64, key), lane).next_float32x4_normal()
    numbers: Any = dr.ravel(normals * dr.opaque(backend.Float32, scale))
    return np.asarray(numbers.numpy()[:count])
