"""Make motions of which no clip ships: sitting, standing up, lying down, bending, squatting, stretching, climbing stairs.

They are made of key poses with contacts: what each part of the body is to do, and when, is written into an `Act`, and rendered
on a skeleton with planted feet, balance and inverse kinematics. Every performance draws its own posture, pace, hands and noise.
"""

from t2d_rt.motion.generate.made.act import Posture
from t2d_rt.motion.generate.made.make import MADE, RESTS, MadeMotion, make

__all__ = ["MADE", "RESTS", "MadeMotion", "Posture", "make"]
