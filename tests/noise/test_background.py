"""The learned background: codec and prior on a small example, the model's file, sums of powers, and what is refused."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from scipy.special import digamma, polygamma

import t2d_rt as t2d
from builders import slow_after
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.dataset.background_records import background_records
from t2d_rt.noise.background import Background, BackgroundModel, BackgroundRecord, Grid, add_background, load_background
from t2d_rt.noise.background.evaluate import distances, evaluation, gaussian_noise, perplexity, two_sample_accuracy
from t2d_rt.noise.background.network import HALO, LEAST_LOOKS, Architecture, decoded, prior_codes
from t2d_rt.noise.background.speckle import correlations, gaussian_field, normal_scores, speckle
from t2d_rt.noise.background.training import learn_background
from t2d_rt.recording.maps import background_settings
from t2d_rt.signal.measured import load_dca1000
from t2d_rt.types import Radar

GRID = Grid.of(np.linspace(-3, 3, 32), 0.03)
FLOOR_W = 1e-14


def example_record(seed: int, columns: int = 240) -> BackgroundRecord:
    """Speckle of 20 looks on a floor, and a line that comes and goes every 24 columns."""
    rng = np.random.default_rng(seed)
    mean = np.ones((32, columns))
    mean[15:17] += 30
    mean[22:25] += 50 * ((np.arange(columns) + rng.integers(24)) % 24 < 12)
    power = FLOOR_W * mean * rng.gamma(20, 1 / 20, mean.shape)
    return BackgroundRecord.of(f"example{seed}", power, GRID, carrier_hz=77e9, calibrated=True)


@pytest.fixture(scope="module")
def records() -> list[BackgroundRecord]:
    return [example_record(seed) for seed in range(8)]


@pytest.fixture(scope="module")
def model(records: list[BackgroundRecord]) -> BackgroundModel:
    return learn_background(records, codes=8, heads=2, codec_steps=80, prior_steps=30, seed=1)


def level(found: Background) -> np.ndarray:
    return 10 * np.log10(found.power)


# --- the networks ---


def test_the_mean_spectrum_is_learned(model: BackgroundModel, records: list[BackgroundRecord]) -> None:
    found = 10 * np.log10(model.columns(400, seed=3).power.mean(axis=1))
    wanted = 10 * np.log10(np.mean([10 ** (each.relative_db / 10) for each in records], axis=(0, 2)))
    assert np.abs(found - wanted).max() < 3
    assert wanted[23] - wanted[5] > 10
    assert np.median(np.abs(found - wanted)) < 0.3


def test_decoder_and_prior_without_torch_are_those_that_were_trained(model: BackgroundModel) -> None:
    torch = pytest.importorskip("torch")
    from t2d_rt.noise.background.training import Decoder, Prior

    size, arrays = model.architecture, model.arrays
    codes = np.random.default_rng(0).integers(size.codes, size=(20, size.heads))
    decoder = Decoder(size, torch.zeros(2, size.padded_bins))
    decoder.load_state_dict(
        {n.removeprefix("decoder."): torch.tensor(a) for n, a in arrays.items() if n[:8] == "decoder."}
    )
    vectors = arrays["codebook"][np.arange(size.heads), codes].reshape(1, len(codes), -1)
    with torch.no_grad():
        level, variance = (each[0].numpy() for each in decoder(torch.tensor(vectors)))
    inside = slice(HALO * size.columns, (20 - HALO) * size.columns)
    mean, looks = decoded(size, arrays, codes)
    # Of a gamma distribution, by its looks; those of a table of 400 entries are interpolated.
    wanted = np.minimum(variance[: size.bins, inside], np.log(polygamma(1, LEAST_LOOKS)))
    np.testing.assert_allclose(np.log(polygamma(1, looks)), wanted, atol=1e-3)
    np.testing.assert_allclose(mean - np.log(looks) + digamma(looks), level[: size.bins, inside], atol=1e-3)
    prior = Prior(size)
    prior.load_state_dict(
        {n.removeprefix("prior."): torch.tensor(a) for n, a in arrays.items() if n[:6] == "prior."}, strict=False
    )
    with torch.no_grad():
        wanted = prior(torch.tensor(codes[None]))[0].softmax(-1).numpy()
    # Each code is the one in whose part of the cumulated probabilities its uniform number falls.
    drawn = prior_codes(size, arrays, 20, np.random.default_rng(5))
    uniform = np.random.default_rng(5).random((20, size.heads))
    with torch.no_grad():
        chance = prior(torch.tensor(drawn[None]))[0].softmax(-1).numpy().cumsum(-1)
    high = np.take_along_axis(chance, drawn[..., None], 2)[..., 0]
    low = np.take_along_axis(np.concatenate([np.zeros_like(chance[..., :1]), chance], 2), drawn[..., None], 2)[..., 0]
    assert ((low - 1e-5 <= uniform) & (uniform <= high + 1e-5)).all()
    assert wanted.shape == chance.shape


@pytest.mark.slow
def test_training_repeats_bit_for_bit() -> None:
    record = example_record(0, columns=80)
    short = [learn_background([record], codes=4, heads=1, codec_steps=3, prior_steps=2, seed=2) for _ in range(2)]
    for name, values in short[0].arrays.items():
        np.testing.assert_array_equal(values, short[1].arrays[name], err_msg=name)


def test_samples_repeat_and_a_longer_one_begins_alike(model: BackgroundModel) -> None:
    short, long = model.sample(2.0, seed=7), model.sample(9.0, seed=7)
    np.testing.assert_array_equal(short.power, long.power[:, : short.power.shape[1]])
    assert long.power.shape == (32, 300)
    assert not np.array_equal(short.power, model.sample(2.0, seed=8).power)
    uniform = model.columns(3000, seed=0, codes="uniform").codes
    assert perplexity(uniform, 8) > 7.9


LENGTHS = """
import numpy as np
from t2d_rt.noise.background.speckle import gaussian_field

