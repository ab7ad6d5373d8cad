"""From ADC samples to range profiles, spectrograms and range-Doppler maps; simulated and recorded cubes go the same
way.

Cubes are (chirp, antenna, sample), or (chirp, sample) for one antenna. Levels are calibrated: a steady target of power
P reads P in its peak cell.
"""

from t2d_rt.signal.doppler import range_doppler, spectrogram, stft
from t2d_rt.signal.maps import RangeDoppler, RangeProfile, Spectrogram
from t2d_rt.signal.mti import mti
from t2d_rt.signal.range import gate, range_fft, range_profile, taper
from t2d_rt.signal.recording import load_recording

__all__ = [
    "RangeDoppler",
    "RangeProfile",
    "Spectrogram",
    "gate",
    "load_recording",
    "mti",
    "range_doppler",
    "range_fft",
    "range_profile",
    "spectrogram",
    "stft",
    "taper",
]
