"""Whether an antenna stands within a target."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import blocks
from t2d_rt.geometry import winding
from t2d_rt.types import MovingMesh, Radar


def check_outside(surface: MovingMesh, radar: Radar, times_s: np.ndarray) -> None:
    """Refuses a radar inside a closed mesh, or touching a mesh, at any of a few instants of the record."""
    for times in blocks(np.linspace(times_s[0], times_s[-1], 25), len(surface.rest)):
        _check_outside(surface, radar, times)


def _check_outside(surface: MovingMesh, radar: Radar, times: np.ndarray) -> None:
    vertices = surface.at(times)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        within = np.all((vertices.min(axis=1) < antenna) & (antenna < vertices.max(axis=1)), axis=1)
        inside = np.zeros(len(times), bool)
        inside[within] = np.abs(winding(vertices[within][:, surface.faces] - antenna)) > 0.5
        touches = np.linalg.norm(vertices - antenna, axis=2).min(axis=1) < 1e-3
        if inside.any() or touches.any():
            where = ", ".join(f"{x:.3g}" for x in antenna)
            instant = times[np.argmax(inside if inside.any() else touches)]
            raise InputError(
                f"the radar at ({where}) m {'is inside' if inside.any() else 'touches'} {surface.name} at {instant:.3g} s; place "
                "the target farther away (distance_m) or move the radar"
            )
