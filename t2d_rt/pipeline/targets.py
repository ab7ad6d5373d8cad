"""Targets as the model asks for them (`types.Target`): bodies, meshes and ellipsoids of the user, movers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from t2d_rt.body import segments as fit_segments
from t2d_rt.body import skin as skin_body
from t2d_rt.body.outfit import Outfit, outfit_of
from t2d_rt.core.errors import InputError
from t2d_rt.motion import Track, place, quaternions, track
from t2d_rt.scene import Mover
from t2d_rt.scene.things import substance, surface, wheels
from t2d_rt.types import ByPart, Ellipsoids, Material, Motion, MovingMesh, Radar
from t2d_rt.types.carried import Carried
from t2d_rt.types.mesh import Made
from t2d_rt.types.splines import set_fields, spline
from t2d_rt.types.target import Geometry, Method, Target

TargetLike = Motion | MovingMesh | Ellipsoids | Mover
"""What may be handed to `simulate`."""
AnyGeometry = TypeVar("AnyGeometry", bound=Geometry)


@dataclass(frozen=True, slots=True)
class Body:
    """A motion and the template that it moves."""

    source: Motion
    template: str
    worn: str | Material | Outfit
    """What it wears, or the one material of the whole body."""
    geometry: Geometry
    """The skin or the segments."""
    may_rotate_fast: bool = False

    @classmethod
    def of(cls, motion: Motion, template: str, worn: str | Material | Outfit, method: Method) -> Body:
        """By skin or segments; the motion stands in its place before the radar."""
        make = skin if method == "mesh" else segments
        return cls(motion, template, worn, make(motion, template, material=worn))

    @property
    def material(self) -> str | Material | ByPart:
        """What its surface is made of."""
        return self.geometry.material

    @property
    def mesh(self) -> MovingMesh | None:
        """The skin, where that is what scatters."""
        return self.geometry if isinstance(self.geometry, MovingMesh) else None

    def ellipsoids(self) -> Ellipsoids:
        """One ellipsoid for each segment of the body."""
        return self.geometry if isinstance(self.geometry, Ellipsoids) else self.by("ellipsoid").ellipsoids()

    def by(self, method: Method) -> Body:
        """By skin or segments."""
        return Body.of(self.source, self.template, self.worn, method)


@dataclass(frozen=True, slots=True)
class UserMesh:
    """A mesh of the user."""

    source: MovingMesh
    material: str | Material | ByPart
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
    material: str | Material | ByPart
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
    """A mover over the time that it is needed, or what a person carries, by its facets whatever the method of bodies."""

    source: Mover | MovingMesh
    mesh: MovingMesh
    may_rotate_fast: bool = True

    @property
    def geometry(self) -> MovingMesh:
        """The mesh of the mover."""
        return self.mesh

    @property
    def material(self) -> str | Material | ByPart:
        """The mover's own material."""
        return self.mesh.material

    def ellipsoids(self) -> None:
        """A mesh has no coarse form."""

    def by(self, method: Method) -> MovingPart:
        """The same facets, whatever the method of bodies."""
        return self


@dataclass(frozen=True, slots=True)
class SeenFromMoving:
    """A target as it passes a radar that moves, in the frame in which that stands still (`Radar.passing`)."""

    target: Target
    radar: Radar
    geometry: Geometry
    template: str

    @classmethod
    def of(cls, target: Target, radar: Radar) -> SeenFromMoving:
        """The target, whose own place is in the world."""
        return cls(target, radar, passing(target.geometry, radar), getattr(target, "template", "ellipsoids"))

    @property
    def source(self) -> Any:
        """What was handed to `simulate`, in the world."""
        return self.target.source

    @property
    def mesh(self) -> MovingMesh | None:
        """The skin or mesh, where that is what scatters."""
        return self.geometry if isinstance(self.geometry, MovingMesh) else None

    @property
    def material(self) -> str | Material | ByPart:
        """The target's own material."""
        return self.target.material

    @property
    def may_rotate_fast(self) -> bool:
        """As the target in the world."""
        return self.target.may_rotate_fast

    def ellipsoids(self) -> Ellipsoids | None:
        """The target's coarse form, if any."""
        found = self.target.ellipsoids()
        return None if found is None else passing(found, self.radar)

    def by(self, method: Method) -> SeenFromMoving:
        """The same, modelled by another method."""
        return SeenFromMoving.of(self.target.by(method), self.radar)


def in_world(target: Target) -> Target:
    """The target in the coordinates of the world."""
    return target.target if isinstance(target, SeenFromMoving) else target


def passing(geometry: AnyGeometry, radar: Radar) -> AnyGeometry:
    """What is given in the world as a radar that moves sees it, in the frame in which it stands still, while both are known; the
    same where the radar stands still."""
    if radar.track is None:
        return geometry
    own_s, track_s = geometry.times_s, np.array(radar.track.times_s)
    begin, end = max(own_s[0], track_s[0]), min(own_s[-1], track_s[-1])
    if not end > begin:
        raise InputError(
            f"the radar's track from {track_s[0]:.6g} to {track_s[-1]:.6g} s and {geometry.name} from {own_s[0]:.6g} to "
            f"{own_s[-1]:.6g} s have no time in common; give overlapping times_s"
        )
    # Its places were given as often as those of the faster of the two: what vibrates is looked for up to that rate.
    times_s = min(own_s, track_s, key=lambda given_s: float(np.diff(given_s).min()))
    half_s = float(np.diff(times_s).min()) / 2
    inside = times_s[(times_s > begin + half_s) & (times_s < end - half_s)]
    found = copy(geometry)
    set_fields(found, track=partial(_carried, geometry, radar), times_s=np.concatenate([[begin], inside, [end]]))
    if geometry.made is not None and geometry.made.by == "arrays":
        set_fields(found, made=Made("passing", {}))  # these arrays are in the world
    if isinstance(found, MovingMesh):
        set_fields(found, period_s=None)  # it is never in the same place before the radar again
    return found


