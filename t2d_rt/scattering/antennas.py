"""What arrays and directional antennas add to echoes: apparent positions, which give an array's delays, and gain over direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import reused_empty
from t2d_rt.types import EchoArrays, Radar


def seen_by(
    radar: Radar, echoes: EchoArrays, departure_m: np.ndarray, arrival_m: np.ndarray | None = None
) -> EchoArrays:
    """Echoes as the radar's antennas see them: times the antenna factor of a directional radar, and for an array with their
    apparent positions `departure_m` and `arrival_m` (T, N, 3) [m]. Without `arrival_m` the receivers see them where the
    transmitters do."""
    amplitude, slope = echoes.amplitude, echoes.slope
    if radar.directional:
        outward = (
            line_of_sight / np.linalg.norm(line_of_sight, axis=-1, keepdims=True)
            for line_of_sight in (
                departure_m - radar.tx_position_m,
                (departure_m if arrival_m is None else arrival_m) - radar.rx_position_m,
            )
        )
        factor = radar.antenna_factor(*outward).astype(np.float32)
        amplitude, slope = amplitude * factor, None if slope is None else slope * factor
    echoes = echoes._replace(amplitude=amplitude, slope=slope)
    if radar.is_array:
        arrival = None if arrival_m is None else arrival_m.astype(np.float32)
        return echoes._replace(departure_m=departure_m.astype(np.float32), arrival_m=arrival)
    return echoes


def concatenated(parts: list[EchoArrays]) -> EchoArrays:
    """Joins echoes of the same frames along the echo axis; raises InputError if only some of them have apparent positions."""
    if len(parts) == 1:
        return parts[0]
    parts = [p if p.slope is not None else p._replace(slope=np.zeros_like(p.amplitude)) for p in parts]
    if any(part.arrival_m is not None for part in parts):
        parts = [p if p.arrival_m is not None else p._replace(arrival_m=p.departure_m) for p in parts]
    if len({part.departure_m is None for part in parts}) > 1:
        raise InputError(
            "some scatterers give no apparent positions (departure_m), which an array radar needs of all; give them as "
            "docs/extend.md does"
        )
    joint = [None if fields[0] is None else _joint(fields) for fields in zip(*parts, strict=True)]
    return EchoArrays(*joint)  # type: ignore[arg-type]


def _joint(fields: Sequence[np.ndarray]) -> np.ndarray:
    """Joins arrays (T, N, ...) along their second axis."""
    first = fields[0]
    out = reused_empty((len(first), sum(field.shape[1] for field in fields), *first.shape[2:]), np.result_type(*fields))
    return np.concatenate(fields, axis=1, out=out)
