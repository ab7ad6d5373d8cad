"""`Receiver`: what a real receiver adds to the ADC samples, each effect by its own value; None leaves it out (docs/noise.md)."""

from __future__ import annotations

import math
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, field_validator, model_validator

from t2d_rt.core.constants import BOLTZMANN, REFERENCE_TEMPERATURE_K
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.types.fields import Count, Decibel, Fields, Number, Vector, later
from t2d_rt.types.radar import Radar

Offset = Annotated[Number, Field(gt=0, le=1e11)]
Density = Annotated[Number, Field(ge=-300, le=0)]
BANDS = {"24ghz": (22e9, 29e9), "60ghz": (56e9, 71e9), "77ghz": (75e9, 82e9)}
"""Ranges of the carrier [Hz] for which values of a receiver are shipped, by the name of their file."""


class _Part(Fields):
    model_config = ConfigDict(use_attribute_docstrings=True)
    noun: ClassVar[str] = "receiver"


class Mask(_Part):
    """Phase noise by a mask: straight lines between its points over the logarithm of the offset, constant beyond the ends."""

    noun: ClassVar[str] = "phase-noise mask"

    kind: Literal["mask"] = "mask"
    points: Annotated[tuple[tuple[Offset, Density], ...], Field(min_length=1, max_length=1000)]
    """Offsets from the carrier [Hz], rising, and the level L at each of them [dBc/Hz]."""

    @field_validator("points")
    @classmethod
    def _rising(cls, points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for (before, _), (after, _) in pairwise(points):
            if not after > before:
                raise InputError(
                    f"offsets of a phase-noise mask must rise, got {after:g} Hz after {before:g} Hz; sort its points"
                )
        return points

    def density(self, offset_hz: np.ndarray) -> np.ndarray:
        """Phase noise L(f), a power density relative to the carrier [1/Hz], at offsets of any sign."""
        offsets, levels = np.array(self.points).T
        place = np.log10(np.maximum(np.abs(offset_hz), 1e-300))
        return np.asarray(10 ** (np.interp(place, np.log10(offsets), levels) / 10))


class Leeson(_Part):
    """Phase noise by Leeson's model: L(f) = floor (1 + (half bandwidth / f)^2) (1 + flicker corner / f) (Leeson 1966)."""

    noun: ClassVar[str] = "Leeson model"

    kind: Literal["leeson"] = "leeson"
    floor_dbc_hz: Density
    """Level far from the carrier [dBc/Hz]."""
    half_bandwidth_hz: Offset
    """Half the bandwidth of the resonator, f0 / 2Q [Hz]."""
    flicker_hz: Annotated[Number, Field(ge=0, le=1e11)] = 0.0
    """Corner of the oscillator's flicker noise [Hz]."""

    def density(self, offset_hz: np.ndarray) -> np.ndarray:
        """Phase noise L(f), a power density relative to the carrier [1/Hz], at offsets of any sign but 0."""
        offset = np.maximum(np.abs(offset_hz), 1e-9)
        shaped = (1 + (self.half_bandwidth_hz / offset) ** 2) * (1 + self.flicker_hz / offset)
        return np.asarray(10 ** (self.floor_dbc_hz / 10) * shaped)


class IqImbalance(_Part):
    """Difference between the I and the Q channel, which adds a conjugate image to the samples."""

    noun: ClassVar[str] = "receiver's IQ imbalance"

    gain_db: Annotated[Number, Field(ge=-20, le=20)] = 0.0
    """Gain of the Q channel relative to I [dB]."""
    phase_deg: Annotated[Number, Field(ge=-80, le=80)] = 0.0
    """Deviation of the phase between I and Q from 90 degrees [deg]."""

    @property
    def coefficients(self) -> tuple[complex, complex]:
        """Factors of the sample and of its conjugate: (1 + g e^-jp) / 2 and (1 - g e^jp) / 2."""
        factor = 10 ** (self.gain_db / 20) * np.exp(1j * math.radians(self.phase_deg))
        return complex((1 + np.conj(factor)) / 2), complex((1 - factor) / 2)

    @property
    def image_rejection_db(self) -> float:
        """Power of a signal relative to that of its image [dB]."""
        direct, image = self.coefficients
        return 20 * math.log10(abs(direct) / abs(image)) if image else math.inf


class Adc(_Part):
    """Two analog-to-digital converters, for I and Q, that round to two's complement and saturate at full scale."""

    noun: ClassVar[str] = "receiver's ADC"

    bits: Annotated[Count, Field(ge=2, le=20)]
    """Resolution of each converter [bits]."""
    full_scale_dbm: Annotated[Number, Field(ge=-150, le=100)]
    """Power of a complex tone whose I and Q just reach full scale, at the converters [dBm]."""
    gain_db: Annotated[Number, Field(ge=0, le=150)] = 0.0
    """Gain before the converters beyond `Radar.if_gain_db` [dB]; the samples are given without it."""

    @property
    def full_scale_w(self) -> float:
        """Power [W] of such a full-scale tone as it appears in the samples, which are given without `gain_db`."""
        return float(10 ** ((self.full_scale_dbm - self.gain_db - 30) / 10))

    @property
    def step(self) -> float:
        """Least significant bit [sqrt(W)] as it appears in the samples."""
        return float(2 * math.sqrt(self.full_scale_w) / 2**self.bits)

    @property
    def noise_power_w(self) -> float:
        """Quantisation noise of one complex sample [W]: step^2 / 12 in each of I and Q."""
        return self.step**2 / 6


class Interferer(_Part):
    """Another FMCW radar in line of sight whose antenna points at this one."""

    noun: ClassVar[str] = "interferer"

    position_m: Vector
    """Position of the interferer in the world [m]."""
    carrier_hz: Annotated[Number, Field(ge=1e6, le=1e13)]
    """Frequency at the start of its chirps [Hz]."""
    slope_hz_per_s: Annotated[Number, Field(ge=-1e18, le=1e18)]
    """Slope of its chirps, negative for falling ones [Hz/s]."""
    duration_s: Annotated[Number, Field(ge=1e-6, le=1e3)]
    """Length of its chirps [s]."""
    interval_s: Annotated[Number, Field(ge=1e-6, le=1e3)]
    """Time from the start of one of its chirps to the start of the next [s]."""
    eirp_dbm: Decibel = 21.0
    """Transmitted power times antenna gain [dBm]."""
    first_s: Annotated[Number, Field(ge=-1e3, le=1e3)] | None = later(None)
    """When its first chirp arrives, on the clock of the radar that hears it [s].

    By default it chirps all the time, and the start of its chirps is drawn at random.
    """

    @model_validator(mode="after")
    def _check_interval(self) -> Self:
        if self.interval_s < self.duration_s:
            raise InputError(
                f"interferer's chirps of {self.duration_s:g} s are longer than their interval of {self.interval_s:g} s; raise "
                "interval_s or lower duration_s"
            )
        return self


class Receiver(_Part):
    """What a receiver adds to the ADC samples; None leaves an effect out. Without arguments it is thermal noise alone.

    >>> Receiver(adc={"bits": 12, "full_scale_dbm": 9, "gain_db": 30}).adc.bits
    12
    """

    written: ClassVar[dict[str, str]] = {
        "phase_noise": "a mapping with a kind, as in {kind: mask, points: [[1e5, -85], [1e6, -93]]}",
        "iq_imbalance": "a mapping, as in {gain_db: 0.3, phase_deg: 2}",
        "adc": "a mapping, as in {bits: 12, full_scale_dbm: 9, gain_db: 30}",
        "interferers": "a list of mappings, as in [{position_m: [20, 3, 1], carrier_hz: 77e9, ...}]",
    }

    temperature_k: Annotated[Number, Field(gt=0, le=1e6)] | None = REFERENCE_TEMPERATURE_K
    """Noise temperature that the antenna sees [K], for thermal noise with the radar's `noise_figure_db`."""
    flicker_corner_hz: Annotated[Number, Field(gt=0, le=1e9)] | None = None
    """Intermediate frequency at which 1/f noise is as strong as thermal noise [Hz]."""
    phase_noise: Annotated[Mask | Leeson, Discriminator("kind")] | None = None
    """Phase noise of the oscillator, which transmitter and receiver share: a mask or Leeson's model."""
    interferers: Annotated[tuple[Interferer, ...], Field(max_length=100)] = ()
    """Other FMCW radars that interfere."""
    iq_imbalance: IqImbalance | None = None
    """Difference between I and Q."""
    dc_offset_dbm: Decibel | None = None
    """Power of a constant offset in all samples of a receive channel [dBm]; its phase is drawn for each channel."""
    adc: Adc | None = None
    """Quantisation and saturation."""
    seed: Annotated[Count, Field(ge=0)] | None = None
    """Seed of all random draws; that of the experiment by default."""

    @classmethod
    def preset(cls, radar: Radar) -> Receiver:
        """The shipped values for the band of a radar (24, 60 or 77 GHz)."""
        for name, (low, high) in BANDS.items():
            if low <= radar.mid_frequency_hz <= high:
                # By path, not as a package: data of the noise stage, none of its code.
                return _shipped(Path(str(files("t2d_rt"))) / "noise" / "receiver" / "presets" / f"{name}.yaml")
        bands = ", ".join(f"{low / 1e9:g} to {high / 1e9:g}" for low, high in BANDS.values())
        raise InputError(
            f"no receiver is shipped for {radar.mid_frequency_hz / 1e9:.4g} GHz (there are those for {bands} GHz); give its "
            "values as a mapping, a YAML file or a Receiver"
        )

    @classmethod
    def from_yaml(cls, path: str | Path) -> Receiver:
        """A receiver from a YAML file of field names and values."""
        example = "field names and values such as 'flicker_corner_hz: 20e3'"
        return cls.of_file(path, read_yaml(path, noun="receiver file", example=example))

    def to_yaml(self) -> str:
        """Text that `from_yaml` reads back as the same."""
        return self.yaml_text()

    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed, checked like a new one."""
        return type(self)(**{**self.model_dump(), **changes})

    def thermal_power_w(self, radar: Radar) -> float:
        """Thermal noise of one complex sample [W] (eq. 32): k B (T + (F - 1) 290 K) Gif, B the sample rate."""
        if self.temperature_k is None:
            return 0.0
        return self._density_w(radar, self.temperature_k) * radar.sample_rate_hz

    def flicker_density_w(self, radar: Radar) -> float:
        """Density [W/Hz] of thermal noise, which flicker noise has at its corner frequency; that of 290 K where thermal noise is
        left out."""
        return self._density_w(radar, self.temperature_k or REFERENCE_TEMPERATURE_K)

    def _density_w(self, radar: Radar, temperature_k: float) -> float:
        """Noise density of the receiver k (T + (F - 1) 290 K) Gif at a noise temperature T of the antenna [W/Hz]."""
        if radar.noise_figure_db < 0:
            raise InputError(
                f"noise_figure_db of a receiver with noise must be 0 or more, got {radar.noise_figure_db:g}; correct the radar"
            )
        factor = 10 ** (radar.noise_figure_db / 10)
        noise_k = temperature_k + (factor - 1) * REFERENCE_TEMPERATURE_K
        return float(BOLTZMANN * noise_k * 10 ** (radar.if_gain_db / 10))

    def noise_floor_w(self, radar: Radar) -> float:
        """Power of white additive noise of one complex sample [W]: the sum of thermal and quantisation noise, as far as they are
        on."""
        return self.thermal_power_w(radar) + (self.adc.noise_power_w if self.adc else 0.0)

    @property
    def effects(self) -> list[str]:
        """Names of the effects that are on."""
        on = {
            "thermal noise": self.temperature_k,
            "1/f noise": self.flicker_corner_hz,
            "phase noise": self.phase_noise,
            "interference": self.interferers or None,
            "IQ imbalance": self.iq_imbalance,
            "DC offset": self.dc_offset_dbm,
            "ADC": self.adc,
        }
        return [name for name, value in on.items() if value is not None]


@cache
def _shipped(path: Path) -> Receiver:
    return Receiver.from_yaml(path)
