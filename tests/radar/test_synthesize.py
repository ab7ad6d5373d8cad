"""Synthesis of the ADC cube: the float64 twin, closed forms of sign, range and speed, streaming, the whole sweep."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import trimesh

from builders import slow_after
from made_echoes import random_echoes as made_up
from measures import nmse_db
from t2d_rt.core import cubes
from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import MemoryLimit
from t2d_rt.radar import groups, multilevel
from t2d_rt.radar.direct import direct_sum
from t2d_rt.radar.groups import levels
from t2d_rt.radar.interpolants import spline_slopes
from t2d_rt.radar.sweep import Sweep
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.radar.windows import Window, Windows
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scattering.phase_integral import divided_difference
from t2d_rt.scattering.refinement import facets
from t2d_rt.scattering.streams import Resampled, joined
from t2d_rt.types import PEC, EchoArrays, Echoes, EchoStream, Ellipsoids, MovingMesh, Radar, stream
from t2d_rt.types.radar import preset_names

TABLE2 = Radar.preset("table2")
LARGE = {
    *("imaging-12x16", "automotive-79", "indoor-60", "array-3x4"),
    *("iwr6843isk", "iwr6843aop", "awr1843boost", "iwr1443boost", "iwr1642boost", "awr2243-cascade"),
}
"""Presets of many antennas, which take long."""


random_echoes = partial(made_up, apparent=True)


def point(range_m: np.ndarray, times_s: np.ndarray, radar: Radar) -> Echoes:
    """0 dBsm along a track (T,)."""
    amplitude = np.sqrt(radar.received_power_w(1.0, range_m))[:, None].astype(np.complex64)
    return Echoes(times_s=times_s, delay_s=2 * range_m[:, None] / SPEED_OF_LIGHT, amplitude=amplitude)


# --- against the direct sum -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "preset", [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in preset_names()]
)
def test_cube_is_the_direct_sum(preset: str) -> None:
    radar = Radar.preset(preset)
    echoes = random_echoes(radar, frames=24 if preset in LARGE else 40)
    cube = synthesize(echoes, radar)
    chirps = np.linspace(0, len(cube) - 1, 4 if preset in LARGE else 10).astype(int)
    # Motion inside the chirp: the twin takes every sample's own time. Every 7th sample, all over the sweep.
    for antenna in {0, radar.antennas // 2, radar.antennas - 1}:
        expected = direct_sum(echoes, radar, chirps, every=7, antenna=antenna)
        assert nmse_db(cube[chirps, antenna, ::7], expected) < -50


def swinging_sheet(radar: Radar, *, frames: int = 60, rate_hz: float = 100.0) -> Echoes:
    """A dense sheet of 60 x 20 cm that swings about its upper edge by up to 6 rad/s and travels at 2 m/s: neighbours are alike."""
    rng = np.random.default_rng(1)
    t = np.arange(frames) / rate_hz
    down, across = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 0.6, 60), np.linspace(-0.1, 0.1, 30)))
    angle = 0.6 * np.sin(10 * t)[:, None]
    ahead = 3 - 2 * t[:, None] + down * np.sin(angle)
    places = (
        np.stack([ahead, np.broadcast_to(across, ahead.shape), 0.6 - down * np.cos(angle)], axis=-1) + radar.position_m
    )
    phase = rng.uniform(0, 2 * np.pi, len(down)) + np.outer(t, rng.uniform(-8, 8, len(down)))
    amplitude = np.exp(1j * phase) * (1 + 0.3 * np.sin(np.outer(t, rng.uniform(0, 20, len(down)))))
    amplitude[frames // 2 :, ::7] = 0
    delay = sum(np.linalg.norm(places - place, axis=-1) for place in (radar.tx_position_m, radar.rx_position_m))
    slope = amplitude * rng.normal(size=len(down)) * 0.1 / radar.bandwidth_hz
    return Echoes(
        times_s=t, delay_s=delay / SPEED_OF_LIGHT, amplitude=amplitude, slope=slope, departure_m=places, arrival_m=places,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("preset", "tolerance_db"),
    slow_after(
        1,
        [
            *(("table2", db) for db in (-40, -30, -50, -60)),
            *((preset, -60) for preset in ("array-3x4", "table2-burst", "ci4r")),
            *((preset, -30) for preset in ("table2-uniform", "text2doppler-code")),
        ],
    ),
)
def test_merged_echoes_keep_the_tolerance(preset: str, tolerance_db: float) -> None:
    radar = Radar.preset(preset)
    echoes = swinging_sheet(radar)
    cube = synthesize(echoes, radar, tolerance_db=tolerance_db)
    chirps_per_frame = len(cube) / (len(echoes.times_s) - 1)
    for window in Windows(echoes.times_s).add(0, stream(echoes).frames(0, len(echoes.times_s))):
        assert levels(window, Sweep.of(radar), chirps_per_frame, 10 ** (tolerance_db / 20)), "they are merged"
    chirps = np.random.default_rng(0).choice(len(cube), 12, replace=False)
    antenna = radar.antennas - 1
    expected = direct_sum(echoes, radar, chirps, every=9, antenna=antenna)
    assert nmse_db(cube[chirps, antenna, ::9], expected) < tolerance_db


def test_merged_echoes_of_transmitters_at_once() -> None:
    radar = Radar.preset("automotive-79")
    echoes = swinging_sheet(radar, frames=12)
    cube = synthesize(echoes, radar)
    chirps = np.linspace(0, len(cube) - 1, 8).astype(int)
    for receiver in (0, 3):
        expected = direct_sum(echoes, radar, chirps, every=19, antenna=receiver)
        assert nmse_db(cube[chirps, receiver, ::19], expected) < -50


def test_merged_echoes_may_part_late() -> None:
    """Two limbs that are together for half a window and then part at 1.2 m/s, to 8 range bins."""
    radar = Radar.preset("text2doppler-code")
    rng = np.random.default_rng(3)
    t = np.arange(33) / 60
    side = np.where(rng.random(2000) < 0.5, -0.5, 0.5)
    range_m = 3 + 0.02 * rng.random(2000) + side * 1.2 * np.maximum(t - t[17], 0)[:, None]
    phase = np.exp(2j * np.pi * rng.random(2000)) * np.ones((33, 1))
    echoes = Echoes(times_s=t, delay_s=2 * range_m / SPEED_OF_LIGHT, amplitude=phase)
    cube = synthesize(echoes, radar, tolerance_db=-30)
    chirps = np.linspace(0, len(cube) - 1, 12).astype(int)
    assert nmse_db(cube[chirps, 0, ::9], direct_sum(echoes, radar, chirps, every=9)) < -30


def test_first_and_last_chirp_are_as_good_as_any() -> None:
    echoes = random_echoes(TABLE2, frames=6)
    cube = synthesize(echoes, TABLE2)
    for chirp in (0, 1, len(cube) - 2, len(cube) - 1):
        assert nmse_db(cube[chirp, 0, ::7], direct_sum(echoes, TABLE2, np.array([chirp]), every=7)[0]) < -50


@pytest.mark.parametrize("count", [1, 600])
def test_a_long_sweep_during_which_echoes_move_by_wavelengths(count: int) -> None:
    # 4 GHz in 1 ms at 6 m/s: the range changes by 6 mm, and the phase bends by 0.13 rad over half the sweep (eq. 16).
    radar = Radar.preset("table2", slope_hz_per_s=4e12, sample_rate_hz=255e3, samples=256, prf_hz=900.0)
    times = np.arange(30) / 100
    ranges = np.linspace(4, 5, count) - 6 * times[:, None]
    amplitude = np.exp(2j * np.pi * np.random.default_rng(0).random((1, count))) * np.ones((30, 1))
    echoes = Echoes(times_s=times, delay_s=2 * ranges / SPEED_OF_LIGHT, amplitude=amplitude.astype(np.complex64))
    cube = synthesize(echoes, radar, tolerance_db=-70)  # not merged
    chirps = np.arange(5, len(cube), 60)
    assert nmse_db(cube[chirps, 0, ::7], direct_sum(echoes, radar, chirps, every=7)) < -66


def test_flat_echoes_need_no_slope() -> None:
    echoes = random_echoes(TABLE2, sloped=False)
    cube = synthesize(echoes, TABLE2)
    chirps = np.array([0, 1234, 3000])
    assert nmse_db(cube[chirps, 0, ::7], direct_sum(echoes, TABLE2, chirps, every=7)) < -50
    zeros = Echoes(
        times_s=echoes.times_s, delay_s=echoes.delay_s, amplitude=echoes.amplitude, slope=np.zeros_like(echoes.amplitude),
    )  # fmt: skip
    np.testing.assert_allclose(synthesize(zeros, TABLE2), cube, atol=1e-5 * np.abs(cube).max())


@pytest.mark.parametrize("preset", ["table2", "openradar"])
def test_nothing_beyond_the_range_axis_passes_the_if_filter(preset: str) -> None:
    """A point below the last bin, in its middle and beyond: all, half and none of its field, though none of these is a multiple
    of the range axis; the direct sum says the same."""
    radar = Radar.preset(preset)
    times_s = np.linspace(0, 0.02, 8)
    starts = radar.chirp_times_s(0.02)[:1]
    for bins_short, gain in ((2.0, 1.0), (0.5, 0.5), (0.0, 0.0), (-20.3, 0.0), (-1.3 * radar.samples, 0.0)):
        range_m = radar.max_range_m - bins_short * radar.range_resolution_m
        echoes = point(np.full(8, range_m), times_s, radar)
        cube = synthesize(echoes, radar)
        level = math.sqrt(radar.received_power_w(1.0, range_m))
        assert float(np.abs(cube[0]).mean()) == pytest.approx(gain * level, rel=1e-3)
        direct = direct_sum(echoes, radar, np.arange(len(starts)))
        assert np.abs(direct).mean() == pytest.approx(gain * level, rel=1e-6)


def test_a_target_that_leaves_the_range_axis_fades_bin_by_bin() -> None:
    """At 4 m/s over the farthest range: never seen at the near end of the axis, where it would fold to."""
    times_s = np.linspace(0, 0.3, 200)
    echoes = point(TABLE2.max_range_m - 0.6 + 4 * times_s, times_s, TABLE2)
    cube = np.asarray(synthesize(echoes, TABLE2))[:, 0]
    power = np.abs(np.fft.fft(cube * np.blackman(TABLE2.samples), axis=1)) ** 2
    near, far = power[:, 4 : TABLE2.samples // 2].sum(), power[:, TABLE2.samples // 2 :].sum()
    assert near < 1e-6 * far
    assert not cube[-1].any()


def test_the_direct_sum_is_eq_1_for_one_static_point() -> None:
    echoes = point(np.full(5, 2.3), np.arange(5) / 1000, TABLE2)
    tau, t = 2 * 2.3 / SPEED_OF_LIGHT, TABLE2.sample_times_s
    phase = 2 * np.pi * (TABLE2.carrier_hz * tau + TABLE2.slope_hz_per_s * (tau * t - tau**2 / 2))
    expected = math.sqrt(TABLE2.received_power_w(1.0, 2.3)) * np.exp(1j * phase)
    np.testing.assert_allclose(direct_sum(echoes, TABLE2, np.array([3]))[0], expected, rtol=1e-6)
    assert nmse_db(synthesize(echoes, TABLE2)[3, 0], expected) < -60


# --- streaming ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("read_frames", [1, 40, 64])
def test_what_is_read_at_once_does_not_matter(read_frames: int) -> None:
    radar = TABLE2.replace(prf_hz=1000.0)
    echoes = random_echoes(radar, frames=161)
    whole = synthesize(echoes, radar)
    asked: list[tuple[int, int]] = []

    def frames(start: int, stop: int) -> EchoArrays:
        asked.append((start, stop))
        return echoes.delay_s[start:stop], echoes.amplitude[start:stop], echoes.slope[start:stop]

    fractions: list[float] = []
    cut = synthesize(
        EchoStream(times_s=echoes.times_s, frames=frames), radar, read_frames=read_frames, progress=fractions.append
    )
    assert np.array_equal(cut, whole)
    assert len(asked) > 2
    assert [start for start, _ in asked[1:]] == [stop for _, stop in asked[:-1]]  # every frame once, in order
    assert (asked[0][0], asked[-1][1]) == (0, 161)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1


def test_few_echoes_of_many_vertices_are_not_read_all_at_once() -> None:
    """A sphere that breathes is one or two echoes and 30 000 vertices: a minute of them would be over a gigabyte."""
    echoes = random_echoes(TABLE2.replace(prf_hz=1000.0), frames=400)
    most: list[int] = []
    for vertices, at_once in ((0, 0), (100_000, 0), (0, 3)):
        asked: list[int] = []
        whole = stream(echoes)

        def frames(start: int, stop: int, whole: EchoStream = whole, asked: list[int] = asked) -> EchoArrays:
            asked.append(stop - start)
            return whole.frames(start, stop)

        source = EchoStream(times_s=echoes.times_s, frames=frames, vertices=vertices, at_once=at_once)
        synthesize(joined([source, source]), TABLE2.replace(prf_hz=1000.0))
        most.append(max(asked))
    assert most[0] > 300
    assert most[1] * 100_000 * 16 < 150e6
    assert most[2] == 3


def test_same_echoes_same_bits() -> None:
    echoes = random_echoes(TABLE2, frames=8)
    assert np.array_equal(synthesize(echoes, TABLE2), synthesize(echoes, TABLE2))


def test_order_of_scatterers_does_not_matter() -> None:
    echoes = random_echoes(TABLE2, frames=8)
    order = np.random.default_rng(1).permutation(echoes.delay_s.shape[1])
    shuffled = Echoes(
        times_s=echoes.times_s, delay_s=echoes.delay_s[:, order], amplitude=echoes.amplitude[:, order],
        slope=echoes.slope[:, order],
    )  # fmt: skip
    assert nmse_db(synthesize(shuffled, TABLE2), synthesize(echoes, TABLE2)) < -110


def test_silent_and_missing_echoes_give_zeros() -> None:
    times_s = np.arange(6) / 100
    for count in (0, 3):
        silent = Echoes(
            times_s=times_s, delay_s=np.full((6, count), 1e-8), amplitude=np.zeros((6, count), np.complex64)
        )
        cube = synthesize(silent, TABLE2)
        assert cube.shape == (len(TABLE2.chirp_times_s(0.05)), 1, TABLE2.samples)
        assert cube.dtype == np.complex64
        assert not cube.any()


def test_one_dark_echo_beside_a_bright_one_changes_nothing() -> None:
    bright = random_echoes(TABLE2, frames=8, sloped=False)
    dark = Echoes(
        times_s=bright.times_s, delay_s=np.hstack([bright.delay_s, np.full((8, 1), 3e-8)]),
        amplitude=np.hstack([bright.amplitude, np.zeros((8, 1), np.complex64)]),
    )  # fmt: skip
    assert np.array_equal(synthesize(dark, TABLE2), synthesize(bright, TABLE2))


def test_a_record_shorter_than_a_chirp_is_refused() -> None:
    with pytest.raises(InputError, match="holds no whole chirp; it must be at least"):
        synthesize(point(np.full(4, 2.0), np.arange(4) * 1e-6, TABLE2), TABLE2)


# --- sign, range, speed ---------------------------------------------------------------------------------------------


def test_echoes_that_leap_are_refused() -> None:
    leaping = Echoes(times_s=np.arange(4) / 100, delay_s=np.arange(4.0)[:, None], amplitude=np.ones((4, 1)))
    with pytest.raises(
        InputError, match=r"an echo's range changes by .* m from one surface frame to the next, .* remove the jump"
    ):
        synthesize(leaping, TABLE2)


def approaching(speed_mps: float, duration_s: float, radar: Radar) -> tuple[Echoes, np.ndarray]:
    times_s = np.arange(round(100 * duration_s) + 1) / 100
    range_m = 4.0 - speed_mps * times_s
    return point(range_m, times_s, radar), range_m


def peak(spectrum: np.ndarray) -> int:
    return int(np.argmax(np.abs(spectrum)))


@pytest.mark.parametrize("speed_mps", [4.0, -2.5])
def test_sign_of_beat_and_doppler(speed_mps: float) -> None:
    echoes, _ = approaching(speed_mps, 0.1, TABLE2)
    cube = synthesize(echoes, TABLE2)[:, 0]
    beat = np.fft.fftfreq(TABLE2.samples, 1 / TABLE2.sample_rate_hz)[peak(np.fft.fft(cube[0]))]
    assert beat == pytest.approx(TABLE2.beat_frequency_hz(4.0), abs=TABLE2.sample_rate_hz / TABLE2.samples)
    assert beat > 0
    slow = np.exp(-2j * np.pi * np.arange(TABLE2.samples) * TABLE2.beat_frequency_hz(4.0) / TABLE2.sample_rate_hz)
    doppler = np.fft.fftfreq(len(cube), TABLE2.chirp_interval_s)[peak(np.fft.fft(cube[:, 128] * slow[128].conj()))]
    assert np.sign(doppler) == -np.sign(speed_mps)
    assert -TABLE2.wavelength_m / 2 * doppler == pytest.approx(speed_mps, abs=TABLE2.speed_resolution_mps(0.1))


@pytest.mark.parametrize(
    ("preset", "speed_mps"), [("table2", 0.0), ("table2", 4.0), ("table2", -4.0), ("text2doppler-code", 5.0)]
)
def test_range_axis_and_its_coupling_with_speed(preset: str, speed_mps: float) -> None:
    # An approaching target reads short by f v/S: 6.7 mm at 4 m/s for table2.
    radar = Radar.preset(preset)
    echoes, _ = approaching(speed_mps, 0.05, radar)
    fft = 64 * radar.samples
    profile = np.fft.fft(synthesize(echoes, radar)[0, 0] * np.blackman(radar.samples), fft)
    read = radar.range_axis_m(fft)[peak(profile)]
    at_mid_sweep = 4.0 - speed_mps * radar.mid_time_s
    coupling = radar.mid_frequency_hz * speed_mps / radar.slope_hz_per_s
    step = radar.max_range_m / fft
    assert read == pytest.approx(at_mid_sweep - coupling, abs=0.6 * step)
    assert radar.range_axis_m(fft, speed_mps=speed_mps)[peak(profile)] == pytest.approx(at_mid_sweep, abs=0.6 * step)


def test_moving_sphere_range_speed_and_clean_spectrum() -> None:
    # 4 m/s towards the radar for half a second, range by the specular point.
    radius, speed, duration = 0.3, 4.0, 0.5
    times_s = np.arange(51) / 100
    centres = np.stack([3.5 + radius - speed * times_s, 0 * times_s, 1 + 0 * times_s], axis=1)[:, None]
    ball = Ellipsoids(np.full((1, 3), radius), centres, times_s)
    cube = synthesize(ellipsoid_echoes(ball, TABLE2, times_s=times_s, material=PEC), TABLE2)[:, 0]
    starts = TABLE2.chirp_times_s(duration)
    fft = 16 * TABLE2.samples
    profiles = np.fft.fft(cube[::64] * np.blackman(TABLE2.samples), fft, axis=1)
    read = TABLE2.range_axis_m(fft, speed_mps=speed)[np.abs(profiles).argmax(axis=1)]
    truth = 3.5 - speed * (starts[::64] + TABLE2.mid_time_s)
    assert np.abs(read - truth).max() < 0.1 * TABLE2.range_resolution_m
    # One sample of every chirp: a line. 4-term Blackman-Harris window, side lobes at -92 dB.
    count = len(cube)
    cosines = np.cos(2 * np.pi * np.outer(np.arange(4), np.arange(count)) / count)
    window = np.array([0.35875, -0.48829, 0.14128, -0.01168]) @ cosines
    spectrum = np.abs(np.fft.fftshift(np.fft.fft(cube[:, 128] / np.abs(cube[:, 128]) * window)))[::-1]
    speeds = TABLE2.speed_axis_mps(count)
    at = speeds[spectrum.argmax()]
    bin_mps = TABLE2.speed_resolution_mps(count * TABLE2.chirp_interval_s)
    assert at == pytest.approx(speed, abs=0.5 * bin_mps)
    away = np.abs(speeds - at) > 8 * bin_mps
    assert 20 * np.log10(spectrum[away].max() / spectrum.max()) < -80


def test_a_static_target_has_no_doppler() -> None:
    times_s = np.arange(6) / 100
    cube = synthesize(point(np.full(6, 2.0), times_s, TABLE2), TABLE2)[:, 0]
    spread = np.abs(cube - cube.mean(axis=0))
    assert 20 * np.log10(spread.max() / np.abs(cube).max()) < -80


# --- the whole sweep ------------------------------------------------------------------------------------------------


def facet_field(vertices: np.ndarray, faces: np.ndarray, radar: Radar, frequencies_hz: np.ndarray) -> np.ndarray:
    """Physical optics (eq. 3) at each frequency in float64, (f,); the antennas keep mid-sweep's lambda, tx = rx."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offset = radar.tx_position_m - corners.mean(axis=1)
    distance = np.linalg.norm(offset, axis=1)
    projected = np.einsum("fi,fi->f", normal, offset) / distance  # twice the area, times the cosine
    lit = projected > 0
    path = 2 * np.linalg.norm(radar.tx_position_m - corners[lit], axis=2)
    wavenumbers = 2 * np.pi * frequencies_hz / SPEED_OF_LIGHT
    sums = [np.sum(projected[lit] / distance[lit] ** 2 * divided_difference(*(k * path).T)) for k in wavenumbers]
    return 1j * radar.link_amplitude * math.sqrt(4 * math.pi) * wavenumbers / (2 * math.pi) * np.array(sums)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["table2", "text2doppler-code"])
