"""Cubes on disk live as long as what can read them, and what is lost is an error, never zeros."""

from __future__ import annotations

import copy
import errno
import gc
import hashlib
import multiprocessing
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from builders import slow_after
from t2d_rt.core import cube_storage as rows
from t2d_rt.core import cubes
from t2d_rt.core.cube_storage import SavedRows, ScratchRows
from t2d_rt.core.cubes import CubeWriter, DiskCube, new_cube
from t2d_rt.core.errors import InputError
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

RADAR = Radar.preset("ci4r")
CHIRPS = 300
SAMPLES = np.random.default_rng(0).normal(size=(CHIRPS, 1, 256, 2)).astype(np.float32).view(np.complex64)[..., 0]


@pytest.fixture(autouse=True)
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cubes, "LARGE_BYTES", 1000)
    monkeypatch.setattr(rows, "BLOCK_BYTES", 40 * 256 * 8)


def simulated(scale: float = 1.0) -> Recording:
    """As `simulate` gives it."""
    cube = new_cube(SAMPLES.shape)
    assert isinstance(cube, DiskCube)
    with CubeWriter(cube) as writer:
        for start in range(0, CHIRPS, 7):
            part = SAMPLES[start : start + 7]
            writer.room(len(part))[:] = scale * part
    return Recording(cube, RADAR)


def loaded(path: Path, scale: float = 1.0) -> Recording:
    simulated(scale).save(path)
    return Recording.load(path)


# --- how long they live ---------------------------------------------------------------------------------------------


def test_an_array_outlives_its_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    result = simulated()
    whole, part = result.adc, result.adc[5:, 0]
    result = simulated(2.0)  # the name is used again
    gc.collect()
    assert np.array_equal(whole, SAMPLES)
    assert np.array_equal(part, SAMPLES[5:, 0])
    assert np.array_equal(result.adc, 2 * SAMPLES)
    assert [*tmp_path.iterdir()] == []  # nothing that a process which is killed could leave
    files = open_files(tmp_path)
    del whole, part
    gc.collect()
    assert open_files(tmp_path) == files - 1


def open_files(folder: Path) -> int:
    """Files of that folder which this process holds open, deleted ones too."""
    return sum(
        f"{file.readlink()}".startswith(f"{folder}/") for file in Path("/proc/self/fd").iterdir() if file.is_symlink()
    )


def test_every_place_is_read_as_from_memory(tmp_path: Path) -> None:
    for result in (simulated(), loaded(tmp_path / "a.zarr")):
        cube = result.cube
        for place in (
            3, -1, slice(5, 290, 3), slice(290, 3, -2), [41, 1, 1, 299], np.arange(CHIRPS) % 3 == 0, (slice(None), 0), (3, 0, 2),
            (Ellipsis, 2), (slice(2, 90), slice(None), slice(1, 40, 5)), ([3, 70], 0), slice(9, 9), (slice(9, 2), 0), Ellipsis,
        ):  # fmt: skip
            np.testing.assert_array_equal(cube[place], SAMPLES[place])
        with pytest.raises(IndexError):
            cube[CHIRPS]
        with pytest.raises(IndexError, match="read it into memory first"):
            cube[:, :, [1, 2]]
        with pytest.raises(ValueError, match="must be read to be an array"):
            np.asarray(cube, copy=False)
        at = {"chirp": xr.DataArray([250, 9], dims="p"), "sample": xr.DataArray([0, 2], dims="p")}
        assert np.array_equal(result.adc.isel(at), SAMPLES[[250, 9], :, [0, 2]])
        assert np.array_equal(result.adc.isel(sample=[7, 3], chirp=slice(None, None, 50)), SAMPLES[::50][..., [7, 3]])


def test_what_is_assigned_to_an_array_stays_in_it(tmp_path: Path) -> None:
    for result in (simulated(), loaded(tmp_path / "a.zarr")):
        adc = result.adc
        adc[0] = 5
        assert (adc[0] == 5).all()
        assert np.array_equal(result.adc, SAMPLES)


