"""Measured samples as radars and tools write them: read as what they are, or answered by a sentence, never taken for others."""

from __future__ import annotations

import itertools
import pickle
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from command_line import Command
from t2d_rt.core import cube_storage as rows
from t2d_rt.core import cubes
from t2d_rt.core.cubes import DiskCube
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.dataset.background_records import background_records
from t2d_rt.signal import load_cube
from t2d_rt.signal.measured import load_dca1000
from t2d_rt.types import Radar

RADAR = Radar.preset("table2", samples=128, rx_offsets_m=[(0, 0.002 * k, 0) for k in range(4)])
TDM = Radar.preset("array-3x4")
MIRROR = "in the upper half of the beat spectrum"


def scene(chirps: int = 96, *, noise: float = 20.0, constant: complex = 0, seed: int = 0) -> np.ndarray:
    """Whole codes (chirp, antenna, sample) of echoes that fall with range, of noise and a constant."""
    rng = np.random.default_rng(seed)
    sample, found = np.arange(RADAR.samples), np.zeros((chirps, 4, RADAR.samples), complex)
    for beat in rng.uniform(2, 40, 10):
        phase = rng.uniform(0, 2 * np.pi, (1, 4, 1)) + rng.uniform(-1, 1) * np.arange(chirps)[:, None, None]
        found += 20_000 / beat**2 * np.exp(1j * (2 * np.pi * beat * sample / RADAR.samples + phase))
    found += noise * (rng.normal(size=found.shape) + 1j * rng.normal(size=found.shape)) + constant
    return np.rint(found.real) + 1j * np.rint(found.imag)


def two_lanes(cube: np.ndarray) -> np.ndarray:
    return np.stack([cube.real.reshape(-1, 2), cube.imag.reshape(-1, 2)], axis=1)


def four_lanes(cube: np.ndarray) -> np.ndarray:
    return np.stack([cube.real.swapaxes(1, 2), cube.imag.swapaxes(1, 2)], axis=2)


WRITERS = {
    "complex samples over 2 lanes": two_lanes,
    "complex samples over 4 lanes": four_lanes,
    "real samples over 2 lanes": lambda cube: cube.real,
    "real samples over 4 lanes": lambda cube: cube.real.swapaxes(1, 2),
    "complex samples one by one, I Q I Q": lambda cube: np.stack([cube.real, cube.imag], axis=-1),
}


def written(path: Path, codes: np.ndarray) -> Path:
    path.write_bytes(codes.astype("<i2").tobytes())
    return path


# --- axes ---


@pytest.mark.parametrize("order", [each for each in itertools.permutations(range(3)) if each != (0, 1, 2)])
def test_other_axes_are_refused_with_those_that_fit(tmp_path: Path, order: tuple[int, int, int]) -> None:
    cube = np.full((32, 12, 256), 1 + 2j, np.complex64)
    np.save(tmp_path / "cube.npy", cube.transpose(order))
    names = ", ".join(("chirp", "antenna", "sample")[axis] for axis in order)
    back = tuple(int(axis) for axis in np.argsort(order))
    with pytest.raises(InputError) as refused:
        t2d.load_recording(tmp_path / "cube.npy", TDM)
    assert f"axes ({names})? give cube.transpose{back}" in str(refused.value)
    assert cube.transpose(order).transpose(back).shape == cube.shape


def test_other_antennas_are_refused() -> None:
    with pytest.raises(InputError, match=r"the radar has 12 antennas, not 7; give the radar that recorded it"):
        t2d.Recording(np.ones((32, 7, 256), np.complex64), TDM)
    with pytest.raises(
        InputError,
        match=r"the radar has 12 antennas, not 4; chirps of 3 transmitters in turn\? give cube.reshape\(-1, 12, 256\)",
    ):
        t2d.Recording(np.ones((96, 4, 256), np.complex64), TDM)


# --- I and Q ---