def field(bins, columns):
    time = np.tile(0.9 ** np.arange(16), (bins, 1))
    return gaussian_field(bins, columns, time, np.array([1, 0.4, 0.1, 0]), np.random.default_rng(7))

for bins in (32, 44, 128):
    longest = field(bins, 300)
    for columns in (1, 7, 64, 67, 191):
        assert np.array_equal(field(bins, columns), longest[:, :columns]), (bins, columns)
"""


@pytest.mark.parametrize(("kernels", "threads"), slow_after(1, [("Haswell", "2"), ("Sandybridge", "1")]))
def test_first_columns_are_the_same_bits_whichever_kernels_blas_takes(kernels: str, threads: str) -> None:
    """OpenBLAS picks its kernels by shape, number of threads and processor; the variable is ignored where it is not known."""
    found = subprocess.run(
        [sys.executable, "-c", LENGTHS],
        env={**os.environ, "OPENBLAS_CORETYPE": kernels, "OPENBLAS_NUM_THREADS": threads}, capture_output=True, text=True,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr


def test_speckle_has_the_gamma_distribution_and_keeps_its_correlation() -> None:
    time, doppler = np.tile([1, 0.6, 0.2, *[0.0] * 13], (64, 1)), np.array([1, 0.35, 0.02, 0])
    field = gaussian_field(64, 20_000, time, doppler, np.random.default_rng(0))
    assert field.std() == pytest.approx(1, abs=0.02)
    found_time, found_doppler = correlations([field])
    np.testing.assert_allclose(found_time[:, :3], time[:, :3], atol=0.04)
    np.testing.assert_allclose(found_doppler, doppler, atol=0.03)
    normal = np.random.default_rng(1).standard_normal(400_000)
    for looks in (1.0, 4.0, 100.0):
        power = speckle(normal, np.full_like(normal, looks))
        assert power.mean() == pytest.approx(1, abs=0.01)
        assert power.var() * looks == pytest.approx(1, abs=0.07)  # Wilson and Hilferty's approximation at one look
    np.testing.assert_allclose(normal_scores(power, np.full_like(normal, 100.0)), normal, atol=1e-9)


def test_each_bin_has_its_own_correlation_in_time() -> None:
    """Near zero speed the power changes slowly, the floor's from window to window."""
    slow, fast = 0.9 ** np.arange(16), np.array([1, 0.5, 0.1, *[0.0] * 13])
    time = np.stack([fast] * 20 + [slow] * 4 + [fast] * 20)
    field = gaussian_field(44, 20_000, time, np.array([1.0, 0, 0, 0]), np.random.default_rng(0))
    found, _ = correlations([field[:, :9000], field[:, 9000:]])
    np.testing.assert_allclose(found[:, :3], time[:, :3], atol=0.05)
    short, _ = correlations([field[:, k : k + 40] for k in range(0, 20_000, 40)])
    np.testing.assert_allclose(short[:, 1:3], time[:, 1:3], atol=0.12)  # no smaller in short records


