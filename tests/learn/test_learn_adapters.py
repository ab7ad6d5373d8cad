"""Adapters of real data, on small files that are made here."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dataset_folder import recipe, write_dataset
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.learn.adapters import AdapterOptions, read_real
from t2d_rt.learn.adapters.parrad import BINS, FOUR, ROWS, ZERO_BIN

COMMANDS = ["walk to bed", "sit down on bed", "walk to room", "fall on floor of room"]
CLASSES = {label: FOUR[label] for label in COMMANDS}
DELAY = 20
"""Rows from a command to the motion."""


def parrad(path: Path, **changes: np.ndarray) -> Path:
    """Four commands 50 rows apart; each motion lights one bin of its own for 30 rows, 24 rows after the command."""
    rng = np.random.default_rng(0)
    starts = 50 * np.arange(4)
    found = {name: 64 * (77.0 + rng.normal(0, 1, (400, BINS))) for name in ("wr14", "wr68")}
    for number, start in enumerate(starts):
        for name, sign in (("wr14", 1), ("wr68", -1)):
            found[name][start + DELAY + 4 : start + DELAY + 34, ZERO_BIN + sign * (8 + 2 * number)] += 64 * 20
    for each in found.values():
        each[:, ZERO_BIN - 1 : ZERO_BIN + 2] += 64 * 50  # static echoes
    values = {
        **found, "starts": starts, "stops": starts + 50, "labels": np.array(COMMANDS), "row_s": np.array(0.09), **changes,
    }  # fmt: skip
    np.savez(path, **values)
    return path


def test_parrad_gives_each_event_by_both_radars_aligned_with_its_motion(tmp_path: Path) -> None:
    found = read_real(parrad(tmp_path / "real.npz"), "parrad", AdapterOptions(classes=CLASSES))
    maps = found.maps
    assert maps.classes == ("walk", "sit or stand", "fall")
    assert maps.counts.tolist() == [4, 2, 2]
    assert maps.levels.shape == (8, BINS, ROWS)
    assert maps.levels.max() == 0.0
    assert maps.groups["event"].tolist() == [f"event {n}" for n in (0, 0, 1, 1, 2, 2, 3, 3)]
    assert maps.groups["radar"].tolist() == ["wr14", "wr68"] * 4
    assert len(found.sha256) == 64
    assert "imec" in found.licence
    for place in range(8):
        speed, time = np.unravel_index(np.argmax(maps.levels[place]), maps.levels[place].shape)
        assert speed == ZERO_BIN + (1, -1)[place % 2] * (8 + 2 * (place // 2))  # of this event, not of its neighbour
        lit = maps.levels[place][speed] > -6
        assert lit.sum() >= 28
        assert 0 <= time < ROWS
        before = ZERO_BIN + (1, -1)[place % 2] * (6 + 2 * (place // 2))
        assert maps.levels[place][before].max() < -6  # nothing of the motion before
    # Static echoes are 50 dB above the noise, and no greatest cell.
    assert maps.levels[:, ZERO_BIN].max() < -10


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"labels": np.array(COMMANDS[:3])}, "give one row for each label"),
        ({"wr14": np.full((400, BINS), np.nan)}, "NaN or infinite"),
        ({"wr68": np.zeros((300, BINS))}, "400 and 300 rows of its radars"),
        ({"starts": np.array([0, 70, 70, 210])}, "starts must ascend"),
        ({"starts": np.array([0.5, 50, 100, 150])}, "starts must be numbers of rows"),
        ({"stops": np.array([0, 50, 100, 150])}, "each before its stop"),
        ({"wr14": np.array(1.0)}, "wr14 of .* must have shape"),
        ({"wr14": np.full((400, BINS), 1j)}, "must hold real numbers"),
        ({"wr14": np.full((400, BINS), "x")}, "wr14 of .* must"),
        ({"wr14": np.zeros((400, BINS))}, "same level in all cells"),
        ({"wr14": np.zeros((50, BINS)), "wr68": np.zeros((50, BINS))}, "50 and 50 rows"),
        ({"labels": np.array("walk to bed")}, "labels must be texts"),
        ({"labels": np.arange(4)}, "labels must be texts"),
    ],
)
def test_parrad_refuses(tmp_path: Path, changes: dict[str, np.ndarray], told: str) -> None:
    with pytest.raises(InputError, match=told):
        read_real(parrad(tmp_path / "real.npz", **changes), "parrad", AdapterOptions(classes=CLASSES))


def test_parrad_refuses_unknown_classes_and_other_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no class 'stand up from bed'"):
        read_real(parrad(tmp_path / "real.npz"), "parrad", AdapterOptions(classes={"stand up from bed": "stand up"}))
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(InputError, match="lacks wr14"):
        read_real(tmp_path / "other.npz", "parrad")
    with pytest.raises(InputError, match="does not exist"):
        read_real(tmp_path / "none.npz", "parrad")
    with pytest.raises(InputError, match="unknown adapter 'parad'; did you mean parrad"):
        read_real(tmp_path / "other.npz", "parad")


def test_parrad_reads_labels_that_are_bytes(tmp_path: Path) -> None:
    path = parrad(tmp_path / "real.npz", labels=np.array(COMMANDS).astype("S"))
    assert read_real(path, "parrad", AdapterOptions(classes=CLASSES)).maps.counts.tolist() == [4, 2, 2]


def radhar(folder: Path, name: str, speed: float, frames: int = 45, speeds: Sequence[float] = ()) -> None:
    """Two points a frame; `speeds` are those of the frames' points in place of one."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for frame in range(frames):
        speed = speeds[frame % len(speeds)] if speeds else speed
        for point in range(2):
            lines += [
                "header: ", "  stamp: ", f"    secs: {1000 + frame // 10}", f"    nsecs: {frame % 10 * 100_000_000}",
                f"point_id: {point}", "x: 1.0", f"velocity: {speed}", "intensity: 12.0", "---",
            ]  # fmt: skip
    (folder / name).write_text("\n".join(lines))


