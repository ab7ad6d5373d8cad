"""Antenna arrays end to end: directions and levels of spheres, antennas on their own, the point cloud of a walk in noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.body.template import template
from t2d_rt.core.backend import select
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.scattering.ellipsoid import specular_points
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.signal import PointCloud, point_cloud, range_angle, steering_vectors, unit_vectors
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar
from t2d_rt.types.motion import CANONICAL_JOINTS
from validation.bodies import occlusion_of, walking
from validation.methods.reference import nmse_db
from validation.physics.rcs import SPHEROID_M, sphere
from validation.report import Check, Section, at_least, at_most, new_figure, save_chart

AZIMUTH_DEG, ELEVATION_DEG, RANGE_M, SPEED_MPS = 30.0, 10.0, 3.0, 1.5
RADIUS_M = 0.05
LOOPS = 128
SPHEROID_ASPECTS_DEG = (0, 45, 90)
IMAGING_S, IMAGING_AZIMUTH_DEG = 0.15, 20.0
WALK_S = (1.0, 2.5)
TORSO = ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar")
TRACK_FRAMES = 9
"""Frames of which a tracker takes the mean: 0.14 s, a fraction of a step; single frames glint."""
FAR_M = 1.5
"""No part of the body is so far in range from its torso."""
FALSE_ALARM_RATE = 1e-4


def run() -> Section:
    radar = Radar.preset("array-3x4")
    walk = _walk(radar)
    table, tracked = _follows(walk)
    counted = _false_alarms(walk)
    checks = [*_spheres(radar), *_spheroid(radar), *_alone(), *_imaging(), *tracked, *counted]
    return Section(
        title="Antenna arrays",
        checks=checks,
        note=f"Directions: strongest point of `point_cloud` over {LOOPS} loops, preset `array-3x4`, conducting sphere of radius "
        f"{RADIUS_M} m with its nearest point at {RANGE_M:g} m, {AZIMUTH_DEG:g} degrees left and {ELEVATION_DEG:g} up; against "
        "the direction of its centre. Spheroid 8 x 22 cm there, long axis at 0, 45 and 90 degrees to the line "
        "of sight; against its "
        "nearest point, which lies up to 2.4 degrees beside the centre. Each antenna alone: a body (and sphere) at rest at 3 m by "
        "`simulate` with the array, first, middle and last antenna, against `simulate` with that pair as the only one. Imaging: "
        f"sphere at 3 m, {IMAGING_AZIMUTH_DEG:g} degrees left, {IMAGING_S:g} s, level of `range_angle`'s beam.  "
        f"Walk: 12_01 (mesh, skin, self-occlusion), {WALK_S[0]:g} to {WALK_S[1]:g} s, with thermal noise by "
        f"`simulate`, {LOOPS} loops a frame. A frame's centre is the mean of the points within "
        f"{FAR_M:g} m of the body, weighted with their SNR as a power ratio; a track is the mean of {TRACK_FRAMES} frames. "
        "The torso is the skin that turns with pelvis, spine, neck or collars, as far as it faces the radar, the mean of its faces "
        "weighted with area times cosine squared: joints lie a hand's breadth deeper. A walker's brightest parts lie lower than "
        "this (the radar stands at 1 m), so that in height the points are compared with the centre of power of "
        "the echoes that were simulated. False alarms: points more than "
        f"{FAR_M:g} m nearer or farther than the torso, against {FALSE_ALARM_RATE:g} of the cells tested there.",
        table=table,
        charts=[_cloud_chart(walk), _map_chart(walk)],
    )  # fmt: skip


# --- spheres and spheroids ---


def _static(vertices: np.ndarray, faces: np.ndarray, duration_s: float, **options: Any) -> MovingMesh:
    return MovingMesh(np.stack([vertices, vertices]), faces, [0.0, duration_s], **options)


def _record_s(radar: Radar) -> float:
    """A little more than `LOOPS` loops."""
    return (LOOPS + 0.5) * radar.loop_interval_s


def _strongest(cube: np.ndarray, radar: Radar, **options: Any) -> np.ndarray:
    """Azimuth and elevation [deg] of the point of highest SNR."""
    points = point_cloud(cube[:LOOPS], radar, mti="none", **options)
    top = points.snr_db.argmax()
    return np.degrees([points.azimuth_rad[top], points.elevation_rad[top]])


def _ray(radar: Radar, azimuth_deg: float = AZIMUTH_DEG, elevation_deg: float = ELEVATION_DEG) -> np.ndarray:
    """Unit vector in the world."""
    return np.asarray(unit_vectors(math.radians(azimuth_deg), math.radians(elevation_deg)) @ radar.axes)


def _spheres(radar: Radar) -> list[Check]:
    true = np.array([AZIMUTH_DEG, ELEVATION_DEG])
    times = np.linspace(0, _record_s(radar), 4)
    ball, faces = sphere(RADIUS_M, np.zeros(3), subdivisions=4)
    checks = []
    for name, speed in (("static", 0.0), (f"at {SPEED_MPS:g} m/s", SPEED_MPS)):
        ranges = RANGE_M + RADIUS_M - speed * times
        mesh = MovingMesh(ball + (radar.position_m + ranges[:, None] * _ray(radar))[:, None], faces, times, PEC)
        cube = t2d.simulate(mesh, radar=radar).cube
        error = float(np.abs(_strongest(cube, radar) - true).max())
        checks.append(at_most(f"sphere {name}: worse of both angles", error, 0.5, "deg"))
        if speed:
            raw = float(np.abs(_strongest(cube, radar, compensate_tdm=False) - true).max())
            checks.append(at_least("the same, TDM phase not compensated", raw, 1.0, "deg"))
    return checks


def _spheroid(radar: Radar) -> list[Check]:
    """Both methods against the direction of the nearest point."""
    a, c = SPHEROID_M
    sizes = np.array([[a, a, c]])
    ray, position = _ray(radar), np.array(radar.position_m)
    centre = position + (RANGE_M + c) * ray
    left = np.cross([0, 0, 1.0], ray) / np.linalg.norm(np.cross([0, 0, 1.0], ray))
    up = np.cross(ray, left)
    unit, faces = sphere(1.0, np.zeros(3))
    errors: dict[str, list[float]] = {"mesh": [], "ellipsoid": []}
    for aspect in SPHEROID_ASPECTS_DEG:
        psi = math.radians(aspect)
        axes = np.array([up, math.sin(psi) * ray - math.cos(psi) * left, math.cos(psi) * ray + math.sin(psi) * left]).T
        nearest, _ = specular_points(centre[None, None], axes[None, None], sizes, position, position)
        x, y, z = (nearest[0, 0] - position) @ radar.axes.T
        true = np.degrees([math.atan2(y, x), math.atan2(z, math.hypot(x, y))])
        times = np.array([0.0, _record_s(radar)])
        geometries = {
            "mesh": _static(unit * sizes @ axes.T + centre, faces, times[1], material=PEC),
            "ellipsoid": Ellipsoids(sizes, np.tile(centre, (2, 1, 1)), times, axes[None], PEC),
        }
        for method, geometry in geometries.items():
            cube = t2d.simulate(geometry, radar=radar, method=method).cube  # type: ignore[arg-type]
            errors[method].append(float(np.abs(_strongest(cube, radar) - true).max()))
    return [
        at_most(f"spheroid, 3 aspects, {method}: worse of both angles", max(found), 0.5, "deg")
        for method, found in errors.items()
    ]


def _alone() -> list[Check]:
    """Antennas of the array against radars that have nothing but that pair."""
    checks = []
    moving = walking(2.5, 2.52)
    body = _static(
        moving.at(moving.times_s[:1])[0], moving.faces, 0.02, sagitta_rad=moving.sagitta_rad, curved=moving.curved
    )  # fmt: skip
    for preset in ("array-3x4", "imaging-12x16"):
        radar = Radar.preset(preset)
        ball = _static(*sphere(RADIUS_M, radar.position_m + (RANGE_M + RADIUS_M) * _ray(radar), 4), 0.02, material=PEC)
        for name, target in (("body", body), ("sphere", ball)):
            cube = t2d.simulate(target, radar=radar).cube
            worst = max(
                nmse_db(cube[0, antenna], t2d.simulate(target, radar=_pair(radar, antenna)).cube[0, 0])
                for antenna in (0, radar.antennas // 2, radar.antennas - 1)
            )
            checks.append(
                at_most(f"{preset}, {name}: an antenna against that pair alone", worst, -23, "dB")
            )  # fmt: skip
    return checks


def _pair(radar: Radar, antenna: int) -> Radar:
    """A radar with one transmitter and one receiver."""
    tx, rx = divmod(antenna, len(radar.rx_offsets_m))
    return radar.replace(
        tx_offsets_m=[radar.tx_offsets_m[tx]], rx_offsets_m=[radar.rx_offsets_m[rx]], multiplexing="simultaneous",
        prf_hz=1 / radar.loop_interval_s,
    )  # fmt: skip


def _imaging() -> list[Check]:
    """Level of a focused and of a plane-wave beam."""
    radar = Radar.preset("imaging-12x16")
    range_m = round(RANGE_M / radar.range_resolution_m) * radar.range_resolution_m  # on a bin
    ray = _ray(radar, IMAGING_AZIMUTH_DEG, 0.0)
    ball, faces = sphere(RADIUS_M, radar.position_m + (range_m + RADIUS_M) * ray, subdivisions=4)
    cube = t2d.simulate(_static(ball, faces, IMAGING_S, material=PEC), radar=radar).cube
    azimuth_rad = np.radians(IMAGING_AZIMUTH_DEG + np.linspace(-3, 3, 121))
    options = {"azimuth_rad": azimuth_rad, "range_gate_m": (range_m - 0.01, range_m + 0.01)}
    levels_db, found_deg = [], []
    for far_field in (False, True):
        power = range_angle(cube, radar, far_field=far_field, **options).power[0]
        levels_db.append(10 * math.log10(power.max()))
        found_deg.append(float(np.degrees(azimuth_rad[power.argmax()])))
    rcs = math.pi * RADIUS_M**2 * (range_m / (range_m + RADIUS_M)) ** 2
    expected_db = 10 * math.log10(radar.received_power_w(rcs, range_m))
    direction = unit_vectors(math.radians(IMAGING_AZIMUTH_DEG), 0.0)
    near = steering_vectors(radar, direction, range_m + RADIUS_M)  # the echo seems to come from the centre
    plane = steering_vectors(radar, unit_vectors(azimuth_rad, 0.0))
    loss_db = 20 * math.log10(np.abs(plane.conj() @ near).max() / len(near))
    return [
        at_most("imaging: focused beam against eq. 2", abs(levels_db[0] - expected_db), 0.3, "dB"),
        at_most("imaging: focused beam's azimuth", abs(found_deg[0] - IMAGING_AZIMUTH_DEG), 0.1, "deg"),
        at_most(
            f"imaging: loss of the plane-wave beam ({levels_db[0] - levels_db[1]:.2f} dB) against the closed form",
            abs(levels_db[1] - levels_db[0] - loss_db),
            0.05,
            "dB",
        ),
    ]


# --- the walk ---


@dataclass(frozen=True, slots=True)
class _Walk:
    radar: Radar
    cube: np.ndarray
    """With noise, (loop, antenna, sample)."""
    points: PointCloud
    times_s: np.ndarray
    """Centres of the frames, (F,)."""
    torso_m: np.ndarray
    """World, (F, 3)."""
    speed_mps: np.ndarray
    """Of the torso towards the radar, (F,)."""
    power_m: np.ndarray
    """Centre of power of the echoes, world, (F, 3)."""

    @property
    def near(self) -> np.ndarray:
        """Points within `FAR_M` of the torso, bool (point,)."""
        away = self.points.xyz_m + self.radar.position_m - self.torso_m[self.frame]
        return np.asarray(np.linalg.norm(away, axis=1) < FAR_M)

    @property
    def frame(self) -> np.ndarray:
        """Frame of each point, (point,)."""
        return np.rint((self.points.time_s - self.times_s[0]) / (LOOPS * self.radar.loop_interval_s)).astype(int)


def _walk(radar: Radar) -> _Walk:
    body = walking(*WALK_S)
    cube = np.asarray(t2d.simulate(body, radar=radar, noise=t2d.Receiver()).cube)
    points = point_cloud(cube, radar, frame_chirps=LOOPS, false_alarm_rate=FALSE_ALARM_RATE)
    times = (np.arange(len(cube) // LOOPS) + 0.5) * LOOPS * radar.loop_interval_s
    step = 1e-3
    position = np.array(radar.position_m)
    before, torso, after = (_torso(body, position, times + shift) for shift in (-step, 0, step))
    distance = [np.linalg.norm(place - position, axis=1) for place in (before, after)]
    return _Walk(
        radar, cube, points, times, torso, (distance[0] - distance[1]) / (2 * step), _power(body, radar, times)
    )


def _torso(body: MovingMesh, position: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Middle of the torso's skin that faces the radar, (T, 3)."""
    fraction = template().weights[:, [CANONICAL_JOINTS.index(name) for name in TORSO]].sum(axis=1)
    corners = body.at(times_s)[:, body.faces]
    middle = corners.mean(axis=2)
    normal = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    area = np.linalg.norm(normal, axis=-1)
    sight = position - middle
    cosine = np.maximum(np.sum(normal * sight, axis=-1) / np.linalg.norm(sight, axis=-1) / area, 0)
    weight = area * cosine**2 * fraction[body.faces].mean(axis=1)
    return np.einsum("tf,tfi->ti", weight, middle) / weight.sum(axis=1)[:, None]


