"""The clock of a file: its times against its stated rate, uneven and lost frames, and what gravity says of the rate."""

from __future__ import annotations

import math
import struct
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import MOTIONS, WALK, slow_after
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, motion_from_joints
from t2d_rt.motion.check.gait import rate_doubt
from t2d_rt.types.motion import Motion
from validation.motions import independent

RATE_HZ = 60.0


@pytest.fixture(scope="module")
def walk() -> Motion:
    return t2d.trim(t2d.resample(load_motion(WALK), RATE_HZ), 0.5, 4.3)


def npz(folder: Path, motion: Motion, frames: np.ndarray | slice = slice(None), **fields: object) -> Path:
    np.savez(folder / "a.npz", joints=motion.joints[frames], names=np.array(motion.names), **fields)  # type: ignore[arg-type]
    return folder / "a.npz"


def speed_mps(motion: Motion) -> float:
    return float(np.linalg.norm(np.diff(motion.joints[:, 0, :2], axis=0), axis=-1).sum() / motion.duration_s)


def times_s(motion: Motion) -> np.ndarray:
    return np.arange(len(motion.joints)) / RATE_HZ


# --- times against the stated rate ---


@pytest.mark.parametrize(
    ("name", "per_s"),
    slow_after(
        4,
        [
            ("timestamps", 1.0), ("times_s", 1.0), ("t", 1e3), ("time_ms", 1e3), ("time", 1e6), ("timestamps", 1e7),
            ("timestamps_ns", 1e9), ("timestamp", 1e9), ("ts", 1.0), ("Elapsed_Time", 1.0), ("TimeStamps_msec", 1e3),
        ],
    ),
)  # fmt: skip
def test_times_in_any_unit_give_the_rate(tmp_path: Path, walk: Motion, name: str, per_s: float) -> None:
    since = 1.7e9 if name != "t" else 0.0
    ticks = np.round((since + times_s(walk)) * per_s).astype(np.int64) if per_s > 1 else 5.0 + times_s(walk)
    for stated in ({}, {"fps": RATE_HZ}):
        motion = load_motion(npz(tmp_path, walk, **{name: ticks}, **stated), smooth_hz=None)
        assert motion.rate_hz == pytest.approx(RATE_HZ, rel=2e-3)
        assert len(motion.joints) == len(walk.joints)
        assert f"rate by its {name}" in motion.report
        assert "assumed" not in motion.report
    with pytest.warns(
        T2DWarning,
        match=rf"fps of 25 Hz contradicts {name}, whose steps of 1\d(\.\d+)? ms are (60|58.8|59.\d+) Hz, which is taken",
    ):
        assert load_motion(npz(tmp_path, walk, **{name: ticks}, fps=25), smooth_hz=None).rate_hz == pytest.approx(
            RATE_HZ, rel=2e-3
        )


@pytest.mark.parametrize("digits", slow_after(1, [2, 3, 6]))
@pytest.mark.parametrize("rate_hz", [60.0, 120.0])
def test_rounded_times_of_a_trc_are_even(tmp_path: Path, walk: Motion, digits: int, rate_hz: float) -> None:
    walk = t2d.resample(walk, rate_hz)
    tracks = {name: walk.joints[:, place] @ independent.Y_UP.T for place, name in enumerate(walk.names)}
    text = independent.trc(tracks, rate_hz, "m")
    rows = text.splitlines()
    for line in range(6, len(rows)):
        frame, _, *cells = rows[line].split("\t")
        rows[line] = "\t".join([frame, f"{(int(frame) - 1) / rate_hz:.{digits}f}", *cells])
    (tmp_path / "a.trc").write_text("\n".join(rows))
    motion = load_motion(tmp_path / "a.trc", smooth_hz=None)
    assert motion.rate_hz == pytest.approx(rate_hz, rel=1e-3)
    assert len(motion.joints) == len(walk.joints)
    (tmp_path / "a.trc").write_text("\n".join(rows).replace(f"{rate_hz}\t{rate_hz}", "15\t15", 1))
    with pytest.warns(T2DWarning, match="DataRate of 15 Hz contradicts Time column"):
        assert load_motion(tmp_path / "a.trc").rate_hz == pytest.approx(rate_hz, rel=1e-3)
    with pytest.warns(T2DWarning, match="the rate of 15 Hz is too low"):
        assert load_motion(tmp_path / "a.trc", rate_hz=15).rate_hz == 15.0


@pytest.mark.parametrize("factor", [1.0, 0.0, np.nan])
def test_what_are_no_times_is_told(tmp_path: Path, walk: Motion, factor: float) -> None:
    motion = load_motion(npz(tmp_path, walk, fps=RATE_HZ, t=factor * np.arange(len(walk.joints))), smooth_hz=None)
    assert motion.rate_hz == RATE_HZ
    assert "its clock (t) tells no rate" in motion.report


