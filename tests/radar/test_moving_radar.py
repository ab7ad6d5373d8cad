"""Radars that move: the same recording as of a radar that stands still in a world that moves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import jv

import t2d_rt as t2d
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.types import MovingMesh, Radar, RadarTrack
from tests.builders import ball, icosphere, moving, static_mesh

TABLE2 = Radar.preset("table2")
UNTIL_S = 0.2
TIMES_S = np.linspace(0, UNTIL_S, 9)


def difference_db(one: t2d.Recording, other: t2d.Recording) -> float:
    """Energy of the difference relative to that of the first one."""
    return float(10 * np.log10(1e-30 + np.sum(abs(one.cube - other.cube) ** 2) / np.sum(abs(one.cube) ** 2)))


def plate_facing(x_m: float, times_s: np.ndarray = TIMES_S) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a plate of 0.4 m that looks along -x, at the height of the radar."""
    corners = np.array([[x_m, y, z] for y in (-0.2, 0.2) for z in (0.8, 1.2)])
    return corners, np.array([[0, 1, 2], [1, 3, 2]])


@pytest.mark.filterwarnings("ignore:.*watertight")
@pytest.mark.parametrize("preset", ["table2", "indoor-60"])
def test_radar_towards_a_plate_is_a_plate_towards_the_radar(preset: str) -> None:
    radar, (corners, faces) = Radar.preset(preset), plate_facing(2.0)
    along = np.outer(TIMES_S, [1.0, 0.0, 0.0])
    still = static_mesh(corners, faces, UNTIL_S)
    coming = MovingMesh(corners - along[:, None], faces, TIMES_S, "pec")
    riding = radar.replace(track=RadarTrack(times_s=TIMES_S, positions_m=np.array(radar.position_m) + along))
    expected = t2d.simulate(coming, radar=radar)
    assert difference_db(expected, t2d.simulate(still, radar=riding)) < -60  # -150 dB seen
    assert difference_db(expected, t2d.simulate(still, radar=radar)) > -3  # had the radar stood still


def test_a_radar_that_turns_is_a_world_that_turns_the_other_way() -> None:
    # An array with patterns, whose elements turn with it: yaw, pitch and roll at once.
    radar = Radar.preset("array-3x4", tx_pattern={"kind": "cosine", "exponent": 4}, rx_polarization_deg=30)
    angles = np.outer(TIMES_S / UNTIL_S, [20.0, -10.0, 15.0])
    track = RadarTrack.of_angles(TIMES_S, np.outer(1 + TIMES_S, [0.1, 0.2, 1.0]), angles)
    radar = radar.replace(track=track)
    vertices, faces = icosphere(3, 0.1, (2.0, 0.3, 1.1))
    frames_s = np.linspace(0, UNTIL_S, 41)
    passing = radar.passing(frames_s).points(np.repeat(vertices[None], len(frames_s), axis=0))
    carried = MovingMesh(passing, faces, frames_s, "pec", sagitta_rad=0.3)
    seen = t2d.simulate(static_mesh(vertices, faces, UNTIL_S, sagitta_rad=0.3), radar=radar)
    assert difference_db(t2d.simulate(carried, radar=radar.replace(track=None)), seen) < -60


