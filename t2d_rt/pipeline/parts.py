"""Splits a recording into named parts: by segment, path pair, target, or number of bounces of each echo."""

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
"""What the parts of a recording are distinguished by."""
STATIC = "static scene"
"""Name of the part for echoes of the static scene alone."""
BETWEEN = "several bounces"
"""Name of the part for echoes over several surfaces, which belong to none of these."""
UNLABELLED = "no target"
"""Name of the part for single bounces whose labels name no target, as scatterers of other packages may return them."""
MOST_PIECES = 24
"""A mesh of more separate pieces than this is one part."""


def checked_split(split: str | None) -> Split | None:
    """A checked way to split a recording, or None."""
    if split is not None and split not in get_args(Split):
        raise InputError(f"split must be one of {', '.join(get_args(Split))}, got {shown(split)}")
    return split  # type: ignore[return-value]


class PartNames:
    """The name of the part of each echo, from its labels; no two parts have the same name.

    Segments are those of bodies, and the connected pieces of other meshes, such as the hub and the blades of a fan. Where there are
    several targets, the name of the target stands before that of the segment.
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
            keys = of_segments + keys  # targets without segments come last
        before = [f"{name}: " if len(targets) > 1 else "" for name in numbered(targets)]
        wished = [before[number] + name if name else targets[number] for number, name in keys]
        distinct = numbered(wished, taken=(STATIC, UNLABELLED, BETWEEN))
        self._names = dict(zip(keys, distinct, strict=True))
        self.renamed = {name: wish for name, wish in zip(distinct, wished, strict=True) if name != wish}
        """For parts whose name had to be changed because another part has it, the original name by the new one."""

    @property
    def count(self) -> int:
        """Upper limit of the number of parts by segments or targets."""
        return len(self._names) + 3

    def of_target(self, number: int, *, ellipsoids: bool) -> tuple[str, list[str]]:
        """Name of the part for a target itself, and names of the parts for each of its faces, or of its ellipsoids, where they are
        split by segment."""
        segments = self._segments[number]
        names = segments.of_ellipsoids if ellipsoids else segments.of_faces
        return self._names[number, ""], [self._names[number, name] for name in names]

    def of(self, labels: EchoLabels) -> np.ndarray:
        """Name of the part of each of N echoes, (N,)."""
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
    """Name of the segment of each face, and of each ellipsoid, of a target; an empty name stands for the target itself."""

    of_faces: Sequence[str]
    of_ellipsoids: Sequence[str]

    @property
    def names(self) -> list[str]:
        """Names of all segments, each once, in the order of faces and ellipsoids."""
        return list(dict.fromkeys([*self.of_faces, *self.of_ellipsoids]))

    @classmethod
    def of(cls, model: Model, number: int) -> _Segments:
        """The segments of the target of that index."""
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
    """Name of the part of each target, with a number where several have the same name."""
    names = ["person" if isinstance(target.source, Motion) else target.geometry.name for target in model.modelled]
    return [
        name if names.count(name) == 1 else f"{name} {names[:number].count(name) + 1}"
        for number, name in enumerate(names)
    ]


def _pieces(mesh: MovingMesh) -> list[str]:
    """Name of the connected piece to which each face of a mesh belongs, numbered from the first face on; empty names for a mesh of
    one piece, or of too many."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Files of loose triangles repeat each vertex, so equal positions count as one vertex.
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
    """The ADC cubes to which the parts of a recording are summed; each is created with its first echo.

    They store products, from which samples are computed when they are read (`ProductRows`), all in one file.
    """

    def __init__(self, split: Split | None, model: Model, *, factored: bool = False) -> None:
        """factored: whether the cube of the whole recording stores products, too."""
        self._model, self._file = model, ScratchFile() if split else None
        self._names = PartNames(split, model) if split else None
        self._rows: dict[str, ProductRows] = {}
        self.whole: Cube | None = DiskCube(ProductRows(self._axes)) if factored else None
        """The cube to which all echoes are added; None where the synthesis creates it."""

    @property
    def _axes(self) -> tuple[int, int, int]:
        radar, (start_s, stop_s) = self._model.radar, self._model.span_s
        return len(radar.chirp_times_s(stop_s - start_s)), radar.antennas, radar.samples

    @property
    def cubes(self) -> dict[str, DiskCube]:
        """ADC cube of each part by the part's name."""
        return {name: DiskCube(rows) for name, rows in self._rows.items()}

    def most(self, accuracy: Accuracy) -> int:
        """Upper limit of the number of parts; 0 without a split."""
        if self._names is None:
            return 0
        pairs = self._model.pairs(accuracy)
        of_split = {"path": 1 + (1 if pairs is None else len(pairs.pairs)), "bounce": 1 + self._model.bounces}
        return of_split.get(self._names.split, self._names.count)

    def of(self, scatterers: Scatterer) -> EchoParts | None:
        """Assigns the echoes of scatterers to parts; None where all belong to one.

        Echoes of path pairs that are switched off are left out of the sum; those of several bounces belong to the direct pair.
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
            order = np.argsort(first)  # in order of appearance
            names, number[on] = names[order], np.argsort(order)[inverse]
        number[~on] = -1
        return EchoParts(number, [self._part(name) for name in names.tolist()])

    def _part(self, name: str) -> ProductRows:
        """The rows of the cube of a part; new ones with its first echo."""
        if name not in self._rows:
            self._rows[name] = ProductRows(self._axes, self._file)
            if self._names is not None and (wished := self._names.renamed.get(name)):
                warn(f"the part {wished} is called {name}, as another part has that name; give the target another name")
        return self._rows[name]
