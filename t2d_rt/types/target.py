"""`Target`: what the model asks of anything that stands before the radar."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.material import ByPart, Material
from t2d_rt.types.mesh import MovingMesh

Geometry = MovingMesh | Ellipsoids
Method = Literal["mesh", "ellipsoid"]


class Target(Protocol):
    """A body, a mesh or ellipsoids of the user, or a mover, made ready for one way of modelling it."""

    @property
    def source(self) -> Any:
        """What was handed to `simulate`, a motion in its place before the radar."""

    @property
    def geometry(self) -> Geometry:
        """Its points in motion."""

    @property
    def mesh(self) -> MovingMesh | None:
        """The surface whose facets scatter; None where ellipsoids do."""

    @property
    def material(self) -> str | Material | ByPart:
        """What its surface is made of."""

    @property
    def may_rotate_fast(self) -> bool:
        """Whether it may rotate too fast for its visibility to be sampled point by point."""

    def ellipsoids(self) -> Ellipsoids | None:
        """Its coarse form; None where it has none."""

    def by(self, method: Method) -> Target:
        """The same, modelled by another method."""