def test_frame_of_a_radar() -> None:
    track = RadarTrack.of_angles([0, 1], [(1, 2, 3), (1, 2, 3)], [(90, 0, 0), (90, 30, 0)])
    radar = TABLE2.replace(track=track)
    assert np.allclose([*radar.position_m, *radar.boresight], (1, 2, 3, 0, 1, 0))
    # What lies ahead of the radar is ahead of it in its frame, however it is turned: 2 m along its boresight, pitched up by 30.
    ahead = np.array([1, 2, 3]) + 2 * np.array([0, math.cos(math.radians(30)), math.sin(math.radians(30))])
    own = (radar.passing(np.array([1.0])).points(ahead[None, None])[0, 0] - radar.position_m) @ radar.axes.T
    assert np.allclose(own, (2, 0, 0))
    rolled = RadarTrack.of_angles([0, 1], np.zeros((2, 3)), [(0, 0, 0), (0, 0, 90)]).axes(np.array([1.0]))
    assert rolled is not None
    assert np.allclose(rolled[0], [(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # the left side is up


def test_lines_of_a_vibrating_mount() -> None:
    # Paired echoes of sinusoidal phase modulation: line n has J_n(4 pi d / lambda) (Chen 2006).
    depth_m, rate_hz, until_s = 0.6e-3, 25.0, 0.4
    times_s = np.linspace(0, until_s, 401)
    places = np.array(TABLE2.position_m) + np.outer(depth_m * np.sin(2 * np.pi * rate_hz * times_s), [1, 0, 0])
    radar = TABLE2.replace(prf_hz=2560.0, track=RadarTrack(times_s=times_s, positions_m=places))
    recording = t2d.simulate(ball((3.0, 0.0, 1.0), time_s=until_s), radar=radar)
    chirps = round(until_s * 2560)
    rows = recording.cube[:chirps, 0]
    # At mid-sweep, in the cell of the ball, over whole periods: no window is needed.
    cell = np.fft.fft(rows, axis=1)
    cell = cell[:, np.abs(cell).sum(axis=0).argmax()]
    lines = np.abs(np.fft.fft(cell)) / np.sqrt(np.mean(np.abs(cell) ** 2)) / len(cell)
    bessel = np.abs(jv(np.arange(-3, 4), 4 * np.pi * depth_m / radar.wavelength_m))
    measured = lines[np.arange(-3, 4) * round(rate_hz * until_s)]
    errors_db = np.abs(20 * np.log10(measured / bessel)).max()
    assert errors_db < 0.2


def test_truth_is_told_from_where_the_radar_is() -> None:
    radar = TABLE2.replace(track=RadarTrack(times_s=[0, 0.3], positions_m=[(0, 0, 1), (0.3, 0, 1)]))
    walk = t2d.example("walk")
    still = t2d.simulate(walk, radar=TABLE2, method="ellipsoid")
    with pytest.warns(T2DWarning, match="ends with the radar's track at 0.3 s"):
        moved = t2d.simulate(walk, radar=radar, method="ellipsoid")
    times_s = np.array([0.1, 0.2])
    own, other = (each.truth_at(times_s, visible=False) for each in (moved, still))
    assert np.allclose(own.speed_mps - other.speed_mps, 1, atol=0.02)
    assert np.allclose(own.joints_m.sel(xyz="forward"), other.joints_m.sel(xyz="forward") - times_s[:, None], atol=1e-6)


def test_tracks_are_kept_and_read(tmp_path: Path) -> None:
    rows = ["t,x,y,z,yaw,pitch,roll", "0,0,0,1,0,0,0", "0.5,0.5,0,1,10,5,0"]
    (tmp_path / "track.csv").write_text("\n".join(rows))
    np.savez(
        tmp_path / "track.npz", **dict(zip(rows[0].split(","), np.loadtxt(rows[1:], delimiter=",").T, strict=True))
    )
    values = TABLE2.model_dump(mode="json", exclude={"position_m", "boresight"})
    assert "track" not in values  # radars that stand still are written as before
    (tmp_path / "radar.yaml").write_text(str({**values, "track": "track.csv"}).replace("None", "null"))
    radar = Radar.from_yaml(tmp_path / "radar.yaml")
    assert (
        radar.track
        == RadarTrack.read(tmp_path / "track.npz")
        == RadarTrack.of_angles([0, 0.5], [(0, 0, 1), (0.5, 0, 1)], [(0, 0, 0), (10, 5, 0)])
    )
    radar.to_yaml(tmp_path / "again.yaml")
    assert Radar.from_yaml(tmp_path / "again.yaml") == radar
    recording = t2d.simulate(ball((3.0, 0.0, 1.0)), radar=radar)
    recording.save(tmp_path / "found.zarr")
    again = t2d.run(t2d.Recording.load(tmp_path / "found.zarr"))
    assert np.array_equal(again.cube, recording.cube)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t,x,y\n0,1,2\n1,1,2", "needs t, x, y, z"),
        ("t,x,y,z\n0,1,2,3\n1,1,2", "as many numbers"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3", "increasing"),
        ("t,x,y,z\n0,1,2,nan\n1,1,2,3", "finite"),
        ("", "needs t, x, y, z"),
        ("t,x,y,z,vx\n0,1,2,3,4\n1,1,2,3,4", "no others, got t, x, y, z, vx"),
        ("t,t,x,y,z\n0,0,1,2,3\n1,1,1,2,3", "each column once"),
    ],
)
def test_tracks_that_are_none(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "track.csv").write_text(text)
    with pytest.raises(InputError, match=told):
        RadarTrack.read(tmp_path / "track.csv")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffT;X;Y;Z\n0;0,5;2;3\n1;1;2;3\n;;;\n",
        '"t","x","y","z",\n0,.5,2,3,\n1,1,2,3,\n',
        "z\ty\tx\tt\n3\t2\t.5\t0\n3\t2\t1\t1\n",
    ],
)
def test_tracks_of_spreadsheets(tmp_path: Path, text: str) -> None:
    (tmp_path / "track.csv").write_text(text, encoding="utf-8")
    assert RadarTrack.read(tmp_path / "track.csv") == RadarTrack(times_s=[0, 1], positions_m=[(0.5, 2, 3), (1, 2, 3)])


