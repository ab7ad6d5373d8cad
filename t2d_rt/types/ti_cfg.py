"""Configuration files (.cfg) of Texas Instruments' radars: reading and writing their chirps and antennas.

The fields of each command are described in the mmWave SDK's user guide (channelCfg, adcCfg, profileCfg, chirpCfg, frameCfg) and in
the tuning guide of the people-tracking demo's detection layer (antGeometry). Signs of antennas (antPhaseRot) are those of the
device's own samples and not of a `Radar`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.files import MAX_YAML_BYTES, read_bytes

Source = str | Path | Sequence[str]
Commands = dict[str, list[list[float]]]
BOARDS = {
    "xwr14xx": "iwr1443boost", "xwr16xx": "iwr1642boost", "xwr18xx": "awr1843boost", "xwr68xx": "iwr6843isk",
    "xwr68xx_aop": "iwr6843aop", "xwr64xx": "iwr6843isk", "xwr64xx_aop": "iwr6843aop",
}  # fmt: skip
"""Presets of the evaluation boards that the visualizer's comment "Platform:..." names."""
FULL_DBM = 12.0
"""Power of a transmitter without back-off [dBm], where the board is not known."""


def read_lines(source: Source) -> list[str]:
    """The lines of a .cfg file, or lines as they are given."""
    if isinstance(source, (str, Path)):
        return (
            read_bytes(source, limit=MAX_YAML_BYTES, noun="radar configuration").decode("utf-8", "replace").splitlines()
        )
    if isinstance(source, Sequence):
        return [str(line) for line in source]
    raise InputError(f"a radar configuration must be a .cfg file or its lines, got {shown(source)}; give a path")


def read_commands(source: Source) -> Commands:
    """The numbers of every line of a .cfg file, or of its lines, by the name of the command. A line with words gives a single NaN;
    where the command has only numbers it is refused."""
    commands: Commands = {}
    for line in read_lines(source):
        words = line.split("%")[0].split()
        if words:
            try:
                numbers = [float(word) for word in words[1:]]
            except ValueError:
                numbers = [math.nan]
            of_numbers = words[0].endswith(("Cfg", "Geometry0", "Geometry1")) and not words[0].startswith("set")
            if of_numbers and not all(map(math.isfinite, numbers)):
                raise InputError(f"a .cfg line must be a command and its numbers, got {line:.80}; correct it")
            commands.setdefault(words[0], []).append(numbers)
    return commands


def board_of(source: Source) -> str | None:
    """Preset of the board that a .cfg file's comment "Platform:..." names; None where it names no known board."""
    for line in read_lines(source):
        name, _, value = line.strip().lstrip("%").strip().partition(":")
        if name.lower() == "platform":
            return BOARDS.get(value.strip().lower())
    return None


def numbers(commands: Commands, name: str, least: int) -> list[float]:
    """Numbers of a command, which the file must have exactly once, with `least` numbers or more."""
    rows = commands.get(name, [])
    if len(rows) != 1 or len(rows[0]) < least:
        raise InputError(
            f"the .cfg file must hold one line {name} with {least} or more numbers, got lines of "
            f"{[len(row) for row in rows]} numbers; give a file of one profile and one frame"
        )
    return rows[0]


