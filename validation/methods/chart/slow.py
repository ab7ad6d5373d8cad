"""The two methods that make no record but single chirps: float64 throughout, and Sionna RT's own paths pose by pose."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from t2d_rt.body.materials import resolve_material
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.propagation.rays import mitsuba, mitsuba_mesh
from t2d_rt.types import Radar
from validation.methods.chart.measure import SAMPLES, Case, Point
from validation.methods.chart.methods import SUMMED
from validation.methods.chart.variants import cut_to
from validation.methods.reference import Converged, nmse_db, reference_samples

FLOAT64_RAD = (0.28, 0.07)
"""Phase sagitta of its facets, which are flat; those of the reference have 0.08."""
RAYS, POSE_RATE_HZ = (10_000, 100_000, 1_000_000), 50.0
POSES = 6
FLOAT64_CHIRPS = 4


def float64(case: Case) -> list[Point]:
    """Every facet at every sample of every chirp in float64, from a few chirps; occlusion traced through the fine mesh."""
    radar = case.radar
    material = resolve_material("skin", radar.mid_frequency_hz)
    chirps = case.chirps[:FLOAT64_CHIRPS]
    points = []
    for sagitta_rad in FLOAT64_RAD:

        def run(samples: np.ndarray, some: np.ndarray, sagitta_rad: float = sagitta_rad) -> tuple[float, np.ndarray]:
            start = time.perf_counter()
            found = reference_samples(
                case.surface, radar, some, samples,
                Converged(material=material, scene=case.scene, sagitta_rad=sagitta_rad),
            )  # fmt: skip
            return time.perf_counter() - start, found

        _, found = run(SAMPLES, chirps)
        # Setting up, tracing and samples apart: what one more chirp takes, and what one more sample of it.
        few, many = run(SAMPLES, chirps[:1])[0], run(SAMPLES, chirps)[0]
        more = run(np.arange(0, radar.samples, 16), chirps)[0]
        each_chirp = (many - few) / (len(chirps) - 1)
        each_sample = max(0.0, more - many) / (len(chirps) * (radar.samples / 16 - len(SAMPLES)))
        points.append(
            Point(
                scene=case.scene,
                motion=case.name,
                method="float64 at every sample",
                knob=f"{sagitta_rad:g} rad",
                seconds_per_second=radar.prf_hz * (each_chirp + each_sample * (radar.samples - len(SAMPLES))),
                nmse_db=nmse_db(found, case.truth[: len(chirps)]),
            )
        )
    return points


def point_sums(case: Case, points: Sequence[Point]) -> list[Point]:
    """One point per facet as it is mostly summed: all of them moved to every chirp, an exponential for each. Errors are those of
    the same facets (`points`) by this engine's sums; the seconds those of a few chirps, for all of a second."""
    return [
        replace(each, method=SUMMED, seconds_per_second=case.radar.prf_hz * _seconds_per_chirp(case, float(each.knob)),
                spectrogram_db="", envelope_r="", power_db="")
        for each in points
        if each.method == "facets with one point each"
    ]  # fmt: skip


def _seconds_per_chirp(case: Case, edge_m: float) -> float:
    import drjit as dr

    radar, surface, backend = case.radar, case.surface, select("cpu")
    fine = cut_to(surface, edge_m, 2 * math.pi / radar.wavelength_m, float(np.linalg.norm(surface.rest, axis=1).min()))
    corner = [backend.lanes(fine.faces[:, i]) for i in range(3)]
    Float64, Array3 = backend.Float64, backend.arrays.Array3f64
    cycles_per_m = 2 * radar.mid_frequency_hz / SPEED_OF_LIGHT
    taken = []
    for start_s in surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[case.chirps[: FLOAT64_CHIRPS + 1]]:
        begin = time.perf_counter()
        vertices = Float64((fine.at(surface.at(np.array([start_s]))[0]) - radar.tx_position_m).ravel())
        a, b, c = (dr.gather(Array3, vertices, place) for place in corner)
        middle, across = (a + b + c) / 3, dr.cross(b - a, c - a)
        squared = dr.dot(middle, middle)
        range_m = dr.sqrt(squared)
        weight = dr.maximum(-dr.dot(across, middle) / range_m, 0) / squared
        cycles = cycles_per_m * range_m
        sine, cosine = dr.sincos(2 * math.pi * (cycles - dr.floor(cycles)))
        dr.eval(dr.sum(weight * sine), dr.sum(weight * cosine))
        dr.sync_thread()
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken[1:]))  # the first one compiles


