"""The LLVM check: one sentence instead of an abort, and the right library chosen."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from t2d_rt.core import backend
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import BackendError, InputError

RUN = """
import sys
from t2d_rt.core.backend import select
from t2d_rt.core.errors import BackendError
try:
    select("cpu")
except BackendError as error:
    print(error)
    sys.exit(2)
"""


def _select_in_a_process(library: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "DRJIT_LIBLLVM_PATH": library}
    return subprocess.run([sys.executable, "-c", RUN], env=env, capture_output=True, text=True, timeout=60, check=False)


def _fake_llvm(folder: Path, version: int | None) -> Path:
    """A shared library that claims an LLVM version; None leaves the version function out, as LLVM 15 does."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler to build a stand-in library with")
    body = f"void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) {{ *a = {version}; *b = 0; *c = 0; }}"
    source, library = folder / "fake.c", folder / f"libLLVM-{version or 15}.so"
    source.write_text(body if version is not None else "int nothing;")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    return library


def _one_sentence(run: subprocess.CompletedProcess[str]) -> str:
    assert run.returncode == 2, run.stderr
    lines = run.stdout.splitlines()
    assert len(lines) == 1
    assert "apt-get install libllvm19" in lines[0]
    return lines[0]


def test_missing_library_is_one_sentence(tmp_path: Path) -> None:
    missing = tmp_path / "libLLVM-99.so"
    assert f"DRJIT_LIBLLVM_PATH is {missing}, which cannot be loaded" in _one_sentence(
        _select_in_a_process(str(missing))
    )


@pytest.mark.parametrize(("version", "said"), [(None, "older than LLVM 16"), (16, "LLVM 16")])
def test_old_library_is_one_sentence(tmp_path: Path, version: int | None, said: str) -> None:
    library = _fake_llvm(tmp_path, version)
    assert f"is {library}, which is too old ({said})" in _one_sentence(_select_in_a_process(str(library)))


def test_a_library_that_is_no_llvm_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "libLLVM-19.so"
    text.write_text("not a library")
    assert "cannot be loaded" in _one_sentence(_select_in_a_process(str(text)))


def test_newest_good_library_is_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for version in (16, 17, 9):
        _fake_llvm(tmp_path, version)
    newest = _fake_llvm(tmp_path, 20)
    monkeypatch.setattr(backend, "_ROOT", tmp_path)
    monkeypatch.setattr(backend, "_LIBRARY_GLOBS", ("libLLVM*.so*",))
    assert backend._newest_installed() == str(newest.resolve())


def test_the_wheels_library_is_found_wherever_pip_put_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library, site = _fake_llvm(tmp_path, 23).rename(tmp_path / "libLLVM.so.23.1"), tmp_path / "python" / "site-packages"
    told = site / "karellen_llvm_core-23.1.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text("Metadata-Version: 2.4\nName: karellen-llvm-core\nVersion: 23.1\n")
    (told / "RECORD").write_text("../../libLLVM.so.23.1,,\n../../libLTO.so.23.1,,\n")
    monkeypatch.setattr(backend, "_ROOT", tmp_path / "nothing")
    monkeypatch.syspath_prepend(str(site))
    assert backend._newest_installed() == str(library.resolve())


def test_only_old_libraries_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = _fake_llvm(tmp_path, 16)
    monkeypatch.setattr(backend, "_installed", lambda: [str(old)])
    with pytest.raises(BackendError, match=r"LLVM is too old: found .*libLLVM-16.so \(LLVM 16\); install LLVM"):
        backend._newest_installed()


def test_no_library_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "_installed", list)
    with pytest.raises(BackendError, match="LLVM was not found; install LLVM"):
        backend._newest_installed()


