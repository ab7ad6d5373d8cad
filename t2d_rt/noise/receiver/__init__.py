"""What a real receiver adds to ADC samples: noise, phase noise, interference, imbalance, quantisation (docs/noise.md)."""

from t2d_rt.noise.receiver.chain import check_receiver, receive

__all__ = ["check_receiver", "receive"]