def test_times_as_text_are_read_and_those_that_run_backward_turn_the_frames(tmp_path: Path, walk: Motion) -> None:
    times = times_s(walk)
    expected = load_motion(npz(tmp_path, walk, times=times), smooth_hz=None)
    text = load_motion(npz(tmp_path, walk, times=np.array([f"{time:.6f}" for time in times])), smooth_hz=None)
    np.testing.assert_array_equal(text.joints, expected.joints)
    with pytest.warns(T2DWarning, match="its clock .times. runs backward"):
        turned = load_motion(npz(tmp_path, walk, slice(None, None, -1), times=times[::-1]), smooth_hz=None)
    assert turned.rate_hz == RATE_HZ
    np.testing.assert_allclose(turned.joints, expected.joints, atol=1e-9)


def test_times_of_other_frames_are_told_and_dates_are_times(tmp_path: Path, walk: Motion) -> None:
    with pytest.warns(T2DWarning, match="timestamps has 228 entries for 229 frames and is left unread"):
        load_motion(npz(tmp_path, walk, timestamps=times_s(walk)[1:], fps=60))
    dates = np.datetime64("2026-01-01T10:00:00") + np.round(1e6 * times_s(walk)).astype("timedelta64[us]")
    assert load_motion(npz(tmp_path, walk, timestamps=dates)).rate_hz == pytest.approx(RATE_HZ, rel=1e-3)


def test_rates_that_contradict_each_other(tmp_path: Path, walk: Motion) -> None:
    with pytest.warns(
        T2DWarning, match="mocap_framerate of 120 Hz contradicts fps of 60 Hz, which is taken; give rate_hz=120"
    ):
        assert load_motion(npz(tmp_path, walk, fps=60, mocap_framerate=120)).rate_hz == 60.0
    assert load_motion(npz(tmp_path, walk, dt=1 / 60)).rate_hz == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("stated_hz", "frames", "taken_hz"), [(240, 120, 60), (30, 120, 60), (60, 120, 60), (100, 120, 100)]
)
def test_the_length_that_amass_gives(tmp_path: Path, stated_hz: float, frames: int, taken_hz: float) -> None:
    swing = 0.3 * np.sin(np.linspace(0, 6 * math.pi, frames))
    poses = np.zeros((frames, 156))
    poses[:, 3], poses[:, 6] = swing, -swing
    path = tmp_path / "a.npz"
    np.savez(
        path, poses=poses, trans=np.tile([0, 0, 0.9], (frames, 1)), mocap_framerate=stated_hz, mocap_time_length=2.0
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        motion = load_motion(path)
    found = [str(each.message) for each in told if "mocap_time_length" in str(each.message)]
    assert motion.rate_hz == taken_hz
    assert len(found) == (stated_hz != 60)
    if found:
        assert f"120 frames at mocap_framerate of {stated_hz} Hz contradict mocap_time_length of 2 s" in found[0]


def test_the_header_of_a_c3d_contradicts_its_rate(tmp_path: Path, walk: Motion) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE_HZ]
    file["parameters"]["POINT"]["LABELS"]["value"] = walk.names
    file["parameters"]["POINT"]["UNITS"]["value"] = ("m",)
    points = walk.joints.transpose(2, 1, 0)
    file["data"]["points"] = np.concatenate([points, np.ones_like(points[:1])])
    path = tmp_path / "a.c3d"
    file.write(str(path))
    assert load_motion(path).rate_hz == RATE_HZ
    data = bytearray(path.read_bytes())
    data[20:24] = struct.pack("<f", 120.0)
    path.write_bytes(data)
    with pytest.warns(
        T2DWarning, match="the header's 120 Hz contradict POINT:RATE of 60 Hz, which is taken; give rate_hz=120"
    ):
        assert load_motion(path).rate_hz == RATE_HZ


# --- uneven times, lost frames ---


def test_uneven_times_are_brought_onto_an_even_clock(tmp_path: Path, walk: Motion) -> None:
    fine = t2d.resample(walk, 960.0)
    rng = np.random.default_rng(3)
    frames = np.unique(
        np.clip(np.round(16 * (np.arange(150) + rng.uniform(-0.4, 0.4, 150))).astype(int), 0, len(fine.joints) - 1)
    )
    motion = load_motion(npz(tmp_path, fine, frames, timestamps=frames / 960.0), smooth_hz=None)
    assert "ms apart brought onto an even clock" in motion.report
    expected = t2d.resample(t2d.trim(fine, frames[0] / 960, frames[-1] / 960), motion.rate_hz)
    count = min(len(expected.joints), len(motion.joints))
    shift = motion.joints[0, 0] - expected.joints[0, 0]
    error = np.linalg.norm(motion.joints[:count] - expected.joints[:count] - shift, axis=-1)
    assert np.percentile(error, 99) < 0.002  # 30 times less than without
    assert speed_mps(motion) == pytest.approx(speed_mps(expected), rel=0.01)


