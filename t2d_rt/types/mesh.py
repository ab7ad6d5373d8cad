"""`MovingMesh`: a triangle mesh in time. Bodies, fans, spheres and curtains are given to the echo models in this form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, call, check_shape, flag, number, numeric, shown, text
from t2d_rt.core.errors import InputError, warn
from t2d_rt.geometry.vectors import checked_faces, edge_cross
from t2d_rt.types.material import ByPart, Material, checked_materials
from t2d_rt.types.splines import checked_times, set_fields, spline, within

if TYPE_CHECKING:
    import trimesh

Track = Callable[[np.ndarray], np.ndarray]
"""Vertices [m], float64 (K, V, 3), at times [s] (K,)."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """How a mesh or ellipsoids were made, so that they can be made again."""

    by: Literal["arrays", "skin", "segments", "mover", "passing"]
    arguments: Mapping[str, Any]
    """Arguments of the function that made it."""


class Solid(NamedTuple):
    """The triangles of an occluder in time."""

    vertices_at: Track
    faces: np.ndarray
    """Indices of the vertices of each triangle, (F, 3)."""
    vertices: int
    """Number of vertices."""


PERIOD_PROBES, PERIOD_M = 100, 2e-6
"""Number of random instants at which a period is checked, and greatest deviation of a vertex that is accepted there [m]."""
SAGITTA_RAD = 1e-3, 1e9
"""Least and greatest phase sagitta [rad]: with less the facets would not fit memory, and a very large one keeps the triangles as
they are."""


@dataclass(frozen=True, slots=True, init=False, eq=False, repr=False)
class MovingMesh:
    """Vertices (T, V, 3) m at times_s (T,) s, triangles (F, 3), counter-clockwise seen from outside.

    Between the given times the vertices follow a C2 cubic spline. Triangles are samples of a curved surface: edges bent by less
    than `crease_deg` are smoothed, sharper ones (those of a box) stay edges; 0 keeps every triangle flat. Echo models refine them
    to flat facets of a phase sagitta of `sagitta_rad`, one number or one per vertex: 0.07 gives 0.3 dB of RCS for canonical targets
    (docs/physics.md, eq. 5). A closed mesh without edges may have `curved` facets instead, as a body has. Whatever `crease_deg`,
    these lie on Loop's surface, which passes through the vertices except for their roughness; a few curved facets of up to 2 rad
    replace many flat ones (eq. 30).
    """

    rest: np.ndarray
    """Pose in which curvature is measured and over which diffuse points are distributed [m], float64 (V, 3)."""
    faces: np.ndarray
    """Indices of the vertices of each triangle, int32 (F, 3)."""
    times_s: np.ndarray
    """Times of the frames [s], float64 (T,)."""
    material: str | Material | ByPart
    crease_deg: float
    sagitta_rad: float | np.ndarray
    curved: bool
    """Whether facets are curved and lie on a smooth surface, as those of a body do."""
    name: str
    track: Track = field(repr=False)
    """Function that gives the vertices at any times."""
    made: Provenance | None
    """How the mesh was made, so that it can be made again; None where a function of the user computes it."""
    period_s: float | None
    """Period [s] after which, from any instant on, the mesh is in the same place again; None where there is none."""
    refined_as: np.ndarray | None
    """Vertices at rest (V, 3) [m] of a similar mesh whose curved facets this one shares, so that they are made only once for
    several bodies; None where it has facets of its own."""

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        times_s: np.ndarray,
        material: str | Material | ByPart = "skin",
        *,
        crease_deg: float = 45.0,
        sagitta_rad: float | np.ndarray = 0.07,
        curved: bool = False,
        name: str = "mesh",
    ) -> None:
        times_s, name = checked_times(times_s), text("name", name)
        check_shape("vertices", numeric("vertices", vertices), (len(times_s), "vertex", 3))
        vertices = array(f"vertices of {name}", vertices, limit=LARGEST_M, unit="m").copy()
        made = Provenance("arrays", {"vertices": vertices})
        self._fill(name, vertices[0], faces, material, crease_deg, sagitta_rad, curved)
        set_fields(
            self, name=name, times_s=times_s, track=spline(times_s, vertices), made=made, period_s=None, refined_as=None
        )

    @classmethod
    def from_track(
        cls,
        track: Track,
        faces: np.ndarray,
        times_s: np.ndarray,
        material: str | Material | ByPart = "skin",
        *,
        rest: np.ndarray | None = None,
        crease_deg: float = 45.0,
        sagitta_rad: float | np.ndarray = 0.07,
        curved: bool = False,
        name: str = "mesh",
        made: Provenance | None = None,
        period_s: float | None = None,
        refined_as: np.ndarray | None = None,
    ) -> MovingMesh:
        """A mesh whose vertices are computed by `track`, which gives (K, V, 3) m at times (K,) s within `times_s`.

        `rest` (V, 3) is the pose in which curvature is measured and over which diffuse points are distributed; the first frame by
        default. `made` says how `track` was made, so that it can be made again from stored data. `period_s`: after each period the
        mesh is in the same place again, so that a fast-rotating one needs to be computed for a few periods only. `refined_as`:
        vertices at rest of a similar mesh whose curved facets this one shares; such a mesh counts as a body, whose shadows are
        wider than the spacing of its vertices.
        """
        mesh = cls.__new__(cls)
        times_s, name = checked_times(times_s), text("name", name)
        call("track", track, "a function from times (K,) to vertices (K, V, 3)")
        first = np.asarray(_positions(track, times_s[:1], None, name)[0], float)
        rest = first if rest is None else array("rest", rest, first.shape, limit=LARGEST_M, unit="m")
        mesh._fill(name, rest, faces, material, crease_deg, sagitta_rad, curved)
        if period_s is not None:
            period_s = number("period_s", period_s, 1e-6, 1e6, unit="s")
            _check_period(track, times_s, len(rest), period_s, name)
        if refined_as is not None:
            refined_as = array("refined_as", refined_as, rest.shape, limit=LARGEST_M, unit="m")
        more = {"track": track, "made": made, "period_s": period_s, "refined_as": refined_as}
        set_fields(mesh, name=name, times_s=times_s, **more)
        return mesh

    def _fill(
        self,
        name: str,
        rest: np.ndarray,
        faces: np.ndarray,
        material: str | Material | ByPart,
        crease_deg: float,
        sagitta_rad: float | np.ndarray,
        curved: bool,
    ) -> None:
        """Checks and sets the fields that both constructors have in common."""
        faces = checked_faces(f"faces of {name}", faces, len(rest))
        _check_faces(faces, len(rest), name, curved)
        _check_side(rest[faces], name)
        hint = f"one number or one per vertex ({len(rest)},), {SAGITTA_RAD[0]:g}..{SAGITTA_RAD[1]:g} rad"
        sagitta = array(f"sagitta_rad of {name}", sagitta_rad, hint=hint)
        fits = sagitta.shape in ((), (len(rest),))
        if not fits or not SAGITTA_RAD[0] <= sagitta.min() <= sagitta.max() <= SAGITTA_RAD[1]:
            raise InputError(f"sagitta_rad of {name} must be positive, {hint}, got {shown(sagitta_rad)}")
        set_fields(
            self,
            rest=rest,
            faces=faces.astype(np.int32),
            material=checked_materials(material, len(faces)),
            crease_deg=number("crease_deg", crease_deg, 0, 180, hint="180 makes all edges smooth, 0 none"),
            sagitta_rad=sagitta_rad,
            curved=flag("curved", curved),
        )

    @property
    def refined_rest(self) -> np.ndarray:
        """Vertices at rest (V, 3) [m] of the mesh that is refined to facets: those of `refined_as`, or its own."""
        return self.rest if self.refined_as is None else self.refined_as

    @property
    def vertices(self) -> np.ndarray:
        """Vertices at `times_s` [m], float64 (T, V, 3)."""
        return self.track(self.times_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Vertices [m], float64 (K, V, 3), at times [s] (K,) within `times_s`."""
        return _positions(self.track, within(times_s, self.times_s, self.name), len(self.rest), self.name)

    @property
    def point_count(self) -> int:
        """Number of points that stand for the moving target: the vertices."""
        return len(self.rest)

    def points_at(self, times_s: np.ndarray) -> np.ndarray:
        """The same as `at`."""
        return self.at(times_s)

    def solid(self) -> Solid:
        """The occluder of this mesh: its triangles."""
        return Solid(self.at, self.faces, len(self.rest))

    def trimesh(self, time_s: float | None = None) -> trimesh.Trimesh:
        """The mesh at one instant, by default its first, as a `trimesh.Trimesh`, to inspect, render and export."""
        import trimesh

        return trimesh.Trimesh(
            vertices=self.at(np.array([self.times_s[0] if time_s is None else number("time_s", time_s)]))[0],
            faces=self.faces,
            process=False,
        )

    def __repr__(self) -> str:
        material = self.material if isinstance(self.material, str) else self.material.name
        return f"MovingMesh({self.name}: {len(self.rest)} vertices, {len(self.faces)} faces, {self.duration_s:.3g} s, {material})"


