"""The kernels of NumPy and OpenBLAS: which ones this process uses, and how to start processes that use those common to all
machines.

Both libraries choose their kernels by processor when they are loaded, and different kernels round differently. Processes that must
give the same bits on other machines use the kernels for AVX2 and FMA, which most x86-64 processors since 2015 have.
`T2D_RT_KERNELS=own` leaves the choice to each machine.
"""

from __future__ import annotations

import functools
import os
import platform
from pathlib import Path

from t2d_rt.core.checks import choice

VARIABLE = "T2D_RT_KERNELS"
COMMON = {"OpenBLAS Haswell", "NumPy AVX2"}
"""The kernels for AVX2 and FMA, in the form that `kernels` returns."""
NEWER = "AVX512", "X86_V4"
"""Beginnings of NumPy's names for newer instructions than these."""


def _features() -> tuple[set[str], list[str]]:
    """Instructions that this process may use, and the sets of instructions for which NumPy has kernels, the newest last."""
    from numpy._core import _multiarray_umath as numpy_core  # type: ignore[attr-defined]

    return {name for name, available in numpy_core.__cpu_features__.items() if available}, numpy_core.__cpu_dispatch__


def common_kernels() -> dict[str, str]:
    """Environment variables with which a process uses the common kernels. Empty where this machine has no AVX2, such as on ARM, or
    where the user wants the machine's own. Raises InputError where T2D_RT_KERNELS is neither own nor common."""
    chosen = choice(VARIABLE, os.environ.get(VARIABLE) or "common", ("own", "common"))
    used, built = _features()
    if chosen == "own" or not {"AVX2", "FMA3"} <= used:
        return {}
    newer = " ".join(name for name in built if name.startswith(NEWER))
    return {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": newer}


@functools.cache
def kernels() -> tuple[str, ...]:
    """Names of the kernels that this process uses, such as ("OpenBLAS Haswell", "NumPy AVX2")."""
    import scipy.linalg  # noqa: F401  # a BLAS of its own
    from threadpoolctl import threadpool_info

    blas = {
        f"{library['internal_api']} {library.get('architecture', '')}"
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }
    return (*sorted(library.strip().replace("openblas", "OpenBLAS") for library in blas), f"NumPy {_numpy_level()}")


def _numpy_level() -> str:
    """The newest instructions that NumPy's kernels use; the machine's architecture where they are older than AVX2."""
    used, built = _features()
    newer = [name for name in built if name.startswith(NEWER)]
    older = "AVX2" if {"AVX2", *built} - {*newer} <= used else platform.machine()
    return next((name for name in reversed(newer) if name in used), older)


def has_common_kernels() -> bool:
    """Whether this process uses the common kernels, whatever its environment says."""
    return set(kernels()) == COMMON


def processor() -> str:
    """Name of the processor, or the machine's architecture where the system does not provide it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()


@functools.cache
def machine() -> str:
    """The processor and the kernels of this process, in one line."""
    return ", ".join((processor(), *kernels()))