@pytest.mark.parametrize("shape", ["ball", "skew plate"])
def test_the_whole_sweep_of_facets(shape: str, preset: str, backend: Backend) -> None:
    # Echoes carry amplitude and slope at mid-sweep; the sum here evaluates every facet at every sample's frequency.
    radar = Radar.preset(preset)
    body = trimesh.creation.icosphere(subdivisions=2, radius=0.12)
    if shape == "skew plate":
        body = trimesh.creation.box((0.01, 0.3, 0.2))
        # 7 degrees: the third side lobe and on, 25 dB down. Beyond 14 degrees, 60 dB down, what is left is error.
        body.apply_transform(trimesh.transformations.euler_matrix(0.04, 0.06, 0.1))
    vertices = np.array(body.vertices) + np.array([2.5, 0.1, 1.0])
    mesh = MovingMesh(np.stack([vertices, vertices]), body.faces, [0, 1], PEC)
    stream = mesh_echoes(
        mesh, radar, times_s=np.arange(4) / radar.prf_hz, material=PEC, detail=Detail(sagitta_rad=mesh.sagitta_rad), seed=0,
        views=[PathVisibility()], backend=backend,
    )  # fmt: skip
    cube = synthesize(stream, radar)[0, 0, ::5]
    times = radar.sample_times_s[::5]
    fine = facets(mesh, radar, mesh.sagitta_rad, span_s=(0.0, 3 / radar.prf_hz))
    field = facet_field(fine.rest, fine.faces, radar, radar.carrier_hz + radar.slope_hz_per_s * times)
    # Eq. 1 has S tau^2/2 besides, which over the target's depth changes by 0.01 rad.
    delay = 2 * np.linalg.norm(vertices.mean(axis=0) - radar.tx_position_m) / SPEED_OF_LIGHT
    expected = field * np.exp(-1j * np.pi * radar.slope_hz_per_s * delay**2)
    assert nmse_db(cube, expected) < -30