def _positions(track: Track, times_s: np.ndarray, count: int | None, name: str) -> np.ndarray:
    """Vertices that a track gives at these times, (K, count, 3) m, checked, since the track may be a user's function."""
    points = track(times_s)
    if (
        not isinstance(points, np.ndarray)
        or not np.issubdtype(points.dtype, np.floating)
        or np.ma.isMaskedArray(points)
    ):
        points = array(f"the track of {name}", points)
    check_shape(f"the track of {name}", points, (len(times_s), "vertex" if count is None else count, 3))
    # The sum is finite only where all values are, and needs no array of its own.
    if not np.isfinite(points.sum()):
        at = times_s[~np.isfinite(points).all(axis=(1, 2))]
        raise InputError(f"the track of {name} must be finite, got NaN or infinite vertices at {at[0]:.6g} s")
    return points


def _check_period(track: Track, times_s: np.ndarray, count: int, period_s: float, name: str) -> None:
    """Refuses a track that, at any of some instants of its record, is not where it was at the same phase of its first period."""
    # Instants are random within equal parts of the record: at evenly spaced ones alone a track might repeat by chance.
    parts = np.linspace(0, times_s[-1] - times_s[0], PERIOD_PROBES + 1)
    since = parts[:-1] + np.random.default_rng(0).random(PERIOD_PROBES) * np.diff(parts)
    since = np.append(since[since >= period_s], parts[-1])
    if parts[-1] < period_s:
        return  # a record shorter than a period never uses it
    apart_m = 0.0
    for probes in np.array_split(since, 10):
        here, first = (_positions(track, times_s[0] + probe, count, name) for probe in (probes, probes % period_s))
        apart_m = max(apart_m, float(np.abs(here - first).max(initial=0.0)))
    if apart_m > PERIOD_M:
        raise InputError(
            f"{name} must be in the same place after each period_s, {period_s:.6g} s, but is {apart_m:.3g} m away; leave it out"
        )


