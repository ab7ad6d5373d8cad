"""`Radar`: waveform, timing, link budget, antennas and pose of one FMCW radar.

IF = transmitted x conj(received): a point at delay tau gives A exp(j 2 pi (f_c tau + S tau t - S tau^2/2)), t from the
first ADC sample. The beat frequency is positive; an approaching target has a negative Doppler frequency and a positive
speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from t2d_rt.core.atomic_write import check_no_folder, replacing
from t2d_rt.core.checks import array, file_path, integer, number, positive, shown, unknown_name
from t2d_rt.core.constants import BOLTZMANN, REFERENCE_TEMPERATURE_K, SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, html_table
from t2d_rt.core.files import read_yaml
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.types.antennas import Isotropic, Pattern, axes_along, one_view, polarization_product
from t2d_rt.types.bandwidth import BANDWIDTHS, with_changes, with_slope
from t2d_rt.types.fields import Count, Decibel, Fields, Number, Vector, Vectors, later
from t2d_rt.types.radar_track import RadarTrack, Rigid, track_named, with_track_beside
from t2d_rt.types.ti_cfg import FULL_DBM, board_of, radar_fields, ti_lines


def preset_names() -> list[str]:
    """Names that `Radar.preset` knows, those of other packages included."""
    packaged = _packaged()
    return sorted([*packaged, *plugins("radars", packaged)])


def preset_fields(name: str) -> dict[str, Any]:
    """Fields of a preset by name, from its packaged YAML file or from another package."""
    packaged, key = _packaged(), str(name).lower().replace("_", "-")
    if key in packaged:
        return read_radar(_preset_folder() / f"{key}.yaml")
    others = plugins("radars", packaged)
    if key not in others:
        raise unknown_name("radar preset", name, sorted([*packaged, *others]), hint=", or give a YAML file")
    preset = loaded(others[key])
    values = preset.model_dump() if hasattr(preset, "model_dump") else preset
    if not isinstance(values, Mapping):
        raise InputError(
            f"the radar {key} of another package must be a Radar or a mapping of its fields, got {shown(preset)}"
        )
    return dict(values)


def _packaged() -> list[str]:
    return [entry.name.removesuffix(".yaml") for entry in _preset_folder().iterdir() if entry.name.endswith(".yaml")]


def _preset_folder() -> Path:
    # The folder is found by its path: importing its package would import the radar stage.
    return Path(str(files("t2d_rt"))) / "radar" / "presets"


def _write(path: str | Path, text: str) -> None:
    """Writes a text file, whole or not at all."""
    target = file_path("path", path).resolve()
    check_no_folder(target)
    with replacing(target, partial(check_no_folder, target)) as new:
        new.write_text(text, encoding="utf-8")


def read_radar(path: str | Path) -> dict[str, Any]:
    """Reads the fields of a radar's YAML file, by name."""
    return read_yaml(path, noun="radar file", example="field names and values such as 'prf_hz: 10240'")


def radar_from(name: str | Path) -> Radar:
    """The radar of a .yaml or .cfg file, or of a preset by name."""
    ending = Path(name).suffix.lower()
    if ending in (".yaml", ".yml"):
        return Radar.from_yaml(name)
    return Radar.from_ti_cfg(Path(name)) if ending == ".cfg" else Radar.preset(str(name))


MOST_CHIRPS = 10**8
"""Greatest number of chirps in a record (three hours of `table2`): their times must fit memory."""
MOST_BINS = 2**26
"""Greatest number of bins of an axis, which must fit memory."""