def test_correlations_of_nothing_make_a_steady_field() -> None:
    time = np.tile([1, -0.9, -0.9, *[0.0] * 13], (4, 1))
    field = gaussian_field(4, 5_000, time, np.array([1.0, 0, 0, 0]), np.random.default_rng(0))
    assert np.abs(field).max() < 10


# --- sums ---


def test_powers_add_exactly_in_the_mean_and_not_in_one_realisation() -> None:
    rng = np.random.default_rng(0)
    echo = 2.0
    noise = rng.standard_normal((200_000, 2)).view(complex)[:, 0] * np.sqrt(0.5 / 2)
    true = np.abs(echo + noise) ** 2
    added = echo**2 + np.abs(noise) ** 2
    assert added.mean() == pytest.approx(true.mean(), rel=5e-3)
    cross = true - added
    assert cross.std() == pytest.approx(np.sqrt(2 * echo**2 * 0.5), rel=0.01)  # what the docstring states, M = 1


def test_add_background_is_a_sum_at_the_level_asked_for(model: BackgroundModel) -> None:
    found = model.columns(50, seed=1)
    power = np.full((32, 50), 1e-13)
    np.testing.assert_allclose(add_background(power, found, -130), power + 1e-13 * found.power, rtol=1e-6)
    own = add_background(np.zeros((32, 50)), model.columns(50, seed=1))
    assert np.median(10 * np.log10(own)) == pytest.approx(-140, abs=0.5)


def test_other_axes_are_interpolated_or_refused(model: BackgroundModel) -> None:
    finer = Grid.of(np.linspace(-2.5, 2.5, 48), 0.02)
    found = model.columns(600, seed=2, grid=finer)
    own = model.columns(600, seed=2)
    assert found.power.shape == (48, 600)
    profile = np.interp(finer.velocity_mps, GRID.velocity_mps, 10 * np.log10(own.power.mean(axis=1)))
    assert np.median(np.abs(10 * np.log10(found.power.mean(axis=1)) - profile)) < 0.5
    for grid in (
        Grid.of(np.linspace(-9, 9, 96), 0.03),
        Grid.of(GRID.velocity_mps, 0.1),
        Grid.of(np.linspace(-3, 3, 8), 0.03),
    ):
        with pytest.raises(InputError, match="choose n_window and overlap alike"):
            model.columns(10, grid=grid)


