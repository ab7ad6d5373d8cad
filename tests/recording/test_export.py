"""Results as files of other programs, read back with what those programs' users have: scipy, xarray, NumPy, h5py."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after, walk
from t2d_rt.cli import main
from t2d_rt.core import cube_storage as rows
from t2d_rt.core.cubes import DiskCube, new_cube
from t2d_rt.core.errors import InputError
from t2d_rt.recording import files
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

RADAR = Radar.preset("ci4r", samples=16, sample_rate_hz=1e6, rx_offsets_m=[[0, 0, 0], [0, 0.002, 0]])
AXES = {"chirp_time_s": "s", "sample_time_s": "s", "velocity_mps": "m/s", "time_s": "s"}


@pytest.fixture(scope="module")
def result() -> Recording:
    rng = np.random.default_rng(1)
    shape = 400, 2, RADAR.samples
    cube = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    return Recording(cube, RADAR, settings={"scene": "free_space", "seed": 3}, processing={"n_window": 64})


def check(result: Recording, arrays: dict[str, Any], units: dict[str, str], attributes: dict[str, str]) -> None:
    """The arrays, bit for bit, with their units and what they were made with."""
    assert arrays["adc"].dtype == np.complex64
    np.testing.assert_array_equal(arrays["adc"], result.cube)
    np.testing.assert_array_equal(arrays["spectrogram"], result.spectrogram.values)
    for name in AXES:
        source = result.adc if name in result.adc.coords else result.spectrogram
        np.testing.assert_array_equal(np.ravel(arrays[name]), source[name].values, err_msg=name)
    assert units == {"adc": "sqrt(W)", "spectrogram": "dB re 1 W", **AXES}
    assert Radar(**json.loads(attributes["radar"])) == RADAR
    assert json.loads(attributes["settings"]) == {"scene": "free_space", "seed": 3}
    assert json.loads(attributes["processing"]) == {"n_window": 64}
    assert attributes["made_by"] == "t2d-rt"


def test_mat(result: Recording, tmp_path: Path) -> None:
    from scipy.io import loadmat

    result.export(tmp_path / "walk.mat")
    found = loadmat(tmp_path / "walk.mat", simplify_cells=True)
    assert loadmat(tmp_path / "walk.mat")["velocity_mps"].shape == (64, 1)  # a column, as MATLAB plots it
    check(result, found, found["units"], found["attributes"])


def test_npz(result: Recording, tmp_path: Path) -> None:
    result.export(tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as file:
        found = dict(file)
    check(result, found, json.loads(str(found["units"])), json.loads(str(found["attributes"])))


def test_netcdf(result: Recording, tmp_path: Path) -> None:
    import xarray as xr

    result.export(tmp_path / "walk.nc")
    with xr.open_dataset(tmp_path / "walk.nc", engine="scipy") as file:
        data = file.load()
    assert data.adc_real.dims == ("chirp", "antenna", "sample")
    assert data.spectrogram.dims == ("velocity_mps", "time_s")
    assert set(data.adc_real.coords) == {"chirp_time_s", "sample_time_s"}
    arrays = {str(name): array.values for name, array in data.variables.items()}
    arrays["adc"] = arrays["adc_real"] + 1j * arrays["adc_imag"]
    units = {str(name): array.attrs["units"] for name, array in data.variables.items()}
    assert units.pop("adc_imag") == units["adc_real"]
    units["adc"] = units.pop("adc_real")
    check(result, arrays, units, data.attrs)


@pytest.mark.parametrize("ending", [".h5", ".hdf5"])
def test_hdf5(result: Recording, tmp_path: Path, ending: str) -> None:
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    result.export(tmp_path / f"walk{ending}")
    with h5py.File(tmp_path / f"walk{ending}") as file:
        arrays = {name: file[name][()] for name in file}
        units = {name: file[name].attrs["units"] for name in file}
        assert [axis.label for axis in file["adc"].dims] == ["chirp", "antenna", "sample"]
        assert file["adc"].dims[0][0] == file["chirp_time_s"]
        assert file["spectrogram"].dims[1]["time_s"] == file["time_s"]
        check(result, arrays, units, dict(file.attrs))


def test_hdf5_without_h5py(result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match=r"needs the package h5py, which is not installed; .* export to \.mat"):
        result.export(tmp_path / "walk.h5")
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("ending", [".mat", ".nc", ".npz"])
def test_a_cube_on_disk(result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    """Its file is that of the cube in memory."""
    monkeypatch.setattr(rows, "BLOCK_BYTES", 100 * rows.row_bytes(result.cube.shape))
    cube = new_cube(result.cube.shape, limit_bytes=1)
    assert isinstance(cube, DiskCube)
    cube[0:400] = result.cube
    monkeypatch.setattr("time.time", lambda: 1e9)  # archives hold the time
    held = Recording(cube, RADAR, settings=result.settings, versions=result.versions, processing=result.processing)
    result.export(tmp_path / f"memory{ending}")
    held.export(tmp_path / f"disk{ending}")
    header = 128 if ending == ".mat" else 0  # a .mat file begins with the date
    assert (tmp_path / f"memory{ending}").read_bytes()[header:] == (tmp_path / f"disk{ending}").read_bytes()[header:]


@pytest.mark.parametrize("ending", [".mat", ".nc", ".npz"])
def test_what_is_there_stays_unless_overwrite(result: Recording, tmp_path: Path, ending: str) -> None:
    place = tmp_path / f"walk{ending}"
    place.write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already; choose another name or pass --overwrite"):
        result.export(place)
    assert place.read_bytes() == b"mine"
    result.export(place, overwrite=True)
    assert place.stat().st_size > 8 * result.cube.size
    assert [*tmp_path.iterdir()] == [place]


@pytest.mark.parametrize("ending", [".mat", ".nc", ".npz"])
def test_a_failure_changes_nothing(
    result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    place = tmp_path / f"walk{ending}"
    place.write_bytes(b"mine")
    write = files.WRITERS[ending]

    def full(new: Path, *arguments: Any) -> None:
        write(new, *arguments)
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(files.WRITERS, ending, full)
    with pytest.raises(InputError, match=r"cannot write .*No space left on device; free space"):
        result.export(place, overwrite=True)
    assert place.read_bytes() == b"mine"
    assert [*tmp_path.iterdir()] == [place]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("walk.csv", r"ends in \.mat, \.h5, \.hdf5, \.nc, \.npz, got 'walk.csv'"),
        ("walk", r"ends in \.mat"),
        ("nowhere/walk.mat", "nowhere does not exist; create it first"),
        ("folder.mat", "is a folder; choose another name"),
    ],
)
def test_places_that_cannot_be_used(result: Recording, tmp_path: Path, name: str, sentence: str) -> None:
    (tmp_path / "folder.mat").mkdir()
    with pytest.raises(InputError, match=sentence):
        result.export(tmp_path / name)


@pytest.mark.parametrize(("name", "gigabytes"), [("walk.mat", 2.2), ("walk.nc", 8.7)])
def test_cubes_beyond_the_format(tmp_path: Path, name: str, gigabytes: float) -> None:
    chirps = round(gigabytes * 1e9 / 8 / 2 / RADAR.samples)
    cube = np.broadcast_to(np.complex64(0), (chirps, 2, RADAR.samples))  # takes no memory
    large = Recording(cube, RADAR)
    with pytest.raises(InputError, match=rf"ADC cube of {gigabytes} GB is more than .* export it to \.h5 or \.npz"):
        large.export(tmp_path / name)


def test_command_line(
    result: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    result.save("walk.zarr")
    assert main(["export", "walk.zarr"]) == 0
    assert main(["export", "walk.zarr", "-o", "other.npz"]) == 0
    assert capsys.readouterr().out == "wrote walk.mat\nwrote other.npz\n"
    assert Path("walk.mat").read_bytes().startswith(b"MATLAB 5.0 MAT-file")
    with np.load("other.npz") as file:
        np.testing.assert_array_equal(file["adc"], result.cube)
    assert main(["export", "walk.zarr"]) == 2
    assert main(["export", "walk.zarr", "--overwrite"]) == 0
    assert main(["export", "missing.zarr"]) == 2


@pytest.mark.parametrize("ending", slow_after(1, [".npz", ".mat", ".h5", ".nc"]))
def test_truth_of_a_recording(seen: Recording, tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    """By the command line, as other programs read it: numbers, flags and names."""
    if ending == ".h5":
        pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    seen.save(tmp_path / "walk.zarr")
    target = tmp_path / f"walk{ending}"
    assert main(["export", str(tmp_path / "walk.zarr"), "--truth", "-o", str(target)]) == 0
    truth = seen.truth
    if ending == ".npz":
        with np.load(target, allow_pickle=False) as file:
            found = dict(file)
        names, units = found["truth_joint"].tolist(), json.loads(str(found["units"]))
    elif ending == ".mat":
        from scipy.io import loadmat

        found = loadmat(target, simplify_cells=True)
        found["truth_joints_m"] = found["truth_joints_m"].reshape(truth.joints_m.shape)
        found["truth_contact"] = found["truth_contact"].reshape(truth.contact.shape)
        names, units = [each.strip() for each in found["truth_joint"]], found["units"]
    elif ending == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(target) as file:
            found = {name: file[name][()] for name in ("truth_joints_m", "truth_contact")}
            names, units = [each.decode() for each in file["truth_joint"]], {n: file[n].attrs["units"] for n in found}
            assert [each.label for each in file["truth_joints_m"].dims][2:] == ["truth_joint", "truth_xyz"]
    else:
        import xarray as xr

        with xr.open_dataset(target, engine="scipy") as data:
            found = {name: data[name].values for name in ("truth_joints_m", "truth_contact")}
            names, units = [str(each) for each in data.truth_joint.values], {n: data[n].attrs["units"] for n in found}
    np.testing.assert_array_equal(found["truth_joints_m"], truth.joints_m.values)
    np.testing.assert_array_equal(found["truth_contact"], truth.contact.values)
    assert names == truth.joint.values.tolist()
    assert units["truth_joints_m"] == "m"
    assert len(units["truth_contact"]) == 0


@pytest.fixture(scope="module")
def seen() -> Recording:
    """A simulated one."""
    return t2d.simulate(t2d.place(t2d.trim(walk(), 0, 0.1)), radar=RADAR, method="ellipsoid")


def test_a_measured_recording_has_no_truth_to_export(result: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the recording was measured: it has no experiment"):
        result.export(tmp_path / "walk.npz", truth=True)
    assert not (tmp_path / "walk.npz").exists()
