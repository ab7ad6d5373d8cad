"""Predicted time of a run, by fitted laws of its parts, and predicted memory; both are known before the run starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.accuracy.error_laws import COARSER, Laws
from t2d_rt.accuracy.estimate import FIELD_BYTES
from t2d_rt.core.cubes import is_large
from t2d_rt.core.memory import release
from t2d_rt.geometry.refine import curvature
from t2d_rt.geometry.vectors import norms
from t2d_rt.pipeline.echo_model import Model, resolved, sagitta_rad
from t2d_rt.pipeline.path_pairs import Clutter
from t2d_rt.pipeline.prepare import Prepared
from t2d_rt.radar.repetition import table_bytes
from t2d_rt.radar.synthesize import FIELDS_BYTES, RECEIVERS, USUAL_NODES, WAITING_BYTES
from t2d_rt.scattering.mesh import POINTS_PER_MESH
from t2d_rt.scattering.patches import rounded_range_m
from t2d_rt.scattering.refinement import POINT_SAGITTA_RAD, REFINING_BYTES
from t2d_rt.scattering.streams import most_echoes
from t2d_rt.types import Accuracy, MovingMesh, PathTier
from t2d_rt.types.material import is_rough

SUMMED_BYTES, SUMMED_ARRAY_BYTES = 6_900, 12_000
"""Bytes that an echo takes while a window of frames is summed: for one antenna, and for an array. (These constants and those that
follow are a least-squares fit to the peak memory of 11 runs, 0.34 to 1.48 GB, which they reproduce within 10 %.)"""
POSED_BYTES = 1_000
"""Bytes for the positions of a facet's vertex in the frames of a window."""
SAMPLED_BYTES = 5_400
"""Bytes for a point at which visibility is sampled, in the frames of a window."""
PART_BYTES = 3e5
"""Bytes for the groups of echoes of one part of a split recording while a window is summed, for each receiver computed at once."""
SET_UP_BYTES, FACET_BYTES = 90e6, 1_400
"""Bytes that a run takes before it sums echoes, and bytes of each of its facets."""
FACETS_PER_SAGITTA, CURVED_PER_SAGITTA = 1.7, 1.9
"""Number of flat, and of curved, facets that an unrefined face is divided into, for each unit of its phase sagitta over the limit
(curved ones 1.58 to 2.19 for bodies at 2.5 to 4 m, limits of 0.5 to 5 rad)."""
CURVED_WORK = 2.7
"""Computing time of a curved facet relative to a flat one (22 million curved facets a second, where flat ones run at 60
million)."""
MADE_ALONG = 0.5
"""Cost of refining a facet together with others, relative to refining it by itself."""
KINDS = (
    "call", "ADC sample", "refined facet", "facet of a path pair", "facet of a frame", "diffuse point of a frame",
    "ellipsoids of a frame", "occluding vertex", "ray", "point between vertices", "obstacle", "path pair", "clutter",
)  # fmt: skip
"""Kinds of work, each of which has a fitted time per unit; free space counts as one path pair."""
PATCHES_PER_FACET, PATCHES_PER_ROOT = 0.35, 70.0
"""Greatest number of patches over one path pair: so many for each facet, and so many for the root of the number of facets, as finer
facets share patches (12 000 to 44 000 patches for 70 000 to 330 000 facets)."""


@dataclass(frozen=True, slots=True)
class FacetCount:
    """The number of facets into which a mesh is refined, estimated without refining it."""

    sagitta_rad: np.ndarray
    """Phase sagitta of each unrefined face relative to the limit of its mesh, (F,)."""
    limit_rad: np.ndarray
    """Limit of the phase sagitta [rad] of each face at a sagitta scale of 1, (F,)."""
    of_points: float
    """Number of the facets that hold the diffuse points of the mesh; 0 for a smooth one."""
    curved: bool

    @property
    def work(self) -> float:
        """Computing time of one of its facets relative to a flat one."""
        return CURVED_WORK if self.curved else 1.0

    @classmethod
    def of(cls, model: Model, mesh: MovingMesh, accuracy: Accuracy) -> FacetCount:
        """Estimates the facets of a mesh at its distance from the radar in the middle of the record, from its curvature at rest."""
        middle = np.array([np.mean(model.span_s)])
        places = np.array([model.radar.tx_position_m])
        range_m = rounded_range_m(float(norms(mesh.at(middle)[0][:, None] - places).min()))
        rest = mesh.refined_rest
        limit = np.broadcast_to(sagitta_rad(mesh, accuracy.replace(sagitta_scale=1.0)), (len(mesh.rest),))
        ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2)
        length2 = ((rest[ends[..., 0]] - rest[ends[..., 1]]) ** 2).sum(axis=2)
        bend = curvature(rest, mesh.faces, mesh.crease_deg)[ends].mean(axis=2) + 1 / range_m
        wavenumber = 2 * math.pi / model.radar.wavelength_m
        of_edges = wavenumber / 3 * length2 * bend
        limits = limit[ends].mean(axis=2)
        rough = is_rough(resolved(mesh.material, model.radar))
        of_points = _facets(of_edges.mean(axis=1) / POINT_SAGITTA_RAD, mesh.curved) if rough else 0.0
        return cls((of_edges / limits).mean(axis=1), limits.mean(axis=1), of_points, mesh.curved)

    def of_tier(self, tier: PathTier, scale: float) -> float:
        """Number of facets over the paths of a tier."""
        of_faces = np.minimum(scale * tier.sagitta_scale, tier.greatest_sagitta_rad / self.limit_rad)
        return self.at(np.maximum(scale, of_faces))

    def at(self, scale: float | np.ndarray) -> float:
        """Number of facets at a sagitta scale: one for all faces, or one for each (F,)."""
        return _facets(self.sagitta_rad / scale, self.curved)


