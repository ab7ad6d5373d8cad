"""Calls of the public functions with valid, cheap arguments, and wrong values to put in their place: each call must give a valid
result or an error of one sentence."""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt import body, motion, plots, signal
from t2d_rt.core.errors import T2DError, T2DWarning
from t2d_rt.recording import compare as comparison
from t2d_rt.scene import Opening, Piece, Slab
from t2d_rt.types import EchoArrays, Ellipsoids, Material, MovingMesh, Radar
from validation.robustness.api_arguments import (
    DDM,
    FACES,
    RADAR,
    TDM,
    TETRAHEDRON,
    TIMES_S,
    ball,
    cube,
    echo_arrays,
    egg,
    result,
    walk,
)

WRONG: dict[str, Any] = {
    "None": None, "text": "x", "empty text": "", "long text": "y" * 5_000, "bytes": b"x", "True": True, "three": 3, "zero": 0,
    "minus one": -1, "fraction": 1.5, "nan": math.nan, "inf": math.inf, "huge": 1e300, "huge integer": 10**400,
    "many": 10**9, "complex": 1j, "empty list": [], "empty dict": {}, "object": object(), "path": Path("nowhere"),
    "list of text": ["a", "b"], "ragged": [[1.0], [1.0, 2.0]], "nans": np.full((3, 3), np.nan),
    "flat": np.zeros(3), "integers": np.arange(6).reshape(2, 3), "objects": np.array([None, "x"], dtype=object),
    "imaginary": np.full((2, 2), 1j), "masked": np.ma.masked_array(np.ones((4, 3)), mask=True), "booleans": np.ones(3, bool),
    "empty array": np.zeros((0, 3)), "four axes": np.zeros((1, 2, 3, 3)), "huge numbers": np.full((4, 3), 1e300),
    "texts": np.array(["a", "b"]), "generator": (each for each in (1, 2)), "function": len, "set": {1, 2}, "type": int,
}  # fmt: skip
"""Nothing that every argument would take; what one of them does take must then give a valid result."""


@dataclass(frozen=True)
class Call:
    """A public function, arguments that it takes, and what is done with its result to see that it is one."""

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    use: Callable[[Any], Any] = field(default=lambda result: result)

    def outcome(self, argument: str, value: Any) -> str | None:
        """What is wrong with the call where an argument is replaced; None where it gives a valid result or one sentence."""
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", T2DWarning)
            try:
                result = self.use(self.function(**{**self.arguments, argument: value}))
            except T2DError as error:
                return _sentence_fault(str(error))
            except Exception as error:  # the sweep's finding
                return f"{type(error).__name__}: {error}"
        return None if all(map(_is_finite, arrays_of(result))) else "a result that is not finite"


