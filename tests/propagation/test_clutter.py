"""Static clutter: closed forms of walls and corners, Sionna RT's paths, the shadow of a knife edge, and invariants."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import get_window
from trimesh.creation import box

import t2d_rt as t2d
import t2d_rt.propagation.clutter as traced
from builders import ball, moving, plate
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.propagation.clutter import Shadows, rough_points, roughened, static_paths
from t2d_rt.propagation.edges import bundle, disc
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.scattering.clutter import mirror_echoes
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar, Scene, StaticPath, Surface
from t2d_rt.types.path_fields import received
from validation.physics.edges import knife_edge_db

Corners = list[tuple[float, float, float]]
TIMES_S = np.linspace(0, 0.02, 5)


def ahead(x: float, half_m: float = 5.0, **kind: object) -> Surface:
    y, z = half_m, (1 - half_m, 1 + half_m)
    corners = [(x, -y, z[0]), (x, y, z[0]), (x, y, z[1]), (x, -y, z[1])]
    return plate("ahead", corners, **{"material": PEC, **kind})  # type: ignore[arg-type]


def found(*surfaces: Surface, radar: Radar | None = None, order: int = 3) -> list[StaticPath]:
    radar = Radar.preset("table2") if radar is None else radar
    return static_paths(Scene(name="test", surfaces=surfaces), radar, order=order, backend=select("cpu"))


def power_w(paths: list[StaticPath], radar: Radar) -> float:
    """Mean power of the samples."""
    cube = synthesize(mirror_echoes(paths, radar, times_s=TIMES_S), radar)
    return float(np.mean(np.abs(cube[:]) ** 2))


# --- walls and corners ---


def test_a_conductor_is_a_mirror() -> None:
    """Friis over twice the distance; with gain and IF gain in the budget, as read from the cube."""
    radar, distance = Radar.preset("table2", tx_gain_dbi=11.0, if_gain_db=3.0), 3.0
    paths = found(ahead(distance), radar=radar)
    assert [path.path.chain for path in paths] == [("ahead",)]
    level_db = 12 + 11 + 9 + 3 - 30 + 20 * math.log10(radar.wavelength_m / (4 * math.pi * 2 * distance))
    assert 10 * math.log10(power_w(paths, radar)) == pytest.approx(level_db, abs=1e-4)


def test_a_wall_beyond_the_farthest_range_is_not_recorded() -> None:
    """At 8.04 m before a radar that reaches 6.25 m: nothing; at 5 m a mirror by Friis."""
    radar = Radar.preset("openradar")
    assert power_w(found(ahead(8.04), radar=radar), radar) == 0
    assert power_w(found(ahead(5.0), radar=radar), radar) == pytest.approx(
        radar.link_amplitude**2 * 4 * math.pi / 10**2, rel=1e-4
    )


def test_path_pairs_beyond_the_farthest_range_are_not_recorded() -> None:
    """A ball at 3 m beside a mirror 4 m to the left, whose image is 8.5 m away: it is recorded there and half-way, at 5.7 m, but
    does not fold to 2.2 m."""
    radar = Radar.preset("openradar", position_m=(0, 0, 1))
    side = plate("side", [(0, 4, -4), (6, 4, -4), (6, 4, 6), (0, 4, 6)], PEC)
    still = Ellipsoids([[0.1] * 3], np.tile([3.0, 0.0, 1.0], (5, 1, 1)), np.linspace(0, 0.05, 5), material="pec")
    recording = t2d.simulate(still, radar=radar, scene=Scene(name="one", surfaces=(side,)), clutter="none")
    assert recording.settings["pairs"] == ["direct", "direct, side", "side"]
    profile = np.abs(np.fft.fft(np.asarray(recording.cube)[0, 0] * np.blackman(radar.samples))) ** 2
    image_m = math.hypot(3, 8) - 0.1
    places = 2.9, (2.9 + image_m) / 2, image_m - radar.max_range_m
    direct, mixed, folded = (
        profile[round(place / radar.range_resolution_m) + np.arange(-2, 3)].max() for place in places
    )
    assert mixed > 0.01 * direct
    assert folded < 1e-7 * direct


def test_a_plasterboard_wall_has_the_coefficient_of_its_slab() -> None:
    """Of each sample's own frequency, conjugated as IF = tx conj(rx)."""
    radar, distance, thickness = Radar.preset("table2"), 3.0, 0.0125
    paths = found(ahead(distance, material="plasterboard", thickness_m=thickness))
    t, delay = radar.sample_times_s, 2 * distance / SPEED_OF_LIGHT
    f = radar.carrier_hz + radar.slope_hz_per_s * t
    # ITU-R P.2040-3: plasterboard has 2.73 and 0.0085 f^0.9395 S/m; the slab at normal incidence.
    conductivity = 0.0085 * (radar.mid_frequency_hz / 1e9) ** 0.9395
    eta = 2.73 - 1j * conductivity / (2 * math.pi * f * 8.8541878128e-12)
    r = (1 - np.sqrt(eta)) / (1 + np.sqrt(eta))
    phase = np.exp(-4j * math.pi * f * thickness / SPEED_OF_LIGHT * np.sqrt(eta))
    coefficient = r * (1 - phase) / (1 - r**2 * phase)
    cycles = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * t - delay**2 / 2)
    scale = radar.link_amplitude * math.sqrt(4 * math.pi) / (2 * distance)
    expected = scale * np.conj(coefficient) * np.exp(2j * math.pi * cycles)
    recorded = synthesize(mirror_echoes(paths, radar, times_s=TIMES_S), radar)[:]
    error = np.mean(np.abs(recorded[0, 0] - expected) ** 2) / np.mean(np.abs(expected) ** 2)
    # The coefficient bends over the sweep: a straight line misses it by -31.7 dB, its value at the middle by -20.9.
    assert 10 * math.log10(error) < -31


