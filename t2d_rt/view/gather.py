"""Collects what a page shows of a recording, as plain values and arrays: bodies and room in time, paths, truth, maps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.body.fit import fit
from t2d_rt.body.segments import SEGMENTS, segment_of_faces
from t2d_rt.body.template import template
from t2d_rt.core.constants import SPEED_OF_LIGHT, decibel
from t2d_rt.experiment.setup import set_up_again
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.plots.canvas import COLUMNS, occupied, thinned
from t2d_rt.plots.figures import outline
from t2d_rt.recording.path_table import pairs_of, path_table, record_times, speeds_and_ranges, target_names
from t2d_rt.recording.truth import Person, persons, truth_table
from t2d_rt.types import Accuracy, Ellipsoids, PathPair, Radar, Scene, Surface
from t2d_rt.view.parts import coloured, parts_shown, tints

if TYPE_CHECKING:
    import xarray as xr

    from t2d_rt.recording.recording import Recording

FRAMES_HZ, MAPS_HZ = 25.0, 12.5
"""Rates of bodies with their speeds and paths, and of range-Doppler maps [Hz]."""
MOST_FRAMES, MOST_MAPS, MOST_PLACES = 1500, 750, 3_000_000
"""Greatest numbers of frames and of maps (long recordings get lower rates), and of vertex positions of one target."""
LEVELS_DB = 80.0
"""Levels of a map are stored down to this far below the peak [dB]."""
WEAKEST_DB, MOST_PATHS = 50.0, 150
"""Paths are stored if they come this close to the strongest one [dB] at any time; greatest number of them."""
AT_ONCE = 25
"""Number of frames whose vertices are computed at once."""


def gathered(recording: Recording) -> dict[str, Any]:
    """Everything about one recording; where there is nothing to show in three dimensions, `why_no_room` is a sentence that says
    why."""
    contents: dict[str, Any] = {
        "radar": _radar(recording.radar),
        "caption": _caption(recording),
        "maps": maps(recording),
        "frames_hz": FRAMES_HZ,
        "focus": 0,
        "why_no_room": _why_no_room(recording),
        "standing": None,
        **{name: [] for name in ("targets", "parts", "surfaces", "walls", "paths")},
    }
    split = parts_shown(recording, contents["maps"]["spectrogram"])
    if contents["why_no_room"] is None:
        model = set_up_again(recording.experiment, recording.inputs).model
        contents |= room(model, recording.accuracy or Accuracy())
        if split is not None:
            for number, target in enumerate(contents["targets"]):
                target["tint"] = tints(model, number, split.get("names", ()))
    return contents if split is None else {**contents, "split": split}


def _caption(recording: Recording) -> str:
    """A line on the recording: simulated or measured, position of the radar, its band and the scene."""
    radar, experiment = recording.radar, recording.experiment
    low, high = sorted((radar.carrier_hz, radar.carrier_hz + radar.slope_hz_per_s * radar.sweep_time_s))
    place = ", ".join(
        f"{axis} {value:.2f}" for axis, value in zip("xyz", np.asarray(radar.position_m) + 0.0, strict=True)
    )
    band = f"{low / 1e9:.4g} to {high / 1e9:.4g} GHz"
    if experiment is None:
        return f"measured, {band}"
    return f"simulated, scene {recording.settings.get('scene', 'free_space')}, radar at {place} m, {band}"


def _why_no_room(recording: Recording) -> str | None:
    if recording.experiment is None:
        return "This recording was measured: who moved before the radar, and where, is not known, so that its maps stand alone."
    if recording.experiment.lost is not None:
        return (
            f"{recording.experiment.lost} was computed by a function, which is not stored with the recording, so that its maps "
            "stand alone."
        )
    if recording.radar.track is not None and recording.settings.get("scene", "free_space") != "free_space":
        return "The radar moves through its scene, which is not drawn, so that its maps stand alone."
    return None


def room(model: Model, accuracy: Accuracy) -> dict[str, Any]:
    """Targets, their parts with speeds and ranges, the scene and the paths in it, over the record of a model."""
    span_s = model.span_s
    rate_hz = min(FRAMES_HZ, MOST_FRAMES / (span_s[1] - span_s[0]))
    frames_s = record_times(span_s, rate_hz)
    truth, people = truth_table(model, accuracy, frames_s), persons(model)
    names = target_names(model.modelled)
    targets: list[dict[str, Any]] = []
    parts: list[dict[str, Any]] = []
    for number, name in enumerate(names):
        person = next((row for row, candidate in enumerate(people) if candidate.number == number), None)
        own_parts = (
            _loose(model, number, truth, frames_s)
            if person is None
            else _segments(truth.isel(person=person), person == 0)
        )
        several = len(people) > 1 and person is not None
        body = _moving(model, number, None if person is None else people[person], len(own_parts), frames_s)
        extents = _extents(model, number, body["owner"], len(own_parts), frames_s)
        parts += [
            {**part, "name": f"{name}: {part['name']}" if several else part["name"], "target": number, **extent}
            for part, extent in zip(own_parts, extents, strict=True)
        ]
        targets.append({"name": name, "first": len(parts) - len(own_parts), "parts": len(own_parts), **body})
    contact = truth.contact.values.any(axis=-1)  # contact of heel or ball
    feet = (
        {side: contact[0, :, k].astype(np.uint8) for k, side in enumerate(truth.foot.values.tolist())}
        if people
        else None
    )
    surfaces, bounds = _surfaces(model.scene), _bounds(model, targets)
    return {
        "frames_hz": rate_hz,
        "targets": targets,
        "parts": parts,
        "standing": feet,
        "focus": people[0].number if people else 0,
        "surfaces": surfaces,
        "bounds": bounds,
        "floor_m": float(bounds["low"][2]),
        "walls": [surface["name"] for surface in surfaces if surface["shell"] and not abs(surface["inward"][2]) > 0.5],
        "paths": _paths(path_table(model, accuracy, frames_s), pairs_of(model, accuracy)),
    }


# --- what moves -----------------------------------------------------------------------------------------------------


def _moving(model: Model, number: int, person: Person | None, parts: int, frames_s: np.ndarray) -> dict[str, Any]:
    """A target's triangles, the positions of their vertices at every frame or every few frames, and the part of each vertex."""
    geometry = model.geometries[number]
    solid = geometry.solid()
    stride = math.ceil(solid.vertices * len(frames_s) / MOST_PLACES)
    frames_s = frames_s[::stride]
    places = solid.vertices_at(np.clip(model.span_s[0] + frames_s, *model.span_s))
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    pitch = np.maximum((high - low) / 65535, 2e-4)
    owner = np.zeros(solid.vertices, np.uint8)
    if isinstance(geometry, Ellipsoids):
        if parts == len(geometry.names):
            owner = np.repeat(np.arange(parts, dtype=np.uint8), solid.vertices // parts)
    elif person is not None:
        faces_owner = segment_of_faces(fit(template(person.body), person.motion))
        owner[solid.faces] = faces_owner[:, None]
    middles = places.mean(axis=1)
    return {
        "vertices": np.round((places - low) / pitch).astype(np.uint16),
        "low": low,
        "pitch": pitch,
        "frames": len(frames_s),
        "every": stride,
        "faces": solid.faces.astype(np.uint32),
        "owner": owner,
        "middles": middles.astype(np.float32),
        "radii": np.linalg.norm(places - middles[:, None], axis=-1).max(axis=1).astype(np.float32),
    }


def _extents(
    model: Model, number: int, owner: np.ndarray, parts: int, frames_s: np.ndarray
) -> list[dict[str, np.ndarray]]:
    """For each part of a target, the speeds of its slowest and fastest vertex [m/s], and the ranges of its nearest and farthest one
    [m]."""
    solid = model.geometries[number].solid()
    order = np.argsort(owner, kind="stable")
    present, starts = np.unique(owner[order], return_index=True)
    extents = np.full((4, parts, len(frames_s)), np.nan, np.float32)
    for first in range(0, len(frames_s), AT_ONCE):
        block = slice(first, first + AT_ONCE)
        values = (table[:, order] for table in speeds_and_ranges(model, solid.vertices_at, frames_s[block]))
        for k, (value, pick) in enumerate((v, pick) for v in values for pick in (np.minimum, np.maximum)):
            extents[k, present, block] = pick.reduceat(value, starts, axis=1).T
    return [dict(zip(("slow", "fast", "near", "far"), curves, strict=True)) for curves in extents.swapaxes(0, 1)]


def _segments(truth: xr.Dataset, first: bool) -> list[dict[str, Any]]:
    """The segments of a person; for the `first` one the speeds of the feet are drawn."""
    parts = []
    for number, name in enumerate(SEGMENTS):
        side, _, part = name.rpartition("_")
        side = name.partition("_")[0] if name.startswith(("left", "right")) else "middle"
        parts.append(
            {
                "name": name.replace("_", " "),
                "side": side,
                "foot": side if part == "foot" and first else "",
                "speed": truth.segment_speed_mps.values[:, number].astype(np.float32),
                "range": truth.segment_range_m.values[:, number].astype(np.float32),
                "visible": truth.segment_visible.values[:, number].astype(np.float32),
            }
        )
    return parts


def _loose(model: Model, number: int, truth: xr.Dataset, frames_s: np.ndarray) -> list[dict[str, Any]]:
    """Targets that are no persons: a few ellipsoids each as a part of its own, anything else as a single part."""
    geometry, name = model.geometries[number], str(truth.target.values[number])
    curves = [(name, truth.speed_mps.values[number], truth.range_m.values[number])]
    if isinstance(geometry, Ellipsoids) and 1 < len(geometry.names) <= 60:
        speeds, ranges = speeds_and_ranges(model, geometry.points_at, frames_s)
        curves = list(zip(geometry.names, speeds.T, ranges.T, strict=True))
    return [
        {
            "name": part,
            "side": "",
            "foot": "",
            "speed": speed.astype(np.float32),
            "range": distance.astype(np.float32),
            "visible": None,
        }
        for part, speed, distance in curves
    ]


# --- what stands, and the paths between ------------------------------------------------------------------------------


def _surfaces(scene: Scene | None) -> list[dict[str, Any]]:
    return [] if scene is None else [_surface(surface, *scene.bounds_m) for surface in scene.surfaces]


def _surface(surface: Surface, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    """Triangles and edges of a surface; for one that bounds the scene, the side on which the scene lies."""
    inward, offset = [0.0, 0.0, 0.0], 0.0
    for axis in range(3):
        for side, place in ((1.0, low[axis]), (-1.0, high[axis])):
            # Walls, floor and ceiling lie close to a side of the scene's bounding box.
            if np.abs(surface.vertices[:, axis] - place).max() < 0.05:
                inward, offset = [side if k == axis else 0.0 for k in range(3)], side * float(place)
    return {
        "name": surface.name,
        "triangles": surface.vertices[surface.faces].astype(np.float32),
        "edges": outline(surface).astype(np.float32),
        "shell": any(inward),
        "inward": inward,
        "offset": offset,
        "floor": inward[2] > 0,
    }


def _bounds(model: Model, targets: list[dict[str, Any]]) -> dict[str, Any]:
    """Corners of the visible space: targets and radar with a margin of a metre, or all of a room of up to 15 m."""
    radar = np.asarray(model.radar.position_m)
    low = np.min([radar, *(target["low"] for target in targets)], axis=0)
    high = np.max(
        [radar, *(target["low"] + target["pitch"] * target["vertices"].max(axis=(0, 1)) for target in targets)], axis=0
    )
    ground = min(low[2], 0.0)
    low, high = low - [1, 1, 0], high + [1, 1, 0.5]
    if model.scene is not None and np.ptp(model.scene.bounds_m, axis=0).max() <= 15:
        low, high = model.scene.bounds_m
    else:
        low[2] = ground
    return {"low": low, "high": high, "middle": (low + high) / 2}


def _paths(table: xr.Dataset, pairs: list[PathPair]) -> list[dict[str, Any]]:
    """The relevant paths of a table, strongest first, with the images of the antennas (from which range and speed of any point over
    each path follow) and the range that slabs add."""
    levels = table.level_dbm.values
    best = levels.max(axis=2)
    paths: list[dict[str, Any]] = []
    for target, pair in zip(*np.unravel_index(np.argsort(-best, axis=None), best.shape), strict=True):
        if not best[target, pair] > best[target].max() - WEAKEST_DB or len(paths) >= MOST_PATHS * len(levels):
            continue
        meets = [name for name in table.meets.values[pair].tolist() if name]
        paths.append({
            "name": str(table.pair.values[pair]), "target": int(target), "order": int(table.reflections.values[pair]),
            "meets": meets, "level": np.where(np.isfinite(levels[target, pair]), levels[target, pair], np.nan).astype(np.float32),
            "range": (0.5 * SPEED_OF_LIGHT * table.delay_s.values[target, pair]).astype(np.float32),
            "speed": table.speed_mps.values[target, pair].astype(np.float32),
            "blocked": table.blocked.values[target, pair].astype(np.float32),
            "images": [pairs[pair].out.image_m, pairs[pair].back.image_m],
            "added": 0.5 * SPEED_OF_LIGHT * float(pairs[pair].delay_s),
            "points": table.points_m.values[target, pair, :, : len(meets)].astype(np.float32),
        })  # fmt: skip
    return paths


def _radar(radar: Radar) -> dict[str, Any]:
    return {
        "position": np.asarray(radar.position_m),
        "axes": np.asarray(radar.axes),
        "beam_deg": _beam(radar),
        "told": str(radar),
        "max_speed": radar.separated.max_speed_mps,
        "range_bin": radar.range_resolution_m,
    }


def _beam(radar: Radar) -> list[float] | None:
    """Half-power beamwidths, horizontal and vertical [deg], of the geometric mean of transmit and receive pattern; None where that
    never falls to half its value ahead."""
    angles = np.radians(np.arange(0.0, 90.0, 0.25))
    widths = []
    for across in (1, 2):
        gains = []
        for side in (-1, 1):
            directions = np.zeros((len(angles), 3))
            directions[:, 0], directions[:, across] = np.cos(angles), side * np.sin(angles)
            gains.append(np.sqrt(radar.tx_pattern.gain(directions) * radar.rx_pattern.gain(directions)))
        below = np.mean(gains, axis=0) < 0.5 * np.mean(gains, axis=0)[0]
        if not below.any():
            return None
        widths.append(float(2 * np.degrees(angles[below.argmax()])))
    return widths


# --- maps -----------------------------------------------------------------------------------------------------------


def maps(recording: Recording) -> dict[str, Any]:
    """Spectrogram, range over time, and range-Doppler maps at `MAPS_HZ`, in 8 bits, cropped to where there is anything."""
    spectrogram, range_time = recording.spectrogram, recording.range_time
    start_s, end_s = (float(spectrogram.time_s[place]) for place in (0, -1))
    times_s = np.arange(start_s, end_s + 1e-9, max(1 / MAPS_HZ, (end_s - start_s) / MOST_MAPS))
    middles_s, doppler = recording._maps.range_doppler_over(times_s)
    images = {}
    for name, image in (("spectrogram", spectrogram), ("range_time", range_time)):
        time_s, power_db = evenly(*thinned(image.time_s.values, image.values))
        axis = image[image.dims[0]].values
        images[name] = _map(power_db[None], ("speed" if name == "spectrogram" else "range", axis), ("time", time_s))
    images["range_doppler"] = {
        **_map(decibel(doppler.power), ("speed", doppler.velocity_mps), ("range", doppler.range_m)),
        "times": middles_s.astype(np.float32),
    }
    return images


def evenly(time_s: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns at evenly spaced times; each shows the nearest of the given columns, such as those of bursts."""
    steps = np.diff(time_s)
    if len(steps) < 2 or np.ptp(steps) < 0.01 * steps.min():
        return time_s, power_db
    even_s = np.linspace(time_s[0], time_s[-1], min(COLUMNS, round(float(time_s[-1] - time_s[0]) / steps.min()) + 1))
    return even_s, power_db[:, np.abs(even_s[:, None] - time_s).argmin(axis=1)]


def _map(power_db: np.ndarray, up: tuple[str, np.ndarray], across: tuple[str, np.ndarray]) -> dict[str, Any]:
    """Levels (frame, up, across) as 0..255 over `LEVELS_DB` below the peak, cropped to where they exceed 60 dB below it."""
    # Silence is -300 dB.
    peak = max(float(power_db.max()), -300.0 + LEVELS_DB)
    axes: dict[str, Any] = {}
    windows = []
    for name, (quantity, axis), others in (("y", up, (0, 2)), ("x", across, (0, 1))):
        low, high = (
            (axis[0], axis[-1])
            if quantity == "time"
            else occupied(axis, power_db.max(axis=others), peak - 45, zero=quantity != "range" or name == "y")
        )
        inside = np.flatnonzero((axis >= low) & (axis <= high))
        windows.append(slice(inside[0], inside[-1] + 1))
        axes[name] = {
            "of": quantity,
            "first": float(axis[inside[0]]),
            "last": float(axis[inside[-1]]),
            "count": len(inside),
            "half": float(axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.05,
        }
    part = power_db[:, windows[0], windows[1]]
    levels = np.clip((np.maximum(part, peak - LEVELS_DB) - peak + LEVELS_DB) * (255 / LEVELS_DB), 0, 255)
    return {"values": np.round(levels).astype(np.uint8), "low_db": peak - LEVELS_DB, "high_db": peak, **axes}


def on_one_scale(recordings: list[dict[str, Any]]) -> None:
    """Rescales the maps of several recordings to the peak of the strongest of each kind, so that colours can be compared; parts of
    the same name get the same colour."""
    coloured([recording["split"] for recording in recordings if "names" in recording.get("split", ())])
    for kind in {name for recording in recordings for name in recording["maps"]}:
        images: list[dict[str, Any]] = [
            recording["maps"][kind] for recording in recordings if kind in recording["maps"]
        ]
        peak = max(image["high_db"] for image in images)
        for image in images:
            fall = round((peak - image["high_db"]) * 255 / LEVELS_DB)
            image["values"][:] = np.maximum(image["values"].astype(int) - fall, 0)
            image["low_db"], image["high_db"] = peak - LEVELS_DB, peak
