"""What an interpreter prints of a radar, and what a notebook shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from t2d_rt.types.radar import Radar


def one_line(radar: Radar) -> str:
    """Carrier, sweep, rates and limits on one line."""
    antennas = f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} antennas"
    return (
        f"Radar({radar.carrier_hz / 1e9:.4g} GHz, sweep {radar.bandwidth_hz / 1e9:.3g} GHz in {radar.samples} samples, PRF "
        f"{radar.prf_hz / 1e3:.4g} kHz, {antennas}, range bin {100 * radar.range_resolution_m:.3g} cm up to "
        f"{radar.max_range_m:.3g} m, +-{radar.max_speed_mps:.3g} m/s)"
    )


def described(radar: Radar) -> list[tuple[str, str]]:
    """Names and texts of its main figures."""
    place, ahead = (", ".join(f"{x:.3g}" for x in vector) for vector in (radar.position_m, radar.boresight))
    chirps = "continuous chirps"
    if radar.chirps_per_frame is not None and radar.frame_interval_s is not None:
        chirps = f"bursts of {radar.chirps_per_frame} chirps every {1e3 * radar.frame_interval_s:.4g} ms"
    return [
        ("carrier, mid-sweep", f"{radar.carrier_hz / 1e9:.4f} GHz, {radar.mid_frequency_hz / 1e9:.4f} GHz"),
        ("bandwidth", f"{radar.bandwidth_hz / 1e9:.4f} GHz"),
        ("samples", f"{radar.samples} at {radar.sample_rate_hz / 1e6:.4g} MHz, {radar.sweep_time_s * 1e6:.4g} us"),
        ("range bin, farthest range", f"{100 * radar.range_resolution_m:.2f} cm, {radar.max_range_m:.2f} m"),
        ("PRF", f"{radar.prf_hz:.6g} Hz, {chirps}"),
        ("unambiguous speed", f"+-{radar.max_speed_mps:.2f} m/s"),
        ("antennas", f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} (tx x rx), {radar.multiplexing}"),
        ("power, gains", f"{radar.tx_power_dbm:g} dBm, {radar.tx_gain_dbi:g} and {radar.rx_gain_dbi:g} dBi"),
        ("place, boresight", f"({place}) m, ({ahead})"),
    ]
