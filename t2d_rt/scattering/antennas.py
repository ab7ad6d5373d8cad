"""What arrays and directional antennas add to echoes: points to measure delays from, gain over direction."""

from __future__ import annotations

import numpy as np

from t2d_rt.types import EchoArrays, Radar


def seen_by(radar: Radar, echoes: EchoArrays, departure_m: np.ndarray, arrival_m: np.ndarray) -> EchoArrays:
    """`echoes` as the radar's antennas see them, from the points (T, N, 3) they seem to stand in."""
    amplitude, slope = echoes.amplitude, echoes.slope
    if radar.directional:
        outward = (
            line_of_sight / np.linalg.norm(line_of_sight, axis=-1, keepdims=True)
            for line_of_sight in (departure_m - radar.tx_position_m, arrival_m - radar.rx_position_m)
        )
        factor = radar.antenna_factor(*outward).astype(np.float32)
        amplitude, slope = amplitude * factor, None if slope is None else slope * factor
    echoes = echoes._replace(amplitude=amplitude, slope=slope)
    if radar.is_array:
        departure = departure_m.astype(np.float32)
        arrival = departure if arrival_m is departure_m else arrival_m.astype(np.float32)
        return echoes._replace(departure_m=departure, arrival_m=arrival)
    return echoes


def side_by_side(parts: list[EchoArrays]) -> EchoArrays:
    """Different echoes at the same frames."""
    if len(parts) == 1:
        return parts[0]
    parts = [p if p.slope is not None else p._replace(slope=np.zeros_like(p.amplitude)) for p in parts]
    same = all(part.arrival_m is part.departure_m for part in parts)
    joint = [None if fields[0] is None else np.concatenate(fields, axis=1) for fields in zip(*parts, strict=True)]
    echoes = EchoArrays(*joint)  # type: ignore[arg-type]
    return echoes._replace(arrival_m=echoes.departure_m) if same else echoes