@pytest.mark.parametrize("ending", [".bin", ".npy", "pairs.npy"])
def test_q_before_i_and_conjugate_samples(tmp_path: Path, ending: str) -> None:
    cube, path = scene(), tmp_path / f"capture{ending}"

    def load(samples: np.ndarray, **options: object) -> np.ndarray:
        if ending == ".bin":
            written(path, two_lanes(samples))
            options["lanes"] = 2
        else:
            np.save(path, samples if ending == ".npy" else np.stack([samples.real, samples.imag], axis=-1))
        return np.asarray(t2d.load_recording(path, RADAR, **options).cube)  # type: ignore[arg-type]

    swapped = cube.imag + 1j * cube.real
    np.testing.assert_array_equal(load(cube), cube)
    np.testing.assert_array_equal(load(swapped, iq="QI"), cube)
    np.testing.assert_array_equal(load(cube.conj(), conjugate=True), cube)
    both = -cube.imag + 1j * cube.real  # Q before I of the conjugate: either alone would mirror it
    np.testing.assert_array_equal(load(both, iq="QI", conjugate=True), cube)
    for mirrored in (swapped, cube.conj()):
        with pytest.warns(T2DWarning, match=rf"{MIRROR}.* give iq='QI' or give conjugate=True"):
            load(mirrored)
        np.testing.assert_array_equal(load(mirrored, conjugate=False), mirrored)  # not told once it was said
    with pytest.warns(T2DWarning, match=rf"{MIRROR}.* leave out iq='QI'"):
        load(cube, iq="QI")
    with pytest.raises(InputError, match=r"iq must be .*, got 'qi'"):
        load(cube, iq="qi")


@pytest.mark.parametrize("constant", [0, 3000 - 2000j])
@pytest.mark.parametrize("noise", [0.0, 20.0, 5000.0])
def test_sound_samples_are_not_warned_of(tmp_path: Path, noise: float, constant: complex) -> None:
    for seed in range(4):
        np.save(tmp_path / "cube.npy", scene(noise=noise, constant=constant, seed=seed))
        t2d.load_recording(tmp_path / "cube.npy", RADAR)


def test_backgrounds_take_the_order_of_the_channels(tmp_path: Path) -> None:
    cube, folders = scene(600, noise=200.0), {}
    for name, samples in (("IQ", cube), ("QI", cube.imag + 1j * cube.real)):
        folders[name] = tmp_path / name
        folders[name].mkdir()
        written(folders[name] / "a.bin", two_lanes(samples))
        RADAR.to_yaml(folders[name] / "radar.yaml")
    one, two = (background_records(folders[iq], lanes=2, iq=iq)[0] for iq in ("IQ", "QI"))
    np.testing.assert_array_equal(one.relative_db, two.relative_db)
    with pytest.warns(T2DWarning, match=MIRROR):
        background_records(folders["QI"], lanes=2)


def test_a_result_takes_no_options_of_measured_samples(tmp_path: Path) -> None:
    t2d.Recording(scene().astype(np.complex64), RADAR).save(tmp_path / "one.zarr")
    for options in ({"iq": "QI"}, {"conjugate": True}, {"lanes": 2}):
        with pytest.raises(InputError, match="lanes, iq and conjugate are those of measured samples"):
            t2d.load_recording(tmp_path / "one.zarr", **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("ending", "lanes"), [(".npy", None), ("complex.npy", None), (".bin", 2), (".bin", 4)])
def test_real_samples_are_read_once_it_is_said(tmp_path: Path, ending: str, lanes: int | None) -> None:
    """A radar of one channel: half of the range axis stays empty, ranges and the sign of speeds are right."""
    cube, path = scene(noise=0), tmp_path / f"a{ending}"
    if lanes is None:
        np.save(path, cube.real + (0j if ending == "complex.npy" else 0))
    else:
        written(path, WRITERS[f"real samples over {lanes} lanes"](cube))
    found = np.asarray(t2d.load_recording(path, RADAR, lanes=lanes, iq="I").cube)
    np.testing.assert_allclose(found.real, cube.real, atol=0.01)
    spectrum = np.fft.fft(found)
    assert np.abs(spectrum[..., 65:]).max() < 1e-6 * np.abs(spectrum).max()
    window = np.hanning(128)
    # Not of the first bins, into which the images of the nearest echoes leak.
    expected, got = np.fft.fft(cube * window)[..., 6:50], np.fft.fft(found * window)[..., 6:50]
    assert np.abs(got - expected).max() < 0.02 * np.abs(expected).max()


# --- the order of a raw capture ---


@pytest.mark.parametrize("noise", [1.0, 300.0])
@pytest.mark.parametrize("lanes", [2, 4])
@pytest.mark.parametrize("name", WRITERS)
def test_captures_in_another_order_are_refused(tmp_path: Path, name: str, lanes: int, noise: float) -> None:
    cube = scene(noise=noise)
    path = written(tmp_path / "a.bin", WRITERS[name](cube))
    if name == f"complex samples over {lanes} lanes":
        np.testing.assert_array_equal(t2d.load_recording(path, RADAR, lanes=lanes).cube, cube)
    else:
        with pytest.raises(
            InputError, match=f"does not hold complex samples over {lanes} lanes: taken as {name} its chirps"
        ):
            t2d.load_recording(path, RADAR, lanes=lanes)


