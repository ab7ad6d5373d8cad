"""The bytes of a data set, and the falls in it, are the same whatever kernels NumPy and OpenBLAS take by themselves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.core.kernels import common_kernels, has_common_kernels, kernels
from t2d_rt.dataset.shards import content_hash, recipe_of

RECIPE = """
name: falls
classes: [falling]
descriptions_per_class: 12
samples_per_description: 1
duration_s: 2.0
radar: table2
conditions: [{name: only, method: ellipsoid}]
products: {spectrogram: {size: [16, 16]}}
"""
STATES = {
    "as it is": {},
    "other kernels of OpenBLAS": {"OPENBLAS_CORETYPE": "Sandybridge"},
    "other instructions of NumPy": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
}
"""Variables of a process; what is not known on a machine is ignored."""
MOTION = """
import numpy as np
from t2d_rt.dataset import Recipe
from t2d_rt.dataset.sample import sample

recipe = Recipe.read("falls.yaml")
np.savez("motions.npz", *[sample(recipe, index).cut.motion.joints for index in (7, 8)])
"""


def told(folder: Path, *command: str, **variables: str) -> Path:
    """The folder in which a process of these variables, and of kernels that it chooses, has worked on `RECIPE`."""
    folder.mkdir()
    (folder / "falls.yaml").write_text(RECIPE)
    env = {name: value for name, value in os.environ.items() if name != "T2D_RT_KERNELS"} | variables
    found = subprocess.run([sys.executable, *command], env=env, cwd=folder, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    return folder


@pytest.mark.slow
def test_a_data_set_is_the_same_bytes_whatever_kernels_a_process_has(tmp_path: Path) -> None:
    command = "-m", "t2d_rt", "dataset", "falls.yaml", "-o", "out", "--workers", "1", "--limit", "2"
    folders = [told(tmp_path / name, *command, **variables) / "out" for name, variables in STATES.items()]
    first, *others = [content_hash(each, recipe_of(each), 2) for each in folders]
    assert (first[1], others) == (2, [first, first])
    (made_on,) = json.loads((folders[0] / "manifest.json").read_text())["made_on"]
    assert not common_kernels() or made_on.endswith("OpenBLAS Haswell, NumPy AVX2")


@pytest.mark.slow
def test_falls_are_the_same_falls_with_other_kernels(tmp_path: Path) -> None:
    """Their physics would multiply the last bit of what they begin with into centimetres."""
    states = {"Haswell": "X86_V4 AVX512_ICL AVX512_SPR", "Sandybridge": "X86_V4 AVX512_ICL AVX512_SPR X86_V3"}
    first, second = (
        np.load(
            told(tmp_path / core, "-c", MOTION, OPENBLAS_CORETYPE=core, NPY_DISABLE_CPU_FEATURES=off) / "motions.npz"
        )
        for core, off in states.items()
    )
    assert len(first.files) == 2
    for name in first.files:
        np.testing.assert_allclose(first[name], second[name], rtol=0, atol=1e-8)


def test_a_machine_may_keep_its_own_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("T2D_RT_KERNELS", "own")
    assert (common_kernels(), has_common_kernels()) == ({}, True)
    assert kernels()[-1].startswith("NumPy ")
    monkeypatch.setenv("T2D_RT_KERNELS", "fastest")
    with pytest.raises(InputError, match=r"T2D_RT_KERNELS must be 'own' or 'common', got 'fastest'"):
        common_kernels()