def test_point_clouds_give_windows_of_power_over_speed_and_time(tmp_path: Path) -> None:
    radhar(tmp_path / "walk", "a.txt", -1.0)  # the range falls: it approaches
    radhar(tmp_path / "jack", "b.txt", 2.0)
    options = AdapterOptions(size=(32, 16), speed_mps=4.0, duration_s=2.0)
    maps = read_real(tmp_path, "radhar", options).maps
    assert maps.classes == ("jack", "walk")
    assert maps.counts.tolist() == [2, 2]
    assert set(maps.groups["event"]) == {"walk/a.txt", "jack/b.txt"}
    for level, label in zip(maps.levels, maps.labels, strict=True):
        speed = maps.velocity_mps[np.unravel_index(np.argmax(level), level.shape)[0]]
        assert abs(speed - (1.0 if label == 1 else -2.0)) <= 0.25
    with pytest.raises(InputError, match=r"up to 2 m/s, 50 % of them beyond the axis of 1\.5 m/s; raise speed_mps"):
        read_real(tmp_path, "radhar", replace(options, speed_mps=1.5))
    radhar(tmp_path / "walk", "c.txt", -1.0, frames=15)
    with pytest.warns(T2DWarning, match=r"1 of 3 files of .* are shorter than a map of 2 s and give none"):
        assert read_real(tmp_path, "radhar", options).maps.counts.tolist() == [2, 2]
    (tmp_path / "walk" / "c.txt").unlink()
    later = (tmp_path / "walk" / "a.txt").read_text().replace("secs: 1004", "secs: 1009")
    (tmp_path / "walk" / "a.txt").write_text(later)  # five seconds without a point: two windows show nothing
    gapped = read_real(tmp_path, "radhar", options).maps
    assert gapped.counts.tolist() == [2, 2]
    assert gapped.levels.min(axis=(1, 2)).max() < -10
    (tmp_path / "walk" / "a.txt").write_text(later.replace("secs: 1009", "secs: 1e12"))
    with pytest.raises(InputError, match="by its stamps, 86400 s are read at most"):
        read_real(tmp_path, "radhar", options)
    (tmp_path / "jack" / "b.txt").write_text("point_id: 0\nvelocity: nan\n")
    with pytest.raises(InputError, match="must hold records"):
        read_real(tmp_path, "radhar", options)


def test_single_points_beyond_the_axis_are_counted_and_left_out(tmp_path: Path) -> None:
    radhar(tmp_path / "walk", "a.txt", 0.0, frames=1500, speeds=[*[-1.0] * 1499, -31.0])
    radhar(tmp_path / "jack", "b.txt", 2.0)
    options = AdapterOptions(size=(32, 16), speed_mps=4.0, duration_s=2.0)
    with pytest.warns(T2DWarning, match=r"2 of 3090 points of .* are faster than 4 m/s and were left out"):
        maps = read_real(tmp_path, "radhar", options).maps
    assert maps.counts.tolist() == [2, 74]
    radhar(tmp_path / "jack", "b.txt", 5.0, frames=1)
    with pytest.raises(InputError, match="raise speed_mps"):
        read_real(tmp_path, "radhar", options)