def _facets(sagitta: np.ndarray, curved: bool) -> float:
    """Total number of facets for faces of such phase sagittas relative to their limit (F,)."""
    return float(np.maximum(1, (CURVED_PER_SAGITTA if curved else FACETS_PER_SAGITTA) * sagitta).sum())


def facet_counts(model: Model, accuracy: Accuracy) -> list[FacetCount]:
    """The facet counts of all meshes among the targets."""
    return [FacetCount.of(model, mesh, accuracy) for mesh in model.geometries if isinstance(mesh, MovingMesh)]


def work_units(
    model: Model, accuracy: Accuracy, counts: Sequence[FacetCount], clutter: Clutter = "none"
) -> dict[str, float]:
    """Number of units of each kind of work (`KINDS`) for computing a record, without its set-up. Times the fitted seconds per unit
    they give the time of the run."""
    radar, length_s = model.radar, model.span_s[1] - model.span_s[0]
    frames = float(max(len(times) for times in model.frame_times(accuracy)))
    pairs = model.pairs(accuracy)
    rough = rough_meshes(model)
    tiers: list[tuple[PathTier, int]] = [(accuracy.tiers[0], 1)]
    if pairs is not None:
        tiers = [(tier, len(tier_pairs)) for tier, tier_pairs in pairs.by_tier(accuracy)]
    chirps = float(len(radar.chirp_times_s(length_s)) * radar.samples * radar.antennas)
    units = dict.fromkeys(KINDS, 0.0) | {
        "call": 1.0,
        "ADC sample": chirps,
        "clutter": length_s if model.scene is not None and clutter != "none" else 0.0,
    }
    samples = length_s * accuracy.visibility_rate_hz
    for tier, count in tiers:
        by_ellipsoids = tier.scatterer == "ellipsoids"
        if model.method == "ellipsoid" or by_ellipsoids or not counts:
            units["ellipsoids of a frame"] += frames * count / tier.decimation
        if not by_ellipsoids:
            facets = sum(facet_count.of_tier(tier, accuracy.sagitta_scale) for facet_count in counts)
            units["refined facet"] += facets
            units["facet of a path pair"] += facets * count
            summed = sum(facet_count.work * facet_count.of_tier(tier, accuracy.sagitta_scale) for facet_count in counts)
            units["facet of a frame"] += frames * summed * count
            units["diffuse point of a frame"] += frames * tier.diffuse_points * count * rough
    units["refined facet"] += beside_facets(counts)
    if accuracy.occlusion and counts:
        vertices, between = mesh_vertices(model), 4.0**accuracy.visibility_subdivision - 1
        units["occluding vertex"] = samples * vertices
        units["ray"] = samples * vertices * places_of(model, accuracy)
        units["point between vertices"] = units["ray"] * between
    if pairs is not None:
        paths = {path.key for pair in pairs.pairs for path in (pair.out, pair.back)}
        units["obstacle"] = samples / 2 * len(paths)
        units["path pair"] = float(len(pairs.pairs))
    return units


def beside_facets(counts: Sequence[FacetCount]) -> float:
    """Additional refined facets, for the cost of refining those that hold diffuse points along with the others."""
    return MADE_ALONG * sum(count.of_points for count in counts)


def patches_of(facets: float) -> float:
    """Estimated number of patches over one path pair."""
    return min(PATCHES_PER_FACET * facets, PATCHES_PER_ROOT * math.sqrt(facets))


def places_of(model: Model, accuracy: Accuracy) -> int:
    """Number of viewpoints from which occlusion is traced: antennas and their mirror images."""
    pairs = model.pairs(accuracy)
    if pairs is None:
        return len(model.radar.views_m)
    return len({path.key for pair in pairs.occluded for path in (pair.out, pair.back)})


def seconds(units: dict[str, float], laws: Laws) -> float:
    """Time [s] of so many units of work on a machine that takes one second for the reference computation."""
    return sum(laws.seconds[kind] * count for kind, count in units.items())