def _power(body: MovingMesh, radar: Radar, times_s: np.ndarray) -> np.ndarray:
    """Mean of the echoes' places weighted with their powers, (T, 3)."""
    samples_s = sample_times(float(body.times_s[0]), float(body.times_s[-1]), 25.0)
    view = occlusion_of(body, radar, samples_s)
    material = resolve_material("skin", radar.mid_frequency_hz)
    echoes = mesh_echoes(
        body, radar, times_s=times_s, material=material, detail=Detail(sagitta_rad=body.sagitta_rad), seed=0,
        views=[PathVisibility(visibility=(lambda t: view.visibility(t)[0],))], backend=select("auto"),
    ).frames(0, len(times_s))  # fmt: skip
    power = np.abs(echoes.amplitude) ** 2
    assert echoes.departure_m is not None
    return np.einsum("tn,tni->ti", power, echoes.departure_m) / power.sum(axis=1)[:, None]


def _centres(walk: _Walk) -> np.ndarray:
    """Centre of each frame's points in the world and their mean speed, (F, 4)."""
    weight = 10 ** (walk.points.snr_db / 10) * walk.near
    values = np.column_stack([walk.points.xyz_m + walk.radar.position_m, walk.points.speed_mps])
    sums = np.zeros((len(walk.times_s), 5))
    np.add.at(sums, walk.frame, weight[:, None] * np.column_stack([values, np.ones(len(values))]))
    return np.asarray(sums[:, :4] / sums[:, 4:])