def corner(*, inside: bool) -> list[Surface]:
    """Three perfect mirrors that meet at (3, 2, 0) at right angles, seen from within or as a box is from without."""
    x, y, z = (3.0, 2.0, 0.0) if inside else (0.7, 0.5, 0.6)
    far = -6 if inside else 6
    return [
        plate("x", [(x, y, z), (x, y + far, z), (x, y + far, z - far), (x, y, z - far)], PEC),
        plate("y", [(x, y, z), (x + far, y, z), (x + far, y, z - far), (x, y, z - far)], PEC),
        plate("z", [(x, y, z), (x + far, y, z), (x + far, y + far, z), (x, y + far, z)], PEC),
    ]


def test_a_corner_has_as_many_paths_as_images() -> None:
    """An antenna has seven images in a trihedral, though its faces can be met in 15 orders."""
    paths = found(*corner(inside=True))
    away = np.array([3.0, 2.0, 1.0])
    expected = sorted(
        2 * math.hypot(*(distance for distance, used in zip(away, pick, strict=True) if used))
        for pick in np.ndindex(2, 2, 2)
        if any(pick)
    )
    lengths = sorted(float(np.linalg.norm(path.arrival_m - [0, 0, 1])) for path in paths)
    assert lengths == pytest.approx(expected, abs=1e-12)
    assert sorted(len(set(path.path.chain)) for path in paths) == [1, 1, 1, 2, 2, 2, 3]
    # Two mirrors that the polarisation lies along do not turn it.
    dihedral = next(path for path in paths if sorted(path.path.chain) == ["x", "y"])
    assert received(dihedral, np.array([77.87e9]))[0] == pytest.approx(1, abs=1e-6)


def test_an_edge_that_sticks_out_sends_nothing_back() -> None:
    assert not found(*corner(inside=False))


def test_between_two_walls_both_paths_round_count() -> None:
    behind = plate("behind", [(-1, -5, -4), (-1, 5, -4), (-1, 5, 6), (-1, -5, 6)], PEC)
    chains = [path.path.chain for path in found(ahead(3.0), behind)]
    one, other = ("ahead", "behind"), ("behind", "ahead")
    assert sorted(chains) == sorted([one[:1], other[:1], one, other, (*one, "ahead"), (*other, "behind")])


def test_antennas_radiate_where_their_pattern_does() -> None:
    behind = plate("behind", [(-1, -5, -4), (-1, 5, -4), (-1, 5, 6), (-1, -5, 6)], PEC)
    pattern = {"kind": "cosine", "exponent": 2}
    radar = Radar.preset("table2", tx_pattern=pattern, rx_pattern=pattern)
    both, one = found(ahead(3.0), behind, order=1), found(ahead(3.0), order=1)
    assert power_w(both, radar) == pytest.approx(power_w(one, radar), rel=1e-6)


