"""Large cubes as products: the same bits as samples in memory, whatever is read, in layers, pickled; and what must not be read."""

from __future__ import annotations

import copy
import errno
import os
import pickle
from dataclasses import replace

import numpy as np
import pytest

from builders import slow_after
from made_echoes import random_echoes
from t2d_rt.core import cubes
from t2d_rt.core import factored_cubes as products
from t2d_rt.core.cubes import Cube, CubeAdder, DiskCube
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import Piece, Product, ProductRows
from t2d_rt.core.memory import MemoryLimit
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.signal import spectrogram
from t2d_rt.signal.doppler import MOST_STEP, _step_of, weighed
from t2d_rt.signal.range import taper
from t2d_rt.types import Radar

RADARS = [
    Radar.preset("table2"),
    Radar.preset("table2", tx_offsets_m=[[0, 0, 0], [0, 0.01, 0]], multiplexing="ddm"),
    Radar.preset("table2", rx_offsets_m=[[0, 0, 0], [0, 0.01, 0]]),
]
NAMES = ["one antenna", "ddm", "two receivers"]


def both(
    radar: Radar, monkeypatch: pytest.MonkeyPatch, *, layers: int = 1, **options: float
) -> tuple[np.ndarray, DiskCube]:
    """The same sum in memory and as products."""

    def summed() -> Cube:
        cube = None
        for seed in range(layers):
            # More frames than a window has, of another number in each layer.
            echoes = random_echoes(radar, frames=50 + 3 * seed, seed=seed)
            times = echoes.times_s / echoes.times_s[-1] * 0.25
            cube = synthesize(replace(echoes, times_s=times), radar, onto=cube, **options)
        assert cube is not None
        return cube

    inside = summed()
    monkeypatch.setattr(cubes, "LARGE_BYTES", 1000)
    outside = summed()
    assert isinstance(inside, np.ndarray)
    assert isinstance(outside, DiskCube)
    assert isinstance(outside.rows, ProductRows)
    return inside, outside