def test_a_recording_carries_its_background(model: BackgroundModel, tmp_path) -> None:
    path = tmp_path / "model.safetensors"
    model.save(path)
    radar = Radar.preset("table2", samples=8)
    scale = radar.speed_axis_mps(32)
    same = BackgroundModel.of(
        model.architecture, model.arrays, Grid.of(scale, 16 / radar.prf_hz), levels_db=[-130], carrier_hz=77e9,
        calibrated=True, about={},
    )  # fmt: skip
    same.save(path)
    with pytest.warns(T2DWarning, match="was learned at 77 GHz and the recording is of 24.05 GHz: level and clutter"):
        background_settings(path, carrier_hz=24.05e9)
    with pytest.warns(T2DWarning, match="of 24.05 GHz: clutter of the background"):
        background_settings(path, carrier_hz=24.05e9, level_db=-130)
    silence = t2d.Recording(np.full((400, 1, 8), 1e-9 + 0j, np.complex64), radar).processed(n_window=32, overlap=16)
    noisy = silence.with_background(path, seed=3)
    assert float(noisy.spectrogram.median()) == pytest.approx(-130, abs=0.5)
    assert float(silence.spectrogram.median()) < -150
    noisy.save(tmp_path / "noisy.zarr")
    back = t2d.load_recording(tmp_path / "noisy.zarr")
    np.testing.assert_array_equal(back.spectrogram, noisy.spectrogram)
    model.save(path)
    with pytest.raises(InputError, match="no longer the background model"):
        _ = t2d.load_recording(tmp_path / "noisy.zarr").spectrogram


# --- files ---


def test_a_model_is_read_back(model: BackgroundModel, tmp_path) -> None:
    path = tmp_path / "model.safetensors"
    model.save(path)
    back = load_background(path)
    assert back.digest == model.digest
    np.testing.assert_array_equal(back.sample(1, seed=2).power, model.sample(1, seed=2).power)
    model.save(tmp_path / "again.safetensors")
    assert path.read_bytes() == (tmp_path / "again.safetensors").read_bytes()


