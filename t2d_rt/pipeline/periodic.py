"""Fast periodic targets such as the blades of a fan: echoes of a few periods stand for the whole record, with gains for the changes
of visibility by other targets and the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from t2d_rt.core.memory import blocks
from t2d_rt.radar.repetition import duration_s, repetition
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import MovingMesh, Radar
from t2d_rt.types.scatterer import Fraction, Scatterer

GAIN_RATE_HZ = 250.0
"""Rate at which visibility is sampled to find these gains [Hz]; its changes take some 40 ms."""
UNCHANGED = 0.01
"""Greatest deviation from its median of a visibility that counts as constant, on the strongest path pair; for a pair 20 dB weaker
it is ten times as much."""
SPEED_PROBES = 60

Make = Callable[..., Scatterer]
"""Function that makes the scatterer of a mesh at surface frames `times_s` over path pairs `views`."""


def in_periods(
    mesh: MovingMesh,
    radar: Radar,
    frames_s: np.ndarray,
    views: Sequence[PathVisibility],
    make: Make,
    *,
    level_db: float = 0.0,
) -> list[Scatterer] | None:
    """Scatterers of a few periods that stand for the record of these surface frames; None where the mesh is not periodic, or this
    would not save work.

    `level_db`: level of the strongest of these path pairs relative to all others; it decides which changes of visibility matter.
    The whole mesh has one visibility at a time. The first scatterer has the median visibility of each path pair; what visibility
    departs from it over time is a gain on further ones.
    """
    span_s = float(frames_s[0]), float(frames_s[-1])
    rate_hz = (len(frames_s) - 1) / (span_s[1] - span_s[0])
    if mesh.period_s is None or span_s[1] - span_s[0] < 2 * mesh.period_s:
        return None
    repeats = repetition(radar, mesh.period_s, _greatest_speed_mps(mesh, span_s[0]), rate_hz, span_s)
    if repeats is None:
        return None
    length_s = duration_s(repeats, rate_hz)
    times_s = np.linspace(span_s[0], span_s[0] + length_s, int(np.ceil(length_s * rate_hz)) + 1)
    samples_s = np.linspace(*span_s, int(np.ceil((span_s[1] - span_s[0]) * GAIN_RATE_HZ)) + 1)
    bare = [replace(view, visibility=(), unblocked=(), subdivision=0) for view in views]
    visibility = [_visibility(view, samples_s) for view in views]
    constant = [float(np.median(fractions)) for fractions in visibility]
    unchanged = min(UNCHANGED * 10 ** (-level_db / 20), 1.0)
    lit = [
        _dimmed(view, level, len(mesh.rest)) for view, level in zip(bare, constant, strict=True) if level > UNCHANGED
    ]
    scatterers = [replace(make(times_s=times_s, views=lit), repeats=repeats)] if lit else []
    alike: dict[bytes, tuple[np.ndarray, list[PathVisibility]]] = {}
    for view, fractions, level in zip(bare, visibility, constant, strict=True):
        departs = fractions - (level if level > UNCHANGED else 0.0)
        most = float(departs[np.abs(departs).argmax()])
        if abs(most) > unchanged:
            # Path pairs whose visibility changes in the same way share one gain, each with a constant factor.
            gain = departs / most
            _, alike_views = alike.setdefault(np.round(gain, 2).tobytes(), (np.sign(most) * gain, []))
            alike_views.append(_dimmed(view, abs(most), len(mesh.rest)))
    for gain, alike_views in alike.values():
        repeated = replace(repeats, gain=partial(np.interp, xp=samples_s, fp=gain))  # type: ignore[arg-type]  # of one number, says NumPy
        scatterers.append(replace(make(times_s=times_s, views=alike_views), repeats=repeated))
    return scatterers or None


def _visibility(view: PathVisibility, samples_s: np.ndarray) -> np.ndarray:
    """Visibility of the whole mesh over a path pair at times [s] (K,), with occlusion and blockage, (K,)."""
    fractions = np.ones(len(samples_s))
    for fraction in (*view.visibility, *view.unblocked):
        fractions *= np.concatenate([fraction(chunk_s)[:, 0] for chunk_s in blocks(samples_s, 10_000)])
    return fractions


def _dimmed(view: PathVisibility, level: float, vertices: int) -> PathVisibility:
    """The path pair with its visibility replaced by the constant `level`, for all vertices and times."""
    if level > 1 - UNCHANGED:
        return view
    constant: Fraction = lambda times_s: np.broadcast_to(np.float32(level), (len(times_s), vertices))  # noqa: E731
    return replace(view, visibility=(constant,))


def _greatest_speed_mps(mesh: MovingMesh, start_s: float) -> float:
    """Greatest speed of any vertex of the mesh over a period [m/s]."""
    assert mesh.period_s is not None
    step_s = mesh.period_s / SPEED_PROBES / 100
    times_s = start_s + mesh.period_s * np.arange(SPEED_PROBES) / SPEED_PROBES
    return float(np.linalg.norm(mesh.at(times_s + step_s) - mesh.at(times_s), axis=2).max()) / step_s