def _sentence_fault(sentence: str) -> str | None:
    if "\n" in sentence.strip() or len(sentence) > 1000 or len(sentence) < 15:
        return f"not one sentence: {sentence[:300]!r}"
    return None


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Arrays of numbers, and numbers, that a result holds."""
    if isinstance(value, np.ndarray) and np.issubdtype(value.dtype, np.inexact):
        yield value
    elif isinstance(value, float):
        yield np.array(value)
    elif isinstance(value, (tuple, list)):
        for each in value:
            yield from arrays_of(each)
    elif is_dataclass(value) and not isinstance(value, (type, Material)):
        for each in fields(value):
            yield from arrays_of(getattr(value, each.name))
    elif hasattr(value, "values") and isinstance(value.values, np.ndarray):
        yield from arrays_of(value.values)


def _is_finite(values: np.ndarray) -> bool:
    return bool(np.isfinite(values).all())


def _drawn(figure: Any) -> None:
    assert figure.axes  # drawing takes half a second; titles, which alone can fail there, have tests of their own


def _meshed(mover: Any) -> Any:
    return repr(mover)  # a mesh of a large one takes seconds


def calls(folder: Path) -> list[Call]:
    """All calls; files are written into `folder`."""
    made: list[Call] = []
    for group in (_values, _radars, _scenes, _movers, _motions, _signals, _pictures, _results):
        made += group(folder)
    return made


def _values(folder: Path) -> list[Call]:
    here = np.array([0.05])
    mesh = {
        "vertices": np.repeat(TETRAHEDRON[None], 3, axis=0), "faces": FACES, "times_s": TIMES_S, "material": "pec",
        "crease_deg": 45.0, "sagitta_rad": 0.1, "name": "ball",
    }  # fmt: skip
    tracked = {
        "track": lambda t: np.repeat(TETRAHEDRON[None], len(t), axis=0), "faces": FACES, "times_s": TIMES_S, "material": "pec",
        "rest": TETRAHEDRON, "crease_deg": 45.0, "sagitta_rad": 0.1,
        "name": "ball",
    }  # fmt: skip
    places = np.tile([3.0, 0, 1], (3, 1, 1)), np.tile(np.eye(3), (3, 1, 1, 1))
    ellipsoids = {
        "semi_axes_m": np.array([[0.1, 0.1, 0.2]]), "centres": places[0], "times_s": TIMES_S, "axes": places[1], "material": "skin",
        "names": ["egg"],
    }  # fmt: skip
    posed = {
        "track": lambda t: (places[0][:1].repeat(len(t), 0), places[1][:1].repeat(len(t), 0)), "semi_axes_m": [[0.1, 0.1, 0.2]],
        "times_s": TIMES_S, "material": "skin", "names": ["egg"],
    }  # fmt: skip
    whole = walk()
    skeleton = {each.name: getattr(whole, each.name) for each in fields(whole)}
    parts = {"materials": ("skin", "pec"), "part": np.array([0, 1, 0, 1])}
    outfit = {"name": "boots", "cloth": "clothed", "bare": "skin", "shoes": "shoe", "cloth_m": 0.003, "sole_m": 0.03}
    return [
        Call("ByPart", t2d.ByPart, parts, lambda m: (MovingMesh(**{**mesh, "material": m}), m.name)),
        Call("Outfit", t2d.Outfit, outfit, lambda each: body.segments(whole, material=each).at(here)),
        Call("MovingMesh", MovingMesh, mesh, lambda m: (m.at(here), repr(m))),
        Call("MovingMesh.from_track", MovingMesh.from_track, tracked, lambda m: (m.at(here), repr(m))),
        Call("MovingMesh.at", ball().at, {"times_s": here}),
        Call("MovingMesh.trimesh", ball().trimesh, {"time_s": 0.1}, lambda m: np.asarray(m.vertices)),
        Call("Ellipsoids", Ellipsoids, ellipsoids, lambda e: (e.at(here), repr(e))),
        Call("Ellipsoids.from_track", Ellipsoids.from_track, posed, lambda e: (e.at(here), repr(e))),
        Call("Ellipsoids.at", egg().at, {"times_s": here}),
        Call("Motion", t2d.Motion, skeleton, lambda m: (m.joints, m.times_s)),
        Call("Motion.index", whole.index, {"name": "head"}),
        Call(
            "Material", Material,
            {"name": "wax", "relative_permittivity": 2.0, "conductivity_s_per_m": 0.1, "scattering_coefficient": 0.2},
            lambda m: abs(m.reflection(77e9)),
        ),
        Call("Material.permittivity", Material(name="wax").permittivity, {"frequency_hz": 77e9}, abs),
        Call("Material.reflection", Material(name="wax").reflection, {"frequency_hz": 77e9}, abs),
        Call("Echoes", t2d.Echoes, echo_arrays()),
        Call(
            "EchoStream", t2d.EchoStream,
            {"times_s": np.arange(5) / 100, "frames": lambda a, b: EchoArrays(np.full((b - a, 1), 2e-8), np.ones((b - a, 1)))},
            lambda s: s.gather(),
        ),
    ]  # fmt: skip


def _radars(folder: Path) -> list[Call]:
    return [
        Call("Radar", Radar, RADAR.model_dump(), lambda r: r.speed_axis_mps(16)),
        Call(
            "Radar.preset",
            Radar.preset,
            {"name": "ci4r", "samples": 32, "prf_hz": 2000},
            lambda r: r.speed_axis_mps(16),
        ),
        Call("Radar.from_yaml", Radar.from_yaml, {"path": folder / "none.yaml"}),
        Call("Radar.to_yaml", RADAR.to_yaml, {"path": folder / "made.yaml"}),
        Call("Radar.replace", RADAR.replace, {"prf_hz": 2000, "samples": 16}, lambda r: r.speed_axis_mps(16)),
        Call("Radar.speed_resolution_mps", RADAR.speed_resolution_mps, {"duration_s": 0.1}),
        Call("Radar.range_axis_m", RADAR.range_axis_m, {"n_fft": 16, "speed_mps": 1.0}),
        Call("Radar.speed_axis_mps", RADAR.speed_axis_mps, {"n_fft": 64}),
        Call("Radar.chirp_starts_s", RADAR.chirp_starts_s, {"chirps": 10}),
        Call("Radar.chirp_times_s", RADAR.chirp_times_s, {"duration_s": 0.1}),
    ]


def _scenes(folder: Path) -> list[Call]:
    surface = {
        "name": "wall", "vertices": np.array([[5.0, -2, 0], [5, -2, 2], [5, 2, 2]]), "faces": np.array([[0, 1, 2]]),
        "material": "concrete", "thickness_m": 0.1,
    }  # fmt: skip
    wall = t2d.Scene(name="wall", surfaces=(t2d.Surface(**surface),))
    return [
        Call("Surface", t2d.Surface, surface, lambda s: s.vertices),
        Call("Scene", t2d.Scene, {"name": "wall", "surfaces": wall.surfaces}, lambda s: s.bounds_m),
        Call("save_scene", t2d.save_scene, {"scene": wall, "folder": folder / "saved"}, str),
        Call("load_scene", t2d.load_scene, {"source": "empty_room"}, lambda s: s.bounds_m),
    ]


def _movers(folder: Path) -> list[Call]:
    place = {"position_m": (2, 0, 1)}
    common = {"material": "wood", "heading_deg": 90.0}
    room = {"name": "box", "size_m": (4, 3, 2.5), "corner_m": (0, 0), "walls": Slab(material="wood", thickness_m=0.1)}
    return [
        Call(
            "TableFan",
            t2d.TableFan,
            {**place, **common, "blades": 3, "radius_m": 0.1, "rpm": 60, "swing_period_s": 3},
            _meshed,
        ),
        Call(
            "CeilingFan",
            t2d.CeilingFan,
            {**place, "material": "wood", "blades": 3, "radius_m": 0.1, "chord_m": 0.05},
            _meshed,
        ),
        Call(
            "Curtain",
            t2d.Curtain,
            {**place, **common, "width_m": 0.5, "height_m": 1, "fold_m": 0.2, "seed": 1},
            _meshed,
        ),
        Call("Door", t2d.Door, {**place, **common, "width_m": 0.8, "angle_deg": 40, "period_s": 5}, _meshed),
        Call("Pet", t2d.Pet, {**place, **common, "animal": "dog", "speed_mps": 0.7, "turn_radius_m": 2}, _meshed),
        Call("Pet.mesh", t2d.Pet(**place).mesh, {"start_s": 0.0, "stop_s": 0.1}, lambda m: m.vertices),
        Call("mover", t2d.mover, {"entry": "fan:2,1,1"}, _meshed),
        Call("Room", t2d.Room, room, lambda r: r.scene().bounds_m),
        Call("Slab", Slab, {"material": "wood", "thickness_m": 0.1}),
        Call("Opening", Opening, {"name": "door", "wall": "+x", "width_m": 0.8, "height_m": 2}),
        Call("Piece", Piece, {"kind": "chair", "x_m": 1, "y_m": 1, "name": "seat"}),
    ]


def _motions(folder: Path) -> list[Call]:
    whole = walk()
    given = {"joints": whole.joints, "rate_hz": 50.0, "names": whole.names, "placed": True, "report": "made"}
    position = {"radar_position_m": (0, 0, 1), "boresight": (1, 0, 0)}
    return [
        Call("motion_from_joints", t2d.motion_from_joints, given),
        Call("load_motion", t2d.load_motion, {"path": folder / "none.bvh", "units": "m", "floor": 0.0}),
        Call("load_recording", t2d.load_recording, {"path": folder / "none.npy"}),
        Call("describe", t2d.describe, {"motion": whole}),
        Call("place", t2d.place, {"motion": whole, "distance_m": 3, "angle_deg": 0, **position}),
        Call("carry", t2d.carry, {"motion": whole, "things": "ball"}),
        Call("repeat", t2d.repeat, {"motion": whole, "duration_s": 0.3, "travel": True, "blend_s": 0.1}),
        Call("resample", t2d.resample, {"motion": whole, "rate_hz": 30.0}),
        Call("smooth", t2d.smooth, {"motion": whole, "cutoff_hz": 10.0}),
        Call("trim", t2d.trim, {"motion": whole, "start_s": 0.0, "stop_s": 0.2}),
        Call("sample", motion.sample, {"motion": whole, "times_s": [0.1]}),
        Call("track", motion.track, {"motion": whole}, lambda t: t([0.1])),
        Call("skin", t2d.skin, {"motion": whole, "body": "adult", "material": "skin"}, lambda m: m.at([0.1])),
        Call("segments", t2d.segments, {"motion": whole, "body": "adult", "material": "skin"}, lambda e: e.at([0.1])),
        Call("body.template", body.template, {"name": "adult"}, lambda t: t.vertices),
    ]


def _signals(folder: Path) -> list[Call]:
    one, four, power = cube(), cube(4), np.abs(cube()[:, 0]) ** 2
    adc = {"adc": one, "radar": RADAR}
    array = {"adc": four, "radar": TDM}
    windows = {"range_window": "hann", "doppler_window": "hann"}
    training = {"guard_cells": (0, 1), "training_cells": (0, 4)}
    options = {
        "range_gate_m": (1, 5), "mti": "highpass", "cutoff_mps": 0.5, "kernel": (1, -2, 1), "combine": "noncoherent",
        "window": "hann", "n_window": 32, "overlap": 16, "n_fft": 32, "range_window": "hann",
    }  # fmt: skip
    return [
        Call("spectrogram", signal.spectrogram, {**adc, **options}),
        Call("spectrogram, canceller", signal.spectrogram, {**adc, **options, "mti": "canceller"}),
        Call(
            "stft", signal.stft, {"series": one, "prf_hz": 1e3, "window": "hann", "n_window": 16, "overlap": 8, "n_fft": 16},
        ),
        Call("range_time", signal.range_time,
             {**adc, "range_window": "hann", "mti": "mean", "cutoff_mps": 0.1, "kernel": (1, -1), "n_window": 32, "overlap": 16}),
        Call("coherent_interval", signal.coherent_interval,
             {**adc, "time_s": 0.01, "chirps": 32, "mti": "mean", "cutoff_mps": 0.1, "kernel": (1, -1)}),
        Call("range_doppler_over", signal.range_doppler_over,
             {**adc, "times_s": np.array([0.01, 0.02]), "range_window": "hann", "mti": "mean", "cutoff_mps": 0.1, "kernel": (1, -1),
              "n_window": 32}),
        Call("range_doppler", signal.range_doppler, {**adc, **windows, "correct_coupling": True}),
        Call("range_fft", signal.range_fft, {"adc": one, "window": "hann", "n_fft": 16, "bins": slice(4), "block": 8}),
        Call("range_profile", signal.range_profile, {**adc, "window": "hann", "n_fft": 16}),
        Call("gate", signal.gate, {"range_m": np.arange(9.0), "limits_m": (1, 5)}),
        Call("taper", signal.taper, {"name": "hann", "length": 16, "periodic": True}),
        Call(
            "mti", signal.mti,
            {"profile": one, "method": "highpass", "prf_hz": 1e3, "cutoff_hz": 50, "order": 4, "kernel": (1, -1)},
        ),
        Call("array_spectrum", signal.array_spectrum, {**array, **windows, "mti": "mean", "compensate_tdm": True}),
        Call(
            "range_angle", signal.range_angle,
            {**array, "azimuth_rad": np.linspace(-1, 1, 5), "elevation_rad": 0.0, "range_gate_m": (1, 9), "speed_gate_mps": (-1, 1),
             "far_field": False, "mti": "mean"},
        ),
        Call("unit_vectors", signal.unit_vectors, {"azimuth_rad": 0.1, "elevation_rad": 0.2}),
        Call("steering_vectors", signal.steering_vectors, {"radar": TDM, "directions": np.eye(3), "range_m": 2.0}),
        Call("cfar", signal.cfar, {"power": power, "false_alarm_rate": 1e-2, "looks": 1, "method": "os", **training,
                                   "windows": ("hann", "hann")}),
        Call("cfar_factor", signal.cfar_factor, {"false_alarm_rate": 1e-2, "cells": 8, "looks": 2, "method": "ca"}),
        Call(
            "point_cloud", signal.point_cloud,
            {**array, **training, "frame_chirps": 32, "false_alarm_rate": 1e-2, "dynamic_range_db": 40, "method": "ca",
             "mti": "mean"},
        ),
        Call("separate_ddm", signal.separate_ddm, {"adc": cube(2), "radar": DDM}),
    ]  # fmt: skip


def _pictures(folder: Path) -> list[Call]:
    speed, time, levels = np.linspace(-2, 2, 8), np.linspace(0, 1, 6), np.linspace(-60, 0, 48).reshape(8, 6)
    style = {"title": "a", "dynamic_range_db": 40, "cmap": "viridis"}
    scene = t2d.Room(name="box", size_m=(4, 3, 2.5)).scene()
    return [
        Call("plot_spectrogram", plots.plot_spectrogram,
             {"velocity_mps": speed, "time_s": time, "power_db": levels, "note": "n", **style}, _drawn),
        Call("plot_range_time", plots.plot_range_time, {"range_m": speed, "time_s": time, "power_db": levels}, _drawn),
        Call("plot_range_doppler", plots.plot_range_doppler,
             {"range_m": time, "velocity_mps": speed, "power_db": levels}, _drawn),
        Call("plot_range_angle", plots.plot_range_angle,
             {"range_m": speed, "azimuth_rad": time, "power_db": levels}, _drawn),
        Call("plot_point_cloud", plots.plot_point_cloud,
             {"xyz_m": np.eye(3), "speed_mps": np.arange(3.0), "cmap": "coolwarm"}, _drawn),
        Call("plot_comparison", plots.plot_comparison,
             {"velocity_mps": speed, "time_s": time, "first_db": levels, "second_db": levels, "labels": ("a", "b"),
              "difference_db": 10}, _drawn),
        Call("plot_scene", plots.plot_scene,
             {"scene": scene, "radar_m": np.zeros(3), "paths_m": [("a", np.eye(3))], "track_m": np.eye(3)}, _drawn),
    ]  # fmt: skip


def _results(folder: Path) -> list[Call]:
    recorded = result()
    processing = {"range_gate_m": (1, 5), "n_window": 32, "overlap": 16, "n_fft": 64, "mti": "mean", "kernel": (1, -1)}
    small = {"radar": RADAR, "method": "ellipsoid"}
    levels = {"title": "a", "cmap": "viridis", "dynamic_range_db": 40, "limits_db": (-100, -50)}
    simulated = {
        **small, "target": egg(), "scene": "free_space", "reflections": 1, "transmissions": 0, "clutter": "none",
        "collisions": "warn", "seed": 0, "body": "adult", "material": "skin", "phase_from": "specular", "measure_error": False,
        "device": "cpu", "progress": lambda fraction: None, "tolerance_db": None,
        "accuracy": {"occlusion": False, "surface_rate_hz": 50, "sagitta_rad": 0.3},
    }  # fmt: skip
    return [
        Call("Recording", t2d.Recording, {"cube": cube(), "radar": RADAR}, lambda r: r.spectrogram),
        Call("Recording.processed", recorded.processed, processing, lambda r: r.spectrogram),
        Call("Recording.plot", recorded.plot, levels, _drawn),
        Call("Recording.plot_range_time", recorded.plot_range_time, levels, _drawn),
        Call("Recording.plot_range_doppler", recorded.plot_range_doppler, {**levels, "time_s": 0.01, "interval_s": 0.02}, _drawn),
        Call("Recording.range_doppler_at", recorded.range_doppler_at, {"time_s": 0.01, "interval_s": 0.02}),
        Call("Recording.export", recorded.export, {"path": folder / "made.npz", "overwrite": True}),
        Call("example", t2d.example, {"name": "walk"}),
        Call("Recording.save", recorded.save, {"path": folder / "made.zarr", "overwrite": True}),
        Call("Recording.load", t2d.Recording.load, {"path": folder / "none.zarr"}),
        Call("compare", t2d.compare,
             {"first": recorded, "second": recorded, "align": False, "relative": True, "labels": ("a", "b")},
             lambda c: c.mean_difference_db),
        Call("compare.figures", comparison.figures, {"result": recorded}),
        Call("compare.ridge", comparison.ridge, {"power_db": np.zeros((3, 4)), "speeds_mps": np.arange(3.0)}),
        Call("compare.envelope", comparison.envelope, {"power_db": np.zeros((3, 4)), "speeds_mps": np.arange(3.0)}),
        Call("Viewer", t2d.Viewer, {"recordings": [recorded], "titles": ["a"]}, str),
        Call("simulate", t2d.simulate, simulated, lambda r: r.cube),
        Call("simulate a mesh", t2d.simulate, {**simulated, "target": ball(), "method": "mesh"}, lambda r: r.cube),
        Call(
            "synthesize", t2d.synthesize,
            {"echoes": t2d.Echoes(**echo_arrays()), "radar": RADAR, "tolerance_db": -50, "device": "cpu", "read_frames": 8,
             "progress": lambda fraction: None},
        ),
        Call("plan", t2d.plan, {"target": egg(), "tolerance_db": "x"}, str),
    ]  # fmt: skip


def faults(folder: Path) -> Iterator[str]:
    """Every call that ends neither in a valid result nor in one sentence."""
    for call in calls(folder):
        yield from faults_of(call)


def faults_of(call: Call) -> Iterator[str]:
    """Those of one function, each of its arguments replaced by each wrong value."""
    for argument, right in call.arguments.items():
        for name, value in WRONG.items():
            if callable(right) and callable(value):
                continue  # what a function of the user's raises is the user's to see
            fault = call.outcome(argument, value)
            if fault is not None:
                yield f"{call.name}({argument}={name}): {fault}"


def main() -> int:
    """Prints what the sweep finds; the number of faults."""
    with tempfile.TemporaryDirectory() as folder:
        found = list(faults(Path(folder)))
    print("\n".join(found) or "no faults")
    return len(found)


if __name__ == "__main__":
    raise SystemExit(main())