def radar_fields(source: Source, board: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Fields of a `Radar` from a .cfg file: waveform, bursts, transmit power and antennas.

    The antennas are those of antGeometry0 and 1 or, without them, those of the board that chirpCfg and channelCfg choose. The power
    is the board's less the profile's back-off of the first transmitter. Settings of the file that a Radar does not have cause a
    warning.

    board: all fields of a preset whose antennas are in the device's order.
    """
    commands = read_commands(source)
    # other ways to send chirps: advanced frames, no frames, and those of the low-power devices
    for name in ("advFrameCfg", "subFrameCfg", "contModeCfg", "chirpComnCfg", "chirpTimingCfg"):
        if name in commands:
            raise InputError(
                f"{name} cannot be represented: a Radar has like bursts of one profile; give a file of one frameCfg"
            )
    if any(len(line) > 1 and line[1] for line in commands.get("bpmCfg", [])):
        raise InputError("bpmCfg must be off; give a file of time multiplexing")
    _check_whole(commands)
    frame = numbers(commands, "frameCfg", 5)
    loops, period_ms = frame[2], frame[5 if len(frame) > 7 else 4]  # devices from 2021 on have one number more
    chirps = _chirps(commands, frame)
    profile = _profile(commands, chirps[0])
    _, start_ghz, idle_us, adc_us, ramp_us, backoff, phases, slope, _, samples, rate_khz = profile[:11]
    for name, value in (
        ("start frequency of profileCfg", start_ghz), ("idle and ramp time of profileCfg", idle_us + ramp_us),
        ("sample rate of profileCfg", rate_khz), ("period of frameCfg", period_ms), ("slope of profileCfg", slope),
    ):  # fmt: skip
        if value <= 0:
            raise InputError(f"the {name} must be more than 0, got {value:g}; correct the .cfg file")
    for name, value in (("samples of profileCfg", samples), ("loops of frameCfg", loops)):
        if value < 1 or value != int(value):
            raise InputError(f"the {name} must be a whole number, 1 or more, got {value:g}; correct the .cfg file")
    if min(adc_us, idle_us) < 0:
        raise InputError(
            f"ADC start and idle time of profileCfg must be 0 us or more, got {adc_us:g} and {idle_us:g}; correct the .cfg file"
        )
    if adc_us + samples / rate_khz * 1e3 > ramp_us * (1 + 1e-9):
        raise InputError(
            f"the samples of profileCfg end {adc_us + samples / rate_khz * 1e3:.4g} us after the ramp's start, the ramp after "
            f"{ramp_us:g} us; correct the .cfg file"
        )
    order = _order([int(chirp[7]) for chirp in chirps])
    slope, adc_s = slope * 1e12, adc_us * 1e-6
    carrier = start_ghz * 1e9 + slope * adc_s
    middle = carrier + slope * (samples - 1) / 2 / (rate_khz * 1e3)
    backoffs = [int(backoff) >> 8 * bit & 0xFF for bit in order]
    _warn_of_rest(commands, backoffs, int(phases))
    of_board = {} if board is None else {name: value for name, value in board.items() if name in OF_BOARD}
    return {
        **of_board, "carrier_hz": carrier, "slope_hz_per_s": slope, "sample_rate_hz": rate_khz * 1e3, "samples": int(samples),
        "prf_hz": 1e6 / (idle_us + ramp_us), "chirps_per_frame": int(loops) * len(chirps), "frame_interval_s": period_ms * 1e-3,
        "tx_power_dbm": (board or {}).get("tx_power_dbm", FULL_DBM) - backoffs[0],
        "multiplexing": "tdm" if len(order) > 1 else "simultaneous",
        **_antennas(commands, order, board, SPEED_OF_LIGHT / middle / 2),
    }  # fmt: skip


OF_BOARD = "tx_gain_dbi", "rx_gain_dbi", "noise_figure_db", "tx_pattern", "rx_pattern"
"""Fields of a board's preset that a .cfg file does not contain."""


WHOLE = {
    "channelCfg": {0: 255, 1: 255, 2: 255}, "chirpCfg": {0: 511, 1: 511, 2: 255, 7: 255}, "frameCfg": {0: 511, 1: 511, 3: 65535},
    "profileCfg": {0: 255, 5: 2**32 - 1, 6: 2**32 - 1},
}  # fmt: skip
"""Positions of whole numbers among the numbers of a command, and the greatest value of each: indices of chirps and profiles,
masks."""


def _check_whole(commands: Commands) -> None:
    """Refuses fractions, negative numbers, and numbers too great for their field."""
    for name, places in WHOLE.items():
        for line in commands.get(name, []):
            for place, most in places.items():
                if place < len(line) and (line[place] % 1 or not 0 <= line[place] <= most):
                    raise InputError(
                        f"number {place + 1} of {name} must be a whole number from 0 to {most}, got {line[place]:.12g}; "
                        "correct the .cfg file"
                    )


def _chirps(commands: Commands, frame: list[float]) -> list[list[float]]:
    """The numbers of the chirpCfg of each chirp of a loop, in order."""
    first, last = int(frame[0]), int(frame[1])
    by_number: dict[int, list[float]] = {}
    for chirp in commands.get("chirpCfg", []):
        if len(chirp) < 8:
            raise InputError(f"a line chirpCfg must have 8 numbers, got {len(chirp)}; correct the .cfg file")
        by_number |= dict.fromkeys(range(int(chirp[0]), int(chirp[1]) + 1), chirp)
    missing = [number for number in range(first, last + 1) if number not in by_number]
    if missing or last < first:
        raise InputError(
            f"frameCfg sends chirps {first} to {last}, and chirpCfg defines {sorted(by_number)}; correct the .cfg file"
        )
    chirps = [by_number[number] for number in range(first, last + 1)]
    if any(chirp[2:7] != chirps[0][2:7] for chirp in chirps):
        raise InputError(
            "the chirps of a frame must be alike in profile, frequency, slope and times, as a Radar's are; give a file of such"
        )
    return chirps


def _profile(commands: Commands, chirp: list[float]) -> list[float]:
    """Numbers of the profile of a chirp, to which the chirp's own variations [Hz, kHz/us, us, us] are added."""
    profiles = [profile for profile in commands.get("profileCfg", []) if profile and profile[0] == chirp[2]]
    profile = list(numbers({"profileCfg": profiles}, "profileCfg", 11))
    for place, change in ((1, chirp[3] * 1e-9), (7, chirp[4] * 1e-3), (2, chirp[5]), (3, chirp[6])):
        profile[place] += change
    return profile


def _order(masks: list[int]) -> list[int]:
    """Indices of the transmitters, from 0, in the order in which they send, from the transmit masks of the chirps."""
    period = next(n for n in range(1, len(masks) + 1) if len(masks) % n == 0 and masks == masks[:n] * (len(masks) // n))
    once = masks[:period]
    if any(mask not in (1, 2, 4, 8) for mask in once) or len(set(once)) != len(once):
        raise InputError(
            f"chirpCfg must let one transmitter after the other send, got the masks {masks[:16]}; give a file of time multiplexing"
        )
    return [mask.bit_length() - 1 for mask in once]


def _warn_of_rest(commands: Commands, backoffs: list[int], phases: int) -> None:
    """Warns of settings of the file that a Radar does not have."""
    differences = []
    if len(set(backoffs)) > 1:
        differences.append(f"back-offs of {backoffs} dB, of which the first is taken for all transmitters")
    if phases:
        differences.append("phase shifters of transmitters, which are taken for zero")
    if any(len(line) > 1 and line[1] == 0 for line in commands.get("adcCfg", [])):
        differences.append("real samples: read captures with iq='I', and of the ranges only the nearer half is real")
    if any(len(line) > 2 and line[2] for line in commands.get("channelCfg", [])):
        differences.append("chips in cascade, of which it tells one")
    if differences:
        warn(f"the .cfg file has what a Radar has not: {'; '.join(differences)}")


def _bits(mask: float) -> list[int]:
    return [bit for bit in range(8) if int(mask) >> bit & 1]


def _antennas(commands: Commands, order: list[int], board: Mapping[str, Any] | None, half_m: float) -> dict[str, Any]:
    """Offsets [m] of the transmitters, in the order in which they send, and of the active receivers, each about their centre."""
    channels = commands.get("channelCfg", [])
    on = _bits(channels[-1][0]) if channels and channels[-1] else [0, 1, 2, 3]
    if not on:
        raise InputError(f"channelCfg must have a receiver on, got the mask {channels[-1][0]:g}; correct the .cfg file")
    allowed = _bits(channels[-1][1]) if channels and len(channels[-1]) > 1 else order
    if not {*order} <= {*allowed}:
        raise InputError(
            f"chirpCfg lets transmitters {[bit + 1 for bit in order]} send and channelCfg has {[bit + 1 for bit in allowed]} on; "
            "correct the .cfg file"
        )
    if "antGeometry0" in commands:
        tx, rx = _of_geometry(commands, len(order), len(on) if channels else None, half_m)
    elif board is not None:
        places = np.array(board["tx_offsets_m"]), np.array(board["rx_offsets_m"])
        if max(order) >= len(places[0]) or max(on) >= len(places[1]):
            raise InputError(
                f"the .cfg file uses transmitter {max(order) + 1} and receiver {max(on) + 1}, the board has {len(places[0])} and "
                f"{len(places[1])}; give the board that it is for"
            )
        tx, rx = places[0][order], places[1][on]
    else:
        tx, rx = (
            half_m * np.arange(count)[:, None] * step * np.array([0.0, -1.0, 0.0])
            for count, step in ((len(order), len(on)), (len(on), 1))
        )
        if len(order) * len(on) > 1:
            warn(
                "the .cfg file tells neither antGeometry nor the board, so the virtual antennas are put in one row, half a "
                "wavelength apart; give board=, as board='iwr6843isk'"
            )
    return {"tx_offsets_m": (tx - tx.mean(axis=0)).tolist(), "rx_offsets_m": (rx - rx.mean(axis=0)).tolist()}


def _of_geometry(commands: Commands, transmitters: int, on: int | None, half_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets [m] of the transmitters (M, 3) and receivers (N, 3), from the positions of the virtual antennas in antGeometry, which
    count half wavelengths to the right and upwards."""
    across, up = (np.array(numbers(commands, f"antGeometry{axis}", 1)) for axis in (0, 1))
    receivers = len(across) // transmitters
    if len(across) != len(up) or receivers * transmitters != len(across) or receivers != (on or receivers):
        raise InputError(
            f"antGeometry must place the receivers of {transmitters} transmitters, got {len(across)} and {len(up)}"
            + (f", and channelCfg has {on} receivers on" if on else "")
        )
    places = half_m * np.stack([0 * across, -across, up], axis=-1).reshape(transmitters, receivers, 3)
    tx, rx = places[:, 0] - places[0, 0], places[0]
    if not np.allclose(places, tx[:, None] + rx):
        raise InputError(
            "antGeometry must be transmitters times receivers in chirp order; the places given are no such array"
        )
    return tx, rx


def ti_lines(radar: Any, board: str | None, full_dbm: float) -> list[str]:
    """Lines of a .cfg file of a `Radar` with bursts and time multiplexing; errors name what cannot be written.

    Of the time in which a chirp does not sample, a third, at most 6 us, is put before the samples, and a sixth, at most 1 us,
    between them and the end of the ramp; the rest is idle. Power is written as back-off from the board's `full_dbm`, in whole dB.
    """
    transmitters, receivers = len(radar.tx_offsets_m), len(radar.rx_offsets_m)
    idle_s = radar.chirp_interval_s - radar.sweep_time_s
    refused = {
        "continuous chirps cannot be written; give chirps_per_frame and frame_interval_s": radar.chirps_per_frame
        is None,
        "transmitters that send at once cannot be written; give multiplexing='tdm'": (
            transmitters > 1 and radar.multiplexing != "tdm"
        ),
        f"a .cfg file is of one chip, of 3 transmitters and 4 receivers, the radar has {transmitters} and {receivers}": (
            transmitters > 3 or receivers > 4
        ),
        f"a chirp needs {1e6 * LEAST_IDLE_S:g} us or more beside its samples, the radar has {1e6 * idle_s:.3g}; lower prf_hz": (
            idle_s < LEAST_IDLE_S
        ),
    }
    for refusal, wrong in refused.items():
        if wrong:
            raise InputError(refusal)
    _warn_of_unwritten(radar)
    before_s, after_s = min(6e-6, idle_s / 3), min(1e-6, idle_s / 6)
    backoff = max(0, round(full_dbm - radar.tx_power_dbm))
    if abs(full_dbm - backoff - radar.tx_power_dbm) > 1e-6:
        warn(
            f"the power of {radar.tx_power_dbm:g} dBm is written as {full_dbm - backoff:g}, whole dB below {full_dbm:g}; give the "
            "board that it is for, as board='iwr6843isk'"
        )
    profile = (
        0, (radar.carrier_hz - radar.slope_hz_per_s * before_s) * 1e-9, (idle_s - before_s - after_s) * 1e6, before_s * 1e6,
        (before_s + radar.sweep_time_s + after_s) * 1e6, sum(backoff << 8 * transmitter for transmitter in range(transmitters)), 0,
        radar.slope_hz_per_s * 1e-12, 1, radar.samples, radar.sample_rate_hz * 1e-3, 0, 0, 30,
    )  # fmt: skip
    platform = [f"% Platform:{name}" for name, preset in BOARDS.items() if preset == board][:1]
    return [
        *platform, "sensorStop", "flushCfg", "dfeDataOutputMode 1",
        f"channelCfg {2**receivers - 1} {2**transmitters - 1} 0", "adcCfg 2 1",
        "adcbufCfg -1 0 1 1 1", f"profileCfg {' '.join(f'{number:.12g}' for number in profile)}",
        *(f"chirpCfg {transmitter} {transmitter} 0 0 0 0 0 {1 << transmitter}" for transmitter in range(transmitters)),
        f"frameCfg 0 {transmitters - 1} {radar.loops_per_frame} 0 {radar.frame_interval_s * 1e3:.12g} 1 0",
        *_geometry_lines(radar), "sensorStart",
    ]  # fmt: skip


def _warn_of_unwritten(radar: Any) -> None:
    """Warns of properties of the radar that the file does not contain, and of a slope that no device has."""
    place = type(radar).model_fields["position_m"].default
    if radar.track is not None or radar.position_m != place or not np.allclose(radar.axes, np.eye(3)):
        warn("place, boresight and track of the radar are not in a .cfg file; give them again where it is read")
    if radar.slope_hz_per_s > STEEPEST_HZ_PER_S:
        warn(
            f"the slope of {radar.slope_hz_per_s * 1e-12:g} MHz/us is written, and devices have "
            f"{STEEPEST_HZ_PER_S * 1e-12:g} at most; no device will take the file"
        )


STEEPEST_HZ_PER_S = 250e12
"""Greatest slope of the 60 GHz devices by mmWaveLink's rlProfileCfg_t [Hz/s]; those at 77 GHz have less."""
LEAST_IDLE_S = 3e-6
"""Time that a device needs in each chirp beside its samples [s]: for the return of the synthesizer and the settling of the
filters."""


def _geometry_lines(radar: Any) -> list[str]:
    """The lines antGeometry0 and 1, if the virtual antennas lie on a grid of about half wavelengths; else a warning."""
    places = 2 * (radar.virtual_offsets_m - radar.virtual_offsets_m[0])
    steps = np.abs(places[np.abs(places) > 1e-6])
    half_m = float(steps.min()) if steps.size else 1.0
    off_grid = np.abs(places / half_m - np.rint(places / half_m)).max()
    if (
        (steps.size and abs(half_m / (radar.wavelength_m / 2) - 1) > 0.1)
        or off_grid > 0.05
        or np.ptp(places[:, 0]) > 1e-6
    ):
        warn("the antennas stand on no grid of half wavelengths, so that antGeometry is left out")
        return []
    across, up = (np.rint(sign * places[:, axis] / half_m).astype(int) for axis, sign in ((1, -1), (2, 1)))
    return [f"antGeometry{axis} {' '.join(map(str, numbers))}" for axis, numbers in ((0, across), (1, up))]