def test_an_odd_number_of_real_loops_is_no_whole_number_of_complex_ones(tmp_path: Path) -> None:
    path = written(tmp_path / "a.bin", scene(95).real)
    with pytest.raises(InputError, match=r"cut the file at the last whole loop, or iq='I' where samples are real"):
        t2d.load_recording(path, RADAR, lanes=2)


def test_noise_has_no_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(-500, 500, (96, 4, 128)) + 1j * rng.integers(-500, 500, (96, 4, 128))
    for lanes, writer in ((2, two_lanes), (4, four_lanes)):
        for order in (writer, WRITERS["complex samples one by one, I Q I Q"]):
            load_dca1000(written(tmp_path / "a.bin", order(noise)), RADAR, lanes=lanes)


@pytest.mark.parametrize(
    "changes",
    [
        {"samples": 64}, {"rx_offsets_m": RADAR.rx_offsets_m[:2]}, {"samples": 32}, {"samples": 96},
    ],
)  # fmt: skip
def test_chirps_cut_at_the_wrong_place_are_refused(tmp_path: Path, changes: dict[str, object]) -> None:
    path = written(tmp_path / "a.bin", two_lanes(scene()))
    assert len(t2d.load_recording(path, RADAR, lanes=2).cube) == 96
    with pytest.raises(InputError, match="repeats itself every"):
        t2d.load_recording(path, RADAR.replace(**changes), lanes=2)


def test_a_capture_that_ends_within_a_burst_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.bin", two_lanes(scene()))
    burst = RADAR.replace(chirps_per_frame=32, frame_interval_s=1.0)
    assert len(t2d.load_recording(path, burst, lanes=2).cube) == 96
    with pytest.raises(InputError, match="holds 96 loops of chirps, and a burst of this radar has 36"):
        t2d.load_recording(path, burst.replace(chirps_per_frame=36), lanes=2)


def test_transmitters_in_turn_are_told(tmp_path: Path) -> None:
    one, two = scene(48, seed=1), scene(48, seed=2)
    np.save(tmp_path / "a.npy", np.stack([one, two], axis=1).reshape(96, 4, 128))
    with pytest.warns(T2DWarning, match="as 2 transmitters in turn leave them"):
        t2d.load_recording(tmp_path / "a.npy", RADAR)


# --- codes ---


@pytest.mark.parametrize("bits", [12, 14, 16])
@pytest.mark.parametrize("ending", [".bin", ".npy"])
def test_offset_binary_is_read_and_told(tmp_path: Path, bits: int, ending: str) -> None:
    cube, middle = np.rint(scene() / 16), 2 ** (bits - 1)
    path = tmp_path / f"a{ending}"
    pairs = np.stack([cube.real, cube.imag], axis=-1) if ending == ".npy" else two_lanes(cube)
    codes = (pairs + middle).astype("<u2").reshape(len(cube), -1)
    codes[70:73] = cube[70:73] = 0  # lost packets
    options = {}
    if ending == ".npy":
        np.save(path, codes.reshape(pairs.shape))
    else:
        path.write_bytes(codes.tobytes())
        options["lanes"] = 2
    told = pytest.warns(T2DWarning, match=f"codes in offset binary, about {middle} ")
    with told, pytest.warns(T2DWarning, match="zeros alone in 12 of its 384 chirps of an antenna"):
        np.testing.assert_array_equal(t2d.load_recording(path, RADAR, **options).cube, cube)  # type: ignore[arg-type]


def test_lost_packets_saturation_and_a_missing_channel_are_told(tmp_path: Path) -> None:
    path, cube = tmp_path / "a.npy", scene()
    lost = cube.copy()
    lost[10:13] = 0
    np.save(path, lost)
    with pytest.warns(T2DWarning, match="zeros alone in 12 of its 384 chirps of an antenna") as told:
        t2d.load_recording(path, RADAR)
    assert told[0].filename == __file__  # the user's line
    clipped = np.clip(2 * cube.real, -(2**11), 2**11 - 1) + 1j * np.clip(2 * cube.imag, -(2**11), 2**11 - 1)
    np.save(path, clipped)
    with pytest.warns(T2DWarning, match=r"is saturated: \d+\.?\d* % of its samples"):
        t2d.load_recording(path, RADAR)
    np.save(path, cube.real.astype(complex))
    with pytest.warns(
        T2DWarning, match="holds one channel, I, and zeros for the other, .* record both, or give iq='I'"
    ):
        t2d.load_recording(path, RADAR)
    np.save(path, 1j * cube.imag)
    with pytest.warns(T2DWarning, match="one channel, Q, .* record both, or save its numbers alone and give iq='I'"):
        t2d.load_recording(path, RADAR)