def test_copies_and_pickles_are_the_same_recording(tmp_path: Path) -> None:
    for result in (simulated(), loaded(tmp_path / "a.zarr")):
        adc = result.adc
        copies = [copy.copy(adc), copy.deepcopy(adc), adc.copy(deep=True), pickle.loads(pickle.dumps(adc))]
        copies += [pickle.loads(pickle.dumps(result)).adc, copy.deepcopy(result).adc]
        del result, adc
        gc.collect()
        for one in copies:
            assert np.array_equal(one, SAMPLES)


@pytest.mark.slow
def test_a_pool_reads_what_it_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    simulated().save("a.zarr")
    given = [simulated(), Recording.load("a.zarr"), simulated().adc, Recording.load("a.zarr").adc]
    with multiprocessing.get_context("spawn").Pool(1, initializer=os.chdir, initargs=("/",)) as pool:
        assert pool.map(digest, given) == [hashlib.sha256(SAMPLES.tobytes()).hexdigest()] * 4
        simulated(2.0).save("a.zarr", overwrite=True)
        with pytest.raises(InputError, match="holds another recording by now"):
            pool.map(digest, [given[1]])
        made = pool.apply(scaled, (3.0,))
    assert np.array_equal(made.adc, 3 * SAMPLES)


def digest(given: Recording | xr.DataArray) -> str:
    adc = given.adc if isinstance(given, Recording) else given
    return hashlib.sha256(adc.values.tobytes()).hexdigest()


def scaled(scale: float) -> Recording:
    cubes.LARGE_BYTES = 1000  # in the other process
    return simulated(scale)


# --- results on disk ------------------------------------------------------------------------------------------------


def test_a_result_is_found_from_any_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    simulated().save("a.zarr")
    result = Recording.load("a.zarr")
    monkeypatch.chdir("/")
    assert np.array_equal(result.adc, SAMPLES)
    result.save(tmp_path / "b.zarr")
    assert np.array_equal(Recording.load(tmp_path / "b.zarr").adc, SAMPLES)


@pytest.mark.parametrize("when", slow_after(1, ["before it is read", "between two reads"]))
@pytest.mark.parametrize("how", ["removed", "moved", "lost chunk", "cut chunk", "flipped bit", "other recording"])
def test_what_is_lost_is_an_error(tmp_path: Path, how: str, when: str) -> None:
    path = tmp_path / "a.zarr"
    result = loaded(path)
    adc = result.adc
    if when == "between two reads":
        assert np.array_equal(adc[:9], SAMPLES[:9])
    else:
        adc = pickle.loads(pickle.dumps(adc))
    chunk = path / "adc" / "c" / "3" / "0" / "0"
    if how == "removed":
        shutil.rmtree(path)
    elif how == "moved":
        path.rename(tmp_path / "b.zarr")
    elif how == "lost chunk":
        chunk.unlink()
    elif how == "cut chunk":
        chunk.write_bytes(chunk.read_bytes()[:-1])
    elif how == "flipped bit":
        content = bytearray(chunk.read_bytes())
        content[1000] ^= 1
        chunk.write_bytes(content)
    else:
        simulated(2.0).save(path, overwrite=True)
    with pytest.raises(InputError, match=r"damaged or gone|holds another recording"):
        _ = adc[100:200].values
    with pytest.raises(InputError, match=r"damaged or gone|holds another recording"):
        result.save(tmp_path / "c.zarr")
    assert not (tmp_path / "c.zarr").exists()
    if how == "moved":
        (tmp_path / "b.zarr").rename(path)
        assert np.array_equal(adc, SAMPLES)


def test_a_result_may_replace_itself(tmp_path: Path) -> None:
    result = loaded(tmp_path / "a.zarr")
    adc = result.adc
    result.processed(mti="mean").save(tmp_path / "a.zarr", overwrite=True)
    assert np.array_equal(adc, SAMPLES)  # the same samples at the same place
    assert Recording.load(tmp_path / "a.zarr").processing == {"mti": "mean"}