def in_frame(radar: Radar, times_s: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Points of the world (K, ..., 3) m at times [s] (K,), in the frame in which a radar that moves stands still."""
    return points_m if radar.track is None else radar.passing(times_s).points(points_m)


def _carried(geometry: Geometry, radar: Radar, times_s: np.ndarray) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """Vertices of a mesh, or centres and axes of ellipsoids, as `in_frame`."""
    if isinstance(geometry, MovingMesh):
        return in_frame(radar, times_s, geometry.at(times_s))
    centres, axes = geometry.at(times_s)
    return in_frame(radar, times_s, centres), radar.passing(times_s).rotation[:, None] @ axes


def targets_of(
    given: Sequence[TargetLike], method: Method, body: str, material: str | Material | Outfit | None, radar: Radar
) -> list[Target]:
    """The targets that were handed in, each person followed by what they carry, movers over the time that all others have in
    common; `material` is that of persons, meshes and ellipsoids, an outfit that of persons alone, None their own."""
    if material is not None and outfit_of(material) is not None and not any(isinstance(each, Motion) for each in given):
        raise InputError(
            f"an outfit is worn by a Motion, got {given!r:.60}; give one, or skin(motion, material=...) in the outfit"
        )
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
    found: list[Target] = []
    for number, each in enumerate(given):
        found.append(MovingPart(each, each.mesh(*time_s)) if isinstance(each, Mover) else lasting[number])
        if isinstance(each, Motion):
            found += [MovingPart(thing, thing) for thing in things(lasting[number].source)]
    return found if radar.track is None else [SeenFromMoving.of(each, radar) for each in found]


def _lasting(
    given: Motion | MovingMesh | Ellipsoids,
    method: Method,
    body: str,
    material: str | Material | Outfit | None,
    radar: Radar,
) -> Target:
    if isinstance(given, Motion):
        return Body.of(placed(given, radar), body, "skin" if material is None else material, method)
    own: str | Material | ByPart = given.material
    if isinstance(material, str | Material) and outfit_of(material) is None:
        own = material
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


def skin(motion: Motion, body: str = "adult", *, material: str | Material | Outfit = "skin") -> MovingMesh:
    """The motion's skinned body, all of one material or in an outfit: `vertices` (T, V, 3) m, `faces` (F, 3), `times_s` (T,)."""
    made = Made("skin", {"motion": motion, "body": body, "material": material})
    return skin_body(motion, body, material=material, track=track(motion), made=made)


def things(motion: Motion) -> list[MovingMesh]:
    """Meshes of what a person carries, and of the wheels that roll with it."""
    followed = track(motion) if motion.carries else None
    return [mesh for each in motion.carries if followed is not None for mesh in _thing(followed, each)]


def _thing(followed: Track, carried: Carried) -> list[MovingMesh]:
    times_s = followed.motion.times_s
    solids = [(carried.thing, surface(carried), Rigid(followed, carried))]
    for axle, radius_m, solid in wheels(carried):
        here, there = np.moveaxis(
            Rigid(followed, carried, axle + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))(times_s), 1, 0
        )
        ahead = there - here
        steps_m = (np.diff(here, axis=0) * 0.5 * (ahead[1:] + ahead[:-1])).sum(axis=1)
        rolled = spline(times_s, np.concatenate([[0.0], np.cumsum(steps_m)]) / radius_m)
        solids.append((f"{carried.thing} wheel", solid, Rigid(followed, carried, axle=axle, rolled=rolled)))
    return [
        MovingMesh.from_track(
            replace(moving, points=vertices), faces, times_s, material=substance(carried), rest=vertices, name=name
        )
        for name, (vertices, faces), moving in solids
    ]


@dataclass(frozen=True, slots=True)
class Rigid:
    """Points that move with a thing that a person carries, as a function of time."""

    followed: Track
    carried: Carried
    points: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    """In the frame of the thing, or about the axle of a wheel [m], (V, 3)."""
    axle: np.ndarray | None = None
    """Of a wheel, in the frame of the thing [m], (3,)."""
    rolled: Callable[[np.ndarray], np.ndarray] | None = None
    """Angle that the wheel has rolled by at times (K,) [rad]."""

    def __call__(self, times_s: np.ndarray) -> np.ndarray:
        """Places (K, V, 3) at times (K,) [m]."""
        points = self.points
        if self.rolled is not None:
            spins = quaternions.about_axis(np.array([0.0, 1.0, 0.0]), self.rolled(times_s))
            points = quaternions.rotate(spins[:, None], points) + self.axle
        joint = self.followed.motion.index(self.carried.joint)
        places, rotations = self.followed(times_s)
        local = quaternions.rotate(np.array(self.carried.rotation), points) + self.carried.position_m
        return places[:, joint, None] + quaternions.rotate(rotations[:, joint, None], local)


def segments(motion: Motion, body: str = "adult", *, material: str | Material | Outfit = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    made = Made("segments", {"motion": motion, "body": body, "material": material})
    return fit_segments(motion, body, material=material, track=track(motion), made=made)


def placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)