@pytest.mark.parametrize("value", [0, np.nan, np.inf, 1e300])
def test_samples_that_say_nothing_are_refused(tmp_path: Path, value: float) -> None:
    cube = scene()
    if value == 0:
        cube[:] = 0
    cube[5, 1, 7] = value
    np.save(tmp_path / "a.npy", cube)
    with pytest.raises(InputError, match=r"holds NaN or infinite samples|holds nothing but zeros"):
        t2d.load_recording(tmp_path / "a.npy", RADAR)


# --- large files ---


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".bin", ".npy"])
def test_large_files_are_read_by_pieces(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cubes, "LARGE_BYTES", 2**16)
    monkeypatch.setattr(rows, "BLOCK_BYTES", 2**18)
    path, cube = tmp_path / f"a{ending}", np.tile(scene(), (40, 1, 1))  # 16 MB of samples
    options = {}
    if ending == ".npy":
        np.save(path, cube.astype(np.complex64))
    else:
        written(path, four_lanes(cube))
        options["lanes"] = 4
    t2d.load_recording(path, RADAR, **options)  # type: ignore[arg-type]  # what is imported at first use
    tracemalloc.start()
    found = t2d.load_recording(path, RADAR, **options)  # type: ignore[arg-type]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8e6
    assert isinstance(found.cube, DiskCube)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(found.cube))[100:700, 2], cube[100:700, 2])
    found.save(tmp_path / "a.zarr")
    np.testing.assert_array_equal(t2d.load_recording(tmp_path / "a.zarr").cube, cube)
    with path.open("ab") as file:
        file.write(b"0123")
    with pytest.raises(InputError, match="has changed since it was loaded; load it again"):
        found.cube[0]


def test_arrays_in_other_layouts(tmp_path: Path) -> None:
    cube, path = scene(), tmp_path / "a.npy"
    for each in (
        np.asfortranarray(cube),
        cube.astype(">c8"),
        cube.astype(np.complex128),
        np.stack([cube.real, cube.imag], -1),
    ):
        np.save(path, each)
        np.testing.assert_array_equal(load_cube(path), cube)


# --- the command ---


def test_process_draws_a_capture_and_sets_it_beside_a_result(run: Command) -> None:
    burst = RADAR.replace(chirps_per_frame=32, frame_interval_s=0.1)
    burst.to_ti_cfg("profile.cfg")
    written(Path("a.bin"), two_lanes(scene()))
    t2d.Recording(scene(seed=1).astype(np.complex64), burst).save("b.zarr")
    found = run("process", "a.bin", "b.zarr", "--radar", "profile.cfg", "--lanes", "2")
    assert found.code == 0, found.err
    assert "wrote a_range_time.png, a_spectrogram.png, a_compare.png" in found.out
    for name in ("range_time", "spectrogram", "compare"):
        assert Path(f"a_{name}.png").read_bytes().startswith(b"\x89PNG")
    for arguments, told in (
        (("a.bin", "--radar", "profile.cfg", "-o", "d"), "give its LVDS lanes"),
        (("b.zarr",), "process takes one capture"),
        (("a.bin", "--radar.track", "x.csv"), "unknown option radar.track; radar takes one value here"),
        (("a.bin", "a.bin", "--radar", "profile.cfg", "--lanes", "2"), "must be a result"),
        (("a.bin", "--radar", "profile.cfg", "--lanes", "2", "--vital-signs", "-o", "c"), "record longer"),
    ):
        refused = run("process", *arguments)
        assert (refused.code, refused.err.count("\n")) == (2, 1)
        assert told in refused.err
    assert not Path("c_spectrogram.png").exists()
    Path("none.bin").touch()
    assert "none.bin is empty" in run("process", "none.bin", "--radar", "profile.cfg", "--lanes", "2").err


def test_short_bursts_are_set_beside_their_simulation(run: Command) -> None:
    """Both as one chirp a burst, whose axes of speed are one."""
    cube, burst = scene(192), RADAR.replace(chirps_per_frame=2, frame_interval_s=0.02)
    burst.to_yaml("radar.yaml")
    written(Path("a.bin"), two_lanes(cube))
    t2d.Recording(cube.astype(np.complex64), burst).save("b.zarr")
    found = run("process", "a.bin", "b.zarr", "--radar", "radar.yaml", "--lanes", "2", "--signal.n-window", "16")
    assert found.code == 0, found.err
    assert found.out.count("are averaged") == 2
    assert Path("a_compare.png").exists()
