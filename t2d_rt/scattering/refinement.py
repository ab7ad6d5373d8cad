"""Facets of a mesh: its refinements, kept from run to run, and values carried along from its own vertices to theirs."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from t2d_rt.core import disk_cache
from t2d_rt.core.backend import aligned_empty, in_threads
from t2d_rt.core.memory import REUSED_BYTES, MemoryLimit, reused
from t2d_rt.geometry import Refinement, curved_refinements, refinements
from t2d_rt.scattering.patches import Csr, PairPlaces, least_range_m
from t2d_rt.types import ByPart, MovingMesh, Radar

# Diffuse points lie on a refinement of their own fixed fineness, so that they do not depend on the facets' size: a point is off
# the curved surface by a tenth of this phase or so, always the same.
POINT_SAGITTA_RAD = 0.7
KEPT_FACETS = 300_000
"""Facets of the last used refinements that are kept in memory, at some 800 bytes each; others are read from disk in
milliseconds."""
REFINING_BYTES = 1_700
"""Memory [bytes] that a facet takes while it is made (measured with 110 000 to 1 000 000 facets of a body)."""
MOST_FACETS = 1_000_000
"""Greatest number of facets of one mesh, unless a run may take more memory."""
ROWS_AT_ONCE = 1_000
"""Number of vertices carried along at once: their positions at all instants of a block fit the cache."""
_by_key: OrderedDict[str, Refinement] = OrderedDict()
KEPT_FLAT = 200_000
"""Number of flat facets of the last used curved refinements that are kept in memory."""
_flat: OrderedDict[tuple[str, bytes], Refinement] = OrderedDict()
_lock = threading.Lock()
"""Held by the thread that looks into `_by_key` and `_flat`."""
Sagitta = float | np.ndarray
"""One phase sagitta [rad], or one for each vertex, (V,)."""


def facets(
    surface: MovingMesh,
    radar: Radar,
    sagitta_rad: Sagitta,
    *,
    span_s: tuple[float, float],
    max_facets: int = MOST_FACETS,
) -> MovingMesh:
    """The facets that `mesh_echoes` would sum in free space, as a mesh of their own."""
    wavenumber = 2 * math.pi / radar.wavelength_m
    range_m = least_range_m(surface, [PairPlaces.of(radar)], np.array(span_s))
    fine, _ = refined(surface, wavenumber, range_m, [sagitta_rad, POINT_SAGITTA_RAD], max_facets)
    fine = flattened(fine, surface.rest)
    return MovingMesh.from_track(
        lambda times_s: apply_operator(fine.operator, fine.controlled(surface.at(times_s))).swapaxes(0, 1),
        fine.faces,
        surface.times_s,
        surface.material.of_faces(fine.base_face) if isinstance(surface.material, ByPart) else surface.material,
        rest=fine.at(surface.rest),
        name=surface.name,
    )


def refined(
    surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Sagitta], max_facets: int
) -> list[Refinement]:
    """Refinements of a mesh, one for each sagitta. Each is kept, on disk too, for the next recording of the same body or of one
    that is refined as the same shape; those that are missing are made together. Raises InputError if one has more than
    `max_facets`.

    `wavenumber` is in rad/m, and `range_m` as `least_range_m` rounds it, so that recordings at about the same distance share them.
    """
    rest = surface.refined_rest
    common = rest, surface.faces, wavenumber, range_m, surface.crease_deg, surface.curved
    keys = [disk_cache.key("geometry", ("refinement", *common, np.asarray(sagitta, float))) for sagitta in sagittas_rad]
    with _lock:
        missing = {key: sagitta for key, sagitta in zip(keys, sagittas_rad, strict=True) if _needed(key, max_facets)}
        if missing:
            make = curved_refinements if surface.curved else partial(refinements, crease_deg=surface.crease_deg)
            new = make(
                rest,
                surface.faces,
                wavenumber=wavenumber,
                range_m=range_m,
                sagittas_rad=list(missing.values()),
                max_faces=max_facets,
            )
            for key, refinement in zip(missing, new, strict=True):
                _by_key[key] = replace(refinement, key=key)
                disk_cache.write(key, _as_arrays(refinement))
        in_order = [_by_key[key] for key in keys]
        for key in keys:
            _by_key.move_to_end(key)
        while len(_by_key) > len(keys) and sum(len(stored.faces) for stored in _by_key.values()) > KEPT_FACETS:
            _by_key.popitem(last=False)
    return in_order


def _needed(key: str, max_facets: int) -> bool:
    """Whether a refinement must be made: it is not kept, or it has too many facets, which making it will report."""
    if key not in _by_key and (arrays := disk_cache.read(key, _ARRAYS)) is not None:
        _by_key[key] = replace(_of_arrays(arrays), key=key)
    return key not in _by_key or len(_by_key[key].faces) > max_facets


_SPARSE = "data", "indices", "indptr", "shape"
_MATRICES = "operator", "linear", "control"
_ARRAYS = "faces", "base_face", "middles", *(f"{name}_{part}" for name in _MATRICES for part in _SPARSE)


def _as_arrays(refinement: Refinement) -> dict[str, np.ndarray]:
    """A refinement as arrays for the disk; those that flat facets lack are empty."""
    from scipy.sparse import csr_matrix

    middles = np.empty((0, 3), np.int32) if refinement.middles is None else refinement.middles
    arrays = {"faces": refinement.faces, "base_face": refinement.base_face, "middles": middles}
    for name in _MATRICES:
        matrix = csr_matrix((0, 0)) if getattr(refinement, name) is None else getattr(refinement, name)
        arrays |= {f"{name}_{part}": np.asarray(getattr(matrix, part)) for part in _SPARSE}
    return arrays


def _of_arrays(arrays: Mapping[str, np.ndarray]) -> Refinement:
    """The refinement that `_as_arrays` stored."""
    from scipy.sparse import csr_matrix

    operator, linear, control = (
        csr_matrix(tuple(arrays[f"{name}_{part}"] for part in _SPARSE[:3]), shape=tuple(arrays[f"{name}_shape"]))
        for name in _MATRICES
    )
    flat = not len(arrays["middles"])
    return Refinement(
        operator=operator,
        faces=arrays["faces"],
        base_face=arrays["base_face"],
        linear=linear,
        middles=None if flat else arrays["middles"],
        control=None if flat else control,
    )


def flattened(refinement: Refinement, rest: np.ndarray) -> Refinement:
    """`Refinement.flattened` for the coarse vertices `rest` (V, 3) m, kept for the next recording of the same body."""
    if refinement.key is None or refinement.middles is None:
        return refinement.flattened(rest)
    key = refinement.key, rest.tobytes()
    with _lock:
        stored = _flat.pop(key, None)
    flat = refinement.flattened(rest) if stored is None else stored
    with _lock:
        _flat[key] = flat
        while sum(len(other.faces) for other in _flat.values()) > KEPT_FLAT:
            _flat.popitem(last=False)
    return flat


def most_facets(memory: MemoryLimit) -> int:
    """Greatest number of facets of one mesh in the memory that a run may take."""
    return int(memory.limit_bytes / REFINING_BYTES)


def forget() -> None:
    """Drops the refinements that this process keeps; without those on disk the next recording takes as long as a first one."""
    with _lock:
        _by_key.clear()
        _flat.clear()


def apply_operator(operator: Csr, values: np.ndarray) -> np.ndarray:
    """Applies a sparse matrix (Vf, V) to values (K, V, C) of the cage and returns (Vf, K, C), in memory of `aligned_empty`."""
    rows, (frames, count, width) = operator.shape[0], values.shape
    columns = np.ascontiguousarray(values.transpose(1, 0, 2)).reshape(count, frames * width)
    size = rows * frames * width
    memory = reused if size * values.itemsize >= REUSED_BYTES else None
    out = aligned_empty(size, values.dtype, memory).reshape(rows, frames * width)

    def carry(first: int) -> None:
        block = slice(first, first + ROWS_AT_ONCE)
        out[block] = operator[block] @ columns

    in_threads(carry, range(0, rows, ROWS_AT_ONCE))  # a sparse product releases Python's lock
    return out.reshape(rows, frames, width)