def test_each_antenna_has_the_delay_of_its_own_image() -> None:
    radar = Radar.preset("array-3x4")
    (path,) = found(ahead(2.0), radar=radar)
    echoes = mirror_echoes([path], radar, times_s=TIMES_S).gather()
    departure, arrival = echoes.departure_m[0, 0].astype(float), echoes.arrival_m[0, 0].astype(float)
    tx, rx = radar.tx_positions_m, radar.rx_positions_m

    def longer(points: np.ndarray, place: np.ndarray, centre: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(points - place, axis=1) - np.linalg.norm(centre - place))

    length_m = longer(tx, departure, radar.tx_position_m)[:, None] + longer(rx, arrival, radar.rx_position_m)
    length_m = length_m + SPEED_OF_LIGHT * echoes.delay_s[0, 0]
    images = tx * [-1, 1, 1] + [4, 0, 0]
    exact = np.linalg.norm(images[:, None] - rx, axis=2)
    # What a sum over both ends cannot hold is the product of the two offsets over the path length.
    most = (
        np.linalg.norm(tx - radar.tx_position_m, axis=1).max() * np.linalg.norm(rx - radar.rx_position_m, axis=1).max()
    )
    assert np.abs(length_m - exact).max() < 1.1 * most / 4 + 1e-6  # points are float32
    assert most / 4 < radar.wavelength_m / 100


@pytest.mark.slow
def test_paths_are_those_of_sionna() -> None:
    """All within 60 dB of the strongest, delays, amplitudes and phases; the line of sight is left out."""
    mitsuba(select("cpu"))
    scene = "living_room"
    import sionna.rt as rt

    radar = Radar.preset("table2", tx_offsets_m=[[0, 0.12, 0.03]], rx_offsets_m=[[0.02, -0.08, 0]])
    theirs = rt.load_scene(str(resource("scenes", scene) / f"{scene}.xml"), merge_shapes=False)
    theirs.frequency = radar.mid_frequency_hz
    theirs.tx_array = theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    theirs.add(rt.Transmitter(name="tx", position=radar.tx_position_m.tolist()))
    theirs.add(rt.Receiver(name="rx", position=radar.rx_position_m.tolist()))

    def solved() -> list[tuple[float, complex]]:
        found = rt.PathSolver()(theirs, max_depth=3, los=False, refraction=False, seed=1)
        field = np.array(found.a[0]).ravel() + 1j * np.array(found.a[1]).ravel()
        return list(zip(np.array(found.tau).ravel().tolist(), field.tolist(), strict=True))

    there = solved()
    theirs.get("tx").position, theirs.get("rx").position = radar.rx_position_m.tolist(), radar.tx_position_m.tolist()
    there_and_back = there + solved()
    strongest = max(abs(field) for _, field in there)
    ours = []
    for path in static_paths(load_scene(scene), radar, order=3, backend=select("cpu")):
        length = float(np.linalg.norm(path.arrival_m - radar.rx_position_m))
        field = radar.wavelength_m / (4 * math.pi * length) * received(path, np.array([radar.mid_frequency_hz]))[0]
        ours.append((length / SPEED_OF_LIGHT, field))
        # That solver loses paths whose hashes collide, but not the way back, and paths that are short somewhere.
        same = [other for delay, other in there_and_back if abs(delay - ours[-1][0]) < 1e-12]
        if not same and np.linalg.norm(np.diff(path.stops_m, axis=0), axis=1).min() < 0.01:
            continue
        if abs(field) > 1e-3 * strongest:
            nearest = min(same, key=lambda other: abs(other - field))
            assert abs(20 * math.log10(abs(field / nearest))) < 0.1
            assert abs(np.angle(field / nearest, deg=True)) < 5
    dominant = [delay for delay, field in there if abs(field) > 1e-3 * strongest]
    assert len(dominant) > 55
    assert all(min(abs(delay - mine) for mine, _ in ours) < 1e-12 for delay in dominant)


def test_paths_that_are_kept_are_those_of_the_scene_and_radar_at_hand() -> None:
    """Whatever changes a path must not find another's."""
    near, far, rough = ahead(3.0), ahead(4.0), ahead(3.0, material=replace(PEC, scattering_coefficient=0.5))
    table2 = Radar.preset("table2")
    changes = {
        "position_m": (0.5, 0.0, 1.0), "tx_offsets_m": ((0.0, 0.3, 0.0),), "rx_polarization_deg": 90.0, "carrier_hz": 60e9,
    }  # fmt: skip
    radars = [table2, *(table2.replace(**{name: value}) for name, value in changes.items())]
    seen = []
    for _ in range(2):  # made, then kept
        for surface, radar in [(near, table2), (far, table2), (rough, table2), *((near, each) for each in radars[1:])]:
            (path,) = found(surface, radar=radar, order=1)
            field = received(path, np.array([radar.mid_frequency_hz]))[0]
            seen.append((*path.stops_m.ravel(), *path.taken, field, radar.mid_frequency_hz))
    half = len(seen) // 2
    assert seen[:half] == seen[half:]
    assert len(set(seen)) == half


