"""Echoes of ellipsoids by geometrical optics: one specular point each (docs/physics.md, eq. 8)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from typing_extensions import override

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross, dot, unit
from t2d_rt.scattering.antennas import concatenated, seen_by
from t2d_rt.scattering.patches import PairPlaces
from t2d_rt.scattering.paths import ArrivingFields, PathVisibility, faded_weights, product, unfolded
from t2d_rt.types import ByPart, EchoArrays, Ellipsoids, Material, MovingMesh, PathPair, Radar
from t2d_rt.types.material import values_of
from t2d_rt.types.scatterer import EchoLabels, Fraction, FrameBlock, Poses, Scatterer, Visibility

FORWARD = 0.08, 0.2
"""An echo fades in between these lengths of the sum of the unit vectors to both antennas; at 0 the ellipsoid lies on the line
between them."""
REACH_FRAMES = 48
"""Number of frames before and after those in which an echo is visible at which its delay must be right, too: the length of a window
of the sum and of the splines around it."""
CONVERGED_RAD, MOST_STEPS = 1e-6, 40
"""Newton's method ends when a step rotates the normal by less than the first [rad], since the error of the path is of second order,
or after the second number of steps; only echoes that have nearly faded out take many."""
PhaseFrom = Literal["specular", "centre"]


def ellipsoid_echoes(
    ellipsoids: Ellipsoids,
    radar: Radar,
    *,
    times_s: np.ndarray,
    material: Material | ByPart,
    phase_from: PhaseFrom = "specular",
    views: Sequence[PathVisibility] = (PathVisibility(),),
    target: int = 0,
    at_instants: bool = False,
) -> EllipsoidScatterer:
    """One echo for each ellipsoid and view at surface frames `times_s` (T,) [s]; ellipsoids do not occlude one another.

    "specular" takes phase, range and curvature from the point of shortest path, exact also in the near field; "centre" is the
    Text2Doppler paper's form: range of the centre, far-field RCS from the aspect of the long axis (its eq. 1). `views` give the
    path pairs and the visibility of each ellipsoid over them; `target` is the ellipsoids' number among the targets. With
    `at_instants` the frames are instants unrelated to one another.
    """
    return EllipsoidScatterer(
        times_s=times_s,
        target=target,
        ellipsoids=ellipsoids,
        radar=radar,
        views=tuple(views),
        reflection=values_of(
            material,
            len(ellipsoids.semi_axes_m),
            lambda of_part: of_part.reflection(radar.mid_frequency_hz).conjugate(),
        ),  # IF = tx conj(rx)
        phase_from=phase_from,
        at_instants=at_instants,
        echoes=len(views) * len(ellipsoids.semi_axes_m),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class EllipsoidScatterer(Scatterer):
    """Ellipsoids, which return one echo each over each of some path pairs."""

    target: int
    ellipsoids: Ellipsoids
    radar: Radar
    views: tuple[PathVisibility, ...]
    reflection: np.ndarray
    """conj(Gamma) of each ellipsoid, (N,)."""
    phase_from: PhaseFrom
    at_instants: bool = False
    """Whether frames are instants unrelated to one another."""

    reach = REACH_FRAMES

    @property
    @override
    def targets(self) -> Mapping[int, MovingMesh | Ellipsoids]:
        return {self.target: self.ellipsoids}

    @property
    @override
    def fractions(self) -> Iterable[Fraction]:
        return (fraction for view in self.views for fraction in view.visibility)

    @property
    @override
    def labels(self) -> EchoLabels:
        count = len(self.ellipsoids.semi_axes_m)
        return EchoLabels.joined(
            EchoLabels.of(count, target=self.target, ellipsoid=np.arange(count), path=view.name) for view in self.views
        )

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        radar, views, count = self.radar, self.views, len(self.ellipsoids.semi_axes_m)
        centres, axes = poses[self.target]
        shown, near = _shown(views, block, seen, count)
        # There is an echo over each view, whose antennas stand in places of its own; dark ones have the delay of the centre.
        tiled, axes = np.tile(centres, (1, len(views), 1)), np.tile(axes, (1, len(views), 1, 1))
        places = [PairPlaces.of(radar, view.paths).at(block.times_s).ends_m for view in views]
        tx, rx = (
            np.broadcast_to(np.repeat(np.stack(np.broadcast_arrays(*place), axis=-2), count, axis=-2), tiled.shape)
            for place in zip(*places, strict=True)
        )
        path = np.linalg.norm(tiled - tx, axis=-1) + np.linalg.norm(tiled - rx, axis=-1)
        field = np.zeros(path.shape)
        # Between an antenna and an image the ellipsoid casts a shadow and reflects nothing: the echo fades out towards that line,
        # on which none is sought.
        aside = np.linalg.norm(unit(tx - tiled) + unit(rx - tiled), axis=-1)
        fade = np.clip((aside - FORWARD[0]) / (FORWARD[1] - FORWARD[0]), 0, 1)
        lit = np.nonzero(near & (aside > FORWARD[0] / 2))
        ends = [tiled.copy(), tiled.copy()]
        semi_axes = self.ellipsoids.semi_axes_m[lit[1] % count]
        model = {"specular": _specular, "centre": _centre}[self.phase_from]
        with np.errstate(invalid="ignore"):
            results = model(tiled[lit], axes[lit], semi_axes, tx[lit], rx[lit])
        # Almost in line with both antennas the search may fail; such echoes have faded out and stay dark.
        finite = np.isfinite(results[0] + results[1])
        lit = (lit[0][finite], lit[1][finite])
        path[lit], field[lit], ends[0][lit], ends[1][lit] = (column[finite] for column in results)
        field *= radar.link_amplitude * fade * fade * (3 - 2 * fade)
        field = np.tile(self.reflection, len(views)) * field
        echoes = EchoArrays(path / SPEED_OF_LIGHT, (field * shown).astype(np.complex64))
        pairs = [view.paths for view in views if view.paths is not None]
        if not pairs:  # in free space
            return seen_by(radar, echoes, *ends)
        echoes = self._over(pairs, echoes, block, centres)
        if not radar.is_array:
            return echoes
        parts = []
        for number, pair in enumerate(pairs):
            columns = slice(number * count, (number + 1) * count)
            of_pair = EchoArrays(*(column[:, columns] for column in echoes if column is not None))
            parts.append(unfolded(radar, of_pair, pair, block.times_s, *(end[:, columns] for end in ends)))
        return concatenated(parts)

    def _over(
        self, pairs: Sequence[PathPair], echoes: EchoArrays, block: FrameBlock, centres: np.ndarray
    ) -> EchoArrays:
        """Echoes (T, N) of all n ellipsoids over one pair after another, times the paths' fields at their centres (T, n, 3) [m]."""
        if self.at_instants:
            weights = ArrivingFields.of(self.radar, pairs, centres, block.times_s).weights()
        else:
            weights = faded_weights(self.radar, pairs, block, centres, self.ellipsoids.points_at)
        factors = (weight.swapaxes(0, 1).reshape(echoes.amplitude.shape) for weight in weights)
        amplitude, slope = ((echoes.amplitude * factor).astype(np.complex64) for factor in factors)
        extra_s = np.repeat([pair.delay_s for pair in pairs], centres.shape[1])
        return echoes._replace(delay_s=echoes.delay_s + extra_s, amplitude=amplitude, slope=slope)


