"""Parts of a recording by name: the segment, the path pair, the target or the bounces that each echo comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from t2d_rt.body.fit import fit
from t2d_rt.body.segments import SEGMENTS, segment_of_faces
from t2d_rt.body.template import template
from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.cube_storage import ScratchFile
from t2d_rt.core.cubes import Cube, DiskCube
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.types import Accuracy, Motion, MovingMesh
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


class PartNames:
    """Names of parts by the labels of echoes, no two parts of one name.

    Segments are those of bodies, and the pieces of other meshes that hang together, such as a fan's hub and blades; the name of the
    target stands before theirs where there are several targets.
    """

    def __init__(self, split: Split, model: Model) -> None:
        self.split = split
        targets, self._segments = _parts_of_targets(model), list[_Segments]()
        keys = [(number, "") for number in range(len(targets))]
        if split == "segment":
            self._segments = [_Segments.of(model, number) for number in range(len(targets))]
            of_segments = [
                (number, name) for number, segments in enumerate(self._segments) for name in segments.names if name
            ]
            keys = of_segments + keys  # what has no segment comes last
        before = [f"{name}: " if len(targets) > 1 else "" for name in numbered(targets)]
        wished = [before[number] + name if name else targets[number] for number, name in keys]
        distinct = numbered(wished, taken=(STATIC, UNLABELLED, BETWEEN))
        self._names = dict(zip(keys, distinct, strict=True))
        self.renamed = {name: wish for name, wish in zip(distinct, wished, strict=True) if name != wish}
        """What parts would be called if no other one had that name, by what they are called."""

    @property
    def count(self) -> int:
        """Most parts of segments and targets that there can be."""
        return len(self._names) + 3

    def of_target(self, number: int, *, ellipsoids: bool) -> tuple[str, list[str]]:
        """The part that a target is, and those of its faces, or of its ellipsoids, where they are split by segment."""
        segments = self._segments[number]
        names = segments.of_ellipsoids if ellipsoids else segments.of_faces
        return self._names[number, ""], [self._names[number, name] for name in names]

    def of(self, labels: EchoLabels) -> np.ndarray:
        """The part that each of N echoes belongs to, names (N,)."""
        if self.split == "bounce":
            more = (f"{count} bounces" for count in range(2, labels.bounces.max(initial=1) + 1))
            return np.array([STATIC, "1 bounce", *more])[labels.bounces]
        if self.split == "path":
            path = np.where(labels.path == STATIC, f"{STATIC} 2", labels.path.astype(str))
            return np.where(labels.bounces == 0, STATIC, path)
        parts = np.array([STATIC, UNLABELLED, BETWEEN], object)[np.minimum(labels.bounces, 2)]
        for number in {number for number, _ in self._names}:
            mine = labels.target == number
            parts[mine] = self._names[number, ""]
            for segments in self._segments[number : number + 1]:
                for names, place in ((segments.of_faces, labels.face), (segments.of_ellipsoids, labels.ellipsoid)):
                    chosen = mine & (place >= 0)
                    parts[chosen] = [self._names[number, names[segment]] for segment in place[chosen]]
        return parts.astype(str)


@dataclass(frozen=True, slots=True)
class _Segments:
    """The segment of a target that each of its faces and its ellipsoids belongs to; an empty name is the target itself."""

    of_faces: Sequence[str]
    of_ellipsoids: Sequence[str]

    @property
    def names(self) -> list[str]:
        """Names of the segments of faces and ellipsoids, each once, in their order."""
        return list(dict.fromkeys([*self.of_faces, *self.of_ellipsoids]))

    @classmethod
    def of(cls, model: Model, number: int) -> _Segments:
        """The segments of the target of that number."""
        target, body = model.modelled[number], model.body
        made, motion = None if target.mesh is None else target.mesh.made, target.source
        if made is not None and made.by == "skin":
            motion, body = made.arguments["motion"], made.arguments["body"]
        segments = list(SEGMENTS)
        if not isinstance(motion, Motion):
            ellipsoids = target.ellipsoids()
            return cls(_pieces(target.mesh) if target.mesh else (), () if ellipsoids is None else ellipsoids.names)
        owners = segment_of_faces(fit(template(body), motion)) if target.mesh else ()
        return cls([segments[owner] for owner in owners], segments)


def _parts_of_targets(model: Model) -> list[str]:
    """The part that each target is, with a number where several have the same name."""
    names = ["person" if isinstance(target.source, Motion) else target.geometry.name for target in model.modelled]
    return [
        name if names.count(name) == 1 else f"{name} {names[:number].count(name) + 1}"
        for number, name in enumerate(names)
    ]


def _pieces(mesh: MovingMesh) -> list[str]:
    """The piece of the mesh that each face hangs together with, counted from the first face on; empty names where it is one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Files of loose triangles have each vertex several times.
    _, same = np.unique(np.round(mesh.rest, 6), axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]).T
    joined = coo_array((np.ones(ends.shape[1], bool), tuple(ends)), shape=(faces.max() + 1,) * 2)
    count, piece = connected_components(joined, directed=False)
    if not 1 < count <= MOST_PIECES:
        return [""] * len(faces)
    _, first, place = np.unique(piece[faces[:, 0]], return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return [f"piece {order[index] + 1}" for index in place]


class PartCubes:
    """The cubes that parts are summed to, each of which comes into being with its first echo.

    They hold products of which samples are made when they are read (`ProductRows`), all in one file.
    """

    def __init__(self, split: Split | None, model: Model, *, factored: bool = False) -> None:
        """factored: whether the cube of the whole holds products, too."""
        self._model, self._file = model, ScratchFile() if split else None
        self._names = PartNames(split, model) if split else None
        self._rows: dict[str, ProductRows] = {}
        self.whole: Cube | None = DiskCube(ProductRows(self._axes)) if factored else None
        """What all echoes are added to; None where the sum makes a cube of its own."""

    @property
    def _axes(self) -> tuple[int, int, int]:
        radar, (start_s, stop_s) = self._model.radar, self._model.span_s
        return len(radar.chirp_times_s(stop_s - start_s)), radar.antennas, radar.samples

    @property
    def cubes(self) -> dict[str, DiskCube]:
        """ADC cubes by the parts' names."""
        return {name: DiskCube(rows) for name, rows in self._rows.items()}

    def most(self, accuracy: Accuracy) -> int:
        """Most parts that there can be; 0 without a split."""
        if self._names is None:
            return 0
        pairs = self._model.pairs(accuracy)
        of_split = {"path": 1 + (1 if pairs is None else len(pairs.pairs)), "bounce": 1 + self._model.bounces}
        return of_split.get(self._names.split, self._names.count)

    def of(self, scatterers: Scatterer) -> EchoParts | None:
        """Which part each of their echoes belongs to; None where all are one.

        Echoes of path pairs that are switched off are silent; several bounces are on the direct one.
        """
        model = self._model
        if self._names is None and model.paths_on is None:
            return None
        labels = scatterers.labels
        on = np.ones(scatterers.echoes, bool)
        if model.paths_on is not None:
            on = (labels.bounces == 0) | np.isin(labels.path.astype(str), sorted(model.paths_on))
        names, number = np.zeros(0, str), np.zeros(scatterers.echoes, int)
        if self._names is not None:
            echo_names = self._names.of(labels)[on]
            names, first, inverse = np.unique(echo_names, return_index=True, return_inverse=True)
            order = np.argsort(first)  # as they come: segments by the body's faces, path pairs by their strength
            names, number[on] = names[order], np.argsort(order)[inverse]
        number[~on] = -1
        return EchoParts(number, [self._part(name) for name in names.tolist()])

    def _part(self, name: str) -> ProductRows:
        """The rows of a part, new ones where it has had no echo."""
        if name not in self._rows:
            self._rows[name] = ProductRows(self._axes, self._file)
            if self._names is not None and (wished := self._names.renamed.get(name)):
                warn(f"the part {wished} is called {name}, as another part has that name; give the target another name")
        return self._rows[name]
