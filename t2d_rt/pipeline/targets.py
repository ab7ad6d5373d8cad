"""Targets as the model asks for them (`types.Target`): bodies, meshes and ellipsoids of the user, movers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from t2d_rt.body import segments as fit_segments
from t2d_rt.body import skin as skin_body
from t2d_rt.core.errors import InputError
from t2d_rt.motion import place, track
from t2d_rt.scene import Mover
from t2d_rt.types import Ellipsoids, Material, Motion, MovingMesh, Radar
from t2d_rt.types.material import checked_material
from t2d_rt.types.mesh import Made
from t2d_rt.types.target import Geometry, Method, Target

TargetLike = Motion | MovingMesh | Ellipsoids | Mover
"""What may be handed to `simulate`."""


@dataclass(frozen=True, slots=True)
class Body:
    """A motion and the template that it moves."""

    source: Motion
    template: str
    material: str | Material
    geometry: Geometry
    """The skin or the segments."""
    may_rotate_fast: bool = False

    @classmethod
    def of(cls, motion: Motion, template: str, material: str | Material, method: Method) -> Body:
        """By skin or segments; the motion stands in its place before the radar."""
        make = skin if method == "mesh" else segments
        return cls(motion, template, material, make(motion, template, material=material))

    @property
    def mesh(self) -> MovingMesh | None:
        """The skin, where that is what scatters."""
        return self.geometry if isinstance(self.geometry, MovingMesh) else None

    def ellipsoids(self) -> Ellipsoids:
        """One ellipsoid for each segment of the body."""
        return segments(self.source, self.template) if isinstance(self.geometry, MovingMesh) else self.geometry

    def by(self, method: Method) -> Body:
        """By skin or segments."""
        return Body.of(self.source, self.template, self.material, method)


@dataclass(frozen=True, slots=True)
class UserMesh:
    """A mesh of the user."""

    source: MovingMesh
    material: str | Material
    may_rotate_fast: bool = True

    @property
    def geometry(self) -> MovingMesh:
        """The mesh that the user gave."""
        return self.source

    @property
    def mesh(self) -> MovingMesh:
        """The mesh that the user gave."""
        return self.source

    def ellipsoids(self) -> None:
        """A mesh has no coarse form."""

    def by(self, method: Method) -> UserMesh:
        """By its facets alone."""
        if method == "ellipsoid":
            raise InputError(
                f"method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh {self.source.name}; use method 'mesh'"
            )
        return self


@dataclass(frozen=True, slots=True)
class UserEllipsoids:
    """Ellipsoids of the user."""

    source: Ellipsoids
    material: str | Material
    mesh: None = None
    may_rotate_fast: bool = True

    @property
    def geometry(self) -> Ellipsoids:
        """The ellipsoids that the user gave."""
        return self.source

    def ellipsoids(self) -> Ellipsoids:
        """The ellipsoids that the user gave."""
        return self.source

    def by(self, method: Method) -> UserEllipsoids:
        """By these, whatever the method of bodies."""
        return self


@dataclass(frozen=True, slots=True)
class MovingPart:
    """A mover over the time that it is needed, by its facets whatever the method of bodies."""

    source: Mover
    mesh: MovingMesh
    may_rotate_fast: bool = True

    @property
    def geometry(self) -> MovingMesh:
        """The mesh of the mover."""
        return self.mesh

    @property
    def material(self) -> str | Material:
        """The mover's own material."""
        return self.mesh.material

    def ellipsoids(self) -> None:
        """A mesh has no coarse form."""

    def by(self, method: Method) -> MovingPart:
        """The same facets, whatever the method of bodies."""
        return self


def targets_of(
    given: Sequence[TargetLike], method: Method, body: str, material: str | Material | None, radar: Radar
) -> list[Target]:
    """The targets that were handed in, movers over the time that all others have in common; `material` is that of all others,
    None their own."""
    lasting = {
        number: _lasting(each, method, body, material, radar)
        for number, each in enumerate(given)
        if not isinstance(each, Mover)
    }
    if not lasting:
        raise InputError(
            f"movers alone have no end, got {given!r:.60}; give one of them as its mesh, mover.mesh(0, 5) for 5 s"
        )
    time_s = shared_time([each.geometry for each in lasting.values()])
    return [
        MovingPart(each, each.mesh(*time_s)) if isinstance(each, Mover) else lasting[number]
        for number, each in enumerate(given)
    ]


def _lasting(
    given: Motion | MovingMesh | Ellipsoids, method: Method, body: str, material: str | Material | None, radar: Radar
) -> Target:
    if isinstance(given, Motion):
        return Body.of(placed(given, radar), body, "skin" if material is None else material, method)
    own = given.material if material is None else material
    return UserMesh(given, own).by(method) if isinstance(given, MovingMesh) else UserEllipsoids(given, own)


def shared_time(geometries: Sequence[Geometry]) -> tuple[float, float]:
    """First and last instant that all targets have in common [s]."""
    start = max(float(s.times_s[0]) for s in geometries)
    stop = min(float(s.times_s[-1]) for s in geometries)
    if not stop > start:
        raise InputError(
            f"the targets have no time in common (last start {start:.6g} s, first end {stop:.6g} s); give overlapping times_s"
        )
    return start, stop


def skin(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> MovingMesh:
    """The motion's skinned body: `vertices` (T, V, 3) m, `faces` (F, 3), `times_s` (T,)."""
    checked_material(material)
    made = Made("skin", {"motion": motion, "body": body, "material": material})
    return skin_body(motion, body, material=material, track=track(motion), made=made)


def segments(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    checked_material(material)
    made = Made("segments", {"motion": motion, "body": body, "material": material})
    return fit_segments(motion, body, material=material, track=track(motion), made=made)


def placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)
