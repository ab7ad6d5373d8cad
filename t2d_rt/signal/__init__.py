"""From ADC samples to range profiles, spectrograms and range-Doppler maps, of simulated and measured cubes alike.

Cubes are (chirp, antenna, sample), or (chirp, sample) for one antenna. Levels are calibrated: a steady target of power
P reads P in its peak cell.
"""

from t2d_rt.core.calls import public
from t2d_rt.signal.angle import array_spectrum, range_angle, steering_vectors, unit_vectors
from t2d_rt.signal.detection import Detection, sensor, sensors
from t2d_rt.signal.device import device_points
from t2d_rt.signal.doppler import range_doppler, spectrogram, stft
from t2d_rt.signal.maps import ArraySpectrum, PointCloud, RangeAngle, RangeDoppler, RangeProfile, RangeTime, Spectrogram
from t2d_rt.signal.measured import load_cube
from t2d_rt.signal.mti import mti
from t2d_rt.signal.multiplex import separate_ddm
from t2d_rt.signal.points import cfar, cfar_factor, point_cloud
from t2d_rt.signal.range import gate, range_fft, range_profile, taper
from t2d_rt.signal.range_time import coherent_interval, range_doppler_over, range_time
from t2d_rt.signal.vital import VitalSigns, vital_signs

__all__ = [
    "ArraySpectrum", "Detection", "PointCloud", "RangeAngle", "RangeDoppler", "RangeProfile", "RangeTime", "Spectrogram",
    "VitalSigns", "array_spectrum", "cfar", "cfar_factor", "coherent_interval", "device_points", "gate", "load_cube", "mti",
    "point_cloud", "range_angle", "range_doppler", "range_doppler_over", "range_fft", "range_profile", "range_time", "sensor",
    "sensors", "separate_ddm", "spectrogram", "steering_vectors", "stft", "taper", "unit_vectors", "vital_signs",
]  # fmt: skip

globals().update({name: public(globals()[name]) for name in __all__})