# --- rough walls ---


def test_a_rough_wall_returns_what_lamberts_law_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """sum of sigma / R^4 over an endless wall at distance d is 2 pi S^2 |R|^2 / d^2, however many points stand for it."""
    radar, distance, fraction = Radar.preset("table2"), 2.0, 0.3
    scene = roughened(Scene(name="wall", surfaces=(ahead(distance, half_m=45.0),)), fraction, radar.mid_frequency_hz)
    mirrors = Mirrors.of(scene, select("cpu"))
    for count in (1000, 4000):
        monkeypatch.setattr(traced, "DIRECTIONS", count)
        points, rcs = rough_points(mirrors, radar)
        total = np.sum(rcs / np.linalg.norm(points - [0, 0, 1], axis=1) ** 4)
        assert 0.4 * count < len(points) < 0.51 * count
        assert total == pytest.approx(2 * math.pi * fraction**2 / distance**2, rel=0.01)
    # What is scattered is missing from the mirror's path.
    (path,), (smooth,) = static_paths(scene, radar, order=1, backend=select("cpu")), found(ahead(distance), order=1)
    ratio = (
        received(path, np.array([radar.mid_frequency_hz]))[0] / received(smooth, np.array([radar.mid_frequency_hz]))[0]
    )
    assert abs(ratio) == pytest.approx(math.sqrt(1 - fraction**2), rel=1e-9)


def test_points_are_seen_from_both_antennas() -> None:
    """A screen before the receiver hides a part of the wall from it, and another from the transmitter."""
    screen = plate("screen", [(1, 1.5, 0), (1, 2.5, 0), (1, 2.5, 2), (1, 1.5, 2)], PEC)
    scene = roughened(Scene(name="two", surfaces=(ahead(3.0), screen)), 0.3, 77e9)
    radar = Radar.preset("table2", rx_offsets_m=[[0.0, 2.0, 0.0]])
    points, _ = rough_points(Mirrors.of(scene, select("cpu")), radar)
    wall = points[points[:, 0] > 2]
    assert len(wall) > 500
    for middle_y, half_y in ((2.0, 1.5), (6.0, 1.5)):
        hidden = np.abs(wall[:, 1:] - [middle_y, 1]) < [half_y - 1e-3, 3 - 1e-3]
        assert not hidden.all(axis=1).any()
    assert np.ptp(points[points[:, 0] < 2], axis=0)[1] > 0.9


# --- shadows ---