# --- the cube's parts -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_cube_on_disk_is_the_one_in_memory() -> None:
    radar = Radar.preset("array-3x4")
    echoes = swinging_sheet(radar, frames=110)  # four windows, the last one short
    inside = synthesize(echoes, radar)
    outside = synthesize(echoes, radar, memory=MemoryLimit(limit_bytes=8.0 * inside.size, held_bytes=0.0))
    assert isinstance(outside, cubes.DiskCube)
    np.testing.assert_array_equal(np.asarray(outside), inside)


def test_echoes_that_are_dark_from_a_windows_start() -> None:
    echoes = random_echoes(TABLE2, frames=60)
    dark = echoes.amplitude.copy()
    dark[31:] = 0  # a window starts at frame 32
    cube = synthesize(replace(echoes, amplitude=dark, slope=None), TABLE2)
    chirps = np.array([0, 1000, len(cube) - 1])
    expected = direct_sum(replace(echoes, amplitude=dark, slope=None), TABLE2, chirps, every=9)
    assert nmse_db(cube[chirps, 0, ::9], expected) < -50
    assert not cube[-1].any()


@pytest.mark.parametrize("multiplexing", slow_after(1, ["simultaneous", "tdm", "ddm"]))
def test_merged_echoes_of_any_number_of_receivers(multiplexing: str) -> None:
    radar = Radar.preset(
        "array-3x4", tx_offsets_m=[[0, -0.004, 0], [0, 0.004, 0]], multiplexing=multiplexing,
        rx_offsets_m=[[0, 0.002 * k, 0.001 * k] for k in range(5)],
    )  # fmt: skip
    echoes = swinging_sheet(radar, frames=12)
    cube = synthesize(echoes, radar)
    chirps = np.linspace(0, len(cube) - 1, 5).astype(int)
    for antenna in range(radar.antennas):
        expected = direct_sum(echoes, radar, chirps, every=19, antenna=antenna)
        assert nmse_db(cube[chirps, antenna, ::19], expected) < -50