class Radar(Fields):
    """One FMCW radar; frozen, every field checked, also after `replace`.

    >>> radar = Radar.preset("table2")
    >>> round(radar.range_resolution_m, 4), round(radar.max_speed_mps, 2)
    (0.0864, 9.86)
    """

    model_config = ConfigDict(use_attribute_docstrings=True)  # they are the help of the command line

    if_missing: ClassVar[str] = "give it, or start from a preset such as table2"
    written: ClassVar[dict[str, str]] = dict.fromkeys(
        ("tx_pattern", "rx_pattern"), "a mapping with a kind, as in {kind: cosine, exponent: 2}"
    )

    carrier_hz: Annotated[Number, Field(ge=1e6, le=1e13)]
    """Frequency at the first ADC sample [Hz]."""
    slope_hz_per_s: Annotated[Number, Field(ge=1e6, le=1e18)]
    """Chirp slope S [Hz/s]; 1 MHz/us is 1e12."""
    sample_rate_hz: Annotated[Number, Field(ge=1e3, le=1e11)]
    """Rate of the complex ADC samples [Hz]."""
    samples: Annotated[Count, Field(ge=2, le=1_000_000)]
    """Number of ADC samples per chirp."""
    prf_hz: Annotated[Number, Field(ge=1e-3, le=1e8)]
    """Chirps per second, of all transmitters together [Hz]; with bursts the rate inside a burst."""
    chirps_per_frame: Annotated[Count, Field(ge=1, le=1_000_000)] | None = None
    """Number of chirps in one burst, of all transmitters together; left out for continuous chirps."""
    frame_interval_s: Annotated[Number, Field(gt=0, le=1e6)] | None = None
    """Time from the start of one burst to the start of the next [s]; left out for continuous chirps."""
    tx_power_dbm: Decibel = 12.0
    """Power that each transmitter feeds into its antenna [dBm]."""
    tx_gain_dbi: Decibel = 9.0
    """Peak gain of the transmit antennas [dBi]."""
    rx_gain_dbi: Decibel = 9.0
    """Peak gain of the receive antennas [dBi]."""
    noise_figure_db: Decibel = 15.0
    """Noise figure of the receiver [dB]."""
    if_gain_db: Decibel = 0.0
    """Gain from the receive antenna to the ADC [dB]."""
    position_m: Vector = (0.0, 0.0, 1.0)
    """Position of the radar in the world, x, y and z (up) [m]."""
    boresight: Vector = (1.0, 0.0, 0.0)
    """Direction in the world in which the antennas point, x, y and z (up); a vector of any length."""
    track: Annotated[RadarTrack | None, BeforeValidator(track_named)] = later(None)
    """Poses of a radar that moves: a `RadarTrack` or its file (.csv of t,x,y,z,yaw,pitch,roll, .npz, .yaml); left out, it stands
    still. `position_m` and `boresight` are then those where the track begins."""
    tx_offsets_m: Vectors = ((0.0, 0.0, 0.0),)
    """Positions of the M transmitters in the radar's frame, from `position_m` [m]: x boresight, y left, z up; one will do."""
    rx_offsets_m: Vectors = ((0.0, 0.0, 0.0),)
    """Positions of the N receivers in the radar's frame, from `position_m` [m]: x boresight, y left, z up; one will do."""
    multiplexing: Literal["simultaneous", "tdm", "ddm"] = "simultaneous"
    """How transmitters share the chirps; virtual antenna a = tx * N + rx is one pair.

    "simultaneous": every pair is recorded on each chirp, as by an ideal device. "tdm": transmitter m sends chirps m, m + M, ...; a
    row of the cube is a loop of M chirps. "ddm": all transmitters send on each chirp, the phase of transmitter m advanced by
    2 pi m k / M on chirp k; a row of the cube is a chirp, its antennas are the receivers, and `signal.separate_ddm` separates the
    transmitters.
    """
    tx_pattern: Pattern = Isotropic()
    """Gain of the transmit antennas over direction, relative to their peak `tx_gain_dbi`."""
    rx_pattern: Pattern = Isotropic()
    """Gain of the receive antennas over direction, relative to their peak `rx_gain_dbi`."""
    tx_polarization_deg: Annotated[Number, Field(ge=-360, le=360)] = 0.0
    """Linear polarisation of the transmit antennas [deg]: 0 vertical (the radar's z), 90 horizontal (its y)."""
    rx_polarization_deg: Annotated[Number, Field(ge=-360, le=360)] = 0.0
    """Linear polarisation of the receive antennas [deg]: 0 vertical (the radar's z), 90 horizontal (its y)."""

    @model_validator(mode="before")
    @classmethod
    def _where_track_begins(cls, values: Any) -> Any:
        """Takes position and boresight from the beginning of the track; refuses other ones."""
        if not isinstance(values, Mapping) or values.get("track") is None:
            return values
        track = track_named(values["track"])
        track = track if isinstance(track, RadarTrack) else RadarTrack.model_validate(track)
        return {**values, "track": track, **track.begins(values.get("position_m"), values.get("boresight"))}

    @model_validator(mode="before")
    @classmethod
    def _slope_of_bandwidth(cls, values: Any) -> Any:
        """Computes the slope where a bandwidth is given in its place."""
        return with_slope(dict(values)) if isinstance(values, Mapping) and BANDWIDTHS & values.keys() else values

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        self._check_timing()
        if math.hypot(*self.boresight) < 1e-9:
            raise InputError(f"boresight must be a direction, got {self.boresight}; (1, 0, 0) points along x")
        return self

    def _check_timing(self) -> None:
        """Refuses sweeps longer than the chirp interval, bursts longer than their interval, and bursts that end within a loop."""
        interval = 1 / self.prf_hz
        if self.sweep_time_s > interval * (1 + 1e-9):
            raise InputError(
                f"sampling window of {self.sweep_time_s * 1e6:.6g} us ({self.samples} samples at "
                f"{self.sample_rate_hz:.6g} Hz) is longer than the chirp interval of {interval * 1e6:.6g} us; "
                f"lower prf_hz to {math.floor(1 / self.sweep_time_s * 1e3) / 1e3:.10g} or take fewer samples"
            )
        if (self.chirps_per_frame is None) != (self.frame_interval_s is None):
            raise InputError(
                f"bursts need both chirps_per_frame and frame_interval_s, got {self.chirps_per_frame} and "
                f"{self.frame_interval_s}; give both, or neither for continuous chirps"
            )
        if self.chirps_per_frame is None or self.frame_interval_s is None:
            return
        burst, shared = self.chirps_per_frame * interval, self.sharing_transmitters
        if burst > self.frame_interval_s * (1 + 1e-9):
            raise InputError(
                f"burst of {self.chirps_per_frame} chirps lasts {burst * 1e3:.6g} ms, longer than its frame of "
                f"{self.frame_interval_s * 1e3:.6g} ms; raise frame_interval_s or prf_hz, or take fewer chirps"
            )
        if self.chirps_per_frame % shared:
            raise InputError(
                f"bursts of {self.chirps_per_frame} chirps do not give {shared} transmitters equally many each; set "
                f"chirps_per_frame to a multiple of {shared}"
            )

    def __repr__(self) -> str:
        antennas = f"{len(self.tx_offsets_m)} x {len(self.rx_offsets_m)} antennas"
        return (
            f"Radar({self.carrier_hz / 1e9:.4g} GHz, sweep {self.bandwidth_hz / 1e9:.3g} GHz in {self.samples} samples, PRF "
            f"{self.prf_hz / 1e3:.4g} kHz, {antennas}, range bin {100 * self.range_resolution_m:.3g} cm up to "
            f"{self.max_range_m:.3g} m, +-{self.max_speed_mps:.3g} m/s)"
        )

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        place, ahead = (", ".join(f"{x:.3g}" for x in vector) for vector in (self.position_m, self.boresight))
        chirps = "continuous chirps"
        if self.chirps_per_frame is not None and self.frame_interval_s is not None:
            chirps = f"bursts of {self.chirps_per_frame} chirps every {1e3 * self.frame_interval_s:.4g} ms"
        rows = [
            ("carrier, mid-sweep", f"{self.carrier_hz / 1e9:.4f} GHz, {self.mid_frequency_hz / 1e9:.4f} GHz"),
            ("bandwidth", f"{self.bandwidth_hz / 1e9:.4f} GHz"),
            ("samples", f"{self.samples} at {self.sample_rate_hz / 1e6:.4g} MHz, {self.sweep_time_s * 1e6:.4g} us"),
            ("range bin, farthest range", f"{100 * self.range_resolution_m:.2f} cm, {self.max_range_m:.2f} m"),
            ("PRF", f"{self.prf_hz:.6g} Hz, {chirps}"),
            ("unambiguous speed", f"+-{self.max_speed_mps:.2f} m/s"),
            ("antennas", f"{len(self.tx_offsets_m)} x {len(self.rx_offsets_m)} (tx x rx), {self.multiplexing}"),
            ("power, gains", f"{self.tx_power_dbm:g} dBm, {self.tx_gain_dbi:g} and {self.rx_gain_dbi:g} dBi"),
            ("place, boresight", f"({place}) m, ({ahead})"),
        ]
        return html_table("Radar", rows)

    # --- reading, writing, changing ---

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Radar:
        """A radar by name, e.g. "table2"; '-' and '_' are the same. `changes` override its fields."""
        return cls(**with_changes(preset_fields(name), changes))

    @classmethod
    def from_yaml(cls, path: str | Path) -> Radar:
        """Read a radar from a YAML file of field names and values."""
        return cls.of_file(path, with_track_beside(read_radar(path), path))

    @classmethod
    def from_ti_cfg(cls, source: str | Path | Sequence[str], *, board: str | None = None, **changes: Any) -> Radar:
        """The radar of a configuration file (.cfg) of Texas Instruments' mmWave SDK, or of its lines.

        The file specifies waveform, bursts, order of the transmitters, back-off of the power and, by antGeometry, the antennas;
        `changes` set the other fields, or override these.
        board: preset whose antennas, patterns and noise figure are used, such as "iwr6843isk"; by default the one that the file's
            comment "Platform:..." names.

        Advanced frames, chirps of several kinds and transmitters that send at the same time are errors, as a `Radar` cannot have
        them.
        """
        name = board_of(source) if board is None else board
        board_fields = None if name is None else cls.preset(name).model_dump()
        return cls(**with_changes(radar_fields(source, board_fields), changes))

    def to_ti_cfg(self, path: str | Path | None = None, *, board: str | None = None) -> list[str]:
        """Lines of a configuration file (.cfg) that `from_ti_cfg` reads back, written to `path` where that is given.

        board: preset of the target device, as in `from_ti_cfg`; it is written as the comment "Platform:..." if the visualizer knows
            the device. Back-off is relative to the board's power, or to 12 dBm where no board is given.

        The radar must have bursts, and time multiplexing if it has several transmitters. The file has no gains, patterns, noise
        figure or pose. Warns of a pose other than the default, of a track, and of a slope above the devices' 250 MHz/us; the device
        rounds frequency and slope to its own steps.
        """
        lines = ti_lines(self, board, FULL_DBM if board is None else type(self).preset(board).tx_power_dbm)
        if path is not None:
            _write(path, "\n".join([*lines, ""]))
        return lines

    def to_yaml(self, path: str | Path) -> None:
        """Write all fields to a YAML file that `from_yaml` reads back exactly; it is written whole or not at all."""
        _write(path, self.yaml_text())

    def replace(self, **changes: Any) -> Radar:
        """A copy with some fields changed, checked like a new one."""
        return type(self)(**with_changes(self.model_dump(), changes))

    # --- waveform ---

    @property
    def chirp_interval_s(self) -> float:
        """Time from the start of one chirp to the start of the next [s]."""
        return 1 / self.prf_hz

    @property
    def loop_chirps(self) -> int:
        """Chirps in one row of the cube: M with "tdm", else 1."""
        return len(self.tx_offsets_m) if self.multiplexing == "tdm" else 1

    @property
    def loop_interval_s(self) -> float:
        """Time from the start of one row of the cube to the start of the next [s]: the interval of Doppler sampling."""
        return self.loop_chirps / self.prf_hz

    @property
    def loops_per_frame(self) -> int | None:
        """Rows of the cube in one burst; None for continuous chirps."""
        return None if self.chirps_per_frame is None else self.chirps_per_frame // self.loop_chirps

    @property
    def sharing_transmitters(self) -> int:
        """Number of transmitters that share the chirps, in time (TDM) or in Doppler (DDM); 1 where each pair is recorded on every
        chirp."""
        return 1 if self.multiplexing == "simultaneous" else len(self.tx_offsets_m)

    @property
    def sweep_time_s(self) -> float:
        """Length of the sampling window [s]."""
        return self.samples / self.sample_rate_hz

    @property
    def bandwidth_hz(self) -> float:
        """Bandwidth swept while sampling [Hz]."""
        return self.slope_hz_per_s * self.sweep_time_s

    @property
    def mid_time_s(self) -> float:
        """Time of mid-sweep after the first ADC sample [s]: the mean of `sample_times_s`."""
        return (self.samples - 1) / 2 / self.sample_rate_hz

    @property
    def mid_frequency_hz(self) -> float:
        """Frequency at mid-sweep [Hz]."""
        return self.carrier_hz + self.slope_hz_per_s * self.mid_time_s

    @property
    def wavelength_m(self) -> float:
        """Wavelength at mid-sweep [m], by which Doppler frequency is converted to speed."""
        return SPEED_OF_LIGHT / self.mid_frequency_hz

    @property
    def sample_times_s(self) -> np.ndarray:
        """Times of the ADC samples from the first [s], (samples,)."""
        return np.arange(self.samples) / self.sample_rate_hz

    # --- range and speed ---

    @property
    def range_resolution_m(self) -> float:
        """Range bin c/(2B) [m]."""
        return SPEED_OF_LIGHT / (2 * self.bandwidth_hz)

    @property
    def max_range_m(self) -> float:
        """Range at which the beat frequency reaches the (complex) sample rate [m]; no echo from beyond passes the IF filter."""
        return self.range_resolution_m * self.samples

    @property
    def max_speed_mps(self) -> float:
        """Unambiguous speed lambda PRF / 4 [m/s], approaching or receding; 1/M of that where M transmitters share the chirps."""
        return self.wavelength_m * self.prf_hz / (4 * self.sharing_transmitters)

    def speed_resolution_mps(self, duration_s: float) -> float:
        """Speed bin lambda/(2 T) of a coherent interval of T = `duration_s` [m/s]."""
        duration_s = positive("duration_s", duration_s, unit="s")
        return self.wavelength_m / (2 * duration_s)

    def beat_frequency_hz(self, range_m: float | np.ndarray) -> float | np.ndarray:
        """Beat frequency 2 S R / c of a static target [Hz]."""
        return 2 * self.slope_hz_per_s * array("range_m", range_m, unit="m") / SPEED_OF_LIGHT

    def range_axis_m(self, n_fft: int | None = None, *, speed_mps: float = 0.0) -> np.ndarray:
        """Range of each FFT bin [m], (n_fft,); `speed_mps` corrects for range-Doppler coupling of a target of that speed.

        A target that approaches at speed v appears too close by f v / S (6.7 mm at 4 m/s for table2), f the mid-sweep frequency.
        """
        n_fft = self.samples if n_fft is None else integer("n_fft", n_fft, 1, MOST_BINS)
        speed_mps = number("speed_mps", speed_mps, unit="m/s")
        coupling = self.mid_frequency_hz * speed_mps / self.slope_hz_per_s
        return np.arange(n_fft) * (self.max_range_m / n_fft) + coupling

    def speed_axis_mps(self, n_fft: int) -> np.ndarray:
        """Speed of each Doppler bin [m/s], (n_fft,), ascending, positive = approaching: v = -lambda f_D / 2.

        The Doppler FFT runs over the rows of the cube; before a "ddm" cube is separated the axis spans +-lambda PRF / 4.
        """
        n_fft = integer("n_fft", n_fft, 1, MOST_BINS)
        doppler_hz = np.fft.fftshift(np.fft.fftfreq(n_fft, self.loop_interval_s))
        return -self.wavelength_m / 2 * doppler_hz[::-1]

    # --- timing ---

    def chirp_starts_s(self, chirps: int) -> np.ndarray:
        """Times of the first ADC samples of the first `chirps` rows of the cube [s], (chirps,); with "tdm" a row is a loop."""
        chirp = np.arange(integer("chirps", chirps, 0, MOST_CHIRPS, hint="cut the record"))
        if self.loops_per_frame is None or self.frame_interval_s is None:
            return chirp * self.loop_chirps / self.prf_hz
        frame, within = np.divmod(chirp, self.loops_per_frame)
        return frame * self.frame_interval_s + within * self.loop_chirps / self.prf_hz

    def chirp_times_s(self, duration_s: float) -> np.ndarray:
        """Times of the first ADC samples of all rows of the cube whose samples lie within `duration_s` [s], (chirps,). Only whole
        loops of the transmitters and whole bursts count."""
        duration_s = positive("duration_s", duration_s, unit="s")
        window = (self.samples - 1) / self.sample_rate_hz
        group, name = self.sharing_transmitters, "chirp" if self.sharing_transmitters == 1 else "loop"
        period = group / self.prf_hz
        if self.chirps_per_frame is not None and self.frame_interval_s is not None:
            group, name, period = self.chirps_per_frame, "burst", self.frame_interval_s
        last = window + (group - 1) * self.chirp_interval_s  # last sample, after the group's start
        # The slack keeps a chirp that ends with the record but for rounding.
        groups = math.floor((duration_s - last) / period + 1e-9) + 1
        if groups < 1:
            raise InputError(f"duration of {duration_s:.6g} s holds no whole {name}; it must be at least {last:.6g} s")
        return self.chirp_starts_s(groups * group // self.loop_chirps)

    # --- link budget ---

    @property
    def link_amplitude(self) -> float:
        """Constant of the link budget [sqrt(W) m], sqrt(Pt Gt Gr Gif lambda^2 / (4 pi)^3): the received amplitude is
        `link_amplitude` sqrt(sigma) / (R_tx R_rx)."""
        level_dbm = self.tx_power_dbm + self.tx_gain_dbi + self.rx_gain_dbi + self.if_gain_db
        return math.sqrt(10 ** ((level_dbm - 30) / 10) / (4 * math.pi) ** 3) * self.wavelength_m

    def received_power_w(
        self, rcs_m2: float | np.ndarray, range_m: float | np.ndarray, rx_range_m: float | np.ndarray | None = None
    ) -> float | np.ndarray:
        """Power at the ADC [W] by the radar equation (Skolnik); `rx_range_m` where the receiver has another distance from the
        target."""
        rx_range_m = range_m if rx_range_m is None else rx_range_m
        there, back = array("range_m", range_m, unit="m"), array("rx_range_m", rx_range_m, unit="m")
        for name, distance_m, argument in (("range_m", there, range_m), ("rx_range_m", back, rx_range_m)):
            if not (distance_m > 0).all():
                raise InputError(f"{name} must be positive, got {shown(argument)}")
        area = array("rcs_m2", rcs_m2, unit="m2")
        if (area < 0).any():
            raise InputError(f"rcs_m2 must not be negative, got {shown(rcs_m2)}")
        return self.link_amplitude**2 * area / (there * back) ** 2

    @property
    def noise_power_w(self) -> float:
        """Thermal noise power of one complex ADC sample [W]: k T0 F B Gif, B the sample rate."""
        gain = 10 ** ((self.noise_figure_db + self.if_gain_db) / 10)
        return BOLTZMANN * REFERENCE_TEMPERATURE_K * self.sample_rate_hz * gain

    # --- pose ---

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors boresight, left and up of the radar in the world, as rows of (3, 3)."""
        return axes_along(self.boresight).copy()

    def passing(self, times_s: np.ndarray) -> Rigid:
        """Rigid motion from the world's coordinates, at times [s] (K,), to the frame in which a moving radar keeps its position and
        axes."""
        if self.track is None:
            raise ValueError("the radar stands still")
        position_m, axes = np.array(self.position_m), self.track.axes(times_s)
        places = self.track.places_m(times_s)
        rotation = np.broadcast_to(np.eye(3), (len(places), 3, 3)) if axes is None else self.axes.T @ axes
        return Rigid(rotation, position_m - np.einsum("kij,kj->ki", rotation, places))

    @property
    def tx_positions_m(self) -> np.ndarray:
        """Positions of the transmitters in the world [m], (M, 3)."""
        return np.array(self.position_m) + np.array(self.tx_offsets_m) @ self.axes

    @property
    def rx_positions_m(self) -> np.ndarray:
        """Positions of the receivers in the world [m], (N, 3)."""
        return np.array(self.position_m) + np.array(self.rx_offsets_m) @ self.axes

    @property
    def tx_position_m(self) -> np.ndarray:
        """Centre of the transmitters in the world [m], (3,)."""
        return self.tx_positions_m.mean(axis=0)

    @property
    def rx_position_m(self) -> np.ndarray:
        """Centre of the receivers in the world [m], (3,)."""
        return self.rx_positions_m.mean(axis=0)

    @property
    def views_m(self) -> list[np.ndarray]:
        """Positions in the world from which visibility is sampled [m], (3,) each: the centres of the transmitters and of the
        receivers, or the midpoint between them where they are within `ONE_VIEW_M`. Delays always use the true positions."""
        return one_view(self.tx_position_m, self.rx_position_m)

    # --- antennas ---

    @property
    def antennas(self) -> int:
        """Length of the cube's antenna axis: M N, with "ddm" N."""
        receivers = len(self.rx_offsets_m)
        return receivers if self.multiplexing == "ddm" else len(self.tx_offsets_m) * receivers

    @property
    def outermost(self) -> list[tuple[int, int]]:
        """Pairs (transmitter, receiver) of the antennas that lie farthest out along each axis, in both directions."""
        tx, rx = np.array(self.tx_offsets_m), np.array(self.rx_offsets_m)
        ends = {(int(np.argmax(tx @ axis)), int(np.argmax(rx @ axis))) for axis in (*np.eye(3), *-np.eye(3))}
        return sorted(ends)

    @property
    def antenna_delays_s(self) -> np.ndarray:
        """Start of each antenna's chirp after the start of its row of the cube [s], (antennas,): m / PRF with "tdm", else 0."""
        if self.multiplexing != "tdm":
            return np.zeros(self.antennas)
        return np.repeat(np.arange(len(self.tx_offsets_m)) / self.prf_hz, len(self.rx_offsets_m))

    def tx_phase(self, chirps: np.ndarray) -> np.ndarray:
        """Phase factor of each transmitter's echoes at IF in the chirps of the given numbers, complex (chirp, M).

        exp(-j 2 pi m k / M) with "ddm", minus because IF conjugates the received wave; else 1.
        """
        transmitters = len(self.tx_offsets_m)
        # Remainders keep whole cycles out, so that no digits are lost however long the record is.
        step = np.outer(chirps, np.arange(transmitters)) % transmitters * (self.multiplexing == "ddm")
        return np.exp(-2j * np.pi / transmitters * step)

    @property
    def virtual_offsets_m(self) -> np.ndarray:
        """Positions of the virtual antennas relative to `position_m` in the radar's frame [m], (M N, 3): midpoints of transmitter
        and receiver.

        In the far field a pair records the same phase as one antenna at the midpoint that transmits and receives.
        """
        pairs = np.array(self.tx_offsets_m)[:, None] + np.array(self.rx_offsets_m)
        return pairs.reshape(-1, 3) / 2

    @property
    def virtual_positions_m(self) -> np.ndarray:
        """Positions of the virtual antennas in the world [m], (M N, 3)."""
        return np.array(self.position_m) + self.virtual_offsets_m @ self.axes

    @property
    def separated(self) -> Radar:
        """The radar that a cube from `signal.separate_ddm` belongs to: it records every pair on each chirp, at PRF / M."""
        if self.multiplexing != "ddm":
            return self
        shared = self.sharing_transmitters
        chirps = None if self.chirps_per_frame is None else self.chirps_per_frame // shared
        return self.replace(multiplexing="simultaneous", prf_hz=self.prf_hz / shared, chirps_per_frame=chirps)

    @property
    def is_array(self) -> bool:
        """Whether there are several transmitters or receivers."""
        return len(self.tx_offsets_m) * len(self.rx_offsets_m) > 1

    @property
    def directional(self) -> bool:
        """Whether `antenna_factor` differs from 1 in any direction."""
        isotropic = all(isinstance(pattern, Isotropic) for pattern in (self.tx_pattern, self.rx_pattern))
        return not isotropic or self.tx_polarization_deg != self.rx_polarization_deg

    def antenna_factor(self, departure: np.ndarray, arrival: np.ndarray) -> np.ndarray:
        """Factor on the amplitude by antenna patterns and polarisation, real (...), 1 for the defaults: sqrt(G_t G_r / peaks) p
        (eq. 17).

        `departure` and `arrival` are unit vectors (..., 3) in the world from transmitter and receiver to the target.
        """
        departure, arrival = (np.asarray(direction) @ self.axes.T for direction in (departure, arrival))
        polarization = polarization_product(
            departure, arrival, math.radians(self.tx_polarization_deg), math.radians(self.rx_polarization_deg)
        )
        return np.sqrt(self.tx_pattern.gain(departure) * self.rx_pattern.gain(arrival)) * polarization