def test_points_fill_the_doppler_cells_of_their_device(tmp_path: Path) -> None:
    """Of a device that tells multiples of 0.6 m/s no row between two of its speeds is empty."""
    speeds = (0.6 * np.arange(-4, 5)).round(3).tolist()
    radhar(tmp_path / "walk", "a.txt", 0.0, speeds=speeds)
    radhar(tmp_path / "jack", "b.txt", 1.2)
    options = AdapterOptions(size=(64, 8), speed_mps=3.2, duration_s=2.0)
    maps = read_real(tmp_path, "radhar", options).maps
    level = (10 ** (maps.levels[maps.labels == 1] / 10)).mean(axis=(0, 2))
    speed = np.abs(maps.velocity_mps)
    assert level[speed < 2.55].min() > 0.3 * level.max()
    assert level[speed > 2.8].max() < 1e-3


@pytest.mark.parametrize("adapter", ["png", "ci4r"])
def test_pictures_are_read_by_colour(tmp_path: Path, adapter: str) -> None:
    import matplotlib
    from PIL import Image

    levels = np.linspace(0, 1, 24)[:, None] * np.ones((24, 16))  # the top row is black: the fastest are least
    for name in ("walk", "fall"):
        (tmp_path / name).mkdir()
        table = matplotlib.colormaps["jet" if adapter == "ci4r" else "gray"](levels)
        Image.fromarray((table * 255).astype(np.uint8)[:, :, :3]).save(tmp_path / name / "0.png")
    options = AdapterOptions(size=(24, 16), dynamic_range_db=45.0)
    maps = read_real(tmp_path, adapter, options).maps
    assert maps.classes == ("fall", "walk")
    assert len(maps) == 2
    expected = 45.0 * (levels[::-1] - 1.0)
    assert np.abs(maps.levels[0] - expected).max() < 0.5
    if adapter == "png":
        deep = (levels * 65535).astype(np.uint16)
        Image.fromarray(deep).save(tmp_path / "walk" / "0.png")
        assert np.abs(read_real(tmp_path, adapter, options).maps.levels[1] - expected).max() < 0.5
        coloured = (matplotlib.colormaps["viridis"](levels) * 255).astype(np.uint8)[:, :, :3]
        Image.fromarray(coloured).save(tmp_path / "walk" / "1.png")
        with pytest.raises(InputError, match=r"1\.png is in colours, whose grey does not tell the level"):
            read_real(tmp_path, adapter, options)
    if adapter == "ci4r":
        Image.fromarray(np.full((24, 16, 3), 255, np.uint8)).save(tmp_path / "walk" / "1.png")
        with pytest.raises(InputError, match="not those of the colour map jet"):
            read_real(tmp_path, adapter, options)


def test_folders_without_files_and_with_one_class_are_refused(tmp_path: Path) -> None:
    (tmp_path / "walk").mkdir()
    with pytest.raises(InputError, match=r"holds no \.png or .* files"):
        read_real(tmp_path, "png")
    (tmp_path / "walk" / "0.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="cannot read picture"):
        read_real(tmp_path, "png")
    np.savez(tmp_path / "x.npz", levels=np.zeros((2, 8, 8)), labels=["a", "b"])
    with pytest.raises(InputError, match="has no class 'run'"):
        read_real(tmp_path / "x.npz", "npz", AdapterOptions(classes={"run": "run"}))


def arrays(**changes: object) -> dict[str, Any]:
    levels = -40 * np.random.default_rng(0).random((4, 16, 12))
    own = {
        "group_event": np.array(["1", "1", "2", "3"]),
        "velocity_mps": np.linspace(-3, 3, 16),
        "duration_s": np.array(2.0),
    }
    return {"levels": levels, "labels": np.array(["a", "b", "a", "b"]), **own, **changes}


def test_npz_keeps_groups_and_axes(tmp_path: Path) -> None:
    np.savez(tmp_path / "maps.npz", **arrays())
    maps = read_real(tmp_path / "maps.npz", "npz", AdapterOptions(size=(16, 12))).maps
    assert maps.groups["event"].tolist() == ["1", "1", "2", "3"]
    assert maps.duration_s == 2.0
    np.testing.assert_allclose(maps.velocity_mps, arrays()["velocity_mps"])
    wanted = arrays()["levels"]
    assert np.abs(maps.levels - (wanted - wanted.max(axis=(1, 2), keepdims=True))).max() < 1e-4


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"velocity_mps": np.r_[-8:0:8j, 1:9:8j]}, "must ascend by equal steps"),
        ({"velocity_mps": np.linspace(3, -3, 16)}, "must ascend"),
        ({"velocity_mps": np.linspace(-1, 5, 16)}, "as far below 0 as above"),
        ({"velocity_mps": np.full(16, "x")}, "velocity_mps of .* must"),
        ({"velocity_mps": np.full(16, np.nan)}, "velocity_mps of .* must be finite"),
        ({"duration_s": np.ones(3)}, "duration_s of .* must have shape"),
        ({"duration_s": "x"}, "duration_s of .* must"),
        ({"levels": np.zeros((4, 16, 12))}, "same level in all cells"),
        ({"levels": np.full((4, 16, 12), -np.inf)}, "levels of .* must be finite"),
        ({"levels": np.full((4, 16, 12), np.nan)}, "NaN or infinite"),
        ({"levels": np.full((4, 16, 12), 5000.0)}, "must not exceed 1000 dB"),
        ({"levels": np.zeros((4, 16))}, "levels must have shape"),
        ({"labels": np.array(["a", "b"])}, "one text for each"),
        ({"group_event": np.array(["1"])}, "must name each"),
    ],
)
def test_arrays_of_wrong_shapes_and_values_are_refused(tmp_path: Path, changes: dict[str, object], told: str) -> None:
    np.savez(tmp_path / "maps.npz", **arrays(**changes))
    with pytest.raises(InputError, match=told):
        read_real(tmp_path / "maps.npz", "npz", AdapterOptions(size=(16, 12)))


