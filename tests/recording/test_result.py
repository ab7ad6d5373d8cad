"""`Recording`: labelled axes, attributes, the way to disk and back, and what is refused."""

from __future__ import annotations

import errno
import hashlib
import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import t2d_rt as t2d
from builders import point_cube
from t2d_rt.core import cube_storage as rows
from t2d_rt.core import cubes
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import versions
from t2d_rt.recording import files as saved
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

RADAR = Radar.preset("ci4r")


def mover(radar: Radar, speed_mps: float, range_m: float = 5.0, chirps: int = 600) -> np.ndarray:
    """ADC cube of a 1 m^2 point by the radar equation, approaching at `speed_mps`."""
    return point_cube(radar, range_m - speed_mps * radar.chirp_starts_s(chirps)).astype(np.complex64)


@pytest.fixture
def result() -> Recording:
    settings = {"method": "mesh", "seed": 3}
    return Recording(mover(RADAR, 1.0), RADAR, settings=settings, versions=versions(), processing={"mti": "mean"})


def test_axes_are_labelled(result: Recording) -> None:
    adc, profile, image, doppler = result.adc, result.range_profile, result.spectrogram, result.range_doppler
    assert adc.dtype == np.complex64
    assert adc.sizes == {"chirp": 600, "antenna": 1, "sample": 256}
    assert np.allclose(np.diff(adc.chirp_time_s), 1 / RADAR.prf_hz)
    assert np.allclose(np.diff(adc.sample_time_s), 1 / RADAR.sample_rate_hz)
    assert profile.dims == ("chirp", "antenna", "range_m")
    assert float(np.abs(profile[0, 0]).idxmax()) == pytest.approx(5.0, abs=RADAR.range_resolution_m)
    assert image.dims == ("velocity_mps", "time_s")
    assert np.allclose(image.idxmax("velocity_mps"), 1.0, atol=RADAR.speed_resolution_mps(256 / RADAR.prf_hz))
    peak = doppler.argmax(("velocity_mps", "range_m"))
    assert float(doppler.velocity_mps[peak["velocity_mps"]]) == pytest.approx(1.0, abs=0.02)
    assert float(doppler.range_m[peak["range_m"]]) == pytest.approx(4.9, abs=RADAR.range_resolution_m)
    assert [array.attrs["units"] for array in (adc, profile, image)] == ["sqrt(W)", "sqrt(W)", "dB re 1 W"]
    assert [image[axis].attrs["units"] for axis in image.dims] == ["m/s", "s"]


def test_attributes_hold_the_configuration(result: Recording) -> None:
    for array in (result.adc, result.range_profile, result.spectrogram, result.range_doppler):
        assert Radar(**json.loads(array.attrs["radar"])) == RADAR
        assert json.loads(array.attrs["settings"]) == {"method": "mesh", "seed": 3}
        assert json.loads(array.attrs["processing"]) == {"mti": "mean"}
        assert json.loads(array.attrs["versions"]).keys() >= {"python", "numpy", "drjit", "mitsuba", "sionna-rt"}


def test_processed_changes_the_picture_only(result: Recording) -> None:
    other = result.processed(n_window=128, overlap=64)
    assert other.cube is result.cube
    assert other.processing == {"mti": "mean", "n_window": 128, "overlap": 64}
    assert other.spectrogram.sizes["velocity_mps"] == 128


def test_round_trip_is_bit_identical(result: Recording, tmp_path: Path) -> None:
    result.save(tmp_path / "a.zarr")
    back = Recording.load(tmp_path / "a.zarr")
    assert back.cube.dtype == np.complex64
    assert back.cube.tobytes() == result.cube.tobytes()
    assert back.radar == result.radar
    assert (back.settings, back.versions, back.processing) == (result.settings, result.versions, result.processing)
    assert back.spectrogram.identical(result.spectrogram)
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


