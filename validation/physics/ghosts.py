"""Ghosts: a sphere's mirror images against closed forms, each one of a room with its chain, and what must stay the same."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import j0
from trimesh.creation import icosphere

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.pipeline.path_pairs import probed
from t2d_rt.propagation.scene_paths import radar_paths
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.scattering.paths import ranked_pairs
from t2d_rt.signal import range_doppler
from t2d_rt.types import MovingMesh, PathPair, Radar, Scene, Surface
from validation.report import Check, Section, at_most, new_figure, save_chart

RADIUS_M, WALL_M = 0.15, 2.0
START_M, VELOCITY_MPS, TIME_S = np.array([4.0, 0.3, 0.0]), np.array([-2.0, 0.5, 0.0]), 0.1
BALL_M, BESIDE_M, HIDDEN_DB = 0.3, 0.4, -40.0
SHOWN, SHOWN_DB = 14, 60.0
"""Ghosts that are labelled, and the dynamic range of the chart."""
RANGE_BINS, SPEED_BINS, POWER_DB, SWAP_DB, MOVED_DB, STATIC_DBC = 0.1, 0.5, 0.5, -80.0, -60.0, -80.0


def run() -> Section:
    checks = [*_beside_a_wall(), *_behind_a_ball(), *_unchanged()]
    rows, chart = _labelled()
    return Section(
        title="Ghosts",
        checks=checks,
        note=f"A metal sphere of {RADIUS_M:g} m passes a metal wall {WALL_M:g} m aside: range, speed and power of its ghosts over "
        "one of the two paths (length (R + R')/2 - a cos(beta/2)) and over both (R' - a) against closed forms. Then a ball of "
        f"{BALL_M:g} m stands on the path to the wall, or {BESIDE_M:g} m beside it, where the ghost has the ripple that "
        "Kirchhoff's integral gives beside a disc of its radius. Then a small room: transmitter and receiver 20 cm apart change "
        "places; everything is turned and shifted together; nothing moves. The chart: such a "
        "sphere in the empty room, and where its ghosts must be.",
        table=rows,
        charts=[chart],
    )


def _plate(name: str, corners: list[tuple[float, float, float]], material: str) -> Surface:
    return Surface(
        name=name,
        vertices=np.array(corners),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        material=material,
        thickness_m=0.01,
    )


def _ball(
    start_m: np.ndarray, velocity_mps: np.ndarray, radius_m: float = RADIUS_M, time_s: float = TIME_S
) -> MovingMesh:
    sphere = icosphere(subdivisions=3, radius=radius_m)
    times = np.linspace(0, time_s, 5)
    return MovingMesh(
        sphere.vertices + (start_m + velocity_mps * times[:, None])[:, None],
        sphere.faces,
        times,
        material="pec",
        name="sphere",
    )


# --- a sphere beside a wall ---


def _walled() -> tuple[Radar, Scene]:
    corners = [(-2.0, WALL_M, -2.0), (12.0, WALL_M, -2.0), (12.0, WALL_M, 4.0), (-2.0, WALL_M, 4.0)]
    wall = Scene(name="wall", surfaces=(_plate("wall", corners, "metal"),))
    return Radar.preset("table2", position_m=(0.0, 0.0, 0.0)), wall


def _behind_a_ball() -> list[Check]:
    """Power of the ghost over both paths, with a ball before the wall or beside the path to it, over that without."""
    radar, wall = _walled()
    reflection = START_M * WALL_M / (2 * WALL_M - START_M[1])
    reflection[1] = WALL_M
    across = np.array([-reflection[1], reflection[0], 0.0]) / np.linalg.norm(reflection)
    power = []
    for targets in [[], *([_ball(reflection / 2 + aside * across, np.zeros(3), BALL_M)] for aside in (0.0, BESIDE_M))]:
        sphere = _ball(START_M, np.zeros(3))
        found = t2d.simulate(
            [sphere, *targets], radar=radar, scene=wall, clutter="none", only_paths=["wall"], split="target"
        )
        power.append(float(np.mean(np.abs(next(iter(found.parts.values())).adc.values) ** 2)))
    half_m = float(np.linalg.norm(reflection)) / 2
    whole_m = float(np.linalg.norm(START_M - [0.0, 2 * WALL_M, 0.0])) - RADIUS_M
    ripple_db = 2 * _beside_disc_db(half_m, whole_m - half_m, radar.wavelength_m)  # out and back
    hidden, beside = (10 * math.log10(max(each / power[0], 1e-12)) for each in power[1:])
    return [
        at_most("ball before the wall: ghost over it", hidden, HIDDEN_DB, "dB"),
        at_most("ball beside the path to the wall: ghost over it, off by", abs(beside - ripple_db), POWER_DB, "dB"),
    ]  # fmt: skip


def _beside_disc_db(out_m: float, back_m: float, wavelength_m: float) -> float:
    """Level of the field beside a disc of the ball's radius, `out_m` behind a point source and `back_m` before the observer, over
    that without it: Kirchhoff's integral in Fresnel's approximation, with rings of the disc by the Bessel function."""
    zone = wavelength_m * out_m * back_m / (out_m + back_m)
    ring = (np.arange(20000) + 0.5) / 20000 * BALL_M
    phase = np.exp(1j * np.pi * (ring**2 + BESIDE_M**2) / zone)
    blocked = np.mean(phase * j0(2 * np.pi * ring * BESIDE_M / zone) * 2 * np.pi * ring) * BALL_M
    return float(20 * math.log10(abs(1 + 1j / zone * blocked)))


def _beside_a_wall() -> list[Check]:
    radar, wall = _walled()
    image = np.array([0.0, 2 * WALL_M, 0.0])

    def geometry(time_s: float, pair: tuple[int, int]) -> tuple[float, float, float]:
        centre = START_M + VELOCITY_MPS * time_s
        towards = [centre, centre - image]
        out, back = towards[pair[0]], towards[pair[1]]
        lengths = float(np.linalg.norm(out)), float(np.linalg.norm(back))
        return *lengths, math.acos(min(1.0, float(out @ back) / (lengths[0] * lengths[1])))

    def path(time_s: float, pair: tuple[int, int]) -> float:
        out, back, beta = geometry(time_s, pair)
        return (out + back) / 2 - RADIUS_M * math.cos(beta / 2)

    image_of = [
        range_doppler(
            t2d.simulate(_ball(START_M, VELOCITY_MPS), radar=radar, scene=scene, clutter="none").adc.values[:, 0], radar,
            correct_coupling=True,
        )
        for scene in (wall, "free_space")
    ]  # fmt: skip
    there, alone = image_of
    bin_m, bin_mps = np.diff(there.range_m[:2])[0], abs(np.diff(there.velocity_mps[:2])[0])
    found = []
    middle, step = TIME_S / 2, 1e-4
    alone_at = np.unravel_index(np.argmax(alone.power), alone.power.shape)
    for name, pair, copies in (("one path over the wall", (0, 1), 2), ("both paths over the wall", (1, 1), 1)):
        range_m, speed = path(middle, pair), (path(middle - step, pair) - path(middle + step, pair)) / (2 * step)
        at = _peak_near(there.power, there.velocity_mps, there.range_m, speed, range_m)
        seen_m = _between(there.range_m, there.power[at[0]], at[1])
        seen_mps = _between(there.velocity_mps, there.power[:, at[1]], at[0])
        expected = copies**2 * sphere_power(*geometry(middle, pair)) / sphere_power(*geometry(middle, (0, 0)))
        # Power of a line is that of the cells it spreads over.
        power_db = 10 * math.log10(_line_power(there.power, at) / _line_power(alone.power, alone_at) / expected)
        found += [
            at_most(f"{name}: range", abs(seen_m - range_m) / bin_m, RANGE_BINS, "bins"),
            at_most(f"{name}: speed", abs(seen_mps - speed) / bin_mps, SPEED_BINS, "bins"),
            at_most(f"{name}: power", abs(power_db), POWER_DB, "dB"),
        ]
    return found


def _peak_near(
    power: np.ndarray, speeds: np.ndarray, ranges: np.ndarray, speed: float, range_m: float
) -> tuple[int, int]:
    row, column = int(np.argmin(np.abs(speeds - speed))), int(np.argmin(np.abs(ranges - range_m)))
    near = power[row - 2 : row + 3, column - 2 : column + 3]
    at = np.unravel_index(np.argmax(near), near.shape)
    return row - 2 + int(at[0]), column - 2 + int(at[1])


def _between(axis: np.ndarray, power: np.ndarray, peak_at: int) -> float:
    """Peak of a Hann-weighted line: parabola through the logs of three cells."""
    a, b, c = np.log(power[peak_at - 1 : peak_at + 2])
    return float(axis[peak_at] + 0.5 * (a - c) / (a - 2 * b + c) * (axis[1] - axis[0]))


def _line_power(power: np.ndarray, at: Any) -> float:
    row, column = at
    return float(power[row - 3 : row + 4, column - 2 : column + 3].sum())


def sphere_power(out_m: float, back_m: float, beta: float, radius_m: float = RADIUS_M) -> float:
    """Power of a sphere's specular echo over two paths to its centre, up to a constant.

    4 cos^2(beta/2) / det H, H the Hessian of the path on its surface.
    """
    cosine = math.cos(beta / 2)
    a, b = out_m - radius_m * cosine, back_m - radius_m * cosine
    bend = 1 / a + 1 / b
    along, across = bend * cosine**2 + 2 * cosine / radius_m, bend + 2 * cosine / radius_m
    return cosine**2 / (along * across) / (a * b) ** 2


# --- what must stay the same ---


def _unchanged() -> list[Check]:
    room = Scene(
        name="corner",
        surfaces=(
            _plate("floor", [(-1, -2, 0), (6, -2, 0), (6, 2, 0), (-1, 2, 0)], "concrete"),
            _plate("left", [(-1, 2, 0), (6, 2, 0), (6, 2, 3), (-1, 2, 3)], "plasterboard"),
        ),
    )
    target = _ball(np.array([3.0, 0.2, 1.1]), np.array([-1.0, 0.3, 0.2]), 0.1, 0.05)
    sides = ([[0.0, 0.1, 0.0]], [[0.0, -0.1, 0.0]])
    swapped = [
        _cube(target, room, Radar.preset("table2", tx_offsets_m=tx, rx_offsets_m=rx)) for tx, rx in (sides, sides[::-1])
    ]
    angle, shift = 0.7, np.array([3.0, -5.0, 0.4])
    rotation = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    moved = Scene(
        name="moved",
        surfaces=tuple(
            Surface(
                name=s.name, vertices=s.vertices @ rotation.T + shift, faces=s.faces, material=s.material,
                thickness_m=s.thickness_m,
            )
            for s in room.surfaces
        ),
    )  # fmt: skip
    # Patches are cut in the pose at rest, which a body brings with it.
    there = MovingMesh.from_track(
        lambda t: target.at(t) @ rotation.T + shift, target.faces, target.times_s, material="pec", rest=target.rest
    )
    radar = Radar.preset(
        "table2", position_m=tuple(rotation @ [0, 0, 1] + shift), boresight=tuple(rotation @ [1, 0, 0])
    )
    one, other = _cube(target, room, Radar.preset("table2")), _cube(there, moved, radar)
    static = _ball(np.array([3.0, 0.2, 1.1]), np.zeros(3), 0.1)
    cube = t2d.simulate(static, radar=Radar.preset("table2"), scene="living_room").adc.values
    moving_dbc = _db(cube - cube.mean(axis=0), cube)
    return [
        at_most("antennas swapped", _db(swapped[1] - swapped[0], swapped[0]), SWAP_DB, "dB"),
        at_most("turned and shifted together", _db(other - one, one), MOVED_DB, "dB"),
        at_most("nothing moves, with clutter: outside zero Doppler", moving_dbc, STATIC_DBC, "dBc"),
    ]


def _cube(target: MovingMesh, scene: Scene, radar: Radar) -> np.ndarray:
    found = t2d.simulate(target, radar=radar, scene=scene, clutter="none", accuracy={"occlusion": False})
    return np.asarray(found.adc.values)


def _db(part: np.ndarray, whole: np.ndarray) -> float:
    ratio = float(np.sum(np.abs(part) ** 2) / np.sum(np.abs(whole) ** 2))
    return 10 * math.log10(max(ratio, 1e-40))


# --- a room's ghosts by name ---


def _labelled() -> tuple[list[dict[str, Any]], str]:
    """The strongest ghosts of a sphere in the empty room: where they must be, and a map of where they are."""
    radar = Radar.preset("table2")
    start = np.array([3.6, 0.4, 1.2])
    target = _ball(start, VELOCITY_MPS)
    result = t2d.simulate(target, radar=radar, scene="empty_room", clutter="none")
    image = range_doppler(result.adc.values[:, 0], radar, correct_coupling=True)
    middle = start + VELOCITY_MPS * TIME_S / 2
    found = radar_paths(load_scene("empty_room"), radar, middle[None], order=2, backend=select("auto"))
    ranked = ranked_pairs(radar, probed(found, middle[None]), order=2)[:SHOWN]

    def ghost(pair: PathPair) -> tuple[float, float]:
        towards = [path.image_m - middle for path in (pair.out, pair.back)]
        lengths = [float(np.linalg.norm(each)) for each in towards]
        units = [each / length for each, length in zip(towards, lengths, strict=True)]
        cosine = math.sqrt((1 + min(1.0, float(units[0] @ units[1]))) / 2)
        return sum(lengths) / 2 - RADIUS_M * cosine, float((units[0] + units[1]) @ VELOCITY_MPS) / 2

    figure, (ax, aside) = new_figure(figsize=(9.5, 5), ncols=2, width_ratios=(3, 1.4))
    level = 10 * np.log10(np.maximum(image.power, 1e-30) / image.power.max())
    drawn = ax.pcolormesh(
        image.range_m, image.velocity_mps, level, vmin=-SHOWN_DB, vmax=0, shading="nearest", rasterized=True
    )
    figure.colorbar(drawn, ax=ax, label="Power rel. to the direct echo [dB]")
    rows, lines = [], []
    for number, each in enumerate(ranked, start=1):
        range_m, speed = ghost(each.pair)
        ax.plot(range_m, speed, "o", ms=9, mfc="none", mec="white", mew=0.8)
        ax.annotate(str(number), (range_m, speed), xytext=(5, 4), textcoords="offset points", color="white", fontsize=8)
        rows.append(
            {
                "": number,
                "path pair": each.pair.name,
                "range [m]": range_m,
                "speed [m/s]": speed,
                "level [dB]": each.best_db,
            }
        )
        lines.append(f"{number}  {each.pair.name}")
    ax.set(xlabel="Range [m]", ylabel="Radial velocity [m/s], approaching > 0", xlim=(2.5, 9), ylim=(-1.5, 3))
    ax.set_title("A metal sphere in the empty room")
    aside.axis("off")
    aside.text(0, 1, "\n".join(lines), va="top", fontsize=8, linespacing=1.6)
    return rows, save_chart(figure, "ghosts.png")
