"""Calls of the public functions with one or two arguments that no signature asks for."""

from __future__ import annotations

import copy
import datetime
import decimal
import fractions
import functools
import inspect
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    chance,
    check_finite,
    check_motion,
    check_recording,
    no_raw_warnings,
    pick,
    quick_ball,
    quick_radar,
    quick_walk,
)


class Strange:
    """An object of no use here; its text is not plain either."""

    def __repr__(self) -> str:
        return "<strange\n\x1b[31m>"


PLAIN: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 3, 7, 10**30, -(10**9), 10**9, 0.0, 0.5, 2.5, -2.5, 1e300, -1e300, 1e-300, math.nan,
    math.inf, -math.inf, 1j,
    "", "x", "120", "nan", "a\nb", "\x1b[31m", "x" * 10000, b"x", [], [1], [1, 2], [1, 2, 3], [2.0, 1.0], (), (0, 0), (1,
    2, 3), (math.nan, 1), {}, {"a": 1},
    {1}, frozenset(), range(3), slice(None), object, int, len, lambda *_: None, Path("x"), Path("/dev/zero"),
    decimal.Decimal("1.5"), fractions.Fraction(1, 3),
    datetime.date(2020, 1, 1), Ellipsis, NotImplemented, np.float32(1.5), np.int64(3), np.bool_(True), np.str_("x"),
    np.float64("nan"), 1 << 62, 128.0,
)  # fmt: skip
TEXTS = (
    "np.zeros(0)", "np.zeros(3)", "np.zeros((0, 3))", "np.zeros((3, 0))", "np.zeros((2, 3))", "np.zeros((4, 3))",
    "np.zeros((3, 22, 3))", "np.ones((3, 4))",
    "np.full(3, np.nan)", "np.full((3, 3), np.inf)", "np.ones(3, complex)", "np.ones((300, 1, 32), np.complex64)",
    "np.ones((300, 32))",
    "np.full((300, 1, 32), np.nan, complex)", "np.ones((300, 1, 32), object)", "np.array(['a', 'b', 'c'])",
    "np.array([1, None, 'x'], dtype=object)",
    "np.ma.masked_array([1.0, 2, 3], [0, 1, 0])", "np.ma.masked_all((4, 3))", "np.array(3.0)", "np.arange(3)",
    "np.arange(3)[::-1]", "np.arange(3, dtype=np.uint8)",
    "np.array([1, 2, 3], np.float16)", "np.array([2**63], np.uint64)", "np.array(['2020-01-01'], 'datetime64[D]')",
    "np.zeros(3, [('a', float)])", "np.zeros((1,) * 32)",
    "np.matrix([[1, 2], [3, 4]])", "np.broadcast_to(1.0, (300, 1, 32))", "(x for x in [1, 2])", "memoryview(b'abc')",
    "bytearray(3)", "Strange()", "[Strange()]",
    "[[1, 2], [3]]", "[[]]", "['a', 3]", "[None]", "{'kind': 'fan'}", "t2d.Radar", "t2d.Radar.preset('ci4r')",
    "np.random.default_rng(0)", "[float('nan')] * 3",
    "type('Like', (), {'__array__': lambda self, *a, **k: np.ones(3)})()",
    "type('Bad', (), {'__len__': lambda self: -1})()",
)  # fmt: skip
"""Values that each call has to have for itself, as they are written."""
NAMES = {"np": np, "t2d": t2d, "Strange": Strange}
ODD: tuple[Callable[[], Any], ...] = (
    *(functools.partial(copy.copy, value) for value in PLAIN),
    *(functools.partial(eval, text, NAMES) for text in TEXTS),
)
"""Makers of odd values."""


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One call."""
    name = pick(rng, sorted(CALLS))
    good = CALLS[name]()
    function, arguments = good[0], dict(good[1])
    odd = {}
    for _ in range(1 if chance(rng, 0.7) else 2):
        key = pick(rng, names_of(name, arguments))
        odd[key] = pick(rng, ODD)()
    told = f"{name}({', '.join(f'{key}={short(value)}' for key, value in odd.items())})"
    return Attempt(told, lambda: called(function, arguments | odd))


def names_of(name: str, arguments: Mapping[str, Any]) -> list[str]:
    """Arguments that may get another value: not those by which ellipsoids are measured against a fine mesh, which takes long."""
    left_out = {"tolerance_db", "measure_error"} if name == "simulate ellipsoids" else set()
    return sorted(set(arguments) - left_out)


def short(value: Any) -> str:
    """A value in a few words."""
    if isinstance(value, np.ndarray) and value.size > 8:
        return f"array{value.shape} {value.dtype}"
    return ascii(value)[:80]


def called(function: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Calls the function and checks what comes back."""
    with no_raw_warnings():
        check_result(function(**arguments))


