"""Pictures of results: shown by notebooks, drawn into axes of one's own, on given levels; the maps that they draw."""

from __future__ import annotations

import io
import math
import pickle
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from builders import slow_after, small_room
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.plots import plot_scene
from t2d_rt.recording.recording import Recording
from t2d_rt.signal import coherent_interval, range_doppler, range_time, spectrogram
from t2d_rt.types import Radar

TABLE2 = Radar.preset("table2")
WATTS = 1e-9
KINDS = "plot", "plot_range_time", "plot_range_doppler"


def cube(
    radar: Radar, range_m: float, speed_mps: float, *, static_m: float | None = None, chirps: int = 2048
) -> np.ndarray:
    """Samples of a point of 1e-9 W that starts at a range and approaches, and of a still one of 1e-7 W."""
    starts, fast = radar.chirp_starts_s(chirps)[:, None], radar.sample_times_s

    def echo(distance_m: np.ndarray, watts: float) -> np.ndarray:
        delay = 2 * distance_m / 299_792_458
        phase = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * fast - delay**2 / 2)
        return np.sqrt(watts) * np.exp(2j * np.pi * phase)

    samples = echo(range_m - speed_mps * (starts + fast), WATTS)
    if static_m is not None:
        samples = samples + echo(np.full_like(starts + fast, static_m), 100 * WATTS)
    return samples[:, None, :].astype(np.complex64)


@pytest.fixture(scope="module")
def walker() -> Recording:
    """A point on a bin's middle at 0.1 s, at 2 m/s, before a still one 20 dB stronger."""
    bins = 50 * TABLE2.range_resolution_m
    samples = cube(TABLE2, bins + 0.2, 2.0, static_m=80 * TABLE2.range_resolution_m)
    return Recording(samples, TABLE2, processing={"mti": "mean"})


# --- the maps -------------------------------------------------------------------------------------------------------


def test_range_over_time_reads_place_and_power(walker: Recording) -> None:
    image = walker.range_time
    assert image.dims == ("range_m", "time_s")
    assert (image.attrs["units"], image.range_m.attrs["units"], image.time_s.attrs["units"]) == ("dB re 1 W", "m", "s")
    np.testing.assert_allclose(image.time_s, walker.spectrogram.time_s)
    expected = 50 * TABLE2.range_resolution_m + 0.2 - 2.0 * image.time_s.values
    found = image.range_m.values[image.values.argmax(axis=0)]
    assert np.abs(found - expected).max() < 0.6 * TABLE2.range_resolution_m
    # Half a bin off the peak a Hann window loses 1.4 dB.
    assert image.values.max() == pytest.approx(10 * math.log10(WATTS), abs=0.3)
    assert image.values.max(axis=0).min() > 10 * math.log10(WATTS) - 1.7
    # The still point is 20 dB stronger, but for the MTI.
    static = image.values[80]
    assert static.max() < 10 * math.log10(WATTS) - 30
    assert walker.processed(mti="none").range_time.values[80] == pytest.approx(10 * math.log10(100 * WATTS), abs=0.1)


def test_range_and_speed_of_an_interval(walker: Recording) -> None:
    image = walker.range_doppler_at(0.1)
    assert image.dims == ("velocity_mps", "range_m")
    assert image.attrs["time_s"] == pytest.approx(0.1, abs=1 / TABLE2.prf_hz)
    assert image.attrs["interval_s"] == pytest.approx(256 / TABLE2.prf_hz)
    row, column = np.unravel_index(image.values.argmax(), image.shape)
    assert image.velocity_mps[row] == pytest.approx(2.0, abs=TABLE2.speed_resolution_mps(0.025))
    assert column == 50
    assert image.values.max() == pytest.approx(10 * math.log10(WATTS), abs=1.5)
    assert image.values[:, 80].max() < 10 * math.log10(WATTS) - 25
    longer = walker.range_doppler_at(0.1, interval_s=0.05)
    assert longer.sizes["velocity_mps"] == 512