def test_hdf5_reads_the_same_or_names_the_extra(tmp_path: Path) -> None:
    try:
        import h5py
    except ImportError:
        (tmp_path / "maps.h5").write_bytes(b"")
        with pytest.raises(InputError, match=r"pip install -e '.\[hdf5\]'"):
            read_real(tmp_path / "maps.h5", "hdf5")
        return
    with h5py.File(tmp_path / "maps.h5", "w") as file:
        for name, each in arrays().items():
            file[name] = each.astype("S") if each.dtype.kind == "U" else each
    maps = read_real(tmp_path / "maps.h5", "hdf5", AdapterOptions(size=(16, 12))).maps
    assert maps.classes == ("a", "b")
    assert maps.groups["event"].tolist() == ["1", "1", "2", "3"]


def test_each_form_is_read_through_one_door_by_its_card(tmp_path: Path) -> None:
    """A card tells what the files do not: labels, width of cells, columns a second, and which way positive speeds go."""
    found = arrays()
    del found["velocity_mps"], found["duration_s"]
    np.savez(tmp_path / "maps.npz", **found)
    options = AdapterOptions(size=(16, 12))
    plain = read_real(tmp_path / "maps.npz", options=options)
    assert plain.adapter == "npz"
    card = tmp_path / "maps.npz.card.yaml"
    card.write_text(
        "classes: {a: walk, b: fall}\ncell_mps: 0.5\nrate_hz: 4\npositive: receding\ncarrier_hz: 60.0e+9\nmti: none\n"
    )
    real = read_real(tmp_path / "maps.npz", options=options)
    assert (real.carrier_hz, real.mti, real.maps.classes) == (60e9, "none", ("walk", "fall"))
    assert real.maps.duration_s == 3.0
    np.testing.assert_allclose(real.maps.velocity_mps[[0, -1]], [-3.75, 3.75])
    np.testing.assert_allclose(real.maps.levels, plain.maps.levels[:, ::-1])
    slow = read_real(tmp_path / "maps.npz", options=replace(options, size=(8, 12), cut_mps=(-2.0, 2.0))).maps
    np.testing.assert_allclose(slow.velocity_mps, real.maps.velocity_mps[4:12])
    middle = real.maps.levels[:, 4:12]
    np.testing.assert_allclose(slow.levels, middle - middle.max(axis=(1, 2), keepdims=True), atol=1e-4)
    with pytest.raises(InputError, match=r"shows -4 to 4 m/s, and -5 to 5 m/s are wanted"):
        read_real(tmp_path / "maps.npz", options=replace(options, cut_mps=(-5.0, 5.0)))
    for text, told in (("sign: 1", "unknown name in .*card.yaml"), ("positive: up", "card.yaml: positive must be")):
        card.write_text(text)
        with pytest.raises(InputError, match=told):
            read_real(tmp_path / "maps.npz", options=options)
    radhar(tmp_path / "points" / "walk", "a.txt", -1.0)
    radhar(tmp_path / "points" / "jack", "b.txt", 2.0)
    (tmp_path / "points" / "card.yaml").write_text("speed_mps: 4\nduration_s: 2\npositive: approaching\n")
    points = read_real(tmp_path / "points", options=options).maps
    walks = points.levels[points.labels == 1].mean(axis=(0, 2))
    assert -1.5 < points.velocity_mps[walks.argmax()] < -0.5  # as the file tells it
    assert read_real(parrad(tmp_path / "real.npz"), options=AdapterOptions(classes=CLASSES)).adapter == "parrad"
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="is no data that an adapter reads"):
        read_real(tmp_path / "empty")