def check_result(value: Any) -> None:
    """What comes back is finite where that is promised."""
    if isinstance(value, t2d.Motion):
        check_motion(value)
    elif isinstance(value, t2d.Recording):
        check_recording(value)
    elif isinstance(value, t2d.MovingMesh):
        check_finite(value.at(value.times_s[:1]), "vertices")
    elif isinstance(value, t2d.Echoes):
        check_finite(value.delay_s, "delays")
        check_finite(value.amplitude, "amplitudes")
    elif isinstance(value, np.ndarray | float | complex):
        check_finite(value, "the result")
    elif isinstance(value, tuple):
        for each in value:
            check_result(each)
    elif hasattr(value, "savefig"):
        value.savefig("figure.png")


# --- good calls: each gives a function and every argument by name ---------------------------------------------------

Good = tuple[Callable[..., Any], dict[str, Any]]


def _filled(function: Callable[..., Any], **given: Any) -> Good:
    """A function with its arguments: those given, and the defaults of all others."""
    parameters = inspect.signature(function).parameters.values()
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    defaults = {p.name: p.default for p in parameters if p.kind not in kinds and p.default is not p.empty}
    return function, {**defaults, **given}


def _simulate(method: str) -> Good:
    target = quick_walk() if method == "ellipsoid" else quick_ball()
    return _filled(t2d.simulate, target=target, radar=quick_radar(), method=method)


def _plan() -> Good:
    arguments = _filled(t2d.simulate, target=quick_ball(), radar=quick_radar(), tolerance_db=-5.0)[1]
    return t2d.plan, {key: value for key, value in arguments.items() if key not in ("measure_error", "progress")}


def _mesh_values() -> dict[str, Any]:
    ball = quick_ball()
    times = np.array([0.0, 0.1, 0.2])
    return {"vertices": ball.at(times), "faces": ball.faces, "times_s": times}


def _from_track() -> Good:
    values = _mesh_values()
    middle = values["vertices"][0]
    return _filled(
        t2d.MovingMesh.from_track,
        track=_Track(middle),
        faces=values["faces"],
        times_s=np.array([0.0, 0.2]),
        rest=middle,
    )


class _Track:
    def __init__(self, points: np.ndarray) -> None:
        self.points = points

    def __call__(self, times_s: np.ndarray) -> np.ndarray:
        return np.repeat(self.points[None], len(times_s), axis=0)


def _broken_track(kind: str) -> Good:
    """A track that gives something else than vertices: an argument of its own."""
    function, arguments = _from_track()
    points = arguments["track"].points
    bad: dict[str, Callable[[np.ndarray], Any]] = {
        "nan": lambda t: np.full((len(t), *points.shape), np.nan), "shape": lambda t: points, "none": lambda t: None,
        "jumps": lambda t: points + 1e3 * (np.asarray(t) > 0.1)[:, None, None], "words": lambda t: "x",
    }  # fmt: skip

    def used(track: Any, **others: Any) -> Any:
        mesh = function(track=track, **others)
        return t2d.simulate(mesh, radar=quick_radar())

    return used, {**arguments, "track": bad[kind]}


def _echoes() -> t2d.Echoes:
    times = np.linspace(0, 0.2, 12)
    delay = 2 * (3 - times[:, None]) / 299792458.0
    return t2d.Echoes(times_s=times, delay_s=delay, amplitude=np.full((12, 1), 1e-6, np.complex64))


def _echoes_call() -> Good:
    good = _echoes()
    return _filled(t2d.Echoes, times_s=good.times_s, delay_s=good.delay_s, amplitude=good.amplitude)


