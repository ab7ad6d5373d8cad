"""PyTorch: whether it is installed with everything that learning needs; its threads and random state, which are global to the
process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from t2d_rt.core.errors import InputError, install

NEEDED = "torch", "monai", "sklearn", "safetensors"


def require_learning() -> None:
    """Raises an error that names the extra to install, if a package that learning needs is missing."""
    lacking = [name for name in NEEDED if find_spec(name) is None]
    if lacking:
        raise InputError(f"learning needs {', '.join(lacking)}, not installed; {install('learn')}")


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Runs PyTorch with `count` threads; afterwards their number, its random state and its choice of algorithms are restored."""
    import torch

    threads, random_state = torch.get_num_threads(), torch.random.get_rng_state()
    deterministic = torch.are_deterministic_algorithms_enabled()
    warn_only = torch.is_deterministic_algorithms_warn_only_enabled()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.random.set_rng_state(random_state)
        torch.use_deterministic_algorithms(deterministic, warn_only=warn_only)
