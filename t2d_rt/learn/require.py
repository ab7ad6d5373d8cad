"""The extra that learning needs."""

from __future__ import annotations

from importlib.util import find_spec

from t2d_rt.core.errors import InputError, install

NEEDED = "torch", "lightning", "torchmetrics", "monai", "sklearn", "safetensors"


def require_learning() -> None:
    """Raises a sentence that names the extra, where something that learning needs is not installed."""
    lacking = [name for name in NEEDED if find_spec(name) is None]
    if lacking:
        raise InputError(f"learning needs {', '.join(lacking)}, not installed; {install('learn')}")