def test_kernel_runs_on_the_cpu() -> None:
    import drjit as dr

    chosen = backend.select("cpu")
    assert (chosen.name, chosen.mitsuba_variant) == ("llvm", "llvm_ad_mono_polarized")
    x = np.linspace(-3, 3, 1001)
    # sin and maximum make the kernel that LLVM 15 and 16 cannot compile on AVX-512
    y = dr.maximum(dr.sin(chosen.Float64(x)), 0.2)
    np.testing.assert_allclose(y.numpy(), np.maximum(np.sin(x), 0.2), rtol=1e-14)  # float64 round-off
    assert dr.detail.llvm_version()[0] >= backend.OLDEST_LLVM


def test_gpu_without_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "_has_cuda", lambda: False)
    with pytest.raises(BackendError, match="no CUDA device was found; use device cpu"):
        backend.select("gpu")
    assert backend.select("auto").name == "llvm"


def test_unknown_device() -> None:
    with pytest.raises(InputError, match="device must be auto, cpu or gpu, got 'tpu'"):
        backend.select("tpu")


def test_numbers_for_lanes_lie_alike_in_memory() -> None:
    import drjit as dr

    here = backend.select("cpu")
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    try:
        dr.kernel_history_clear()
        for skipped in range(5):  # NumPy's own arrays come at any multiple of 16 bytes
            values = np.arange(3.0 + skipped, 103 + skipped)
            np.testing.assert_array_equal((here.lanes(values, here.Float32) + 1).numpy(), values + 1)
            whole = np.arange(skipped, 100 + skipped)
            np.testing.assert_array_equal((here.lanes(whole) + 1).numpy(), whole + 1)
        kernels = {entry["hash"] for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT}
    finally:
        dr.set_flag(dr.JitFlag.KernelHistory, False)
    assert len(kernels) == 2


def test_a_machines_speed_is_measured_once_a_minute_on_each_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, measured = [1000.0], []

    def yardstick_s(on: Backend) -> float:
        measured.append(on.name)
        return float(len(measured))

    monkeypatch.setattr(backend, "yardstick_s", yardstick_s)
    monkeypatch.setattr(backend, "_yardsticks", {})
    monkeypatch.setattr(backend, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    here = backend.select("cpu")
    other = replace(here, name="cuda")
    found = []
    for each, later_s in ((here, 0.0), (here, 59.0), (other, 0.0), (here, 0.0), (here, 2.0), (other, 0.0)):
        clock[0] += later_s
        found.append(backend.recent_yardstick_s(each))
    assert found == [1.0, 1.0, 2.0, 1.0, 3.0, 2.0]
    assert measured == ["llvm", "cuda", "llvm"]


@pytest.mark.parametrize("fails", [False, True])
def test_threads_are_as_many_as_before(fails: bool) -> None:
    """Of Dr.Jit and of BLAS, also after an error."""
    import drjit as dr
    from threadpoolctl import threadpool_info

    def threads() -> list[int]:
        return [dr.thread_count(), *(each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas")]

    before = threads()
    count = before[0] + 1
    with contextlib.suppress(KeyError), backend.limited_threads(count):
        assert set(threads()) == {count}
        if fails:
            raise KeyError
    assert threads() == before


def test_one_blas_thread_holds_until_the_last_thread_has_left() -> None:
    """Two threads of Python whose stays overlap: what one restores would else be the number that the other computes with."""
    from threadpoolctl import threadpool_info, threadpool_limits

    def threads() -> set[int]:
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        seen: dict[str, set[int]] = {}
        entered, left = threading.Event(), threading.Event()

        def second() -> None:
            with backend.one_blas_thread:
                entered.set()
                left.wait()
                seen["alone"] = threads()

        other = threading.Thread(target=second)
        with backend.one_blas_thread:
            other.start()
            entered.wait()
        left.set()
        other.join()
        assert seen["alone"] == {1}
        assert threads() == before
        third = threading.Thread(target=second)  # threadpoolctl alone would not let it: the main thread was first
        third.start()
        third.join()
        assert seen["alone"] == {1}
        assert threads() == before