def memory_bytes(
    model: Model,
    accuracy: Accuracy,
    *,
    echoes: float,
    vertices: float,
    facets: float,
    measured: bool,
    taken: float = 0.0,
) -> float:
    """Expected peak memory of a run [bytes] beyond what the process held before.

    echoes, vertices: number of echoes and of facets' vertices in the scatterers that are summed together and take most memory.
    facets: number of facets that are refined at once. taken: memory that the run takes before it sums.
    """
    radar = model.radar
    of_echo = SUMMED_ARRAY_BYTES if radar.is_array else SUMMED_BYTES
    summed = of_echo * echoes + POSED_BYTES * vertices + SAMPLED_BYTES * sampled_points(model, accuracy)
    most = max(summed, REFINING_BYTES * facets, FIELD_BYTES if measured else 0.0)
    shape = (len(radar.chirp_times_s(model.span_s[1] - model.span_s[0])), radar.antennas, radar.samples)
    cube = 0.0 if is_large(shape, model.memory.limit_bytes) else 8.0 * math.prod(shape)
    return max(taken, model.memory.taken_bytes) + most + cube


def sampled_points(model: Model, accuracy: Accuracy) -> float:
    """Number of points on all meshes at which visibility is sampled, subdivision included."""
    return mesh_vertices(model) * 4.0**accuracy.visibility_subdivision if accuracy.occlusion else 0.0


def mesh_vertices(model: Model) -> int:
    """Number of vertices of all unrefined meshes."""
    return sum(len(mesh.rest) for mesh in model.geometries if isinstance(mesh, MovingMesh))


def predicted_bytes(model: Model, accuracy: Accuracy, counts: Sequence[FacetCount], *, measured: bool) -> float:
    """`memory_bytes`, predicted before any facet is made."""
    units = work_units(model, accuracy, counts)
    facets, pairs = units["refined facet"] - beside_facets(counts), max(1.0, units["path pair"])
    of_pair = patches_of(units["facet of a path pair"] / pairs) + POINTS_PER_MESH * rough_meshes(model)
    echoes = min(pairs * of_pair, most_echoes(model.radar))
    return memory_bytes(
        model,
        accuracy,
        echoes=echoes,
        vertices=facets / 2,
        facets=facets,
        measured=measured,
        taken=SET_UP_BYTES + FACET_BYTES * facets,
    )


def rough_meshes(model: Model) -> int:
    """Number of meshes that have diffuse points."""
    materials = [target.material for target in model.modelled if target.mesh is not None]
    return sum(is_rough(resolved(material, model.radar)) for material in materials)


def parts_bytes(model: Model, parts: int) -> float:
    """Additional memory [bytes] for summing the echoes of so many parts separately; there may be hundreds of parts."""
    if parts < 2:
        return 0.0
    radar = model.radar
    chirps = len(radar.chirp_times_s(model.span_s[1] - model.span_s[0]))
    of_all = 8.0 * USUAL_NODES * parts * chirps * radar.antennas
    groups = PART_BYTES * parts * min(RECEIVERS, len(radar.rx_offsets_m))
    return min(WAITING_BYTES + 2 * FIELDS_BYTES, of_all) + groups


def check_memory(prepared: Prepared, *, measured: bool, parts: int = 0) -> float:
    """Memory [bytes] that summing all echoes, divided into so many parts, needs; refused if it exceeds the limit."""
    needed = _summing_bytes(prepared, measured, parts)
    if needed > prepared.model.memory.limit_bytes:
        release()  # memory that is kept for reuse is given back, so that it does not count
        needed = _summing_bytes(prepared, measured, parts)
    refuse(prepared.model, needed, measured=measured)
    return needed


def _summing_bytes(prepared: Prepared, measured: bool, parts: int) -> float:
    model, batches = prepared.model, prepared.parts
    greatest = max(batches, key=lambda batch: batch.echoes * SUMMED_BYTES + batch.vertices * POSED_BYTES)
    # A surface has twice as many facets as vertices. The facets of the run exist by now, those of the error measurement do not.
    facets = 2 * max(batch.vertices for batch in batches) / COARSER if measured else 0.0
    tables = max((table_bytes(batch.repeats, model.radar) for batch in batches if batch.repeats), default=0.0)
    return memory_bytes(
        model, prepared.accuracy, echoes=greatest.echoes, vertices=greatest.vertices, facets=facets, measured=measured
    ) + max(tables, parts_bytes(model, parts))


def refuse(model: Model, needed_bytes: float, *, measured: bool) -> None:
    """Raises an `InputError` where a run needs more memory than it may take."""
    remedy = (
        "ask for a looser tolerance or a coarser sagitta_rad, cut the record, or measure no error (measure_error=False)"
    )
    model.memory.check(needed_bytes, "this simulation", remedy if measured else remedy.rpartition(", or ")[0])