def test_damaged_models_are_refused_in_a_sentence(model: BackgroundModel, tmp_path) -> None:
    from safetensors.numpy import save

    path = tmp_path / "model.safetensors"
    model.save(path)
    whole = path.read_bytes()
    length = int.from_bytes(whole[:8], "little")
    header = json.loads(whole[8 : 8 + length])
    told = header["__metadata__"]
    ((key, model_text),) = told.items()
    arrays = dict(model.arrays)
    broken = {
        "is not a safetensors file but a pickle": pickle.dumps({"a": 1}),
        "is not a safetensors file but something else": b"\0" * 5,
        "is a background model that cannot be read": whole[: len(whole) // 2],
        "holds no background model": save(arrays, {}),
        "of version 9, this program reads version 1": save(
            arrays, {key: model_text.replace('"version": 1', '"version": 9')}
        ),
        "array codebook of a background model must have shape": save(
            {**arrays, "codebook": np.zeros(2, np.float32)}, told
        ),
        "array speckle.time of a background model must have shape": save(
            {n: a for n, a in arrays.items() if n != "speckle.time"}, told
        ),
        "must be finite": save({**arrays, "codebook": np.full((2, 8, 16), np.nan, np.float32)}, told),
        "architecture key codes: got -8": save(arrays, {key: model_text.replace('"codes": 8', '"codes": -8')}),
    }
    for sentence, data in broken.items():
        path.write_bytes(data)
        with pytest.raises(InputError, match=sentence) as caught:
            load_background(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r'is "default" or a .safetensors file, got'):
        load_background("model.pt")


def test_records_are_read_back_and_others_refused(tmp_path) -> None:
    record = example_record(0, 80)
    record.save(tmp_path / "a.npz")
    (back,) = background_records(tmp_path)
    np.testing.assert_array_equal(back.power, record.power)
    assert back.grid.same_as(GRID)
    assert back.calibrated
    assert back.level_db == record.level_db
    np.savez(tmp_path / "b.npz", power_w=np.ones(3))
    with pytest.raises(InputError, match=r"b.npz is not a background record"):
        background_records(tmp_path)
    with pytest.raises(InputError, match="holds no recording"):
        background_records(tmp_path.joinpath("empty").resolve() if (tmp_path / "empty").mkdir() is None else tmp_path)
    other = BackgroundRecord.of(
        "other", record.power, Grid.of(GRID.velocity_mps, 0.05), carrier_hz=77e9, calibrated=True
    )
    with pytest.raises(InputError, match=r"must have the same axes: example0 has .* other has"):
        learn_background([record, other])


def test_measured_cubes_become_records(tmp_path) -> None:
    radar = Radar.preset("table2", samples=8)
    radar.to_yaml(tmp_path / "radar.yaml")
    rng = np.random.default_rng(0)
    cube = (100 * rng.standard_normal((600, 1, 8, 2))).round()
    np.save(tmp_path / "a.npy", cube[..., 0] + 1j * cube[..., 1])
    pairs = cube[:, 0].reshape(600, 4, 2, 2).swapaxes(2, 3)  # two samples of I, then of Q
    (tmp_path / "b.bin").write_bytes(pairs.astype("<i2").tobytes())
    first, second = background_records(tmp_path, lanes=2)
    np.testing.assert_array_equal(first.power, second.power)
    assert not first.calibrated
    (tmp_path / "radar.yaml").unlink()
    with pytest.raises(InputError, match=r"neither a.yaml nor radar.yaml"):
        background_records(tmp_path, lanes=2)


# --- raw captures: bytes written here, word by word, as TI's report lists them ---


def _capture(cube: np.ndarray, lanes: int) -> bytes:
    words: list[int] = []
    for chirp in cube:  # (receiver, sample)
        if lanes == 2:
            for receiver in chirp:
                for first, second in zip(receiver[::2], receiver[1::2], strict=True):
                    words += [int(first.real), int(second.real), int(first.imag), int(second.imag)]
        else:
            for sample in chirp.T:
                words += [int(each.real) for each in sample] + [int(each.imag) for each in sample]
    return b"".join(word.to_bytes(2, "little", signed=True) for word in words)


@pytest.mark.parametrize("lanes", [2, 4])
def test_captures_of_both_layouts(tmp_path, lanes: int) -> None:
    radar = Radar.preset("table2", samples=6, rx_offsets_m=[(0, 0.002 * k, 0) for k in range(4)])
    rng = np.random.default_rng(0)
    cube = rng.integers(-(2**15), 2**15, (5, 4, 6)) + 1j * rng.integers(-(2**15), 2**15, (5, 4, 6))
    (tmp_path / "a.bin").write_bytes(_capture(cube, lanes))
    np.testing.assert_array_equal(load_dca1000(tmp_path / "a.bin", radar, lanes=lanes), cube)
    loaded = t2d.load_recording(tmp_path / "a.bin", radar, lanes=lanes)
    np.testing.assert_array_equal(loaded.cube, cube)
    two = radar.replace(
        tx_offsets_m=[(0, 0, 0), (0, 0.01, 0)], multiplexing="tdm", rx_offsets_m=[(0, 0, 0), (0, 0.002, 0)]
    )
    tdm = cube[:4, :2]
    written = _capture(tdm if lanes == 2 else np.concatenate([0 * tdm, tdm], axis=1), lanes)
    (tmp_path / "b.bin").write_bytes(written)
    # A loop is two chirps; the antennas of the first transmitter come first.
    np.testing.assert_array_equal(load_dca1000(tmp_path / "b.bin", two, lanes=lanes), tdm.reshape(2, 4, 6))
    (tmp_path / "b.bin").write_bytes(written[:-2])
    with pytest.raises(InputError, match="cut the file at the last whole loop"):
        load_dca1000(tmp_path / "b.bin", two, lanes=lanes)
    with pytest.raises(InputError, match="lanes must be"):
        load_dca1000(tmp_path / "b.bin", two, lanes=3)
    with pytest.raises(InputError, match="give its LVDS lanes"):
        t2d.load_recording(tmp_path / "a.bin", radar)


# --- evaluation ---


@pytest.mark.slow
def test_distances_tell_like_from_unlike() -> None:
    first = [example_record(seed).relative_db for seed in range(8)]
    alike = distances(first, [example_record(seed).relative_db for seed in range(10, 18)])
    noise = distances(first, gaussian_noise(first, np.random.default_rng(0)))
    assert alike.profile_db < 0.3
    assert alike.levels_db < 0.2
    assert alike.autocorrelation < 0.05
    assert abs(alike.classifier - 0.5) < 0.12
    assert noise.profile_db > 3
    assert noise.levels_db > 3
    assert noise.autocorrelation > 0.1
    assert noise.classifier > 0.95


def test_power_of_the_gaussian_noise_is_equal() -> None:
    like = [example_record(0).relative_db]
    (noise,) = gaussian_noise(like, np.random.default_rng(0))
    assert np.mean(10 ** (noise / 10)) == pytest.approx(np.mean(10 ** (like[0] / 10)), rel=0.03)


def test_a_classifier_does_not_see_its_own_records() -> None:
    """Records with a level of their own each would be told apart by heart."""
    rng = np.random.default_rng(0)
    sets = [[rng.normal(rng.normal(0, 3, (32, 1)), 1, (32, 320)) for _ in range(8)] for _ in range(2)]
    assert two_sample_accuracy(*sets) < 0.7


def test_perplexity() -> None:
    assert perplexity(np.array([[0, 1], [1, 1], [0, 1], [1, 1]]), 4) == pytest.approx(np.sqrt(2))


@pytest.mark.slow
def test_evaluation_sets_prior_beside_the_others(model: BackgroundModel) -> None:
    found = evaluation(model, [example_record(seed) for seed in range(20, 22)])
    assert list(found) == ["prior", "uniform codes", "Gaussian noise"]
    assert found["prior"][0].profile_db < found["Gaussian noise"][0].profile_db


# --- the command ---


@pytest.mark.slow
def test_commands(run, model: BackgroundModel, tmp_path) -> None:
    model.save(tmp_path / "m.safetensors")
    assert run("background", "sample", "m.safetensors", "-n", "2", "--duration-s", "3", "-o", "out").code == 0
    (first, second) = background_records(tmp_path / "out")
    assert first.duration_s == pytest.approx(3)
    assert not np.array_equal(first.power, second.power)
    again = "background", "sample", "m.safetensors", "-n", "1", "--duration-s", "3", "--overwrite", "-o"
    assert "background_0001.npz of an earlier call" in run(*again, "out").err
    assert run(*again, "other").code == 0
    told = run("background", "evaluate", "m.safetensors", "out")
    assert told.code == 0
    assert "uniform codes" in told.out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("background",), "needs one of simulate, train, sample, evaluate, got nothing"),
        (("background", "learn"), "needs one of"),
        (("background", "sample"), "sample takes 1 names, got 0"),
        (("background", "sample", "default"), "needs --output"),
        (("background", "train", "nowhere", "-o", "m.safetensors"), "nowhere is not a folder"),
        (("simulate", "walk", "--background-seed", "3"), "--background-seed is of a background and there is none"),
        (
            ("simulate", "walk", "--background-level-db", "-9"),
            "--background-level-db is of a background and there is none",
        ),
        (("background", "train", "nowhere", "-o", "m.pt"), "ends in .safetensors"),
        (
            ("simulate", "walk", "--background", "nothing.safetensors"),
            "cannot read background model nothing.safetensors",
        ),
    ],
)
def test_commands_that_cannot_run(refused, words: tuple[str, ...], sentence: str) -> None:
    assert sentence in refused(*words)


def test_without_torch_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, records: list[BackgroundRecord]) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"pip install -e '.\[learn\]'"):
        learn_background(records)


@pytest.mark.slow
def test_sampling_needs_no_torch() -> None:
    import subprocess

    modules = "t2d_rt.noise.background, t2d_rt.noise.masks, t2d_rt.recording.recording"
    code = f"import sys; import {modules}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


def test_architecture_sizes() -> None:
    size = Architecture(bins=100, time_halvings=2)
    assert size.padded_bins >= 100
    assert size.rows * 2**size.doppler_halvings == size.padded_bins
    assert np.prod([times for *_, times in size.stages]) == size.columns == 4
    with pytest.raises(InputError, match="take fewer time_halvings"):
        Architecture(bins=16, time_halvings=3)