def _check_faces(faces: np.ndarray, vertex_count: int, name: str, curved: bool) -> None:
    """Refuses vertices that no face uses; warns where faces leave edges open or do not agree in their orientation."""
    unused = np.count_nonzero(np.bincount(faces.ravel(), minlength=vertex_count) == 0)
    if unused:
        raise InputError(
            f"{unused} of {vertex_count} vertices of {name} belong to no face; remove them "
            "(trimesh: remove_unreferenced_vertices) or check the face list"
        )
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    _, counts = np.unique(np.minimum(start, end) * vertex_count + np.maximum(start, end), return_counts=True)
    alone = np.count_nonzero(counts != 2)
    if alone and curved:
        raise InputError(
            f"{name} must be watertight to have curved facets, got {alone} of {len(counts)} edges that do not join two faces; "
            "merge its vertices (trimesh: merge_vertices), or leave curved out"
        )
    if alone:
        warn(
            f"{name} is not watertight ({alone} of {len(counts)} edges do not join two faces): it reflects only from its front "
            "side (if its triangles do not share vertices, merge them: trimesh merge_vertices)"
        )
    directed = np.sort((start * vertex_count + end).ravel())  # much quicker than np.unique
    if (directed[1:] == directed[:-1]).any():
        warn(
            f"triangles of {name} are not all oriented alike, so that some show their back and shadows beside them may be wrong: "
            "orient them (trimesh: fix_normals)"
        )


def _check_side(corners: np.ndarray, name: str) -> None:
    """Refuses a closed mesh (F, 3, 3) whose faces are oriented inward."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    # The area vectors of a closed mesh add up to zero; its volume is that of the tetrahedra under its faces.
    closed = np.allclose(edge_cross(corners).sum(axis=0), 0, atol=1e-9 * np.abs(corners).max() ** 2)
    across = np.cross(b, c) - np.cross(a, c) - np.cross(b, a)
    volume = float(np.einsum("fi,fi->", a - corners.mean(axis=(0, 1)), across)) / 6
    if closed and volume < -1e-9 * np.abs(corners).max() ** 3:
        raise InputError(f"{name} is inside out: its triangles run clockwise seen from outside; give faces[:, ::-1]")