def _tracked(values: np.ndarray) -> np.ndarray:
    """Means of `TRACK_FRAMES` frames, (F - TRACK_FRAMES + 1, ...)."""
    return np.lib.stride_tricks.sliding_window_view(values, TRACK_FRAMES, axis=0).mean(axis=-1)


def _follows(walk: _Walk) -> tuple[list[dict[str, Any]], list[Check]]:
    """Table and checks of how the points follow the body."""
    centre = _centres(walk)
    away = {
        "from the torso, along and across [m]": (centre[:, :2] - walk.torso_m[:, :2], 0.15, "m"),
        "from the centre of power, all axes [m]": (centre[:, :3] - walk.power_m, 0.15, "m"),
        "radial speed against the torso's [m/s]": (centre[:, 3:] - walk.speed_mps[:, None], 0.2, "m/s"),
    }
    rows, checks = [], []
    for what, (error, limit, unit) in away.items():
        frames, track = (np.linalg.norm(values, axis=1) for values in (error, _tracked(error)))
        rms = [math.sqrt(np.mean(values**2)) for values in (frames, track)]
        rows.append(
            {
                "points' centre": what, "frames, RMS": rms[0], "frames, worst": frames.max(), "track, RMS": rms[1],
                "track, worst": track.max(),
            }
        )  # fmt: skip
        what = what.split(" [")[0]
        checks.append(at_most(f"walk: centre {what}, track, worst", track.max(), limit, unit))
    return rows, checks


