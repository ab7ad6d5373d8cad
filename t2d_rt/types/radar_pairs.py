"""Pairs of radars: a bistatic radar made of two, and the interference that one radar causes at another."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.core.checks import instance
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.types.antennas import Isotropic
from t2d_rt.types.radar import Radar
from t2d_rt.types.receiver import Interferer

WAVEFORM = "carrier_hz", "slope_hz_per_s", "sample_rate_hz", "samples", "prf_hz", "chirps_per_frame", "frame_interval_s"
"""Fields that the transmitting and the receiving radar must have in common."""
SAME_AXES = 1e-9


def bistatic(transmitter: Radar, receiver: Radar) -> Radar:
    """The bistatic radar whose echoes go from the transmitters of one radar to the receivers of another; both must have the same
    waveform and one clock.

    Its position and axes are the receiver's. Refused are directional transmitters that point elsewhere, which cannot be described
    in these axes, and radars that move.
    """
    for name, radar in (("transmitter", transmitter), ("receiver", receiver)):
        instance(name, radar, Radar, "a Radar", hint="Radar.preset gives one by its name")
    for name in WAVEFORM:
        sent, received = getattr(transmitter, name), getattr(receiver, name)
        if sent != received:
            raise InputError(
                f"a receiver mixes echoes with its own chirp: {name} of the transmitter is {sent} and of the receiver {received}; "
                "give both the same"
            )
    if transmitter.track is not None or receiver.track is not None:
        raise InputError(
            "transmitter and receiver of a pair must stand still, got one with a track; leave the track out"
        )
    alike = np.abs(transmitter.axes - receiver.axes).max() < SAME_AXES
    upright = np.abs(transmitter.axes[2] - receiver.axes[2]).max() < SAME_AXES and not transmitter.tx_polarization_deg
    if not alike and not (upright and isinstance(transmitter.tx_pattern, Isotropic)):
        raise InputError(
            "a pair has the axes of its receiver, in which a transmitter that looks elsewhere must be isotropic and upright; give "
            f"both the boresight {receiver.boresight}"
        )
    places = (transmitter.tx_positions_m - np.array(receiver.position_m)) @ receiver.axes.T
    sending = {
        name: getattr(transmitter, name) for name in ("tx_power_dbm", "tx_gain_dbi", "tx_pattern", "multiplexing")
    }
    return receiver.replace(
        **sending, tx_offsets_m=places.tolist(), tx_polarization_deg=transmitter.tx_polarization_deg if alike else 0.0
    )


def heard(other: Radar, radar: Radar, later_s: float | None = None) -> Interferer:
    """The interferer that another radar is to `radar` over the line of sight: its position, its chirps, and its power in that
    direction.

    later_s: by how much later than this radar's its first sweep begins [s]; by default the start is drawn at random.

    Both must stand still, and the other one must chirp without pauses. Where all transmitters send on each chirp, their powers add
    up.
    """
    if other.track is not None or radar.track is not None:
        raise InputError("radars hear one another where both stand still; leave the track out, or interference")
    if other.chirps_per_frame is not None:
        raise InputError(
            "a radar is heard as one that chirps without pauses, got bursts; leave chirps_per_frame and frame_interval_s out"
        )
    ahead = radar.rx_position_m - other.tx_position_m
    range_m = float(np.linalg.norm(ahead))
    if not range_m > 0:
        raise InputError(
            f"two radars are in one place, {other.position_m} m; move one of them, or leave out interference"
        )
    gain = float(other.tx_pattern.gain(ahead / range_m @ other.axes.T))
    at_once = 1 if other.multiplexing == "tdm" else len(other.tx_offsets_m)
    return Interferer(
        position_m=tuple(other.tx_position_m.tolist()),
        carrier_hz=other.carrier_hz,
        slope_hz_per_s=other.slope_hz_per_s,
        duration_s=other.sweep_time_s,
        interval_s=other.chirp_interval_s,
        eirp_dbm=other.tx_power_dbm + other.tx_gain_dbi + 10 * math.log10(max(gain * at_once, 1e-15)),
        first_s=None if later_s is None else later_s + range_m / SPEED_OF_LIGHT,
    )