def sionna_paths(case: Case) -> list[Point]:
    """The posed mesh in a scene of Sionna RT, its paths summed, at the very instants compared; the seconds are those of 50 poses a
    second. A spectrogram needs a pose for every chirp, 200 times as many."""
    radar = case.radar
    scene, body = _scene(radar)
    poses = case.surface.at(case.surface.times_s[0] + radar.chirp_times_s(case.surface.duration_s)[case.chirps[:POSES]])
    points = []
    for rays in RAYS:
        found, taken = [], []
        for vertices in [poses[0], *poses]:  # the first one compiles
            start = time.perf_counter()
            found.append(_samples(scene, body, vertices, case.surface.faces, radar, rays))
            taken.append(time.perf_counter() - start)
        points.append(
            Point(
                scene=case.scene,
                motion=case.name,
                method="Sionna RT's paths per pose",
                knob=f"{rays:.0e} rays",
                seconds_per_second=POSE_RATE_HZ * float(np.median(taken[1:])),
                nmse_db=nmse_db(np.array(found[1:]), case.truth[:POSES]),
                power_db=10 * math.log10(np.mean(np.abs(found[1:]) ** 2) / np.mean(np.abs(case.truth[:POSES]) ** 2)),
            )
        )
    return points


def _scene(radar: Radar) -> tuple[Any, Any]:
    """An empty scene with both antennas, and the body's material."""
    mitsuba(select("cpu"))
    import sionna.rt as rt

    skin = resolve_material("skin", radar.mid_frequency_hz)
    scene = rt.load_scene()
    scene.frequency = radar.mid_frequency_hz
    scene.tx_array = scene.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    for add, place in ((rt.Transmitter, radar.tx_position_m), (rt.Receiver, radar.rx_position_m)):
        scene.add(add(name=add.__name__, position=place.tolist()))
    material = rt.RadioMaterial(
        name="skin", thickness=0.1, relative_permittivity=skin.relative_permittivity,
        conductivity=skin.conductivity_s_per_m, scattering_coefficient=skin.scattering_coefficient,
    )  # fmt: skip
    return scene, material


def _samples(scene: Any, material: Any, vertices: np.ndarray, faces: np.ndarray, radar: Radar, rays: int) -> np.ndarray:
    """The paths' sum (SAMPLES,) at IF: sqrt(P_t G_t G_r) sum conj(a) exp(j 2 pi (f tau - S tau^2/2))."""
    import sionna.rt as rt

    mi = mitsuba(select("cpu"))
    body = rt.SceneObject(mi_mesh=mitsuba_mesh(mi, vertices, faces), name="body", radio_material=material)
    scene.edit(add=body, remove=[each for name, each in scene.objects.items() if name == "body"])
    paths = rt.PathSolver()(
        scene, max_depth=1, samples_per_src=rays, max_num_paths_per_src=rays, los=False, specular_reflection=True,
        diffuse_reflection=True, refraction=False,
    )  # fmt: skip
    amplitude = (np.array(paths.a[0]) + 1j * np.array(paths.a[1])).ravel()
    delay = np.array(paths.tau, np.float64).ravel()
    # link_amplitude^2 = P G G lambda^2/(4 pi)^3
    scale = radar.link_amplitude * (4 * math.pi) ** 1.5 / (SPEED_OF_LIGHT / radar.mid_frequency_hz)
    frequency = radar.carrier_hz + radar.slope_hz_per_s * radar.sample_times_s[SAMPLES]
    cycles = frequency[:, None] * delay - 0.5 * radar.slope_hz_per_s * delay**2
    return np.asarray(scale * np.exp(2j * math.pi * (cycles % 1.0)) @ np.conj(amplitude))