@pytest.mark.parametrize("jitter_ms", [0.0, 1.0])
def test_lost_frames_are_put_back(tmp_path: Path, walk: Motion, jitter_ms: float) -> None:
    kept = np.setdiff1d(np.arange(len(walk.joints)), [20, 41, 42, 43, 90, 91, 92, 93, 94, 95])
    times = kept / RATE_HZ + 1e-3 * jitter_ms * np.random.default_rng(1).uniform(-1, 1, len(kept))
    motion = load_motion(npz(tmp_path, walk, kept, timestamps=times, fps=60), smooth_hz=None)
    assert motion.rate_hz == pytest.approx(RATE_HZ, rel=2e-3)
    assert len(motion.joints) == len(walk.joints)
    assert "10 frame(s) lost by its timestamps" in motion.report
    moved = motion.joints - walk.joints
    assert np.linalg.norm(moved - moved[:, :1].mean(axis=0), axis=-1).max() < 0.03


def test_of_frames_lost_for_long_the_longest_piece_is_kept(tmp_path: Path, walk: Motion) -> None:
    kept = np.setdiff1d(np.arange(len(walk.joints)), np.arange(100, 140))
    with pytest.warns(T2DWarning, match=r"is missing for 0.67 s from 1.67 s on"):
        motion = load_motion(npz(tmp_path, walk, kept, timestamps=kept / RATE_HZ))
    assert len(motion.joints) == 100


def test_times_that_stand_or_go_back_leave_their_frames_out(tmp_path: Path, walk: Motion) -> None:
    times = times_s(walk)
    frames = np.insert(np.arange(len(times)), 50, 49)
    motion = load_motion(npz(tmp_path, walk, frames, timestamps=times[frames], fps=60), smooth_hz=None)
    assert "1 frame(s) left out whose timestamps does not go on" in motion.report
    assert len(motion.joints) == len(walk.joints)


# --- what gravity says ---


def hop(rate_hz: float, *, flights: int = 3, height_m: float = 0.2) -> Motion:
    """A body that stands, then flies by g, and again, at a rate."""
    stand = load_motion(WALK).joints[200]
    air_s, ground_s = 2 * math.sqrt(2 * height_m / 9.81), 0.4
    at = np.arange(round(flights * (air_s + ground_s) * rate_hz) + 1) / rate_hz % (air_s + ground_s) - ground_s
    rise = np.where(at > 0, 0.5 * 9.81 * at * (air_s - at), 0.0)
    names = load_motion(WALK).names
    return motion_from_joints(stand + rise[:, None, None] * [0, 0, 1], rate_hz=rate_hz, names=names)


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 120.0])
def test_flights_tell_the_rate(rate_hz: float) -> None:
    flying = hop(rate_hz)
    assert rate_doubt(flying) is None
    for factor in (0.5, 1.5, 2.0, 4.0):
        told = rate_doubt(replace(flying, rate_hz=rate_hz * factor))
        by = f"too high by {factor:.2f}" if factor > 1 else f"too low by {1 / factor:.2f}"
        found_g = float(told.partition(" m/s^2")[0].rpartition(" ")[2]) / 9.81
        assert found_g == pytest.approx(factor**2, rel=0.03)
        assert f"the rate of {rate_hz * factor:g} Hz is {by}, {rate_hz:g} Hz would fit" in told


def test_steps_tell_the_rate(walk: Motion) -> None:
    assert rate_doubt(walk) is None
    for factor, fits in ((0.25, 60), (0.5, 60), (2.0, 60), (4.0, 60)):
        told = rate_doubt(replace(walk, rate_hz=RATE_HZ * factor))
        assert "it walks at" in told
        found = float(told.rpartition(", ")[2].split()[0])
        assert 0.6 < found / fits < 1.7


@pytest.mark.slow
def test_sound_motions_are_not_doubted() -> None:
    for path in sorted(MOTIONS.glob("*.bvh*")):
        assert rate_doubt(load_motion(path)) is None, path.name
    walk = load_motion(WALK)
    for sentence in ("a person walks very slowly forward", "a child jumps up", "a person trips and falls forward"):
        provider = "library" if "falls" not in sentence else "auto"
        assert rate_doubt(t2d.motion_from_text(sentence, seed=1, provider=provider)) is None
    assert rate_doubt(t2d.trim(walk, 0.0, 0.1)) is None


def test_the_file_and_the_check_say_the_same(tmp_path: Path) -> None:
    flying = replace(hop(60.0), rate_hz=95.0)
    with pytest.warns(
        T2DWarning,
        match=r"in flight the body accelerates at 24.\d m/s\^2, 2.5 g: the rate of 95 Hz is too high by 1.58",
    ):
        motion = load_motion(npz(tmp_path, flying, fps=95.0), smooth_hz=None)
    assert rate_doubt(motion) in t2d.check_motion(motion).reasons
    with pytest.raises(InputError, match="rate"):
        load_motion(npz(tmp_path, flying, fps=1e-9))