def _cube(radar: t2d.Radar | None = None, chirps: int = 300) -> np.ndarray:
    radar = radar or quick_radar()
    rng = np.random.default_rng(0)
    shape = chirps, len(radar.tx_offsets_m) * len(radar.rx_offsets_m), radar.samples
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def _recording() -> t2d.Recording:
    return t2d.Recording(_cube(), quick_radar(), settings={"method": "mesh"}, versions={}, processing={"n_window": 64})


@functools.cache
def _array() -> t2d.Radar:
    return t2d.Radar.preset("array-3x4", samples=32)


def _signal(name: str, /, **given: Any) -> Callable[[], Good]:
    def make() -> Good:
        from t2d_rt import signal

        return _filled(
            getattr(signal, name), **{key: value() if callable(value) else value for key, value in given.items()}
        )

    return make


def _plot(name: str, /, **given: Any) -> Callable[[], Good]:
    def make() -> Good:
        from t2d_rt import plots

        return _filled(getattr(plots, name), **given)

    return make


def _method(make: Callable[[], Any], name: str, /, **given: Any) -> Callable[[], Good]:
    return lambda: _filled(getattr(make(), name), **given)


def _model(kind: str, /, **given: Any) -> Callable[[], Good]:
    """A model of fields with all of them given."""

    def make() -> Good:
        cls = getattr(t2d, kind)
        fields = {key: field.default for key, field in cls.model_fields.items() if not field.is_required()}
        return cls, {**fields, **given}

    return make


def _mover(**fields: Any) -> Any:
    return t2d.mover(fields).mesh(0.0, 0.2)


def _motion_values() -> dict[str, Any]:
    walk = quick_walk()
    return {
        name: getattr(walk, name) for name in ("joints", "rotations", "rate_hz", "names", "parents", "placed", "report")
    }


def _joints() -> dict[str, Any]:
    walk = quick_walk()
    return {"joints": walk.joints, "rate_hz": walk.rate_hz, "names": walk.names}


def _surface() -> dict[str, Any]:
    return {
        "name": "wall", "vertices": np.array([[5.0, -2, 0], [5, -2, 2], [5, 2, 2]]), "faces": np.array([[0, 1, 2]]),
        "material": "concrete",
        "thickness_m": 0.1,
    }  # fmt: skip


def _scene() -> t2d.Scene:
    return t2d.Scene(name="wall", surfaces=(t2d.Surface(**_surface()),))


def _ellipsoids() -> dict[str, Any]:
    return {
        "semi_axes_m": np.full((1, 3), 0.1),
        "centres": np.array([[[2.0, 0, 1]], [[1.9, 0, 1]]]),
        "times_s": np.array([0, 0.2]),
    }


