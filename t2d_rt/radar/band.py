"""The IF filter: what of the echoes lies in the band of the range axis."""

from __future__ import annotations

import numpy as np

from t2d_rt.types import EchoArrays, Radar


def filtered(echoes: EchoArrays, radar: Radar) -> EchoArrays:
    """Echoes behind the IF filter, ideal from 0 to the sample rate: those whose beat frequency S tau lies beyond are silent.

    The filter falls over the last range bin, so that echoes that move out of range fade, as they leave bin after bin.
    """
    last_s = radar.sample_rate_hz / radar.slope_hz_per_s
    if not echoes.delay_s.size or echoes.delay_s.max() <= last_s - 1 / radar.bandwidth_hz:
        return echoes
    gain = np.clip((last_s - echoes.delay_s) * radar.bandwidth_hz, 0, 1).astype(np.float32)
    slope = None if echoes.slope is None else echoes.slope * gain
    return echoes._replace(amplitude=echoes.amplitude * gain, slope=slope)