def test_a_lost_chunk_is_not_zeros_for_plain_xarray(tmp_path: Path) -> None:
    loaded(tmp_path / "a.zarr")
    (tmp_path / "a.zarr" / "adc" / "c" / "0" / "0" / "0").unlink()
    with xr.open_zarr(tmp_path / "a.zarr") as data:
        assert np.isnan(data.adc[0]).all()


def test_silence_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    Recording(np.zeros((256, 1, 256), np.complex64), RADAR).save(path)
    assert not np.asarray(Recording.load(path).cube).any()
    (path / "adc" / "c" / "0" / "0" / "0").unlink()  # is there although it holds nothing but zeros
    with pytest.raises(InputError, match="damaged or gone"):
        Recording.load(path)


@pytest.mark.slow
def test_no_byte_changes_unseen(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    result = loaded(path)
    draw, refused, tried = np.random.default_rng(1), 0, 0
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        content = file.read_bytes()
        for place in {0, len(content) - 1, *draw.integers(len(content), size=12).tolist()}:
            changed = bytearray(content)
            changed[place] ^= 1 << int(draw.integers(8))
            file.write_bytes(changed)
            tried += 1
            try:
                back = Recording.load(path)
            except InputError:
                refused += 1
            else:
                assert np.array_equal(back.cube, SAMPLES)
                assert back.attributes == result.attributes
        file.write_bytes(content)
    assert np.array_equal(Recording.load(path).cube, SAMPLES)
    assert refused > 0.9 * tried  # blanks in zarr.json may change


# --- while they are made --------------------------------------------------------------------------------------------


def test_rows_that_were_not_written_are_no_zeros() -> None:
    scratch = ScratchRows((10, 1, 4))
    scratch.write(0, np.ones((3, 1, 4), np.complex64))
    assert scratch.read(0, 3).sum() == 12
    with pytest.raises(InputError, match=r"chirps 2..5 of the ADC samples were asked for, and only 3 of 10"):
        scratch.read(2, 5)
    for start, count in ((4, 1), (3, 8)):
        with pytest.raises(InputError, match="do not fit 3 of"):
            scratch.write(start, np.ones((count, 1, 4), np.complex64))
    os.ftruncate(scratch._file._file, 40)
    with pytest.raises(InputError, match="ends early"):
        scratch.read(0, 3)


def test_a_full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    result, write = simulated(), os.pwrite

    def half(file: int, data: memoryview, offset: int) -> int:
        if offset > 40 * 256 * 8:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[: len(data) // 2 + 1], offset)

    content = pickle.dumps(result)
    monkeypatch.setattr(os, "pwrite", half)
    with pytest.raises(
        InputError, match=r"cannot write the ADC samples .*\(No space left on device\); free space, or set TMPDIR"
    ):
        simulated()
    back = pickle.loads(content)  # an error here would leave a pool waiting for ever
    with pytest.raises(InputError, match="No space left on device"):
        _ = back.adc.values


def test_a_cube_that_is_there_at_the_end_of_a_program_is_no_warning() -> None:
    program = "from t2d_rt.core.cube_storage import ScratchFile; file = ScratchFile()"
    done = subprocess.run([sys.executable, "-W", "always", "-c", program], capture_output=True, text=True, check=True)
    assert "ResourceWarning" not in done.stderr


def test_no_place_for_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_place(**_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", no_place)
    with pytest.raises(InputError, match=r"cannot write the ADC samples .*\(Permission denied\)"):
        simulated()


def test_another_layout_is_refused(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    for options in ({"chunks": (CHIRPS, 1, 100)}, {"chunks": (CHIRPS, 1, 256), "compressors": "auto"}):
        zarr.create_array(tmp_path, name="adc", shape=SAMPLES.shape, dtype="complex64", overwrite=True, **options)
        with pytest.raises(InputError, match="in another layout"):
            SavedRows.of(tmp_path)
    zarr.create_array(tmp_path, name="adc", shape=(3,), dtype="complex64", overwrite=True)
    with pytest.raises(InputError, match="expected a complex64 cube"):
        SavedRows.of(tmp_path)