def test_the_default_interval_is_the_middle_and_the_ends_are_moved_inside(walker: Recording) -> None:
    assert walker.range_doppler_at().attrs["time_s"] == pytest.approx(0.1, abs=1e-3)
    assert walker.range_doppler_at(0.0).attrs["time_s"] == pytest.approx(0.0125)
    assert walker.range_doppler_at(0.1999).attrs["time_s"] == pytest.approx(0.2 - 0.0125, abs=1e-3)
    with pytest.raises(InputError, match=r"time_s must lie in 0\.\..* s, got 3"):
        walker.range_doppler_at(3.0)
    with pytest.raises(InputError, match="interval of 3072 chirps does not fit into the record of 2048"):
        walker.range_doppler_at(interval_s=0.3)
    with pytest.raises(InputError, match="interval_s must be positive"):
        walker.range_doppler_at(interval_s=0)


def test_bursts_keep_their_intervals() -> None:
    radar = Radar.preset("table2-burst")
    result = Recording(cube(radar, 3.0, 2.0, chirps=384), radar)
    for time_s, middle_s in ((0.0, 0.0025), (0.101, 0.1025), (0.19, 0.2025)):
        image = result.range_doppler_at(time_s)
        assert image.attrs["time_s"] == pytest.approx(middle_s, abs=1e-4)
        assert image.velocity_mps.values[image.values.max(axis=1).argmax()] == pytest.approx(2.0, abs=0.4)
    assert result.range_time.time_s.values == pytest.approx([0.0025, 0.1025, 0.2025], abs=1e-4)
    with pytest.raises(InputError, match="interval of 256 chirps does not fit into a burst of 128"):
        result.range_doppler_at(interval_s=0.01)


@pytest.mark.parametrize(("preset", "watts"), [("array-3x4", WATTS), ("automotive-79", WATTS / 3)])
def test_arrays(preset: str, watts: float) -> None:
    """Powers are averaged over the virtual antennas; of these echoes only one of three transmitters that share Doppler has sent."""
    radar = Radar.preset(preset)
    one = cube(radar.replace(tx_offsets_m=(0, 0, 0), multiplexing="simultaneous"), 3.0, 1.0, chirps=1023)
    rows = one[::3] if radar.multiplexing == "tdm" else one
    result = Recording(np.repeat(rows, radar.antennas, axis=1), radar)
    assert result.range_time.values.shape[1] == result.spectrogram.sizes["time_s"]
    image = result.range_doppler_at()
    assert image.values.max() == pytest.approx(10 * math.log10(watts), abs=1.5)
    assert result.range_time.values.max() == pytest.approx(10 * math.log10(watts), abs=1.5)
    speed = image.velocity_mps.values[image.values.max(axis=1).argmax()]
    assert speed == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("mti", ["none", "mean", "highpass", "canceller"])
def test_long_records_are_worked_on_in_pieces(monkeypatch: pytest.MonkeyPatch, mti: str) -> None:
    samples = cube(TABLE2, 4.0, 2.0, static_m=6.0)
    before = samples.copy()
    options: Any = {"mti": mti, "cutoff_mps": 0.3}

    def maps() -> tuple[np.ndarray, np.ndarray, float]:
        part, _, middle_s = coherent_interval(samples, TABLE2, time_s=0.12, chirps=64, **options)
        return range_time(samples, TABLE2, n_window=64, **options).power, part, middle_s

    power, part, middle_s = maps()
    monkeypatch.setattr("t2d_rt.signal.doppler.PIECE", 1)
    for _ in range(2):
        again = maps()
        np.testing.assert_allclose(again[0], power, rtol=1e-3, atol=1e-14)
        np.testing.assert_allclose(again[1], part, atol=1e-9)
        assert again[2] == middle_s
    np.testing.assert_array_equal(samples, before)


def test_range_over_time_and_the_spectrogram_hold_the_same_power() -> None:
    """Parseval: the mean power of a column, over its ranges or over its speeds."""
    rng = np.random.default_rng(3)
    shape = (1024, 2, TABLE2.samples)
    samples = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    ranges = range_time(samples, TABLE2, range_window="boxcar")
    speeds = spectrogram(samples, TABLE2, range_window="boxcar", window="boxcar")
    np.testing.assert_allclose(ranges.power.sum(axis=0), speeds.power.sum(axis=0), rtol=1e-4)
    np.testing.assert_allclose(ranges.time_s, speeds.time_s)