def test_plain_xarray_opens_it(result: Recording, tmp_path: Path) -> None:
    result.save(tmp_path / "a.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(tmp_path / "a.zarr") as data:
            checksum = data.adc.attrs.pop("sha256")
            assert data.adc.identical(result.adc.assign_attrs({}).drop_attrs(deep=False).assign_attrs(units="sqrt(W)"))
            assert checksum == hashlib.sha256(result.cube.tobytes()).hexdigest()
            assert np.array_equal(data.spectrogram, result.spectrogram)
            assert json.loads(data.attrs["settings"])["seed"] == 3


def test_plots(result: Recording, tmp_path: Path) -> None:
    figure = result.plot(title="a mover")
    axes, bar = figure.axes
    assert axes.get_title() == "a mover"
    assert axes.get_xlabel() == "Time [s]"
    assert "m/s" in axes.get_ylabel()
    assert "dB" in bar.get_ylabel()
    # Only where something moves: the mover with a margin, and zero.
    low, high = axes.get_ylim()
    assert -1.0 < low < 0
    assert 1.0 < high < 2.5
    figure.savefig(tmp_path / "a.png")


# --- what is refused ------------------------------------------------------------------------------------------------


def test_refuses_what_is_no_cube(result: Recording) -> None:
    with pytest.raises(InputError, match=r"must have shape \(chirp, antenna, 256\), got \(4, 256\)"):
        Recording(result.cube[:4, 0], RADAR)
    with pytest.raises(InputError, match=r"got \(600, 1, 128\)"):
        Recording(result.cube[:, :, :128], RADAR)
    with pytest.raises(InputError, match="unknown spectrogram option 'windw'; choose from range_window"):
        result.processed(windw="hann")


def test_existing_result(result: Recording, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    result.save(path)
    with pytest.raises(InputError, match="exists already; choose another name or pass --overwrite"):
        result.save(path)
    Recording(result.cube[:300], RADAR).save(path, overwrite=True)
    assert len(Recording.load(path).cube) == 300
    (tmp_path / "link.zarr").symlink_to(path)
    result.save(tmp_path / "link.zarr", overwrite=True)
    assert len(Recording.load(path).cube) == 600
    assert (tmp_path / "link.zarr").is_symlink()


def test_a_folder_of_something_else_is_never_replaced(result: Recording, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "me.jpg").touch()
    with pytest.raises(InputError, match="is a folder but not a result, so it is not replaced"):
        result.save(tmp_path / "photos", overwrite=True)
    assert (tmp_path / "photos" / "me.jpg").exists()


def test_a_large_cube_stays_on_disk(result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cubes, "LARGE_BYTES", 1000)
    monkeypatch.setattr(rows, "BLOCK_BYTES", 100 * 256 * 8)
    on_disk = cubes.new_cube(result.cube.shape)
    assert isinstance(on_disk, cubes.DiskCube)
    for start in range(0, 600, 37):
        on_disk[start : start + 37] = result.cube[start : start + 37]
    large = Recording(on_disk, RADAR, settings=result.settings, versions=versions(), processing={"mti": "mean"})
    large.save(tmp_path / "a.zarr")
    loaded = Recording.load(tmp_path / "a.zarr")
    assert isinstance(loaded.cube, cubes.DiskCube)
    for one in (large, loaded):
        assert "values with dtype=complex64" in repr(one.adc.variable)  # not read yet
        xr.testing.assert_equal(one.adc, result.adc)
        xr.testing.assert_allclose(one.spectrogram, result.spectrogram)
    plain = tmp_path / "b.zarr"
    result.save(plain)
    with xr.open_zarr(plain) as small, xr.open_zarr(tmp_path / "a.zarr") as big:
        xr.testing.assert_equal(small.adc, big.adc)
        assert small.adc.attrs == big.adc.attrs


@pytest.mark.parametrize("stage", ["write", "move away", "move there"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_a_failed_overwrite_keeps_the_old(
    result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, error: BaseException
) -> None:
    path = tmp_path / "a.zarr"
    result.save(path)
    rename, failed = Path.rename, []

    def failing_write(_: xr.Dataset, folder: Path, **__: Any) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "zarr.json").write_text("{")
        raise error

    def failing_rename(source: Path, target: Path) -> Path:
        if (source if stage == "move away" else target).parent == tmp_path and not failed:
            failed.append(source)
            raise error
        return rename(source, target)

    with monkeypatch.context() as patch:
        if stage == "write":
            patch.setattr(xr.Dataset, "to_zarr", failing_write)
        else:
            patch.setattr(Path, "rename", failing_rename)
        expected = InputError if isinstance(error, OSError) else KeyboardInterrupt
        with pytest.raises(
            expected, match="No space left on device; free space" if isinstance(error, OSError) else None
        ):
            Recording(result.cube[:300], RADAR).save(path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]
    assert len(Recording.load(path).cube) == 600


def test_places(result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="gone does not exist; create it first"):
        result.save(tmp_path / "gone" / "a.zarr")
    (tmp_path / "file.zarr").touch()
    with pytest.raises(InputError, match="is a file and a result is a folder"):
        result.save(tmp_path / "file.zarr", overwrite=True)

    def no_file(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", no_file)  # permissions do not bind root
    with pytest.raises(InputError, match="is not writable"):
        result.save(tmp_path / "a.zarr")


def spoil(path: Path, how: str) -> None:
    top = path / "zarr.json"
    if how == "not a result":
        shutil.rmtree(path)
        path.mkdir()
    elif how == "lost samples":
        next(p for p in (path / "adc" / "c").rglob("*") if p.is_file()).unlink()
    elif how == "cut samples":
        piece = next(p for p in (path / "adc" / "c").rglob("*") if p.is_file())
        piece.write_bytes(piece.read_bytes()[:100])
    elif how == "lost cube":
        shutil.rmtree(path / "adc")
    elif how == "cut metadata":
        top.write_text(top.read_text()[:300])
    elif how == "newer":
        top.write_text(top.read_text().replace('"format": "4"', '"format": "5"'))
    elif how == "other radar":
        top.write_text(top.read_text().replace('\\"prf_hz\\":3200.0', '\\"prf_hz\\":3201.0'))
    elif how == "wrong radar":
        top.write_text(top.read_text().replace('\\"prf_hz\\":3200.0', '\\"prf_hz\\":-1.0'))
        seal(path)
    elif how == "no radar":
        top.write_text(top.read_text().replace('"radar"', '"rader"'))
        seal(path)
    elif how == "other samples":
        np.save(path / "adc" / "c" / "note.npy", np.zeros(3))  # read by nobody
        other = path.with_name("other.zarr")
        Recording(2 * mover(RADAR, 1.0), RADAR).save(other)
        shutil.copytree(other / "adc" / "c", path / "adc" / "c", dirs_exist_ok=True)
    elif how == "lost spectrogram":
        shutil.rmtree(path / "spectrogram" / "c")


def seal(path: Path) -> None:
    """The checksum of what the folder holds now, as someone who means ill could write it."""
    metadata = json.loads((path / "zarr.json").read_text())
    metadata["attributes"]["checksum"] = saved._checksum(path, metadata)
    (path / "zarr.json").write_text(json.dumps(metadata))


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("not a result", "does not hold a t2d-rt result"),
        ("lost samples", r"ADC samples in .* are damaged or gone \(chunk 0: No such file"),
        ("cut samples", r"ADC samples in .* are damaged or gone \(chunk 0 has 100 bytes, expected"),
        ("other samples", "ADC samples in .* are damaged"),
        ("lost cube", "is damaged: it is not as it was written"),
        ("lost spectrogram", "is damaged: it is not as it was written"),
        ("cut metadata", "does not hold a t2d-rt result"),
        ("newer", "has format 5, expected 4"),
        ("other radar", "is damaged: it is not as it was written"),
        ("wrong radar", "prf_hz: got -1.0"),
        ("no radar", r"does not hold a t2d-rt result \(no 'radar'\)"),
    ],
)
def test_broken_results_are_refused(result: Recording, tmp_path: Path, how: str, sentence: str) -> None:
    path = tmp_path / "a.zarr"
    result.save(path)
    spoil(path, how)
    with pytest.raises(InputError, match=sentence):
        Recording.load(path)


def test_what_is_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a result folder"):
        Recording.load(tmp_path / "gone.zarr")


def test_recordings_are_loaded_alike_simulated_or_measured(tmp_path: Path) -> None:
    radar = t2d.Radar.preset("ci4r", samples=16)
    rng = np.random.default_rng(0)
    cube = (rng.normal(size=(300, 16)) + 1j * rng.normal(size=(300, 16))).astype(np.complex64)
    np.save(tmp_path / "frames.npy", cube)
    radar.to_yaml(tmp_path / "radar.yaml")
    measured = t2d.load_recording(tmp_path / "frames.npy", tmp_path / "radar.yaml")
    assert np.array_equal(measured.cube, cube[:, None])
    assert measured.radar == radar
    assert measured.experiment is None
    measured.save(tmp_path / "frames.zarr")
    back = t2d.load_recording(str(tmp_path / "frames.zarr"))
    assert np.array_equal(back.cube, measured.cube)
    assert np.array_equal(back.spectrogram, measured.spectrogram)
    for each in (measured, back):
        with pytest.raises(
            InputError, match=r"^the recording was measured and has no experiment, so it cannot be simulated again; "
        ):
            each.again()


@pytest.mark.parametrize(
    ("name", "radar", "sentence"),
    [
        (
            "frames.npy",
            None,
            r"frames.npy holds samples only; give its radar, a Radar, a preset's name, a .yaml or a .cfg file",
        ),
        ("frames.npy", "ci4r", r"must have shape \(chirp, antenna, \d+\), got \(4, 1, 8\)"),
        ("frames.npy", 3, "radar must be a Radar, got 3"),
        ("frames.zarr", None, "frames.zarr is not a result folder"),
        (
            "frames.zarr",
            "ci4r",
            "frames.zarr is a result, which holds its own radar, and a radar was given; leave radar out",
        ),
        ("none.npy", "ci4r", "cannot read recording .*none.npy"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, name: str, radar: object, sentence: str) -> None:
    np.save(tmp_path / "frames.npy", np.full((4, 8), 1 + 1j, np.complex64))
    with pytest.raises(InputError, match=sentence):
        t2d.load_recording(tmp_path / name, radar)  # type: ignore[arg-type]
