"""Targets in the form that the model needs: bodies, meshes and ellipsoids of the user, movers, and things that persons carry."""

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
"""Types of target that `simulate` accepts."""
AnyGeometry = TypeVar("AnyGeometry", bound=Geometry)


@dataclass(frozen=True, slots=True)
class Target:
    """A body, a mesh or ellipsoids of the user, a mover, or a thing that a person carries, made ready for one scattering method."""

    source: Any
    """The object that was given to `simulate`; a motion after placement."""
    world: Geometry
    """Mesh or ellipsoids of the target in the world."""
    geometry: Geometry
    """The same geometry in the frame in which a moving radar stands still."""
    material: str | Material | ByPart
    """Material of its surface."""
    radar: Radar
    template: str = "ellipsoids"
    """Name of a body's template, which also names the target where it has no mesh."""
    worn: str | Material | Outfit = "skin"
    """What a body wears, or its one material."""

    @classmethod
    def of(
        cls, source: Any, world: Geometry, radar: Radar, material: str | Material | ByPart | None = None, **body: Any
    ) -> Target:
        """A target with this geometry in the world; its material is the geometry's own by default."""
        own = world.material if material is None else material
        return cls(source, world, passing(world, radar), own, radar, **body)

    @classmethod
    def of_body(
        cls, motion: Motion, template: str, worn: str | Material | Outfit, method: Method, radar: Radar
    ) -> Target:
        """A body as a mesh or as ellipsoids, according to `method`; the motion must have been placed."""
        make = skin if method == "mesh" else segments
        return cls.of(motion, make(motion, template, material=worn), radar, template=template, worn=worn)

    @property
    def mesh(self) -> MovingMesh | None:
        """The mesh whose facets scatter; None where ellipsoids do."""
        return self.geometry if isinstance(self.geometry, MovingMesh) else None

    @property
    def tested(self) -> Tested:
        """The geometry that is checked for collisions with the scene: a motion's joints, the outline of a carried thing, or all
        vertices."""
        world = self.world
        if isinstance(world, MovingMesh) and isinstance(world.track, Rigid):
            return Held(world, outline(world.rest), world.track.pelvis_at)
        return self.source if isinstance(self.source, Motion) else world

    @property
    def may_rotate_fast(self) -> bool:
        """Whether it may rotate too fast for its visibility to be sampled point by point."""
        return not isinstance(self.source, Motion)

    def ellipsoids(self) -> Ellipsoids | None:
        """The target as ellipsoids, for a body one for each segment; None for a mesh that is no body."""
        coarse = self.by("ellipsoid").geometry if self.mesh is not None else self.geometry
        return coarse if isinstance(coarse, Ellipsoids) else None

    def by(self, method: Method) -> Target:
        """The target modelled by another method; unchanged if it is no body."""
        if not isinstance(self.source, Motion):
            return self
        return Target.of_body(self.source, self.template, self.worn, method, self.radar)


def passing(geometry: AnyGeometry, radar: Radar) -> AnyGeometry:
    """A geometry given in the world, in the frame in which a moving radar stands still, for the time in which both are known;
    unchanged if the radar does not move."""
    if radar.track is None:
        return geometry
    own_s, track_s = geometry.times_s, np.array(radar.track.times_s)
    begin, end = max(own_s[0], track_s[0]), min(own_s[-1], track_s[-1])
    if not end > begin:
        raise InputError(
            f"the radar's track from {track_s[0]:.6g} to {track_s[-1]:.6g} s and {geometry.name} from {own_s[0]:.6g} to "
            f"{own_s[-1]:.6g} s have no time in common; give overlapping times_s"
        )
    # Keep the denser of both time grids: the surface rate is searched up to the rate at which positions were given.
    times_s = min(own_s, track_s, key=lambda given_s: float(np.diff(given_s).min()))
    half_s = float(np.diff(times_s).min()) / 2
    inside = times_s[(times_s > begin + half_s) & (times_s < end - half_s)]
    moved = copy(geometry)
    set_fields(moved, track=partial(_carried, geometry, radar), times_s=np.concatenate([[begin], inside, [end]]))
    if geometry.made is not None and geometry.made.by == "arrays":
        set_fields(moved, made=Provenance("passing", {}))  # these arrays are in the world
    if isinstance(moved, MovingMesh):
        set_fields(moved, period_s=None)  # before a moving radar it does not return to the same place
    return moved


def in_frame(radar: Radar, times_s: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Points of the world (K, ..., 3) m at times [s] (K,), in the frame in which a moving radar stands still."""
    return points_m if radar.track is None else radar.passing(times_s).points(points_m)


def _carried(geometry: Geometry, radar: Radar, times_s: np.ndarray) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """Vertices of a mesh, or centres and axes of ellipsoids, in the frame of `in_frame`."""
    if isinstance(geometry, MovingMesh):
        return in_frame(radar, times_s, geometry.at(times_s))
    centres, axes = geometry.at(times_s)
    return in_frame(radar, times_s, centres), radar.passing(times_s).rotation[:, None] @ axes


def targets_of(
    given: Sequence[TargetLike], method: Method, body: str, material: str | Material | Outfit | None, radar: Radar
) -> list[Target]:
    """The targets that the user gave, each person followed by the things that they carry. Movers last for the time that all others
    have in common. `material` is that of persons, meshes and ellipsoids, None their own; an outfit applies to persons only."""
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
    """First and last instant that all geometries have in common [s]."""
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
    """Meshes of the things that a person carries, and of wheels that roll with them."""
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
    """Track of points that move rigidly with a thing that a person carries."""

    followed: Track
    carried: Carried
    points: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    """Points in the frame of the thing, or relative to the axle of a wheel [m], (V, 3)."""
    axle: np.ndarray | None = None
    """Axle of a wheel in the frame of the thing [m], (3,); None for other parts."""
    rolled: Callable[[np.ndarray], np.ndarray] | None = None
    """Function that gives the angle [rad] by which the wheel has rolled at times (K,)."""

    def __call__(self, times_s: np.ndarray) -> np.ndarray:
        """Positions (K, V, 3) m at times (K,) s."""
        points = self.points
        if self.rolled is not None:
            spins = quaternions.about_axis(np.array([0.0, 1.0, 0.0]), self.rolled(times_s))
            points = quaternions.rotate(spins[:, None], points) + self.axle
        joint = self.followed.motion.index(self.carried.joint)
        places, rotations = self.followed(times_s)
        local = quaternions.rotate(np.array(self.carried.rotation), points) + self.carried.position_m
        return places[:, joint, None] + quaternions.rotate(rotations[:, joint, None], local)

    def pelvis_at(self, times_s: np.ndarray) -> np.ndarray:
        """Positions (K, 3) m of the pelvis of the person who carries the thing, at times (K,) s."""
        return self.followed(times_s)[0][:, self.followed.motion.index("pelvis")]


def segments(motion: Motion, body: str = "adult", *, material: str | Material | Outfit = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the motion's body."""
    made = Provenance("segments", {"motion": motion, "body": body, "material": material})
    return fit_segments(motion, body, material=material, track=track(motion), made=made)


def placed(motion: Motion, radar: Radar) -> Motion:
    """The motion, placed before the radar unless it has been placed already."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)
