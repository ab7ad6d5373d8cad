"""The paths to the targets as a table: delay, length, speed, level, directions, and the surfaces on each path (docs/rooms.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from t2d_rt.core import files
from t2d_rt.core.checks import array, numbered
from t2d_rt.core.constants import SPEED_OF_LIGHT, unit_of
from t2d_rt.core.errors import InputError
from t2d_rt.motion import track
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.pipeline.targets import Target, in_frame
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.scene_paths import polarization
from t2d_rt.scattering.paths import ArrivingFields
from t2d_rt.types import Accuracy, Motion, OneWayPath, PathPair, Radar
from t2d_rt.types.paths import points_in_scene

if TYPE_CHECKING:
    import xarray as xr

PATHS_RATE_HZ = 25.0
"""Rate of the table where no times are given [Hz]: that at which visibility is sampled by default."""
SCREEN_ROWS = 20
"""Greatest number of rows for each target when the table is printed."""
STEP_S = 1e-4
"""Half the time over which speeds are computed as differences [s]."""
VARIABLES = (
    "delay_s", "length_m", "speed_mps", "level_dbm", "departure_azimuth_rad", "departure_elevation_rad", "arrival_azimuth_rad",
    "arrival_elevation_rad", "blocked",
)  # fmt: skip
"""Variables over target, path pair and time; the vertices of the paths are stored in addition."""


class Nearby(NamedTuple):
    """The same quantity at some instants, a little earlier and a little later, to compute its rate of change."""

    now: np.ndarray
    earlier: np.ndarray
    later: np.ndarray

    @classmethod
    def instants(cls, times_s: np.ndarray, span_s: tuple[float, float]) -> Nearby:
        """Instants of a record (K,) [s] and those `STEP_S` before and after them, all within the record."""
        return cls(*(np.clip(times_s + step, 0.0, span_s[1] - span_s[0]) for step in (0.0, -STEP_S, STEP_S)))


def path_table(model: Model, accuracy: Accuracy, times_s: np.ndarray | None = None) -> xr.Dataset:
    """The path pairs in use to the reference point of each target, over (target, pair, time_s), strongest pair first.

    times_s: instants of the record (K,) [s]; every 40 ms by default.

    `delay_s` and `length_m` are those of the round trip, `speed_mps` is the rate at which half the length gets shorter (positive =
    approaching). `level_dbm` is the power in an ADC sample that a reflector of 1 m^2 at the reference point returns over the pair,
    at mid-sweep, -inf where nothing arrives. Azimuth (left > 0) and elevation are those at the radar, as seen along its boresight.
    `points_m` are the vertices (point, xyz) in the scene's coordinates, from the transmitters over the target to the receivers, and
    `meets` (pair, point) names the surface at each vertex. `blocked` is the fraction of the field that the static scene blocks.
    Where it is 1 there is no path: its level is -inf and all its other values are NaN.
    """
    import xarray as xr

    times_s = record_times(model.span_s, PATHS_RATE_HZ) if times_s is None else times_s
    pairs = pairs_of(model, accuracy)
    names, points = target_names(model.modelled), reference_points(model, times_s)
    nearby_s = Nearby.instants(times_s, model.span_s)
    before, after = (reference_points(model, instants_s) for instants_s in (nearby_s.earlier, nearby_s.later))
    velocity = (after - before) / (nearby_s.later - nearby_s.earlier)[:, None]
    at = Nearby(*(np.clip(model.span_s[0] + instants_s, *model.span_s) for instants_s in nearby_s))
    rows = _rows(model, pairs, points, velocity, at)
    dims = ("target", "pair", "time_s")
    data = {name: (dims, np.stack(values, axis=1), {"units": unit_of(name)}) for name, values in rows.items()}
    stops, meets = _polylines(pairs, points, at.now, ~np.isnan(np.stack(rows["delay_s"], axis=1)))
    table = xr.Dataset(
        {**data, "points_m": ((*dims, "point", "xyz"), stops, {"units": "m"}), "meets": (("pair", "point"), meets)},
        coords={
            "target": names,
            "pair": [pair.name for pair in pairs],
            "time_s": times_s,
            "xyz": ["x", "y", "z"],
            "reflections": ("pair", [pair.order for pair in pairs]),
            "copies": ("pair", [pair.copies for pair in pairs]),
        },
        attrs={
            "scene": "free_space" if model.scene is None else model.scene.name,
            "level": "of a reflector of 1 m^2 at the target's reference point, at mid-sweep",
        },
    )
    table.time_s.attrs["units"] = "s"
    return table


def pairs_of(model: Model, accuracy: Accuracy) -> list[PathPair]:
    """The path pairs that have echoes, strongest first; in free space the direct pair alone."""
    chosen = model.pairs(accuracy)
    return [PathPair(out=sight(model, 0), back=sight(model, 1))] if chosen is None else chosen.switched_on


def sight(model: Model, end: int) -> OneWayPath:
    """The line of sight from the centre of the transmitters (end 0) or of the receivers (end 1)."""
    radar = model.radar
    place, angle_deg = (
        (radar.tx_position_m, radar.tx_polarization_deg),
        (radar.rx_position_m, radar.rx_polarization_deg),
    )[end]
    moves = model.scene is not None and radar.track is not None
    return OneWayPath.line_of_sight(place, polarization(radar, angle_deg), radar.passing if moves else None)


def record_times(span_s: tuple[float, float], rate_hz: float) -> np.ndarray:
    """Instants of a record at a rate [s], (K,), from 0 to no later than its end."""
    return np.arange(int((span_s[1] - span_s[0]) * rate_hz + 1e-6) + 1) / rate_hz


def target_names(targets: Sequence[Target]) -> list[str]:
    """A distinct name for each target: that of its body or mesh, with a number if needed ("adult", "adult 2")."""
    return numbered(target.template if target.mesh is None else target.mesh.name for target in targets)


def reference_points(model: Model, times_s: np.ndarray) -> np.ndarray:
    """Reference point of each target at instants of the record (K,) [s], (target, K, 3) m: the pelvis of a motion, the mean of a
    mesh's vertices or of the centres of ellipsoids."""
    at_s = np.clip(model.span_s[0] + times_s, *model.span_s)
    return np.stack(
        [
            in_frame(model.radar, at_s, track(target.source)(at_s)[0][:, 0])
            if isinstance(target.source, Motion)
            else target.geometry.points_at(at_s).mean(axis=1)
            for target in model.modelled
        ]
    )