def test_arrays_that_are_no_track(tmp_path: Path) -> None:
    path, columns = tmp_path / "track.npz", dict.fromkeys("txyz", np.arange(50.0))
    np.savez(path, **columns)
    whole = path.read_bytes()
    assert len(RadarTrack.read(path).times_s) == 50
    broken = bytearray(whole)
    broken[200] ^= 1  # a value of t, so that its checksum is wrong
    for data in (whole[: len(whole) // 2], broken, b"PK", b""):
        path.write_bytes(data)
        with pytest.raises(InputError, match="cut short, damaged"):
            RadarTrack.read(path)
    with path.open("wb") as file:
        np.save(file, np.zeros((5, 4)))
    with pytest.raises(InputError, match=r"no \.npz file"):
        RadarTrack.read(path)
    np.savez(path, **{**columns, "x": columns["x"] + 1j})
    with pytest.raises(InputError, match="real numbers"):
        RadarTrack.read(path)


@pytest.mark.parametrize("angles", [[(0, 0), (1, 0)], "north", (0, 0, 0), [(0, 0, 0)], [], None, [(0, 0, 0), (0, 0)]])
def test_angles_that_are_none(angles: object) -> None:
    with pytest.raises(InputError):
        RadarTrack.of_angles([0, 1], [(0, 0, 1), (1, 0, 1)], angles)


def test_a_track_that_begins_late_is_told() -> None:
    target = ball((3.0, 0.0, 1.0))
    begin_s, end_s = target.times_s[0], target.times_s[-1]
    late = TABLE2.replace(track=RadarTrack(times_s=[begin_s + 0.02, end_s], positions_m=[(0, 0, 1), (0.1, 0, 1)]))
    with pytest.warns(T2DWarning, match=r"begins with the radar's track at 0\.02 s, and the targets at 0 s"):
        t2d.simulate(target, radar=late)
    with pytest.raises(InputError, match=r"begin at one instant, got 0, 0\.02 s"):
        t2d.simulate_radars(target, [TABLE2, late])
    with pytest.warns(T2DWarning, match="begins with"):
        first, second = t2d.simulate_radars(target, [late, late])
    assert np.array_equal(first.cube, second.cube)


def test_what_is_not_modelled_is_refused() -> None:
    radar = TABLE2.replace(track=RadarTrack(times_s=[0, 1], positions_m=[(0, 0, 1), (0.1, 0, 1)]))
    with pytest.raises(InputError, match="position_m of a radar that moves is where its track begins"):
        radar.replace(position_m=(1, 0, 1))
    assert Radar.preset("people-tracking-60", track=radar.track).position_m == (0, 0, 1)
    assert radar.replace(track=None, position_m=(1, 0, 1)).track is None
    late = moving(icosphere(2, 0.1), np.full((3, 3), 2.0), np.array([2.0, 2.5, 3.0]), sagitta_rad=0.3)
    with pytest.raises(InputError, match="no time in common"):
        t2d.simulate(late, radar=radar)
