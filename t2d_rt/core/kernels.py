"""Kernels of NumPy and OpenBLAS: which ones this process has, and how to start processes with those that all machines have.

Both libraries choose by the processor when they are loaded, and each choice rounds differently. Processes that must give the same
bits on another machine get the kernels of AVX2 and FMA, which most processors for x86-64 have had since 2015.
`T2D_RT_KERNELS=own` leaves each machine its own.
"""

from __future__ import annotations

import functools
import os
import platform
from pathlib import Path

from t2d_rt.core.checks import choice

VARIABLE = "T2D_RT_KERNELS"
COMMON = {"OpenBLAS Haswell", "NumPy AVX2"}
"""The kernels of AVX2 and FMA, as `kernels` names them."""
NEWER = "AVX512", "X86_V4"
"""How NumPy's names of instructions beyond these begin."""


def _features() -> tuple[set[str], list[str]]:
    """Instructions that this process may use, and the sets of them for which NumPy has kernels, the newest last."""
    from numpy._core import _multiarray_umath as numpy_core  # type: ignore[attr-defined]

    return {name for name, available in numpy_core.__cpu_features__.items() if available}, numpy_core.__cpu_dispatch__


def common_kernels() -> dict[str, str]:
    """Environment in which a process takes the kernels that all machines have; empty where this one has no AVX2, as on ARM, and it
    takes its own, or where the user wants that. Raises InputError where T2D_RT_KERNELS is neither own nor common."""
    chosen = choice(VARIABLE, os.environ.get(VARIABLE) or "common", ("own", "common"))
    used, built = _features()
    if chosen == "own" or not {"AVX2", "FMA3"} <= used:
        return {}
    newer = " ".join(name for name in built if name.startswith(NEWER))
    return {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": newer}


@functools.cache
def kernels() -> tuple[str, ...]:
    """What this process computes with, as ("OpenBLAS Haswell", "NumPy AVX2")."""
    import scipy.linalg  # noqa: F401  # a BLAS of its own
    from threadpoolctl import threadpool_info

    blas = {
        f"{library['internal_api']} {library.get('architecture', '')}"
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }
    return (*sorted(library.strip().replace("openblas", "OpenBLAS") for library in blas), f"NumPy {_numpy_level()}")


def _numpy_level() -> str:
    """The newest instructions of NumPy's kernels; the machine's kind where they are older than AVX2."""
    used, built = _features()
    newer = [name for name in built if name.startswith(NEWER)]
    older = "AVX2" if {"AVX2", *built} - {*newer} <= used else platform.machine()
    return next((name for name in reversed(newer) if name in used), older)


def has_common_kernels() -> bool:
    """Whether this process computes with the kernels that all machines have, whatever it was told to do."""
    return set(kernels()) == COMMON


def processor() -> str:
    """Name of the processor, or the machine's kind where the system does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()


@functools.cache
def machine() -> str:
    """The processor and the kernels of this process in one line."""
    return ", ".join((processor(), *kernels()))