def _shown(
    views: Sequence[PathVisibility], block: FrameBlock, seen: Visibility, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Visibility (T, views x count) of each ellipsoid in each view at the frames of a block, and whether it is above 0 at any frame
    from `REACH_FRAMES` before to as many after."""
    from scipy.ndimage import maximum_filter1d

    frames = len(block.wider(REACH_FRAMES))
    visibilities = [product([seen[fraction] for fraction in view.visibility]) for view in views]
    fractions = np.concatenate(
        [np.ones((frames, count)) if values is None else values for values in visibilities], axis=1
    )
    begin = block.first - max(0, block.first - REACH_FRAMES)
    of_block = slice(begin, begin + block.last - block.first)
    near = maximum_filter1d(fractions, 2 * REACH_FRAMES + 1, axis=0, mode="constant") > 0
    return fractions[of_block], near[of_block]


def specular_points(
    centres: np.ndarray, axes: np.ndarray, semi_axes_m: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points of shortest path tx - ellipsoid - rx [m] and outward normals there, each (..., 3), in world axes.

    Centres, semi-axes and antennas are (..., 3) [m]; `axes` (..., 3, 3) has the ellipsoid's unit axes as columns. At the point the
    normal n bisects the directions to the antennas, and in the ellipsoid's axes the point with normal n is D^2 n/|D n|, D the
    diagonal matrix of the semi-axes. It is found by Newton's method on the surface, where the Hessian is positive definite wherever
    both antennas see the point, however flat the ellipsoid is. (To take the bisector as the next normal would diverge where the
    radius of curvature exceeds the range.)
    """
    shape = centres.shape
    flat = np.reshape(axes, (-1, 3, 3))
    middle, *antennas = (np.broadcast_to(vectors, shape).reshape(-1, 3).T for vectors in (centres, tx_m, rx_m))
    semi_axes = np.broadcast_to(semi_axes_m, shape).reshape(-1, 3).T
    point, normal = _nearest(semi_axes, *(_rotated(flat.swapaxes(1, 2), antenna - middle) for antenna in antennas))
    return (middle + _rotated(flat, point)).T.reshape(shape), _rotated(flat, normal).T.reshape(shape)


def _nearest(semi_axes_m: np.ndarray, tx: np.ndarray, rx: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points [m] and normals of `specular_points` in the ellipsoids' own axes; all arrays are (3, M), components first."""
    normal = _unit(_unit(tx) / semi_axes_m + _unit(rx) / semi_axes_m)
    going = np.arange(normal.shape[1])
    for _ in range(MOST_STEPS):
        normal[:, going], step = _nearer(*(vectors[:, going] for vectors in (normal, semi_axes_m, tx, rx)))
        going = going[step >= CONVERGED_RAD]
        if not len(going):
            break
    return semi_axes_m**2 * normal / _length(semi_axes_m * normal), normal


def _nearer(
    normal: np.ndarray, semi_axes_m: np.ndarray, tx: np.ndarray, rx: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One step of Newton's method towards the shortest path: the new normals (3, M) and how far they rotated (M,) [rad]."""
    tangents = _tangents(normal)
    curvature = _curvature(normal, tangents, semi_axes_m)
    bend, towards, _ = _seen_from((tx, rx), semi_axes_m**2 * normal / _length(semi_axes_m * normal), tangents)
    facing = np.maximum(dot(normal, towards), FORWARD[0] / 2)
    a, b, c = (one + facing * other for one, other in zip(bend, curvature, strict=True))
    x, y = (dot(tangent, towards) for tangent in tangents)
    x, y = ((c * x - b * y) / (a * c - b * b), (a * y - b * x) / (a * c - b * b))
    x, y = curvature[0] * x + curvature[1] * y, curvature[1] * x + curvature[2] * y
    # The normal rotates by at most half a radian at once.
    most = np.maximum(1, 2 * np.sqrt(x**2 + y**2))
    x, y = x / most, y / most
    return _unit(normal + x * tangents[0] + y * tangents[1]), np.maximum(np.abs(x), np.abs(y))


def _seen_from(
    antennas: Sequence[np.ndarray], point: np.ndarray, tangents: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], np.ndarray, list[np.ndarray]]:
    """Hessian (xx, xy, yy) of the sum of the distances from the antennas along two tangents at points (3, M), as if the surface
    were flat; the sum of the unit vectors to the antennas; and the distances [m]."""
    bend, ranges = [np.zeros(point.shape[1]) for _ in range(3)], []
    towards = np.zeros_like(point)
    for antenna in antennas:
        offset = antenna - point
        distance = _length(offset)
        offset /= distance
        towards += offset
        x, y = (dot(tangent, offset) for tangent in tangents)
        for total, term in zip(bend, (1 - x * x, -x * y, 1 - y * y), strict=True):
            total += term / distance
        ranges.append(distance)
    return bend, towards, ranges


def _curvature(normal: np.ndarray, tangents: Sequence[np.ndarray], semi_axes_m: np.ndarray) -> list[np.ndarray]:
    """Curvature (xx, xy, yy) [1/m] of sum (x_i/a_i)^2 = 1 along two tangents: p T^t diag(1/a^2) T, p = |D n| the distance of the
    tangent plane from the centre."""
    plane = _length(semi_axes_m * normal)
    scaled = [tangent / semi_axes_m**2 for tangent in tangents]
    return [dot(scaled[i], tangents[k]) * plane for i, k in ((0, 0), (0, 1), (1, 1))]


def _specular(
    centres: np.ndarray, axes: np.ndarray, semi_axes_m: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Path [m] and sqrt(sigma)/(R_tx R_rx) (M,), sigma = 4 pi cos^2(beta/2)/det H, beta the bistatic angle and H the Hessian of the
    path on the surface; and the points (M, 3) [m] from which the echo seems to come for transmitters and for receivers.

    For a single antenna det H = 4 (k1 + 1/R)(k2 + 1/R), so that sigma = pi R1 R2/((1 + R1/R)(1 + R2/R)) as in eq. 8.
    """
    antennas = [_rotated(axes.swapaxes(1, 2), (place - centres).T) for place in (tx_m, rx_m)]
    point, normal = _nearest(semi_axes_m.T, *antennas)
    tangents = _tangents(normal)
    curvature = _curvature(normal, tangents, semi_axes_m.T)
    bend, towards, ranges = _seen_from(antennas, point, tangents)
    cosine = dot(normal, towards)
    a, b, c = (one + cosine * other for one, other in zip(bend, curvature, strict=True))
    field = math.sqrt(math.pi) * cosine / np.sqrt(a * c - b * b) / (ranges[0] * ranges[1])
    # Seen from a little aside, the nearest point moves on the surface, as if the echo came from its centre of curvature.
    radius = 2 / (curvature[0] + curvature[2])
    place = centres + _rotated(axes, point).T
    apparent = (
        antenna + (1 + radius / distance)[:, None] * (place - antenna)
        for antenna, distance in zip((tx_m, rx_m), ranges, strict=True)
    )
    return (ranges[0] + ranges[1], field, *apparent)


def _centre(
    centres: np.ndarray, axes: np.ndarray, semi_axes_m: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, ...]:
    """What `_specular` returns, with the centre in place of the specular point and sigma by eq. 1 of the Text2Doppler paper:

    sigma = pi a^4 c^2/(a^2 sin^2 psi + c^2 cos^2 psi)^2, where psi lies between the long axis (the third) and the bisector of the
    two paths, and a^2 is the product of the two short semi-axes.
    """
    to_tx, to_rx = tx_m - centres, rx_m - centres
    r_tx, r_rx = np.linalg.norm(to_tx, axis=-1), np.linalg.norm(to_rx, axis=-1)
    cosine = np.einsum("...i,...i->...", axes[..., 2], unit(unit(to_tx) + unit(to_rx)))
    a2, c2 = semi_axes_m[..., 0] * semi_axes_m[..., 1], semi_axes_m[..., 2] ** 2
    rcs = math.pi * a2**2 * c2 / (a2 * (1 - cosine**2) + c2 * cosine**2) ** 2
    return r_tx + r_rx, np.sqrt(rcs) / (r_tx * r_rx), centres, centres


def _tangents(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit tangents of unit normals (3, M)."""
    helper = np.where(np.abs(normal[0]) < 0.6, *np.eye(3)[:2, :, None])
    first = _unit(np.stack(cross(normal, helper)))
    return first, np.stack(cross(normal, first))


def _rotated(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products (3, M) of matrices (M, 3, 3) and vectors (3, M)."""
    return np.stack([dot(axes[:, row].T, vectors) for row in range(3)])


def _length(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors (3, M)."""
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (3, M) of length one."""
    return np.asarray(vectors / _length(vectors))