def mean_range_m(radar: Radar, points: np.ndarray) -> np.ndarray:
    """Mean of the distances of points (..., 3) from the centres of the transmitters and of the receivers [m], (...)."""
    return np.mean(
        [np.linalg.norm(points - place, axis=-1) for place in (radar.tx_position_m, radar.rx_position_m)], axis=0
    )


def speeds_and_ranges(
    model: Model, points_at: Callable[[np.ndarray], np.ndarray], times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (positive = approaching) [m/s] and ranges [m], (K, N) each, at instants of the record (K,) of points that `points_at`
    gives, (K, N, 3), at times on the model's clock."""
    _, *sides_s = Nearby.instants(times_s, model.span_s)
    before, after = (mean_range_m(model.radar, points_at(model.span_s[0] + side_s)) for side_s in sides_s)
    return (before - after) / (sides_s[1] - sides_s[0])[:, None], (before + after) / 2


def seen_from_radar(radar: Radar, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth (left > 0) and elevation [rad], (...) each, of directions (..., 3) in the world as seen from the radar."""
    ahead, left, up = np.moveaxis(directions @ radar.axes.T, -1, 0)
    return np.arctan2(left, ahead), np.arctan2(up, np.hypot(ahead, left))


def _rows(
    model: Model, pairs: Sequence[PathPair], points: np.ndarray, velocity: np.ndarray, at: Nearby
) -> dict[str, list[np.ndarray]]:
    """The `VARIABLES` of each pair at the times `at`, lists over pairs of arrays (target, time)."""
    in_time, apart_s = points.swapaxes(0, 1), (at.later - at.earlier)[:, None]
    radar, arrivals = model.radar, ArrivingFields.of(model.radar, pairs, in_time, at.now, frequencies=1)
    one_way = {path.key: path for pair in pairs for path in (pair.out, pair.back)}
    free = {
        key: np.ones(points.shape[:2])
        if model.scene is None
        else model.blockage.fraction(path, in_time, at.now).T.astype(float)
        for key, path in one_way.items()
    }
    rows: dict[str, list[np.ndarray]] = {name: [] for name in VARIABLES}
    for number, pair in enumerate(pairs):
        both = pair.out, pair.back
        towards = [points - path.place_m(at.now) for path in both]
        lengths = [np.linalg.norm(toward, axis=-1) for toward in towards]
        passes = free[pair.out.key] * free[pair.back.key]
        velocities = [velocity - (path.place_m(at.later) - path.place_m(at.earlier)) / apart_s for path in both]
        rate = sum(
            np.einsum("...i,...i->...", *vectors) / m for *vectors, m in zip(towards, velocities, lengths, strict=True)
        )
        field = arrivals.spectra(np.array([number]))[0, 0].T
        power = radar.received_power_w(1.0, *lengths) * np.abs(field) ** 2 * passes**2
        with np.errstate(divide="ignore"):
            level_dbm = 10 * np.log10(power) + 30
        departure, arrival = (
            seen_from_radar(radar, path.unfolded(in_time, at.now).swapaxes(0, 1) - path.antenna_m) for path in both
        )
        present = np.where(passes > 0, 1.0, np.nan)
        quantities: dict[str, Any] = {
            "delay_s": present * (sum(lengths) / SPEED_OF_LIGHT + pair.delay_s),
            "length_m": present * sum(lengths),
            "speed_mps": -present * rate / 2,
            "level_dbm": level_dbm,
            "blocked": 1 - passes,
            "departure_azimuth_rad": present * departure[0],
            "departure_elevation_rad": present * departure[1],
            "arrival_azimuth_rad": present * arrival[0],
            "arrival_elevation_rad": present * arrival[1],
        }
        for name, values in quantities.items():
            rows[name].append(values)
    return rows


def _polylines(
    pairs: Sequence[PathPair], points: np.ndarray, at_s: np.ndarray, arriving: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (target, pair, time, point, 3) of the pairs, NaN where a path does not exist and after its last vertex; and the
    names of what is at each vertex (pair, point), "" after the last one."""
    in_time = points_in_scene(pairs[0].out.passing, points.swapaxes(0, 1), at_s)
    courses = [[*pair.out.chain, "target", *pair.back.chain[::-1]] for pair in pairs]
    longest = max(len(course) for course in courses) + 2
    stops = np.full((len(points), len(pairs), points.shape[1], longest, 3), np.nan)
    for number, pair in enumerate(pairs):
        out, back = (vertices(path.in_scene(at_s, 3), in_time) for path in (pair.out, pair.back))
        course = np.concatenate([out, back[-2::-1]])
        stops[:, number, :, : len(course)] = course.transpose(2, 1, 0, 3)
    stops[~arriving] = np.nan
    meets = [["radar", *course, "radar"] + [""] * (longest - len(course) - 2) for course in courses]
    return stops, np.array(meets)


# --- as text ---


def csv_text(table: xr.Dataset) -> str:
    """The table as CSV text with a row for each target, path pair and instant at which the path exists; columns are the variables,
    then x, y and z of each vertex."""
    columns = list(VARIABLES)
    corners = [f"{axis}{k}_m" for k in range(table.sizes["point"]) for axis in "xyz"]
    rows: list[list[Any]] = [["target", "pair", "time_s", *columns, "meets", *corners]]
    values = {name: table[name].values for name in (*columns, "points_m")}
    met = [" > ".join(filter(None, value)) for value in table.meets.values.tolist()]
    for t, target in enumerate(table.target.values.tolist()):
        for k, time_s in enumerate(table.time_s.values.tolist()):
            for p, pair in enumerate(table.pair.values.tolist()):
                if values["blocked"][t, p, k] < 1:
                    numbers = [_number(values[name][t, p, k]) for name in columns]
                    places = [_number(coordinate) for coordinate in values["points_m"][t, p, k].ravel()]
                    rows.append([target, pair, _number(time_s), *numbers, met[p], *places])
    return files.csv_text(rows)


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.10g}"


def screen_text(table: xr.Dataset) -> str:
    """The strongest pairs to each target at the first instant of the table, as text: levels in dBm, angles in degrees."""
    at = table.isel(time_s=0)
    lines = []
    for target in at.target.values.tolist():
        of_target = at.sel(target=target)
        order = np.argsort(-of_target.level_dbm.values)
        order = order[np.isfinite(of_target.level_dbm.values[order])]
        lines += [
            f"{target} at {float(at.time_s):.3g} s: {len(order)} path pair{'s' * (len(order) != 1)}; level of 1 m^2, "
            "azimuth, left > 0, and elevation",
            "   level    delay   range   speed  departure    arrival  blocked  path pair",
            "     dBm       ns       m     m/s        deg        deg        %",
        ]
        for number in order[:SCREEN_ROWS]:
            row = {name: float(of_target[name].values[number]) for name in VARIABLES}
            angles = [
                " ".join(f"{round(np.degrees(row[f'{end}_{angle}_rad'])) + 0:d}" for angle in ("azimuth", "elevation"))
                for end in ("departure", "arrival")
            ]
            figures = (
                f"{row['level_dbm']:8.1f} {1e9 * row['delay_s']:8.2f} {row['length_m'] / 2:7.2f} "
                f"{round(row['speed_mps'], 2) + 0:7.2f} {angles[0]:>10} {angles[1]:>10} {100 * row['blocked']:8.0f}"
            )
            lines.append(f"{figures}  {of_target.pair.values[number]}")
        if len(order) > SCREEN_ROWS:
            lines.append(f"and {len(order) - SCREEN_ROWS} weaker ones")
    return "\n".join(lines)


def checked_times(model: Model, times_s: Any) -> np.ndarray | None:
    """Checked instants within the record [s], (K,); None where none are given."""
    if times_s is None:
        return None
    times = np.atleast_1d(array("times_s", times_s))
    end = model.span_s[1] - model.span_s[0]
    if times.ndim != 1 or not len(times) or times.min() < -1e-9 or times.max() > end + 1e-9:
        raise InputError(f"times_s must be a list within the record, 0..{end:.6g} s, got {times_s!r:.80}")
    return np.clip(times, 0.0, end)
