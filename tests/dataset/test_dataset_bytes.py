"""The bytes of a data set, and the falls in it, are the same whatever kernels NumPy and OpenBLAS take by themselves."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.kernels import common_kernels, has_common_kernels, kernels
from t2d_rt.dataset import Recipe, make_dataset, making
from t2d_rt.dataset.shards import MadeSample, content_hash, read_manifest, recipe_of
from t2d_rt.types import Accuracy

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
ALL_BITS = RECIPE.replace("[falling]", "[falling, bending]").replace("spectrogram: {size: [16, 16]}", "adc: {}")
"""A fall and another motion, and the ADC samples, in which a last bit shows."""
STATES = {
    "as it is": {},
    "other kernels of OpenBLAS": {"OPENBLAS_CORETYPE": "Sandybridge"},
    "other instructions of NumPy": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR X86_V3"},
}
"""Variables of a process; what is not known on a machine is ignored."""
MOTION = """
import numpy as np
from t2d_rt.dataset import Recipe
from t2d_rt.dataset.sample import sample

recipe = Recipe.read("falls.yaml")
np.savez("motions.npz", *[sample(recipe, index).cut.motion.joints for index in (7, 8)])
"""


def made_by(folder: Path, recipe: str, *command: str, **variables: str) -> Path:
    """The folder in which a process of these variables, and of kernels that it chooses, has worked on a recipe."""
    folder.mkdir()
    (folder / "falls.yaml").write_text(recipe)
    env = {name: value for name, value in os.environ.items() if name != "T2D_RT_KERNELS"} | variables
    found = subprocess.run([sys.executable, *command], env=env, cwd=folder, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    return folder


@pytest.mark.slow
def test_a_data_set_is_the_same_bytes_with_any_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("T2D_RT_KERNELS")
    command = "-m", "t2d_rt", "dataset", "falls.yaml", "-o", "out", "--workers", "1", "--limit", "2"
    states = STATES | {"its own": {"T2D_RT_KERNELS": "own", "OPENBLAS_CORETYPE": "Sandybridge"}}
    folders = [made_by(tmp_path / name, ALL_BITS, *command, **each) / "out" for name, each in states.items()]
    first, *others, own = [content_hash(each, recipe_of(each), 2) for each in folders]
    assert (first[1], others) == (2, [first, first])
    (made_on,) = read_manifest(folders[0])["made_on"]
    if common_kernels():
        assert made_on.endswith("OpenBLAS Haswell, NumPy AVX2")
        assert own[0] != first[0]


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="frozen on x86-64")
def test_the_benchmark_is_the_one_that_is_frozen(tmp_path: Path) -> None:
    (quick, due), *_ = Recipe.read("benchmark-3").frozen
    command = "-m", "t2d_rt", "dataset", "benchmark-3", "-o", "out", "--limit", str(quick)
    folder = made_by(tmp_path / "benchmark", ALL_BITS, *command) / "out"
    assert content_hash(folder, recipe_of(folder), quick) == (due, quick)


@pytest.mark.slow
def test_falls_are_the_same_falls_with_other_kernels(tmp_path: Path) -> None:
    """Their physics would multiply the last bit of what they begin with into millimetres and more."""
    states = {"Haswell": "X86_V4 AVX512_ICL AVX512_SPR", "Sandybridge": "X86_V4 AVX512_ICL AVX512_SPR X86_V3"}
    variables = [{"OPENBLAS_CORETYPE": core, "NPY_DISABLE_CPU_FEATURES": off} for core, off in states.items()]
    folders = [made_by(tmp_path / str(k), RECIPE, "-c", MOTION, **each) for k, each in enumerate(variables)]
    first, second = (np.load(folder / "motions.npz") for folder in folders)
    assert len(first.files) == 2
    for name in first.files:
        np.testing.assert_allclose(first[name], second[name], rtol=0, atol=1e-8)


def test_a_machine_may_keep_its_own_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("T2D_RT_KERNELS", "own")
    assert common_kernels() == {}
    assert kernels()[-1].startswith("NumPy ")
    monkeypatch.setenv("T2D_RT_KERNELS", "fastest")
    with pytest.raises(InputError, match=r"T2D_RT_KERNELS must be 'own' or 'common', got 'fastest'"):
        common_kernels()


AVX512 = {"AVX2", "FMA3", "X86_V3", "X86_V4"}
BUILT = ["X86_V3", "X86_V4", "AVX512_SPR"]
"""Sets of instructions for which NumPy 2.4 has kernels; before, it had them one by one."""


@pytest.fixture
def told_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("T2D_RT_KERNELS")
    monkeypatch.setattr("t2d_rt.core.kernels._features", lambda: (AVX512, BUILT))


@pytest.mark.usefixtures("told_nothing")
def test_common_kernels_are_those_of_avx2(monkeypatch: pytest.MonkeyPatch) -> None:
    assert common_kernels() == {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_SPR"}
    monkeypatch.setattr("t2d_rt.core.kernels._features", lambda: ({"NEON", "SVE"}, ["SVE"]))
    assert common_kernels() == {}


@pytest.mark.parametrize(
    ("used", "built", "level"),
    [
        (AVX512, BUILT, "X86_V4"),
        (AVX512 - {"X86_V4"}, BUILT, "AVX2"),
        (AVX512 - {"X86_V4", "X86_V3"}, BUILT, platform.machine()),  # the processor has AVX2, and NumPy does not use it
        ({"AVX2", "FMA3"}, ["FMA3", "AVX2", "AVX512F"], "AVX2"),
        ({"AVX2"}, ["FMA3", "AVX2", "AVX512F"], platform.machine()),
        ({"NEON", "SVE"}, ["SVE"], platform.machine()),
    ],
)
def test_the_level_of_numpy_is_that_of_its_kernels(
    monkeypatch: pytest.MonkeyPatch, used: set[str], built: list[str], level: str
) -> None:
    monkeypatch.setattr("t2d_rt.core.kernels._features", lambda: (used, built))
    monkeypatch.setattr("threadpoolctl.threadpool_info", lambda: [
        {"user_api": "blas", "internal_api": "openblas", "architecture": "Haswell"}, {"user_api": "openmp"},
    ])  # fmt: skip
    found = kernels.__wrapped__()
    assert found == ("OpenBLAS Haswell", f"NumPy {level}")
    monkeypatch.setattr("t2d_rt.core.kernels.kernels", lambda: found)
    assert has_common_kernels() == (level == "AVX2")


@pytest.mark.usefixtures("told_nothing")
def test_one_worker_of_other_kernels_is_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "has_common_kernels", lambda: False)
    assert making.scheduler_named(None, 1)[0] is not making.here
    monkeypatch.setenv("T2D_RT_KERNELS", "own")
    assert making.scheduler_named(None, 1)[0] is making.here
    monkeypatch.setenv("T2D_RT_KERNELS", "common")
    monkeypatch.setattr(making, "has_common_kernels", lambda: True)
    assert making.scheduler_named(None, 1)[0] is making.here
    monkeypatch.setenv("T2D_RT_KERNELS", "fastest")
    with pytest.raises(InputError, match=r"T2D_RT_KERNELS must be 'own' or 'common', got 'fastest'"):
        making.scheduler_named(None, 2)


@pytest.mark.usefixtures("told_nothing")
def test_a_worker_of_other_kernels_is_told_once_in_each_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = Recipe(**yaml.safe_load(RECIPE))
    making._prepare(tmp_path / "out", recipe)
    foreign = [MadeSample({"index": index, "failure": None}, machine="abacus", common=False) for index in range(2)]
    for _ in range(2):  # the second run finds the machine in the manifest
        with pytest.warns(T2DWarning, match=r"a worker computes with abacus: .*OPENBLAS_CORETYPE='Haswell'") as told:
            making._Run(recipe, tmp_path / "out", 12, None).add(foreign)
        assert len(told) == 1
    assert read_manifest(tmp_path / "out")["made_on"] == ["abacus"]
    monkeypatch.setenv("T2D_RT_KERNELS", "own")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        making._Run(recipe, tmp_path / "out", 12, None).add(foreign)
    (tmp_path / "out" / "manifest.json").write_text('{"made_on": "abacus"}')
    with pytest.raises(InputError, match=r"made_on must be a list of texts"):
        read_manifest(tmp_path / "out")


def test_workers_of_a_local_cluster_have_common_kernels_whatever_the_user_set(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra [cluster])")
    monkeypatch.delenv("T2D_RT_KERNELS")
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Sandybridge")
    before = dict(os.environ)
    with making.local_cluster(1) as cluster, distributed.Client(cluster) as client:
        assert dict(os.environ) == before
        (found,) = client.run(has_common_kernels).values()
    assert found == bool(common_kernels())


def test_plans_are_made_where_samples_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def elsewhere(work: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        for task in tasks:
            asked.append(work.__name__)
            yield work(*task)

    monkeypatch.setattr(making, "scheduler_named", lambda *_: (elsewhere, 1))
    monkeypatch.setattr("t2d_rt.dataset.worker.plan_of", lambda *_: Accuracy(sagitta_scale=2.0))
    monkeypatch.setattr("t2d_rt.dataset.worker.make_sample", lambda *_: MadeSample({"index": 0, "failure": None}))
    conditions = [{"name": "only", "method": "mesh", "tolerance_db": -15}]
    make_dataset(Recipe(**yaml.safe_load(RECIPE) | {"conditions": conditions}), tmp_path / "out", limit=1)
    assert asked == ["make_plan", "make_samples"]
    assert '"sagitta_scale": 2.0' in (tmp_path / "out" / "plans.json").read_text()
