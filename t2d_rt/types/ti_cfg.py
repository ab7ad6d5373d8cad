"""Configuration files (.cfg) of Texas Instruments' radars: the chirps, and how 3D people tracking finds points.

The fields of each command stand in the mmWave SDK's user guide (profileCfg, chirpCfg, frameCfg) and in the tuning guide of the
people-tracking demo's detection layer (dynamicRACfarCfg, dynamicRangeAngleCfg, dynamic2DAngleCfg, fovCfg, antGeometry).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field

from t2d_rt.core.checks import shown
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import MAX_YAML_BYTES, read_bytes
from t2d_rt.types.fields import Count, Fields, Number

Source = str | Path | Sequence[str]
Commands = dict[str, list[list[float]]]
Steps = Annotated[Count, Field(ge=0, le=1000)]


def read_commands(source: Source) -> Commands:
    """The numbers of every line of a .cfg file, or of its lines, by the name of the command."""
    if isinstance(source, (str, Path)):
        lines = (
            read_bytes(source, limit=MAX_YAML_BYTES, noun="radar configuration").decode("utf-8", "replace").splitlines()
        )
    elif isinstance(source, Sequence):
        lines = list(source)
    else:
        raise InputError(f"a radar configuration must be a .cfg file or its lines, got {shown(source)}; give a path")
    found: Commands = {}
    for line in lines:
        words = str(line).split("%")[0].split()
        if words:
            try:
                numbers = [float(word) for word in words[1:]]
            except ValueError:
                numbers = [math.nan]
            if not all(map(math.isfinite, numbers)):
                raise InputError(f"a .cfg line must be a command and its numbers, got {line!s:.80}; correct it")
            found.setdefault(words[0], []).append(numbers)
    return found


def _numbers(commands: Commands, name: str, least: int) -> list[float]:
    """Numbers of a command that the file must have once."""
    given = commands.get(name, [])
    if len(given) != 1 or len(given[0]) < least:
        raise InputError(
            f"the .cfg file must hold one line {name} with {least} or more numbers, got lines of "
            f"{[len(each) for each in given]} numbers; give a file of one profile and one frame"
        )
    return given[0]


def radar_fields(source: Source) -> dict[str, Any]:
    """Fields of a `Radar` that a .cfg file tells: waveform, bursts, transmit power and, from antGeometry0 and 1, the antennas.

    The power is 12 dBm less the profile's back-off of the first transmitter; gains, noise figure and pose are not in the file.
    """
    commands = read_commands(source)
    profile = _numbers(commands, "profileCfg", 11)
    _, start_ghz, idle_us, adc_us, ramp_us, backoff, _, slope, _, samples, rate_khz = profile[:11]
    first, last, loops, _, period_ms = _numbers(commands, "frameCfg", 5)[:5]
    for name, value in (
        ("start frequency of profileCfg", start_ghz), ("idle and ramp time of profileCfg", idle_us + ramp_us),
        ("sample rate of profileCfg", rate_khz), ("period of frameCfg", period_ms),
    ):  # fmt: skip
        if value <= 0:
            raise InputError(f"the {name} must be more than 0, got {value:g}; correct the .cfg file")
    for name, value in (("samples of profileCfg", samples), ("loops of frameCfg", loops)):
        if value < 1 or value != int(value):
            raise InputError(f"the {name} must be a whole number, 1 or more, got {value:g}; correct the .cfg file")
    if any(any(chirp[3:7]) for chirp in commands.get("chirpCfg", [])):
        raise InputError(
            "chirpCfg must leave frequency, slope and times as profileCfg has them; give a file of like chirps"
        )
    if any(len(line) > 1 and line[1] for line in commands.get("bpmCfg", [])):
        raise InputError("bpmCfg must be off; give a file of time multiplexing")
    order = [
        int(chirp[7]) for chirp in sorted(commands.get("chirpCfg", [])) if len(chirp) > 7 and first <= chirp[0] <= last
    ]
    if any(mask not in (1, 2, 4) for mask in order) or len(set(order)) != len(order) or len(order) != last - first + 1:
        raise InputError(
            f"chirpCfg must let one transmitter after the other send, got the masks {order}; give a file of time multiplexing"
        )
    slope, adc_s = slope * 1e12, adc_us * 1e-6
    carrier = start_ghz * 1e9 + slope * adc_s
    middle = carrier + slope * (samples - 1) / 2 / (rate_khz * 1e3)
    interval = (idle_us + ramp_us) * 1e-6
    return {
        "carrier_hz": carrier, "slope_hz_per_s": slope, "sample_rate_hz": rate_khz * 1e3, "samples": int(samples),
        "prf_hz": 1 / interval, "chirps_per_frame": int(loops) * len(order), "frame_interval_s": period_ms * 1e-3,
        "tx_power_dbm": 12.0 - (int(backoff) & 0xFF), "multiplexing": "tdm",
        **_antennas(commands, len(order), SPEED_OF_LIGHT / middle / 2),
    }  # fmt: skip


def _antennas(commands: Commands, transmitters: int, half_m: float) -> dict[str, Any]:
    """Offsets from the places of the virtual antennas, which stand in half wavelengths, across to the right and upwards."""
    across, up = (np.array(_numbers(commands, f"antGeometry{axis}", 1)) for axis in (0, 1))
    receivers = len(across) // transmitters
    if len(across) != len(up) or receivers * transmitters != len(across):
        raise InputError(
            f"antGeometry must place the receivers of {transmitters} transmitters, got {len(across)} and {len(up)}"
        )
    places = half_m * np.stack([0 * across, -across, up], axis=-1).reshape(transmitters, receivers, 3)
    tx, rx = places[:, 0] - places[0, 0], places[0]
    if not np.allclose(places, tx[:, None] + rx):
        raise InputError(
            "antGeometry must be transmitters times receivers in chirp order; the places given are no such array"
        )
    return {"tx_offsets_m": (tx - tx.mean(axis=0)).tolist(), "rx_offsets_m": (rx - rx.mean(axis=0)).tolist()}


class Detection(Fields):
    """How 3D people tracking finds points; the defaults are those of the demo's 6 m configuration of an IWR6843AOP."""

    noun: ClassVar[str] = "detection"

    range_skip: tuple[Steps, Steps] = (4, 4)
    """Range bins at the near and the far end that are not looked at."""
    angle_skip: tuple[Steps, Steps] = (2, 2)
    """Azimuths at either end that are not tested."""
    training_cells: tuple[Annotated[Steps, Field(ge=1)], Annotated[Steps, Field(ge=1)]] = (8, 12)
    """Cells of one side whose mean is the noise, along range and azimuth; the quieter side counts."""
    guard_cells: tuple[Steps, Steps] = (4, 12)
    """Cells between these and the tested one, along range and azimuth."""
    thresholds: tuple[Annotated[Number, Field(gt=0)], Annotated[Number, Field(gt=0)]] = (5.0, 8.0)
    """Least power over noise, a ratio, along range and azimuth."""
    side_lobe: Annotated[Number, Field(ge=0, le=1)] = 0.4
    """Least power over that of the strongest azimuth at the same range."""
    steps_deg: tuple[Annotated[Number, Field(gt=0, le=30)], Annotated[Number, Field(gt=0, le=30)]] = (0.75, 3.0)
    """Steps of the search over azimuth and elevation about boresight [deg]."""
    loading: tuple[Annotated[Number, Field(gt=0, le=1)], Annotated[Number, Field(gt=0, le=1)]] = (0.001, 0.03)
    """What is added to the covariance's diagonal, over the antennas' mean power, for azimuth and for elevation."""
    field_of_view_deg: tuple[Annotated[Number, Field(gt=0, lt=90)], Annotated[Number, Field(gt=0, lt=90)]] = (
        70.0,
        70.0,
    )
    """Largest azimuth and elevation of the search [deg]."""
    most_points: Annotated[Count, Field(ge=1, le=10_000)] = 150
    """Points of one frame that are sent, the strongest: no recording of this device that was seen has more."""

    @classmethod
    def from_ti_cfg(cls, source: Source) -> Self:
        """Read from a .cfg file of the 3D people-tracking demo, or from its lines."""
        commands = read_commands(source)
        cfar = _numbers(commands, "dynamicRACfarCfg", 13)[1:]
        azimuth, elevation = _numbers(commands, "dynamicRangeAngleCfg", 3), _numbers(commands, "dynamic2DAngleCfg", 3)
        view = _numbers(commands, "fovCfg", 3)
        whole = [int(value) for value in cfar[:8]]
        return cls(
            range_skip=(whole[0], whole[1]), angle_skip=(whole[2], whole[3]), training_cells=(whole[4], whole[5]),
            guard_cells=(whole[6], whole[7]), thresholds=(cfar[8], cfar[9]), side_lobe=cfar[10],
            steps_deg=(azimuth[1], elevation[1]), loading=(azimuth[2], elevation[2]),
            field_of_view_deg=(view[1], view[2]),
        )  # fmt: skip
