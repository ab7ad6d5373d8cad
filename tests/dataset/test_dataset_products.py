"""Maps of a data set show what moves, not the receiver's offset."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.dataset.products import (
    Products,
    RangeDopplerProduct,
    SpectrogramPower,
    SpectrogramProduct,
    averaging,
    axis,
    record_length_s,
    resized,
)
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import range_gate, sample, scene_extent
from t2d_rt.dataset.worker import make_sample, view
from t2d_rt.recording.maps import background, background_settings
from t2d_rt.recording.recording import Recording
from t2d_rt.simulate import run
from t2d_rt.types import Radar

RADAR = Radar.preset("table2")
SPEED_MPS = 2.0


def offset_and_target() -> Recording:
    """A target that approaches, 20 dB below a constant in all samples."""
    chirps = np.arange(1024)[:, None, None]
    samples = np.arange(RADAR.samples)[None, None, :]
    doppler = -2 * SPEED_MPS / RADAR.wavelength_m / RADAR.prf_hz
    tone = 0.1 * np.exp(2j * np.pi * (doppler * chirps + 20 / RADAR.samples * samples))
    return Recording((1.0 + tone).astype(np.complex64), RADAR)


@pytest.mark.parametrize(("kind", "rows"), [(SpectrogramProduct, 0), (RangeDopplerProduct, 1)])
@pytest.mark.parametrize(("mti", "speed_mps"), [("mean", SPEED_MPS), ("none", 0.0)])
def test_the_greatest_cell_is_the_target_without_the_mean(kind: Any, rows: int, mti: Any, speed_mps: float) -> None:
    product = kind(mti=mti, size=(128, 64))
    seen: Any = offset_and_target()
    if kind is SpectrogramProduct:
        recipe = Recipe.read("small-hard").model_copy(update={"products": Products(spectrogram=product)})
        seen = view(seen, recipe, 0)
    levels, told = product.made(seen)
    speeds = axis(told["velocity_mps"], levels.shape[rows])
    best = np.unravel_index(levels.argmax(), levels.shape)
    assert speeds[best[rows]] == pytest.approx(speed_mps, abs=speeds[1] - speeds[0])
    assert kind().mti == "mean"


@pytest.mark.parametrize("greatest_mps", [None, 4.0])
@pytest.mark.parametrize("cells", [255, 256])
def test_the_map_of_a_mirrored_spectrum_is_the_mirrored_map(greatest_mps: float | None, cells: int) -> None:
    """So no cell about zero tells which way somebody goes."""
    velocity_mps = np.fft.fftshift(np.fft.fftfreq(cells, 1 / 20.0))
    power = np.random.default_rng(0).exponential(size=(cells, 16))
    opposite = power.copy()
    opposite[1 - cells % 2 :] = power[1 - cells % 2 :][::-1]
    product = SpectrogramProduct(size=(64, 8), speed_mps=greatest_mps)
    (levels, told), (mirrored, _) = (
        product.made(SpectrogramPower(spectrum, velocity_mps, np.arange(16.0))) for spectrum in (power, opposite)
    )
    np.testing.assert_allclose(mirrored, levels[::-1], atol=0.02)  # a step of float16
    low, high = told["velocity_mps"]
    assert low == -high


def test_a_map_of_one_speed_says_what_gives_it_more() -> None:
    """The error names the span that suffices; with two chirps in a burst no span does, and it asks for more chirps."""
    velocity_mps = Radar.preset("table2").speed_axis_mps(256)
    with pytest.raises(InputError, match=r"speed_mps 0\.01 leaves one cell of speed of 256, .* raise") as told:
        SpectrogramProduct(speed_mps=0.01).rows(velocity_mps)
    advised_mps = float(str(told.value).split()[-1])
    rows = SpectrogramProduct(speed_mps=advised_mps).rows(velocity_mps)
    assert rows.stop - rows.start == 3
    for given_mps in (None, 50.0):
        for few_mps in (8 * velocity_mps[127:129], 8 * velocity_mps[128:129]):
            with pytest.raises(InputError, match=r"[12] cells of speed .*; give a radar with more chirps in a burst"):
                SpectrogramProduct(speed_mps=given_mps).rows(few_mps)


def test_a_record_of_bursts_lasts_to_the_end_of_the_last() -> None:
    radar = Radar.preset("table2-burst")
    burst = radar.loops_per_frame
    assert burst is not None
    recording = Recording(np.zeros((3 * burst, 1, radar.samples), np.complex64), radar)
    lasts_s = 2 * radar.frame_interval_s + burst * radar.loop_interval_s
    assert record_length_s(recording) == pytest.approx(lasts_s)


def test_an_occluded_window_shows_the_background_alone() -> None:
    """However far the person stands above it."""
    rng = np.random.default_rng(0)
    strong = rng.standard_normal((2048, 1, RADAR.samples)) + 0j
    recording = Recording(strong.astype(np.complex64), RADAR)
    masks = {"windows": 40, "shortest_s": 0.05, "longest_s": 0.1}
    asked = {"background": "default", "background_level_db": -140.0, "masks": masks}
    recipe = Recipe.model_validate(Recipe.read("small-hard").model_dump() | asked)
    seen = view(recording, recipe, 0)
    told = seen.details["background"]
    image = recording.processed(mti="mean").spectrogram
    alone = background(image.velocity_mps.values, image.time_s.values, told).power_w(-140.0)
    hidden = np.any(
        [(image.time_s.values >= a) & (image.time_s.values < b) for a, b in seen.details["masks_s"]], axis=0
    )
    assert hidden.any()
    np.testing.assert_allclose(seen.power[:, hidden], alone[:, hidden], rtol=1e-6)


def test_a_background_beside_receiver_noise_is_warned_of() -> None:
    with pytest.warns(T2DWarning, match="noise floor of its own"):
        background_settings("default", noisy=True)
    background_settings("default", noisy=True, level_db=-160.0)


def test_cells_are_means_over_what_they_cover() -> None:
    """Thirds by hand, the power of the whole, and a part of the speeds. Mutation: weights of what overlaps at all."""
    thirds = averaging(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
    np.testing.assert_allclose(thirds, [[2 / 3, 1 / 3, 0], [0, 1 / 3, 2 / 3]])
    np.testing.assert_array_equal(averaging(np.array([0.0, 1.0, 2.0]), np.array([2.0, 3.0])), [[0, 1]])  # the nearest
    power = np.random.default_rng(0).random((7, 10))
    assert resized(power, (3, 4)).mean() == pytest.approx(power.mean())
    np.testing.assert_allclose(
        resized(power, (2, 10), (1 / 7, 5 / 7)), [power[1:3].mean(axis=0), power[3:5].mean(axis=0)]
    )


@pytest.mark.parametrize(
    ("gate", "sentence"),
    [
        ([100, 200], r"range gate 100\.\.200 m holds no range bin"),
        ([2.0, 2.05], r"range gate 2\.\.2\.05 m holds no range bin"),
        ("Scene", r"range_gate_m must be nearest and farthest range \[m\], got 'Scene'"),
        ([6, 0.5], r"range_gate_m must be nearest and farthest range \[m\], got \[6, 0\.5\]"),
    ],
)
def test_gates_that_are_refused(gate: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Recipe(
            name="gated", classes=["bending"], descriptions_per_class=1, samples_per_description=1, radar="table2",
            conditions=[{"name": "free"}], products={"spectrogram": {"range_gate_m": gate}},
        )  # fmt: skip


def test_a_gate_by_the_scene_is_what_persons_of_the_recipe_reach_or_the_room() -> None:
    gated = {"spectrogram": {"size": [32, 32], "range_gate_m": "scene"}}
    conditions = [{"name": "free", "method": "ellipsoid"}, {"name": "room", "scene": "empty_room"}]
    recipe = Recipe(
        name="gated", classes=["bending"], descriptions_per_class=1, samples_per_description=1, radar="table2",
        conditions=conditions, each_condition=True, products=gated, duration_s=1.0, noise="none",
    )  # fmt: skip
    free, room = (range_gate(recipe, sample(recipe, index)) for index in (0, 1))
    assert free == (0.3, 7.5)  # 5 m, 2 m of path and half a metre of body
    low, high, _ = scene_extent("empty_room")
    corner_m = np.linalg.norm([max(-low[0], high[0]), max(-low[1], high[1]), high[2] - 1.0])
    assert room == (0.3, pytest.approx(corner_m, abs=1e-3))

    made = make_sample(recipe, {}, 0)
    assert made.record["products"]["spectrogram"]["range_gate_m"] == list(free)
    by_samples = run(sample(recipe, 0).experiment, device="cpu")
    shown = view(by_samples, recipe, 0, free)
    assert shown is not None
    levels, told = SpectrogramProduct(size=(32, 32)).made(shown)
    above = levels > -90  # below, it is rounding
    assert np.abs(made.arrays["spectrogram"].astype(float) - levels)[above].max() < 0.1
    assert told["peak_db"] == pytest.approx(made.record["products"]["spectrogram"]["peak_db"], abs=1e-3)


def test_a_recipe_without_a_gate_has_the_hash_of_before() -> None:
    assert "range_gate_m" not in Products().model_dump()["spectrogram"]
    with pytest.raises(InputError, match="nearest and farthest"):
        SpectrogramProduct(range_gate_m=(3.0, 1.0))