def board(start_m: tuple[float, float, float], speed_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> MovingMesh:
    """2 m wide and high, thin, across x."""
    shape, times = box((0.002, 2.0, 2.0)), np.linspace(0, 1, 11)
    return moving((shape.vertices, shape.faces), np.array(start_m) + np.array(speed_mps) * times[:, None], times)


def shadows(body: MovingMesh | Ellipsoids, path_m: list[tuple[float, float, float]], rate_hz: float = 25.0) -> Shadows:
    samples_s = sample_times(body.times_s[0], body.times_s[-1], rate_hz)
    return Shadows([body], [np.array(path_m)], 0.00385, samples_s=samples_s, backend=select("cpu"))


def test_a_wide_plate_fades_a_path_as_a_knife_edge_does() -> None:
    # Its leading edge goes from 0.2 m before the ray to 0.2 m beyond.
    plane = board((2.0, -1.2, 1.0), (0.0, 0.4, 0.0))
    times = np.linspace(0, 1, 401)
    fraction = shadows(plane, [(0, 0, 1), (4, 0, 1)], rate_hz=100.0).fractions(times)[:, 0]
    height = -0.2 + 0.4 * times
    v = height * math.sqrt(2 / 0.00385 * (1 / 2 + 1 / 2))
    loss = -20 * np.log10(np.maximum(fraction, 1e-9))
    lit = v < 0.3
    assert np.abs(loss[lit] + knife_edge_db(v)[lit]).max() < 2.5
    assert loss[np.argmin(np.abs(v))] == pytest.approx(6.0, abs=1.0)
    assert (loss[v > 1.5] > 20).all()
    assert (fraction[v < -1.6] == 1).all()
    # No steps: it takes some 60 mm to fade, a ray of the bundle is a 32nd.
    assert (np.diff(fraction) < 1e-6).all()
    assert np.abs(np.diff(fraction)).max() < 0.04


def test_the_fresnel_zone_is_bent_at_mirrors() -> None:
    path, wavelength = np.array([(0.0, 0.0, 1.0), (2.0, 2.0, 1.3), (5.0, -1.0, 1.75)]), 0.004
    rays = bundle(path, wavelength, disc(32), 4)
    before, after = rays[0, -1] - path[1], rays[1, 0] - path[1]
    assert np.abs(before * [1, -1, 1] - after).max() < 1e-12
    first, second = np.linalg.norm(np.diff(path, axis=0), axis=1)
    radius = math.sqrt(wavelength * first * second / (first + second))
    assert np.mean(np.sum(before**2, axis=1)) == pytest.approx(radius**2 / 2, rel=1e-9)
    assert np.abs(before @ (path[1] - path[0])).max() < 1e-12


def test_a_path_is_shadowed_out_and_back() -> None:
    """The same rays meet a body both times: a half covered zone leaves a half, not a quarter."""
    wide = board((1.5, -1.0, 1.0))
    there_and_back = [(0.0, 0.0, 1.0), (3.0, 0.0, 1.0), (0.0, 0.0, 1.0)]
    assert shadows(wide, there_and_back).fractions(TIMES_S)[0, 0] == pytest.approx(0.5, abs=0.04)


def test_bodies_of_ellipsoids_and_of_triangles_have_the_same_shadow() -> None:
    times, radius = np.linspace(0, 1, 11), 0.15
    sphere = ball((2, -0.3, 1), (0, 0.6, 0), 1.0, radius_m=radius, level=2, frames=11)
    centres = np.array([2.0, -0.3, 1.0]) + np.array([0.0, 0.6, 0.0]) * times[:, None, None]
    ellipsoid = Ellipsoids(np.full((1, 3), radius), centres, times)
    asked = np.linspace(0, 1, 101)
    path = [(0.0, 0.0, 1.0), (4.0, 0.0, 1.0)]
    one, other = (shadows(body, path).fractions(asked) for body in (ellipsoid, sphere))
    assert one.min() == 0
    assert one.max() == 1
    assert np.abs(one - other).max() < 1e-6


@pytest.mark.slow
def test_the_static_scene_stays_at_zero_doppler() -> None:
    """Also in a shadow, and with rough walls."""
    short = ball((2.5, 0.4, 1.0), time_s=0.1, radius_m=0.15, frames=2)
    radar = Radar.preset("table2", prf_hz=2000.0)
    result = t2d.simulate(
        short, radar=radar, scene="living_room", clutter="diffuse", accuracy={"dynamic_range_db": 20.0}
    )
    cube = result.adc.values[:, 0].astype(complex)
    spectrum = np.fft.fft(get_window("hann", len(cube))[:, None] * cube, axis=0)
    power = np.sum(np.abs(spectrum) ** 2, axis=1)
    # A periodic Hann window holds a still line in the three cells around zero.
    assert 10 * math.log10(power[2:-1].sum() / power.sum()) < -80
    assert result.settings["clutter_paths"] > 50
    assert result.settings["clutter_points"] > 2000


def test_a_body_passes_before_a_wall() -> None:
    """The wall's line fades while the body blocks the path, and only then."""
    scene = Scene(name="wall", surfaces=(ahead(3.0),))
    body = ball((1.5, -1.0, 1.0), (0.0, 2.0, 0.0), 1.0, radius_m=0.25, level=2, frames=11)
    radar = Radar.preset("table2", prf_hz=2000.0, rx_gain_dbi=9.0)
    with_wall, alone = (
        t2d.simulate(body, radar=radar, scene=scene, clutter=clutter, reflections=0).adc.values[:, 0].astype(complex)
        for clutter in ("specular", "none")
    )
    level = np.mean(np.abs(with_wall - alone) ** 2, axis=1)
    level_db = 10 * np.log10(level / level[0] + 1e-12)
    middle = len(level) // 2
    assert np.abs(level_db[: middle // 3]).max() < 0.01
    assert np.abs(level_db[-middle // 3 :]).max() < 0.01
    assert level_db[middle] < -60


def test_what_clutter_there_may_be() -> None:
    body = ball((1.5, 0.0, 1.0), time_s=1.0, level=2, frames=11)
    with pytest.raises(InputError, match="clutter must be 'specular', 'diffuse' or 'none', got 'all'"):
        t2d.simulate(body, clutter="all")  # type: ignore[arg-type]
    free = t2d.simulate(body, radar=Radar.preset("table2", prf_hz=100.0))
    assert "clutter" not in free.settings