def test_a_card_may_not_contradict_the_file_beside_it(tmp_path: Path) -> None:
    np.savez(tmp_path / "maps.npz", **{name: arrays()[name] for name in ("levels", "labels")})
    bare = read_real(tmp_path / "maps.npz")
    assert bare.assumed == ("speeds", "duration")
    np.savez(tmp_path / "maps.npz", **arrays(duration_s=2.0, velocity_mps=np.linspace(-3.75, 3.75, 16)))
    own = read_real(tmp_path / "maps.npz")
    assert own.assumed == ()
    card = tmp_path / "maps.npz.card.yaml"
    for text, told in (
        ("speed_mps: 6.4", "itself tells speeds of 4 m/s, the card beside it 6.4 m/s; correct one of them"),
        ("cell_mps: 0.1", "speeds of 4 m/s, the card beside it 0.8 m/s"),
        ("rate_hz: 24", "itself tells duration of 2 s, the card beside it 0.5 s"),
    ):
        card.write_text(text)
        with pytest.raises(InputError, match=told):
            read_real(tmp_path / "maps.npz")
    card.write_text("speed_mps: 4.0\nrate_hz: 6.0\ncarrier_hz: 60.0e+9\n")
    assert read_real(tmp_path / "maps.npz").sha256 != own.sha256  # what a card tells is a part of the data


def test_a_card_may_not_contradict_the_recipe_of_a_data_set(tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "data")
    assert (read_real(data).carrier_hz, read_real(data).mti) == (77e9, "mean")
    for text, told in (
        ("carrier_hz: 24.0e+9", "tells a carrier of 24 GHz, the recipe 77 GHz; correct the card"),
        ("mti: none", "tells mti none, the recipe mean; correct the card"),
        ("positive: receding", "tells positive, which a data set tells itself; leave them out"),
    ):
        (data / "card.yaml").write_text(text)
        with pytest.raises(InputError, match=told):
            read_real(data)


def test_a_data_set_of_our_own_goes_through_the_same_door(tmp_path: Path) -> None:
    data = write_dataset(
        tmp_path / "data", recipe(descriptions_per_class=2, products={"spectrogram": {"size": [24, 24]}})
    )
    own = read_real(data, options=AdapterOptions(size=(16, 16)))
    assert own.adapter == "dataset"
    assert len(set(own.maps.groups["event"])) == len(own.maps)
    first, *_ = own.maps.classes
    classes = {each: "x" if each == first else "y" for each in own.maps.classes}
    some = read_real(data, options=AdapterOptions(size=(16, 16), classes=classes))
    assert some.maps.classes == ("x", "y")
    assert some.maps.counts[0] == own.maps.counts[0]


def test_a_black_picture_with_some_coloured_lines_is_not_grey(tmp_path: Path) -> None:
    from PIL import Image

    pixels = np.zeros((100, 50, 3), np.uint8)
    pixels[40:43] = (255, 40, 0)
    for name in ("walk", "fall"):
        (tmp_path / name).mkdir()
        Image.fromarray(pixels).save(tmp_path / name / "0.png")
    with pytest.raises(InputError, match="is in colours, whose grey does not tell the level"):
        read_real(tmp_path, "png")


@pytest.mark.slow
def test_a_day_of_points_is_read_without_holding_its_maps(tmp_path: Path) -> None:
    """Maps of 0.5 s; each takes 16 kB, and memory grows by that of the points alone."""
    count = 4000
    radhar(tmp_path / "walk", "a.txt", -1.0, frames=5 * count)
    radhar(tmp_path / "jack", "b.txt", 2.0)
    options = AdapterOptions(speed_mps=4.0, duration_s=0.5)
    tracemalloc.start()
    maps = read_real(tmp_path, options=options).maps
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert maps.counts[1] == count - 1
    assert most < 0.4 * maps.levels.nbytes