def test_an_interval_of_the_whole_record_is_its_map() -> None:
    samples = cube(TABLE2, 3.0, 2.0, chirps=300)
    part, radar, middle_s = coherent_interval(samples, TABLE2, chirps=300)
    assert middle_s == pytest.approx(150 / TABLE2.prf_hz)
    np.testing.assert_array_equal(range_doppler(part, radar).power, range_doppler(samples, TABLE2).power)


# --- the pictures ---------------------------------------------------------------------------------------------------


def colours(figure: Figure | Axes) -> Any:
    axes = figure.axes[0] if isinstance(figure, Figure) else figure
    return axes.collections[0]


@pytest.mark.parametrize("kind", slow_after(1, KINDS))
def test_a_notebook_shows_the_picture(walker: Recording, kind: str) -> None:
    formatters = pytest.importorskip("IPython.core.formatters", reason="IPython is not installed")
    figure = getattr(walker, kind)()
    shown, _ = formatters.DisplayFormatter().format(figure)
    picture = Image.open(io.BytesIO(shown["image/png"]))
    assert picture.size == tuple(round(160 * inches) for inches in figure.get_size_inches())
    assert len(set(picture.convert("RGB").resize((64, 64)).get_flattened_data())) > 20


def test_a_figure_can_be_kept(walker: Recording) -> None:
    figure = pickle.loads(pickle.dumps(walker.plot()))
    assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("kind", "across", "up", "dims"),
    [
        ("plot", "Time [s]", "Radial velocity [m/s], approaching > 0", ("time_s", "velocity_mps")),
        ("plot_range_time", "Time [s]", "Range [m]", ("time_s", "range_m")),
        ("plot_range_doppler", "Range [m]", "Radial velocity [m/s], approaching > 0", ("range_m", "velocity_mps")),
    ],
)
def test_axes_have_names_units_and_the_places_of_the_target(
    walker: Recording, kind: str, across: str, up: str, dims: tuple[str, str]
) -> None:
    figure = getattr(walker, kind)("A title", dynamic_range_db=40)
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) == (across, up, "A title")
    assert bar.get_ylabel() == "Power rel. to peak [dB]"
    assert colours(figure).get_clim() == (-40, 0)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    image = {"plot": walker.spectrogram, "plot_range_time": walker.range_time}.get(kind, walker.range_doppler_at())
    peak = image.where(image == image.max(), drop=True)
    assert left <= float(peak[dims[0]][0]) <= right
    assert low <= float(peak[dims[1]][0]) <= high
    # No more than where there is anything, with a margin.
    assert high < 10
    if "range" in kind:
        assert (right if kind == "plot_range_doppler" else high) < 8
        assert left > 2 if kind == "plot_range_doppler" else low == 0


@pytest.mark.parametrize("kind", slow_after(1, KINDS))
def test_levels_may_be_given(walker: Recording, kind: str) -> None:
    figure = getattr(walker, kind)(limits_db=(-130, -95), cmap="magma")
    assert colours(figure).get_clim() == (-130, -95)
    assert colours(figure).cmap.name == "magma"
    assert figure.axes[1].get_ylabel() == "Power [dB re 1 W]"
    # Absolute levels: the colours of the peak are those of 1e-9 W = -90 dB.
    assert colours(figure).get_array().max() == pytest.approx(-90, abs=1.7)
    dark = getattr(walker, kind)(limits_db=(0, 10))
    assert np.ptp(colours(dark).get_array()) == 0


@pytest.mark.parametrize("kind", slow_after(1, KINDS))
def test_axes_of_a_figure_of_ones_own(walker: Recording, kind: str) -> None:
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert getattr(walker, kind)("mine", ax=right) is right
    assert right.get_title() == "mine"
    assert not left.collections
    assert len(right.collections) == 1
    figure.draw_without_rendering()


