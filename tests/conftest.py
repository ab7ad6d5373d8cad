"""What all processes of a run of tests begin with: threads, the order of the files, hypothesis, the fixtures that files share."""

from __future__ import annotations

import gc
import os

# Before NumPy is loaded: two processes share two cores, and waiting threads of BLAS and OpenMP take a core from the other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Workers keep this process's kernels, so that samples made here and there are the same bits: pytest's plugins have loaded NumPy.
os.environ.setdefault("T2D_RT_KERNELS", "own")

import pytest
from hypothesis import settings

# Tests are collected without looking for garbage among them (`pytest_collection_finish`).
gc.disable()


def pytest_configure(config: pytest.Config) -> None:
    """Fixtures load the package, which takes seconds: not in the process that hands tests out and runs none."""
    if config.getoption("dist", "no") == "no":
        config.pluginmanager.import_plugin("shared_fixtures")


# The same examples in every run, so that what fails is what was changed; `pytest --hypothesis-profile=default` draws new ones.
settings.register_profile("same", derandomize=True, database=None)
settings.load_profile("same")

LONGEST = (
    "test_examples", "test_moving_radar", "test_sweep", "test_parts", "test_background", "test_tolerance", "test_outfits",
    "test_carry", "test_library", "test_path_table", "test_pipeline", "test_view", "test_dataset", "test_cli", "test_view_parts",
    "test_studies", "test_dataset_parts", "test_counts", "test_edge_waves", "test_dataset_subjects", "test_switched_paths",
    "test_synthesize", "test_several_radars", "test_made", "test_breathing", "test_abnormal_gait", "test_rate", "test_angle",
    "test_check_motion",
)  # fmt: skip
"""Files that take longest, which start first so that no process waits for another at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts them first."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


def pytest_collection_finish() -> None:
    """What is there by now stays, and is not looked through again and again."""
    gc.collect()
    gc.freeze()
    gc.enable()
