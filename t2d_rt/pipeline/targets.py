"""Targets as the model asks for them: bodies, meshes and ellipsoids of the user, movers."""

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
from t2d_rt.propagation.collisions import Held, Tested
from t2d_rt.scene import Mover
from t2d_rt.scene.things import outline, substance, surface, wheels
from t2d_rt.types import ByPart, Ellipsoids, Material, Motion, MovingMesh, Radar
from t2d_rt.types.carried import Carried
from t2d_rt.types.ellipsoids import Geometry, Method
from t2d_rt.types.mesh import Provenance
from t2d_rt.types.splines import set_fields, spline

TargetLike = Motion | MovingMesh | Ellipsoids | Mover
"""What may be handed to `simulate`."""
AnyGeometry = TypeVar("AnyGeometry", bound=Geometry)


@dataclass(frozen=True, slots=True)
class Target:
    """A body, a mesh or ellipsoids of the user, a mover, or what a person carries, made ready for one way of modelling it."""

    source: Any
    """What was handed to `simulate`, a motion in its place before the radar."""
    world: Geometry
    """Points of the target in motion, in the world."""
    geometry: Geometry
    """The geometry in the frame in which a radar that moves stands still."""
    material: str | Material | ByPart
    """What its surface is made of."""
    radar: Radar
    template: str = "ellipsoids"
    """Name of a body's template."""
    worn: str | Material | Outfit = "skin"
    """What a body wears, or its one material."""

    @classmethod
    def of(
        cls, source: Any, world: Geometry, radar: Radar, material: str | Material | ByPart | None = None, **body: Any
    ) -> Target:
        """What moves so in the world; its own material by default."""
        own = world.material if material is None else material
        return cls(source, world, passing(world, radar), own, radar, **body)

    @classmethod
    def of_body(
        cls, motion: Motion, template: str, worn: str | Material | Outfit, method: Method, radar: Radar
    ) -> Target:
        """A body by its skin or its segments; the motion stands in its place before the radar."""
        make = skin if method == "mesh" else segments
        return cls.of(motion, make(motion, template, material=worn), radar, template=template, worn=worn)

    @property
    def mesh(self) -> MovingMesh | None:
        """The surface whose facets scatter; None where ellipsoids do."""
        return self.geometry if isinstance(self.geometry, MovingMesh) else None

    @property
    def tested(self) -> Tested:
        """What must not go through the scene."""
        world = self.world
        if isinstance(world, MovingMesh) and isinstance(world.track, Rigid):
            return Held(world, outline(world.rest), world.track.pelvis_at)
        return self.source if isinstance(self.source, Motion) else world

    @property
    def may_rotate_fast(self) -> bool:
        """Whether it may rotate too fast for its visibility to be sampled point by point."""
        return not isinstance(self.source, Motion)

    def ellipsoids(self) -> Ellipsoids | None:
        """Its coarse form, of a body one ellipsoid for each segment; None where it has none."""
        coarse = self.by("ellipsoid").geometry if self.mesh is not None else self.geometry
        return coarse if isinstance(coarse, Ellipsoids) else None

    def by(self, method: Method) -> Target:
        """The target, modelled by another method if it is a body."""
        if not isinstance(self.source, Motion):
            return self
        return Target.of_body(self.source, self.template, self.worn, method, self.radar)


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
    moved = copy(geometry)
    set_fields(moved, track=partial(_carried, geometry, radar), times_s=np.concatenate([[begin], inside, [end]]))
    if geometry.made is not None and geometry.made.by == "arrays":
        set_fields(moved, made=Provenance("passing", {}))  # these arrays are in the world
    if isinstance(moved, MovingMesh):
        set_fields(moved, period_s=None)  # it is never in the same place before the radar again
    return moved


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
    if material is not None and outfit_of(material) is not None and not any(isinstance(item, Motion) for item in given):
        raise InputError(
            f"an outfit is worn by a Motion, got {given!r:.60}; give one, or skin(motion, material=...) in the outfit"
        )
    lasting = {
        number: _lasting(target, method, body, material, radar)
        for number, target in enumerate(given)
        if not isinstance(target, Mover)
    }
    if not lasting:
        raise InputError(
            f"movers alone have no end, got {given!r:.60}; give one of them as its mesh, mover.mesh(0, 5) for 5 s"
        )
    time_s = shared_time([target.world for target in lasting.values()])
    targets: list[Target] = []
    for number, target in enumerate(given):
        targets.append(Target.of(target, target.mesh(*time_s), radar) if isinstance(target, Mover) else lasting[number])
        if isinstance(target, Motion):
            targets += [Target.of(carried, carried, radar) for carried in things(lasting[number].source)]
    return targets


def _lasting(
    given: Motion | MovingMesh | Ellipsoids,
    method: Method,
    body: str,
    material: str | Material | Outfit | None,
    radar: Radar,
) -> Target:
    if isinstance(given, Motion):
        return Target.of_body(placed(given, radar), body, "skin" if material is None else material, method, radar)
    if isinstance(given, MovingMesh) and method == "ellipsoid":
        raise InputError(
            f"method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh {given.name}; use method 'mesh'"
        )
    own_material = material if isinstance(material, str | Material) and outfit_of(material) is None else None
    return Target.of(given, given, radar, own_material)


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
    made = Provenance("skin", {"motion": motion, "body": body, "material": material})
    return skin_body(motion, body, material=material, track=track(motion), made=made)


def things(motion: Motion) -> list[MovingMesh]:
    """Meshes of what a person carries, and of the wheels that roll with it."""
    followed = track(motion) if motion.carries else None
    return [mesh for carried in motion.carries if followed is not None for mesh in _thing(followed, carried)]


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
    """Axle of a wheel in the frame of the thing [m], (3,)."""
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

    def pelvis_at(self, times_s: np.ndarray) -> np.ndarray:
        """Places (K, 3) [m] of the pelvis of who carries it, at times (K,)."""
        return self.followed(times_s)[0][:, self.followed.motion.index("pelvis")]


def segments(motion: Motion, body: str = "adult", *, material: str | Material | Outfit = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    made = Provenance("segments", {"motion": motion, "body": body, "material": material})
    return fit_segments(motion, body, material=material, track=track(motion), made=made)


def placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)