def test_a_grid_of_pictures_has_room_for_its_labels(walker: Recording) -> None:
    figure = Figure(figsize=(7.0, 4.0))
    renderer = FigureCanvasAgg(figure).get_renderer()
    for number, axes in enumerate(figure.subplots(2, 2).flat):
        walker.plot(f"number {number}", ax=axes, bar=number == 1, limits_db=(-140, -90))
    figure.draw_without_rendering()
    boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
    assert len(boxes) == 5  # four maps and one colour bar
    for place, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:place])
    assert {axes.collections[0].get_clim() for axes in figure.axes[:4]} == {(-140, -90)}


@pytest.mark.parametrize(("kind", "size"), slow_after(1, [("plot", (3.5, 2.29)), ("plot_range_doppler", (3.5, 3.17))]))
def test_a_column_of_a_paper(walker: Recording, kind: str, size: tuple[float, float], tmp_path: Path) -> None:
    figure = getattr(walker, kind)("walk", width_in=3.5)
    assert tuple(figure.get_size_inches()) == pytest.approx(size, abs=0.01)
    assert figure.axes[0].get_ylabel() == "Radial velocity [m/s]"  # the longer label has no room
    figure.savefig(tmp_path / "walk.pdf")
    text = (tmp_path / "walk.pdf").read_bytes()
    assert b"/FontType 3" not in text
    assert b"/TrueType" in text or b"/CIDFontType2" in text
    figure.savefig(tmp_path / "walk.svg")
    assert "Radial velocity [m/s]" in (tmp_path / "walk.svg").read_text()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"width_in": 0.1}, "width_in must lie in 2..40 inch, got 0.1; 3.5 is a column of a paper"),
        ({"bar": 1}, "bar must be True or False"),
        ({"ax": 3}, "ax must be axes of a figure of Matplotlib, got 3"),
        ({"ax": Figure().add_subplot(projection="3d")}, "ax must be flat"),
        ({"cmap": "mauve"}, "cmap must be the name of a colour map"),
        ({"limits_db": (-10, -50)}, "limits_db must be two numbers, least and greatest, in dB re 1 W"),
        ({"limits_db": (-10, -10)}, "limits_db must be two levels, the lower one first"),
        ({"limits_db": 3}, "limits_db must be two numbers"),
        ({"dynamic_range_db": -1}, "dynamic_range_db must be positive"),
        ({"title": 3}, "title must be a text"),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_what_cannot_be_drawn(walker: Recording, kind: str, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        getattr(walker, kind)(**options)


def test_a_scene_is_drawn_into_axes_of_ones_own() -> None:
    figure = Figure(figsize=(9, 4))
    own = figure.subplots(1, 2)[1]
    options: Any = {"paths_m": [("over the wall", np.array([[0, 0, 1], [2, 1.5, 1], [3, 0, 1]]))], "title": "mine"}
    assert plot_scene(small_room(), np.array([0.0, 0.5, 1.0]), ax=own, **options) is own
    assert (own.get_title(), own.get_xlabel(), own.get_ylabel()) == ("mine", "x [m]", "y [m]")
    assert [text.get_text() for text in own.get_legend().get_texts()] == ["over the wall", "radar"]
    path, radar = own.lines
    assert (path.get_xdata().tolist(), radar.get_ydata().tolist()) == ([0, 2, 3], [0.5])
    assert len(figure.axes) == 2
    plan, view = plot_scene(small_room(), np.array([0.0, 0.5, 1.0]), **options).axes
    assert (view.name, [len(axes.collections) for axes in (plan, view)]) == ("3d", [len(own.collections)] * 2)
    with pytest.raises(InputError, match="ax must be axes of a figure of Matplotlib, got 3"):
        plot_scene(small_room(), np.zeros(3), ax=cast(Any, 3))


def test_one_column_is_drawn_with_a_width_and_told() -> None:
    record = Recording(cube(TABLE2, 4.0, 2.0, chirps=85), TABLE2)
    with pytest.warns(T2DWarning, match=r"room for one column, at 0.00415 s: the picture shows no change in time"):
        axes = record.plot().axes[0]
    assert axes.get_xlim() == pytest.approx((0.0, 85 * TABLE2.loop_interval_s))
    mesh = axes.collections[0]
    assert mesh.get_array().shape[1] == 2
    assert mesh.get_array().max() == 0.0
