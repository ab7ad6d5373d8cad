"""Kernels of NumPy and OpenBLAS: which ones this process computes with, and how to start processes that have those of any machine.

Both libraries choose by the processor when they are loaded, and each choice rounds differently. Processes that must give the same
bits on another machine get the kernels of AVX2 and FMA, which processors for x86-64 have had since 2013 (Haswell).
`T2D_RT_KERNELS=own` leaves each machine its own.
"""

from __future__ import annotations

import functools
import os
import platform
from pathlib import Path

from t2d_rt.core.checks import choice

VARIABLE = "T2D_RT_KERNELS"
CORE = "Haswell"
"""OpenBLAS's name for processors with AVX2 and FMA."""
NEWER = "AVX512", "X86_V4"
"""How NumPy's names of instructions beyond these begin."""
DISABLED = "NPY_DISABLE_CPU_FEATURES"


def _features() -> tuple[frozenset[str], list[str]]:
    """Instructions that NumPy uses if it has kernels of them, and of those that it has kernels of the ones beyond AVX2."""
    from numpy._core import _multiarray_umath as numpy_core  # type: ignore[attr-defined]

    used = frozenset(name for name, there in numpy_core.__cpu_features__.items() if there)
    return used, [name for name in numpy_core.__cpu_dispatch__ if name.startswith(NEWER)]


def common_kernels() -> dict[str, str]:
    """Environment in which a process takes the kernels of any machine; empty where this one has no AVX2, as on ARM, and it takes
    its own, or where the user wants that. Raises InputError where T2D_RT_KERNELS is neither own nor common."""
    wanted = choice(VARIABLE, os.environ.get(VARIABLE) or "common", ("own", "common"))
    used, newer = _features()
    if wanted == "own" or not {"AVX2", "FMA3"} <= used:
        return {}
    off = os.environ.get(DISABLED, "").replace(",", " ").split()  # in this process, so that `used` lacks them
    names = [name for name in newer if name in used or name in off]  # NumPy warns of those that the processor lacks
    return {"OPENBLAS_CORETYPE": CORE} | ({DISABLED: " ".join(names)} if names else {})


@functools.cache
def kernels() -> tuple[str, ...]:
    """What this process computes with, as ("OpenBLAS Haswell", "NumPy AVX2")."""
    import scipy.linalg  # noqa: F401  # a BLAS of its own
    from threadpoolctl import threadpool_info

    used, newer = _features()
    blas = {
        f"{each['internal_api']} {each.get('architecture', '')}"
        for each in threadpool_info()
        if each["user_api"] == "blas"
    }
    best = next((name for name in (*reversed(newer), "AVX2") if name in used), platform.machine())
    return (*sorted(each.strip().replace("openblas", "OpenBLAS") for each in blas), f"NumPy {best}")


def has_common_kernels() -> bool:
    """Whether this process computes with the kernels that `common_kernels` asks for."""
    used, newer = _features()
    blas = [each for each in kernels() if each.startswith("OpenBLAS")]
    return not common_kernels() or (used.isdisjoint(newer) and all(each == f"OpenBLAS {CORE}" for each in blas))


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