def _false_alarms(walk: _Walk) -> list[Check]:
    ranges = np.linalg.norm(walk.torso_m - walk.radar.position_m, axis=1)
    cells = LOOPS * np.count_nonzero(np.abs(walk.radar.range_axis_m() - ranges[:, None]) > FAR_M)
    alarms = np.count_nonzero(np.abs(walk.points.range_m - ranges[walk.frame]) > FAR_M)
    return [
        at_most(f"walk: {alarms} false alarms in {cells} cells, to the rate asked for", alarms / cells / FALSE_ALARM_RATE, 2)
    ]  # fmt: skip


# --- charts ---


def _cloud_chart(walk: _Walk) -> str:
    figure, axes = new_figure(ncols=2, figsize=(10, 4.2), sharex=True)
    xyz = walk.points.xyz_m[walk.near]
    torso, power = (place - walk.radar.position_m for place in (walk.torso_m, walk.power_m))
    track = _tracked(_centres(walk)[:, :3]) - walk.radar.position_m
    size = np.clip(walk.points.snr_db[walk.near] / 2, 2, None)
    for axis, component, name in ((axes[0], 1, "left [m]"), (axes[1], 2, "up from the radar [m]")):
        drawn = axis.scatter(
            xyz[:, 0],
            xyz[:, component],
            c=walk.points.speed_mps[walk.near],
            s=size,
            cmap="coolwarm",
            vmin=-3,
            vmax=3,
            alpha=0.7,
        )
        axis.plot(torso[:, 0], torso[:, component], "k-", label="torso, facing skin")
        axis.plot(power[:, 0], power[:, component], "k:", label="centre of power")
        axis.plot(track[:, 0], track[:, component], "C2-", label=f"track, {TRACK_FRAMES} frames")
        axis.set(xlabel="forward [m]", ylabel=name, ylim=(-1.2, 1.2))
        axis.grid(alpha=0.3)
    axes[0].set_title("from above")
    axes[1].set_title("from the side")
    axes[1].legend(fontsize=8)
    figure.colorbar(drawn, ax=axes, label="speed, approaching [m/s]")
    return save_chart(figure, "arrays_walk.png")


def _map_chart(walk: _Walk) -> str:
    figure, axis = new_figure()
    frame = len(walk.times_s) // 2
    found = range_angle(walk.cube[frame * LOOPS : (frame + 1) * LOOPS], walk.radar, mti="mean", range_gate_m=(1.0, 6.0))
    level = 10 * np.log10(found.power / found.power.max())
    drawn = axis.pcolormesh(np.degrees(found.azimuth_rad), found.range_m, level, vmin=-40, vmax=0, rasterized=True)
    x, y, _ = (walk.torso_m[frame] - walk.radar.position_m) @ walk.radar.axes.T
    axis.plot(math.degrees(math.atan2(y, x)), np.linalg.norm([x, y]), "w+", markersize=12, label="torso")
    axis.invert_xaxis()
    axis.set(xlabel="azimuth, left positive [deg]", ylabel="range [m]", title="walk, one frame of 15 ms, movers only")
    axis.legend()
    figure.colorbar(drawn, label="[dB]")
    return save_chart(figure, "arrays_map.png")
