"""Parts of a recording by name: the segment, the path pair, the target or the bounces that each echo comes from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from t2d_rt.body.fit import fit
from t2d_rt.body.segments import SEGMENTS, segment_of_faces
from t2d_rt.body.template import template
from t2d_rt.core.checks import shown
from t2d_rt.core.cubes import DiskCube
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.types import Motion, MovingMesh
from t2d_rt.types.scatterer import EchoLabels, EchoParts, Scatterer

Split = Literal["segment", "path", "target", "bounce"]
"""What the parts of a recording differ in."""
STATIC = "static scene"
"""The part of echoes that no target takes part in."""
BETWEEN = "several bounces"
"""The part of echoes over several surfaces, which belong to none of them."""
UNLABELLED = "no target"
"""The part of single bounces whose labels name no target, as those of other packages may."""
MOST_PIECES = 24
"""A mesh of more pieces that hang together is one part."""


def checked_split(split: str | None) -> Split | None:
    """One of the kinds of parts, or None."""
    if split is not None and split not in get_args(Split):
        raise InputError(f"split must be one of {', '.join(get_args(Split))}, got {shown(split)}")
    return split  # type: ignore[return-value]


def part_names(split: Split, labels: EchoLabels, model: Model) -> np.ndarray:
    """The part that each of N echoes belongs to, names (N,).

    Segments are those of bodies, and the pieces of other meshes that hang together, such as a fan's hub and blades; the name of the
    target stands before theirs where there are several targets.
    """
    if split == "bounce":
        words = np.array(
            [STATIC, "1 bounce", *(f"{count} bounces" for count in range(2, labels.bounces.max(initial=1) + 1))]
        )
        return words[labels.bounces]
    if split == "path":
        return np.where(labels.bounces == 0, STATIC, labels.path.astype(str))
    found = np.array([STATIC, UNLABELLED, BETWEEN], object)[np.minimum(labels.bounces, 2)]
    for number, name in enumerate(target_names(model)):
        mine = labels.target == number
        found[mine] = name
        if split == "segment":
            before = "" if len(model.modelled) == 1 else f"{name}: "
            for kind, names in (("face", face_segments(model, number)), ("ellipsoid", ellipsoid_names(model, number))):
                place = getattr(labels, kind)
                own = mine & (place >= 0)
                found[own] = [before + names[each] for each in place[own]]
    return found.astype(str)


def target_names(model: Model) -> list[str]:
    """Names of the targets, with a number where several have the same."""
    names = ["person" if isinstance(each.source, Motion) else each.geometry.name for each in model.modelled]
    return [
        name if names.count(name) == 1 else f"{name} {names[:number].count(name) + 1}"
        for number, name in enumerate(names)
    ]


def face_segments(model: Model, number: int) -> list[str]:
    """The segment that each face of a target's mesh belongs to; nothing where it has no mesh."""
    target = model.modelled[number]
    if target.mesh is None:
        return []
    made, motion, body = target.mesh.made, target.source, model.body
    if made is not None and made.by == "skin":
        motion, body = made.arguments["motion"], made.arguments["body"]
    if not isinstance(motion, Motion):
        return _pieces(target.mesh, target_names(model)[number])
    segments = list(SEGMENTS)
    return [segments[owner] for owner in segment_of_faces(fit(template(body), motion))]


def ellipsoid_names(model: Model, number: int) -> Sequence[str]:
    """Names of a target's ellipsoids; nothing where it has none."""
    ellipsoids = model.modelled[number].ellipsoids()
    return () if ellipsoids is None else ellipsoids.names


def _pieces(mesh: MovingMesh, name: str) -> list[str]:
    """The piece of the mesh that each face hangs together with, counted from the first face on."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Files of loose triangles have each vertex several times.
    _, same = np.unique(np.round(mesh.rest, 6), axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]).T
    joined = coo_array((np.ones(ends.shape[1], bool), tuple(ends)), shape=(faces.max() + 1,) * 2)
    count, piece = connected_components(joined, directed=False)
    if not 1 < count <= MOST_PIECES:
        return [name] * len(faces)
    _, first, place = np.unique(piece[faces[:, 0]], return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return [f"{name} piece {order[each] + 1}" for each in place]


class PartCubes:
    """The cubes that parts are summed to, each of which comes into being with its first echo.

    They hold products of which samples are made when they are read (`ProductRows`): a tenth of the samples and less.
    """

    def __init__(self, split: Split | None, model: Model) -> None:
        self.split, self._model = split, model
        self.cubes: dict[str, DiskCube] = {}

    def of(self, scatterers: Scatterer) -> EchoParts | None:
        """Which part each of their echoes belongs to; None where all are one.

        Echoes of path pairs that are switched off are silent; several bounces are on the direct one.
        """
        model = self._model
        if self.split is None and model.paths_on is None:
            return None
        labels, radar = scatterers.labels, model.radar
        on = np.ones(scatterers.echoes, bool)
        if model.paths_on is not None:
            on = (labels.bounces == 0) | np.isin(labels.path.astype(str), sorted(model.paths_on))
        names, number = np.zeros(0, str), np.zeros(scatterers.echoes, int)
        if self.split is not None:
            every = part_names(self.split, labels, model)[on]
            names, first, found = np.unique(every, return_index=True, return_inverse=True)
            order = np.argsort(first)  # as they come: segments by the body's faces, path pairs by their strength
            names, number[on] = names[order], np.argsort(order)[found]
        number[~on] = -1
        shape = len(radar.chirp_times_s(model.span_s[1] - model.span_s[0])), radar.antennas, radar.samples
        for name in names.tolist():
            self.cubes.setdefault(name, DiskCube(ProductRows(shape)))
        return EchoParts(number, [self.cubes[name] for name in names.tolist()])