@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("radar", slow_after(1, RADARS), ids=NAMES)
def test_the_same_bits_as_in_memory(radar: Radar, layers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    inside, outside = both(radar, monkeypatch, layers=layers)
    assert inside.any()
    np.testing.assert_array_equal(np.asarray(outside), inside)
    for start, stop in ((0, 1), (511, 513), (700, 1900), (len(inside) - 3, len(inside))):
        np.testing.assert_array_equal(outside[start:stop], inside[start:stop])
    np.testing.assert_array_equal(outside[5::700, -1, ::9], inside[5::700, -1, ::9])


@pytest.mark.parametrize("multiplexing", ["tdm", "ddm"])
def test_more_coefficients_than_samples_are_kept_as_samples(multiplexing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # No merging at that tolerance, and more echoes than are summed in wide buckets.
    radar = Radar.preset("table2", samples=32, tx_offsets_m=[[0, 0, 0], [0, 0.01, 0]], multiplexing=multiplexing)
    monkeypatch.setattr("t2d_rt.radar.synthesize.FEW_ECHOES", 0)
    inside, outside = both(radar, monkeypatch, tolerance_db=-70.0)
    np.testing.assert_array_equal(np.asarray(outside), inside)
    assert isinstance(outside.rows, ProductRows)
    assert outside.rows._file.size <= (2 if multiplexing == "ddm" else 1) * inside.nbytes


def test_copies_and_pickles_hold_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.core.cube_storage.BLOCK_BYTES", 5000)  # several blocks
    inside, outside = both(RADARS[1], monkeypatch, layers=2)
    for other in (pickle.loads(pickle.dumps(outside)), copy.deepcopy(outside)):
        assert other.rows._file is not outside.rows._file
        np.testing.assert_array_equal(np.asarray(other), inside)


def test_samples_are_added_to_products(monkeypatch: pytest.MonkeyPatch) -> None:
    inside, outside = both(RADARS[2], monkeypatch)
    assert isinstance(outside.rows, ProductRows)
    assert np.isfinite(outside.spread(0, 100))
    for cube in (inside, outside):
        rng = np.random.default_rng(0)
        with CubeAdder(cube) as adder:
            for first in range(0, len(inside), 700):
                out = adder.room(min(700, len(inside) - first))
                out[:] = rng.normal(size=out.shape) if first != 700 else 0
    assert np.isinf(outside.spread(0, 100))  # a spectrogram takes all samples of what nothing is known of
    assert np.isfinite(outside.spread(800, 900))
    np.testing.assert_array_equal(np.asarray(outside), inside)


def test_few_coefficients_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    inside, outside = both(RADARS[0], monkeypatch)
    assert isinstance(outside.rows, ProductRows)
    assert outside.rows._file.size < 0.5 * inside.nbytes  # random echoes fill a good part of the range axis


def test_a_disk_that_is_full_where_a_pickle_is_read_shows_at_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    _, outside = both(RADARS[0], monkeypatch)
    content = pickle.dumps(outside)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    back = pickle.loads(content)  # an error here would leave a pool waiting for ever
    with pytest.raises(InputError, match="No space left on device"):
        back[0:3]


def test_a_sum_that_was_broken_off_is_not_read() -> None:
    rows = ProductRows((4, 1, 8))
    product = Product(np.ones((4, 1, 2), np.complex64), np.ones((2, 8)), np.zeros(1), np.linspace(-1, 1, 8), 1.0)
    with pytest.raises(InputError, match="were not summed to their end; simulate again"):
        rows.read(0, 4)
    rows.begin()
    for chirps, piece in product.pieces():
        rows.add(chirps.start, 0, piece)
    with pytest.raises(InputError, match="were not summed to their end"):
        rows.read(0, 4)
    rows.end()
    np.testing.assert_array_equal(rows.read(1, 3), np.full((2, 1, 8), 2))
    rows.begin()
    with pytest.raises(InputError, match="were not summed to their end"):
        rows.read(0, 4)


def test_a_wide_sweep_is_multiplied_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    numbers = (rng.normal(size=(5, 6)) + 1j * rng.normal(size=(5, 6))).astype(np.complex64)
    theta, weights, x = rng.normal(size=3), rng.normal(size=(2, 40)), np.linspace(-1, 1, 40)
    piece = Piece(numbers, theta, weights, x, None, 1.0)
    whole, cut = np.empty((2, 5, 40), np.complex64)
    piece.put(whole)
    monkeypatch.setattr(products, "BASIS_NUMBERS", 6 * 7)
    piece.put(cut)
    expected = np.einsum("cbq,bs,qs->cs", numbers.reshape(5, 3, 2), np.exp(1j * np.outer(theta, x)), weights)
    np.testing.assert_allclose(whole, expected, rtol=1e-4)
    np.testing.assert_allclose(cut, expected, rtol=1e-4)


@pytest.mark.parametrize("window", ["hann", "blackmanharris", "boxcar", ("kaiser", 14)])
@pytest.mark.parametrize("spread", [5, 25, 60, 140, 400, 500])
def test_powers_of_few_samples_are_those_of_all(window: str, spread: int) -> None:
    samples, rng = 256, np.random.default_rng(0)
    step = _step_of(window, samples, spread)
    weights, x = taper(window, samples), np.linspace(-1, 1, samples)
    theta = 1000 + np.hstack([rng.uniform(0, spread, (50, 5)), np.tile([0, spread], (50, 1))])
    amplitude = rng.normal(size=theta.shape) + 1j * rng.normal(size=theta.shape)
    beats = weights * np.einsum("ki,kin->kn", amplitude, np.exp(1j * theta[..., None] * x))
    whole, few = np.sum(np.abs(beats) ** 2, axis=1), step * np.sum(np.abs(beats[:, ::step]) ** 2, axis=1)
    bound = np.abs(amplitude).sum(axis=1) ** 2 * np.sum(weights**2)
    assert np.abs(few - whole).max() <= 1.5e-6 * bound.max()
    if window != "boxcar":
        assert step > 1 or spread > 300
        further = step + 1  # and one more would be wrong somewhere
        apart = np.linspace(0, spread, 2000)
        kernel = np.exp(1j * np.outer(apart, x)) @ weights**2
        thin = further * (np.exp(1j * np.outer(apart, x[::further])) @ weights[::further] ** 2)
        assert step == MOST_STEP or np.abs(thin - kernel).max() > 1e-6 * np.sum(weights**2)


@pytest.mark.parametrize("window", ["hann", "blackmanharris", "boxcar", ("kaiser", 14)])
def test_what_the_ends_of_a_window_leave_out_is_next_to_nothing(window: str) -> None:
    weights = taper(window, 256) ** 2
    kept = weighed(np.sqrt(weights))
    assert 1 - 1e-7 < weights[kept].sum() / weights.sum() <= 1
    assert (kept == slice(0, 256)) == (window == "boxcar")
    more = weights[kept.start + 1 : kept.stop - 1].sum() / weights.sum()
    assert more < 1 - 1e-7  # and one more at either end would be too much


def test_a_wide_sweep_of_echoes_far_apart_takes_little_memory() -> None:
    assert _step_of("hann", 16_384, 300) > 4
    assert _step_of("hann", 1_000_000, 10_000_000) == 1


@pytest.mark.parametrize("window", slow_after(1, ["hann", "boxcar", "blackmanharris"]))
def test_a_spectrogram_takes_few_samples_of_beats_that_lie_close(window: str, monkeypatch: pytest.MonkeyPatch) -> None:
    radar = Radar.preset("table2", rx_offsets_m=[[0, 0, 0], [0, 0.01, 0]], prf_hz=20e3)
    inside, outside = both(radar, monkeypatch)
    read: list[int] = []
    rows = ProductRows.read
    monkeypatch.setattr(
        ProductRows, "read", lambda self, start, stop, every=1: read.append(every) or rows(self, start, stop, every)
    )
    expected, found = (spectrogram(cube, radar, range_window=window).power for cube in (inside, outside))
    assert (max(read) > 1) == (window != "boxcar")  # a boxcar's edges need all of them
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-10 * expected.max())  # float32


def test_a_run_that_may_take_little_keeps_products() -> None:
    radar = RADARS[0]
    echoes = random_echoes(radar, frames=40)
    cube = synthesize(echoes, radar, memory=MemoryLimit(limit_bytes=1e6, held_bytes=0.0))
    assert isinstance(cube, DiskCube)
    assert isinstance(cube.rows, ProductRows)
    np.testing.assert_array_equal(np.asarray(cube), synthesize(echoes, radar))