SPEED, TIME = np.linspace(-3, 3, 32), np.linspace(0, 1, 20)
POWER = np.linspace(-80, -20, 32 * 20).reshape(32, 20)
CALLS: dict[str, Callable[[], Good]] = {
    "load_motion": lambda: _filled(t2d.load_motion, path=MOTIONS / "momask_22j_120frames.bvh"),
    "motion_from_joints": lambda: _filled(t2d.motion_from_joints, **_joints()),
    "Motion": lambda: (t2d.Motion, _motion_values()),
    "describe": lambda: (t2d.describe, {"motion": quick_walk()}),
    "place": lambda: _filled(t2d.place, motion=quick_walk()),
    "repeat": lambda: _filled(t2d.repeat, motion=t2d.load_motion(MOTIONS / "momask_22j_120frames.bvh"), duration_s=3.0),
    "resample": lambda: (t2d.resample, {"motion": quick_walk(), "rate_hz": 30.0}),
    "smooth": lambda: _filled(t2d.smooth, motion=quick_walk()),
    "trim": lambda: _filled(t2d.trim, motion=quick_walk(), start_s=0.05, stop_s=0.1),
    "sample": lambda: _filled(_of("motion", "sample"), motion=quick_walk(), times_s=np.array([0.0, 0.1])),
    "register_flavour": lambda: _filled(_of("motion", "register_flavour"), name="own", joints={"pelvis": "Hips"}),
    "skin": lambda: _filled(t2d.skin, motion=quick_walk()),
    "segments": lambda: _filled(t2d.segments, motion=quick_walk()),
    "simulate ellipsoids": lambda: _simulate("ellipsoid"),
    "simulate a mesh": lambda: _simulate("mesh"),
    "plan": _plan,
    "MovingMesh": lambda: _filled(t2d.MovingMesh, **_mesh_values()),
    "MovingMesh.at": _method(quick_ball, "at", times_s=np.array([0.0, 0.1])),
    "MovingMesh.trimesh": _method(quick_ball, "trimesh"),
    "MovingMesh.from_track": _from_track,
    **{f"a track of {kind}": functools.partial(_broken_track, kind) for kind in ("nan", "shape", "none", "jumps", "words")},
    "Ellipsoids": lambda: _filled(t2d.Ellipsoids, **_ellipsoids()),
    "Ellipsoids.at": _method(lambda: t2d.Ellipsoids(**_ellipsoids()), "at", times_s=np.array([0.0])),
    "Material": lambda: _filled(t2d.Material, relative_permittivity=4.0, conductivity_s_per_m=0.1, scattering_coefficient=0.2),
    "Material.reflection": _method(lambda: t2d.Material(relative_permittivity=4.0), "reflection", frequency_hz=77e9),
    "Surface": lambda: (t2d.Surface, _surface()),
    "Scene": lambda: (t2d.Scene, {"name": "wall", "surfaces": _scene().surfaces}),
    "save_scene": lambda: (t2d.save_scene, {"scene": _scene(), "folder": Path("saved")}),
    "load_scene": lambda: (t2d.load_scene, {"source": "empty_room"}),
    "load_recording": lambda: (t2d.load_recording, {"path": "none.npy"}),
    "mover": lambda: (t2d.mover, {"entry": "fan:2,1,1"}),
    "mover of fields": lambda: (_mover, {"kind": "pet", "position_m": (3, 0, 0), "size": 1.0, "speed_mps": 0.7,
    "turn_radius_m": 1.0, "material": "clothed"}),
    "TableFan": _model("TableFan", position_m=(2, 1, 1)),
    "CeilingFan": _model("CeilingFan", position_m=(2, 1, 2)),
    "Curtain": _model("Curtain", position_m=(2, 1, 0)),
    "Door": _model("Door", position_m=(2, 1, 0)),
    "Pet": _model("Pet", position_m=(2, 1, 0)),
    "TableFan.mesh": lambda: (t2d.TableFan(position_m=(2, 1, 1)).mesh, {"start_s": 0.0, "stop_s": 0.2}),
    "Room": _model("Room", name="box", size_m=(4, 3, 2.5)),
    "Room.scene": lambda: (lambda **fields: t2d.Room(**fields).scene(), {"name": "box", "size_m": (4, 3, 2.5), "openings": (),
    "furniture": (), "corner_m": None}),
    "a piece": lambda: (lambda **fields: t2d.Room(name="box", size_m=(4, 3, 2.5), furniture=(fields,)).scene(),
    {"kind": "cupboard", "x_m": 1, "y_m": 1, "name": "c"}),
    "an opening": lambda: (
        lambda **fields: t2d.Room(name="box", size_m=(4, 3, 2.5), openings=(fields,)).scene(),
        {"name": "door", "wall": "-y", "along_m": 0.5, "width_m": 0.9, "height_m": 2.0, "slab": None},
    ),
    "Radar": lambda: (t2d.Radar, quick_radar().model_dump()),
    "Radar.preset": lambda: (t2d.Radar.preset, {"name": "ci4r", "samples": 32, "prf_hz": 2000}),
    "Radar.from_yaml": lambda: (t2d.Radar.from_yaml, {"path": "none.yaml"}),
    "Radar.to_yaml": _method(quick_radar, "to_yaml", path="x.yaml"),
    "Radar.replace": lambda: (quick_radar().replace, {"prf_hz": 2000, "samples": 16}),
    "Radar.speed_resolution_mps": _method(quick_radar, "speed_resolution_mps", duration_s=0.1),
    "Radar.beat_frequency_hz": _method(quick_radar, "beat_frequency_hz", range_m=3.0),
    "Radar.range_axis_m": _method(quick_radar, "range_axis_m"),
    "Radar.speed_axis_mps": _method(quick_radar, "speed_axis_mps", n_fft=64),
    "Radar.chirp_starts_s": _method(quick_radar, "chirp_starts_s", chirps=10),
    "Radar.chirp_times_s": _method(quick_radar, "chirp_times_s", duration_s=0.1),
    "Radar.received_power_w": _method(quick_radar, "received_power_w", rcs_m2=1.0, range_m=3.0),
    "Echoes": _echoes_call,
    "synthesize": lambda: _filled(t2d.synthesize, echoes=_echoes(), radar=quick_radar()),
    "Recording": lambda: _filled(t2d.Recording, cube=_cube(), radar=quick_radar(), settings={}, versions={}, processing={}),
    "Recording.save": _method(_recording, "save", path="x.zarr"),
    "Recording.load": lambda: (t2d.Recording.load, {"path": "none.zarr"}),
    "Recording.plot": _method(_recording, "plot"),
    "Recording.plot_range_time": _method(_recording, "plot_range_time"),
    "Recording.plot_range_doppler": _method(_recording, "plot_range_doppler"),
    "Recording.export": _method(_recording, "export", path="x.npz"),
    "Recording.processed": lambda: (lambda **changes: _recording().processed(**changes), _signal("spectrogram")()[1]),
    "compare": lambda: (_of("comparison", "compare"), {"first": _recording(), "second": _recording()}),
    "spectrogram": _signal("spectrogram", adc=_cube, radar=quick_radar),
    "range_doppler": _signal("range_doppler", adc=_cube, radar=quick_radar),
    "range_time": _signal("range_time", adc=_cube, radar=quick_radar),
    "coherent_interval": _signal("coherent_interval", adc=_cube, radar=quick_radar),
    "range_profile": _signal("range_profile", adc=_cube, radar=quick_radar),
    "range_fft": _signal("range_fft", adc=_cube),
    "mti": _signal("mti", profile=_cube, prf_hz=2000.0, cutoff_hz=50.0),
    "stft": _signal("stft", series=lambda: _cube()[:, 0, 0], prf_hz=2000.0),
    "taper": _signal("taper", name="hann", length=32),
    "gate": _signal("gate", range_m=TIME, limits_m=(0.1, 0.5)),
    "cfar": _signal("cfar", power=lambda: np.abs(_cube()[:, 0]) ** 2, false_alarm_rate=1e-3),
    "cfar_factor": _signal("cfar_factor", false_alarm_rate=1e-3, cells=16),
    "unit_vectors": _signal("unit_vectors", azimuth_rad=0.1, elevation_rad=0.1),
    "steering_vectors": _signal("steering_vectors", radar=_array, directions=np.array([[1.0, 0, 0]])),
    "array_spectrum": _signal("array_spectrum", adc=lambda: _cube(_array(), 64), radar=_array),
    "range_angle": _signal("range_angle", adc=lambda: _cube(_array(), 64), radar=_array),
    "point_cloud": _signal("point_cloud", adc=lambda: _cube(_array(), 64), radar=_array),
    "separate_ddm": _signal("separate_ddm", adc=_cube, radar=quick_radar),
    "plot_spectrogram": _plot("plot_spectrogram", velocity_mps=SPEED, time_s=TIME, power_db=POWER),
    "plot_range_time": _plot("plot_range_time", range_m=SPEED, time_s=TIME, power_db=POWER),
    "plot_range_doppler": _plot("plot_range_doppler", range_m=TIME, velocity_mps=SPEED, power_db=POWER),
    "plot_range_angle": _plot("plot_range_angle", range_m=TIME, azimuth_rad=np.linspace(-1, 1, 32), power_db=POWER),
    "plot_point_cloud": _plot("plot_point_cloud", xyz_m=np.ones((5, 3)), speed_mps=np.arange(5.0)),
    "plot_scene": lambda: _filled(_of("plots", "plot_scene"), scene=_scene(), radar_m=np.array([0.0, 0, 1])),
    "plot_comparison": _plot("plot_comparison", velocity_mps=SPEED, time_s=TIME, first_db=POWER, second_db=POWER),
}  # fmt: skip


def _of(module: str, name: str) -> Any:
    from importlib import import_module

    return getattr(import_module(f"t2d_rt.{module}"), name)
