"""Frozen values that are passed between the stages: motion, mesh, ellipsoids, radar, paths, scene, accuracy, echoes, scatterers."""

from t2d_rt.core.calls import public
from t2d_rt.types.accuracy import Accuracy, PathTier
from t2d_rt.types.carried import Carried
from t2d_rt.types.echoes import EchoArrays, Echoes
from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.material import PEC, ByPart, Material
from t2d_rt.types.mesh import MovingMesh
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, OPTIONAL_JOINTS, Breathing, Heartbeat, Motion
from t2d_rt.types.paths import OneWayPath, PathPair, PathSet, StaticPath
from t2d_rt.types.radar import Radar
from t2d_rt.types.radar_track import RadarTrack
from t2d_rt.types.receiver import Receiver
from t2d_rt.types.scatterer import EchoStream, stream
from t2d_rt.types.scene import Scene, Surface

__all__ = [
    "CANONICAL_JOINTS", "CANONICAL_PARENTS", "OPTIONAL_JOINTS", "PEC", "Accuracy", "Breathing", "ByPart", "Carried",
    "EchoArrays", "EchoStream", "Echoes", "Ellipsoids", "Heartbeat", "Material", "Motion", "MovingMesh", "OneWayPath",
    "PathPair", "PathSet", "PathTier", "Radar", "RadarTrack", "Receiver", "Scene", "StaticPath", "Surface", "stream",
]  # fmt: skip

for _each in __all__:
    if isinstance(globals()[_each], type):
        public(globals()[_each])