@pytest.mark.parametrize("preset", ["table2", "array-3x4"])
def test_merged_echoes_use_no_interval_beyond_the_last(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples go on after a window's last interval; cubics read from there would be whatever lies in memory."""
    read: list[np.ndarray] = []
    found = multilevel._places

    def places(inner: Any, below: Any) -> tuple[np.ndarray, np.ndarray]:
        interval, time = found(inner, below)
        place = inner.first + 2 + np.arange(inner.samples - 5)
        np.testing.assert_allclose(interval - 1 + time, place / below.rate, atol=1e-12)
        assert interval.min() >= 0
        assert interval.max() <= len(below.delay) - 2
        read.append(interval)
        return interval, time

    monkeypatch.setattr(multilevel, "_places", places)
    radar = Radar.preset(preset)
    synthesize(swinging_sheet(radar, frames=40), radar)
    assert read


def test_resampled_at_its_own_times_a_scatterer_is_the_same() -> None:
    whole = stream(random_echoes(TABLE2, frames=41))
    made = Resampled.of(whole, whole.times_s)
    for start, stop in ((0, 7), (7, 20), (12, 35), (35, 41)):
        for one, two in zip(made.frames(start, stop), whole.frames(start, stop), strict=True):
            np.testing.assert_array_equal(one, two)


def test_merged_echoes_far_apart_across_range_before_a_wide_array() -> None:
    """Groups are formed by delay and its rate, so one may hold echoes metres apart, of which a wide array sees much."""
    radar = Radar.preset("table2", tx_offsets_m=[[0, -0.2, 0]], rx_offsets_m=[[0, -0.2, 0], [0, 0.2, 0]])
    rng = np.random.default_rng(4)
    t = np.arange(30) / 100
    side = np.where(rng.random(3000) < 0.5, -2.0, 2.0)[:, None]
    shape = rng.uniform(-0.05, 0.05, (3000, 3)) + side * [0, 1, 0]
    places = shape + np.stack([4 - 0.5 * t, 0 * t, 0 * t + 1], axis=-1)[:, None]
    centres = radar.tx_position_m, radar.rx_position_m
    delay = sum(np.linalg.norm(places - centre, axis=-1) for centre in centres) / SPEED_OF_LIGHT
    amplitude = np.exp(2j * np.pi * rng.random(3000)) * np.ones((30, 1))
    echoes = Echoes(times_s=t, delay_s=delay, amplitude=amplitude, departure_m=places, arrival_m=places)
    cube = synthesize(echoes, radar)
    chirps = np.linspace(0, len(cube) - 1, 8).astype(int)
    for antenna in (0, 1):
        expected = direct_sum(echoes, radar, chirps, every=9, antenna=antenna)
        assert nmse_db(cube[chirps, antenna, ::9], expected) < -50


@pytest.mark.parametrize("frames", [4, 5, 9, 40])
def test_ends_of_splines_follow_a_quartic(frames: int) -> None:
    t = np.arange(frames) - 1.5
    order = min(4, frames - 1)
    values = t**order
    slopes = spline_slopes(frames) @ values
    assert slopes[[0, -1]] == pytest.approx(order * t[[0, -1]] ** (order - 1), rel=1e-9)
    # Inside its second derivative has no jump.
    rise = np.diff(values)
    left = -6 * rise[:-1] + 2 * slopes[:-2] + 4 * slopes[1:-1]
    right = 6 * rise[1:] - 4 * slopes[1:-1] - 2 * slopes[2:]
    assert left == pytest.approx(right, abs=1e-9 * np.abs(values).max())


def test_few_echoes_are_asked_first_whether_groups_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound says no only where no level of groups pays."""
    said = []
    may_pay = groups._may_pay
    monkeypatch.setattr(groups, "_may_pay", lambda *given: said.append(may_pay(*given)) or True)
    radar, counts = Radar.preset("table2"), []
    sweep = Sweep.of(radar)
    for count, spread in ((4, 1.0), (12, 0.3), (30, 0.02), (60, 1.0), (60, 0.001)):
        rng = np.random.default_rng(count)
        frames = np.arange(35)
        delay = 2e-8 + spread * 1e-8 * rng.random(count) + spread * 3e-12 * frames[:, None] * rng.normal(size=count)
        window = Window(
            start=0, stop=32, step_s=1 / 60, delay=delay, delay_slope=np.gradient(delay, axis=0),
            amplitude=np.ones((37, count), np.complex64), sweep=None, lit=(np.zeros(1, int), np.zeros(1, int)), apparent=None,
        )  # fmt: skip
        counts.append(len(levels(window, sweep, 170.0, 10**-2.5)))
    assert all(said[number] for number, count in enumerate(counts) if count)
    assert {bool(count) for count in counts} == {True, False}
    assert not all(said)


@pytest.mark.parametrize("count", [1, 3, 600])
def test_echoes_that_are_lit_only_between_bursts_are_not_recorded(count: int) -> None:
    radar = Radar(
        carrier_hz=77e9, slope_hz_per_s=50e12, samples=64, sample_rate_hz=4e6, prf_hz=3000, chirps_per_frame=16,
        frame_interval_s=0.25,
    )  # fmt: skip
    times_s = np.arange(60) / 120.0
    amplitude = np.zeros((60, count), np.complex64)
    amplitude[8:20] = 1e-4
    delay_s = 2 * (3 + 0.1 * times_s[:, None] + np.arange(count) * 0.01) / SPEED_OF_LIGHT
    cube = np.asarray(synthesize(Echoes(times_s=times_s, delay_s=delay_s, amplitude=amplitude), radar))
    assert len(cube) == 32
    assert not cube.any()
    amplitude[:] = 1e-4
    assert np.asarray(synthesize(Echoes(times_s=times_s, delay_s=delay_s, amplitude=amplitude), radar)).all()
