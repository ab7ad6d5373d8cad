"""Rooms and ray tracers: Sionna RT's paths off a faceted sphere, walls twice in one plane, bodies at walls, random rays."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import find_paths
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scene import Room
from t2d_rt.types import Material, MovingMesh, Radar, Scene, Surface
from validation.bodies import WALK, recorded
from validation.methods.stability.case import Case, Theme
from validation.methods.stability.targets import ball, ball_rcs, decibel, measured_rcs, static_mesh
from validation.physics.rcs import TIMES_S, sphere
from validation.report import at_least, at_most, new_figure, save_chart

BALL_M, RANGE_M = 0.15, 3.0
POSES = 40
RAYS = (100_000, 400_000, 1_600_000, 6_400_000, 12_800_000)
ROUGH_M, NEAR_M = 0.05, 0.3
"""Radius and range of the sphere whose diffuse paths are summed: so near, one ray in 200 meets it."""
REALISATIONS = 24
POINTS = (1_000, 4_000, 16_000)
DRAWS, SHOTS = 12, 100_000
WALL_M = 2.0
WALLS = {
    "given twice": ((-2, 12), (-2, 12)),
    "overlapping": ((-2, 2), (1, 12)),
    "meeting at the ghost": ((-2, 1.5), (1.5, 12)),
}
"""From where to where along x two pieces of one wall reach."""
GAPS_M, DEPTHS_M = (0.0005, 0.002, 0.02), (0.0, 0.02)


def theme() -> Theme:
    radar = Radar.preset("table2")
    diffuse, chart = diffuse_paths(radar)
    cases = [*specular_path(radar), diffuse, random_rays(radar), *coplanar(radar), touching(radar), collisions(radar)]
    return Theme(cases=cases, charts=[chart])


# --- Sionna RT's paths ----------------------------------------------------------------------------------------------


def _scene(vertices: np.ndarray, faces: np.ndarray, radar: Radar, scattering: float) -> Any:
    """A metal mesh, the transmitter and the receiver of a radar, as Sionna RT's own scene."""
    mi = mitsuba(select("auto"))
    import sionna.rt as rt

    mesh = mi.Mesh("ball", len(vertices), len(faces))
    fields = mi.traverse(mesh)
    fields["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    fields["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    fields.update()
    scene = rt.load_scene()
    scene.frequency = radar.mid_frequency_hz
    metal = rt.ITURadioMaterial("ball-metal", "metal", thickness=0.01, scattering_coefficient=scattering)
    scene.edit(add=rt.SceneObject(mi_mesh=mesh, name="ball", radio_material=metal))
    scene.tx_array = scene.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    scene.add(rt.Transmitter(name="tx", position=radar.tx_position_m.tolist()))
    scene.add(rt.Receiver(name="rx", position=radar.rx_position_m.tolist()))
    return scene


def _paths_rcs(scene: Any, radar: Radar, range_m: float, rays: int, *, diffuse: bool) -> tuple[float, int]:
    """RCS [m^2] by the coherent sum of that solver's paths, and how many there are."""
    import sionna.rt as rt

    paths = rt.PathSolver()(
        scene, max_depth=1, los=False, refraction=False, specular_reflection=not diffuse, diffuse_reflection=diffuse,
        samples_per_src=rays, max_num_paths_per_src=rays, seed=1,
    )  # fmt: skip
    delay = np.array(paths.tau).ravel().astype(float)
    amplitude = (np.array(paths.a[0]).ravel() + 1j * np.array(paths.a[1]).ravel())[delay > 0]
    field = np.sum(amplitude * np.exp(-2j * math.pi * radar.mid_frequency_hz * delay[delay > 0]))
    per_rcs = radar.wavelength_m**2 / ((4 * math.pi) ** 3 * range_m**4)
    return float(abs(field) ** 2 / per_rcs), int(np.count_nonzero(delay > 0))


def specular_path(radar: Radar) -> list[Case]:
    """A conducting sphere of 1 280 faces: in random poses, and with one of them square to the radar."""
    unit, faces = sphere(BALL_M, np.zeros(3), 3)
    centre = radar.tx_position_m + [RANGE_M + BALL_M, 0, 0]
    poses = [Rotation.random(rng=np.random.default_rng(seed)).apply(unit) + centre for seed in range(POSES)]
    found = [_paths_rcs(_scene(v, faces, radar, 0.0), radar, RANGE_M, 100_000, diffuse=False)[1] for v in poses]
    normal = np.cross(unit[faces[0, 1]] - unit[faces[0, 0]], unit[faces[0, 2]] - unit[faces[0, 0]])
    square = Rotation.align_vectors([[-1, 0, 0]], [normal / np.linalg.norm(normal)])[0].apply(unit) + centre
    theirs, paths = _paths_rcs(_scene(square, faces, radar, 0.0), radar, RANGE_M, 1_000_000, diffuse=False)
    exact = ball_rcs(BALL_M, RANGE_M)
    errors = [abs(decibel(measured_rcs(static_mesh(v, faces), radar, RANGE_M) / exact)) for v in poses[:8]]
    return [
        Case(
            "Sionna RT's specular path, sphere in random poses",
            at_least(f"poses of {POSES} without a path", float(np.mean(np.array(found) == 0)), 0.9, "of all"),
            at_most("worst of 8 of them", max(errors), 0.3, "dB"),
        ),
        Case(
            "the same with a face square to the radar",
            at_least(
                "its path is that of a plane, pi R^2", abs(decibel(theirs / exact)) if paths else math.nan, 20, "dB"
            ),
            at_most(
                "facets", abs(decibel(measured_rcs(static_mesh(square, faces), radar, RANGE_M) / exact)), 0.3, "dB"
            ),
        ),
    ]


def diffuse_paths(radar: Radar) -> tuple[Case, str]:
    """A Lambertian sphere: paths summed as fields over the number of rays; our diffuse points over their number."""
    vertices, faces = ball(radar, ROUGH_M, NEAR_M, 5)
    scene = _scene(vertices, faces, radar, 1.0)
    theirs = [_paths_rcs(scene, radar, NEAR_M, rays, diffuse=True)[0] for rays in RAYS]
    rough = Material(name="rough", relative_permittivity=1.0, conductivity_s_per_m=1e9, scattering_coefficient=1.0)
    surface = MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, rough)
    ours = [_diffuse_rcs(surface, radar, rough, points) for points in POINTS]
    mean = _lambertian_rcs(ROUGH_M, NEAR_M)
    case = Case(
        "diffuse returns summed as fields",
        at_least(
            f"Sionna RT's diffuse paths, {RAYS[-1] / 1e6:g} instead of {RAYS[2] / 1e6:g} million rays: RCS grows by",
            float(decibel(theirs[-1] / theirs[2])),
            6,
            "dB",
        ),
        at_most(
            f"frozen points of random phase, {POINTS[0]} to {POINTS[-1]}: their mean RCS, against an integral",
            max(abs(decibel(each / mean)) for each in ours),
            0.5,
            "dB",
        ),
    )
    figure, axis = new_figure()
    axis.semilogx(
        RAYS, [decibel(x) for x in theirs], "o--", label="Sionna RT's diffuse paths summed as fields, over rays"
    )
    axis.semilogx(POINTS, [decibel(x) for x in ours], "s-", label="t2d_rt, mean of its diffuse points, over points")
    axis.axhline(decibel(mean), color="grey", linestyle=":", label="mean by integration")
    axis.set(
        xlabel="rays or points", ylabel="RCS [dBsm]", title=f"Lambertian sphere of {ROUGH_M * 100:g} cm at {NEAR_M:g} m"
    )
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3, which="both")
    return case, save_chart(figure, "stability_diffuse.png")


def _diffuse_rcs(surface: MovingMesh, radar: Radar, material: Material, points: int) -> float:
    """Mean RCS [m^2] over the random phases of diffuse points: the sum of the powers of patches, whose points add up as fields,
    in the mean over realisations."""
    powers = []
    for seed in range(REALISATIONS):
        stream = mesh_echoes(
            surface, radar, times_s=np.linspace(*TIMES_S, 4), material=material,
            detail=Detail(sagitta_rad=0.3, points=points), seed=seed, views=(PathVisibility(),),
            backend=select("cpu"),
        )  # fmt: skip
        powers.append(float(np.sum(np.abs(stream.gather().amplitude[0]) ** 2)))
    return float(np.mean(powers)) / float(radar.received_power_w(1.0, NEAR_M))


def _lambertian_rcs(radius_m: float, range_m: float, rings: int = 10_000) -> float:
    """int 4 cos^2 (R_0/R)^4 dA over the lit part of a sphere near by, R_0 the range of its nearest point (physics.md, eq. 9)."""
    angle = (np.arange(rings) + 0.5) / rings * math.pi / 2
    along, across = range_m + radius_m * (1 - np.cos(angle)), radius_m * np.sin(angle)
    distance = np.hypot(along, across)
    cosine = np.maximum((along * np.cos(angle) - across * np.sin(angle)) / distance, 0)
    area = 2 * math.pi * radius_m**2 * np.sin(angle) * (math.pi / 2 / rings)
    return float(np.sum(4 * cosine**2 * (range_m / distance) ** 4 * area))


def random_rays(radar: Radar) -> Case:
    """A conducting sphere by rays shot at random over its outline, each with the phase of its hit."""
    spread = []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        radius, angle = BALL_M * np.sqrt(rng.uniform(size=SHOTS)), rng.uniform(0, 2 * math.pi, SHOTS)
        y, z = radius * np.cos(angle), radius * np.sin(angle)
        depth = BALL_M - np.sqrt(BALL_M**2 - radius**2)
        hit = np.sqrt((RANGE_M + depth) ** 2 + y**2 + z**2)
        field = np.mean(np.exp(4j * math.pi / radar.wavelength_m * hit)) * math.pi * BALL_M**2
        spread.append(decibel(4 * math.pi / radar.wavelength_m**2 * abs(field) ** 2))
    vertices, faces = ball(radar, BALL_M, RANGE_M, 3)
    target = static_mesh(vertices, faces)
    cubes = [t2d.simulate(target, radar=radar, seed=seed).cube[0, 0] for seed in (0, 1)]
    change = float(np.abs(cubes[1] - cubes[0]).max() / np.abs(cubes[0]).max())
    return Case(
        "rays and seeds, conducting sphere",
        at_least(
            f"{SHOTS} random rays summed as fields, spread of RCS over {DRAWS} seeds", float(np.ptp(spread)), 3, "dB"
        ),
        at_most("change of the samples from seed to seed", change, 0, "of their peak"),
    )


# --- walls ----------------------------------------------------------------------------------------------------------


def wall(name: str, start_m: float, stop_m: float) -> Surface:
    corners = [(start_m, WALL_M, -2), (stop_m, WALL_M, -2), (stop_m, WALL_M, 4), (start_m, WALL_M, 4)]
    return Surface(
        name=name, vertices=np.array(corners, float), faces=np.array([[0, 1, 2], [0, 2, 3]]), material="metal", thickness_m=0.01
    )  # fmt: skip


def coplanar(radar: Radar) -> list[Case]:
    """A metal wall beside the line of sight to a sphere, in two pieces, against the same in one."""
    vertices, faces = ball(radar, 0.1, 2.9)
    target = static_mesh(vertices, faces)
    free = t2d.simulate(target, radar=radar).cube[0, 0]

    def ghosts(*walls: Surface) -> np.ndarray:
        scene = Scene(name="walls", surfaces=walls)
        return t2d.simulate(target, radar=radar, scene=scene, clutter="none").cube[0, 0] - free

    whole = ghosts(wall("whole", -2, 12))
    cases = []
    for name, pieces in WALLS.items():
        ours = ghosts(*(wall(f"piece {n}", *piece) for n, piece in enumerate(pieces)))
        cases.append(
            Case(
                f"walls in one plane, {name}",
                at_least(
                    "an image for each piece that holds the reflection",
                    decibel(_image_count(radar, pieces) ** 2),
                    6,
                    "dB",
                ),
                at_most(
                    "power of the ghosts against one wall's",
                    abs(decibel(np.sum(np.abs(ours) ** 2) / np.sum(np.abs(whole) ** 2))),
                    0.5,
                    "dB",
                ),
            )
        )
    return cases


def _image_count(radar: Radar, pieces: tuple[tuple[float, float], ...]) -> int:
    """In how many pieces the path over the wall to the sphere's centre, 3 m away, meets it: halfway."""
    meets = radar.tx_position_m[0] + 1.5
    return sum(start <= meets <= stop for start, stop in pieces)


def touching(radar: Radar) -> Case:
    """A target at a wall: Sionna RT's solver drops segments under 1 cm, and with them the ghosts of what touches a wall."""
    import sionna.rt as rt
    from sionna.rt.rcs import ConstantRCSSensingTarget, RCSSolver

    mi = mitsuba(select("auto"))
    whole = wall("wall", -2, 12)
    theirs = _scene(whole.vertices, whole.faces, radar, 0.0)
    theirs.tx_array = theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    target = ConstantRCSSensingTarget(name="target", length=1e-3, width=1e-3, height=1e-3, position=[3, 0, 1])
    theirs.add(target)
    walls = Scene(name="wall", surfaces=(whole,))
    mirrors, up = Mirrors.of(walls, select("cpu")), np.array([0.0, 0.0, 1.0])
    counts = []
    for gap in GAPS_M:
        place = np.array([3.0, WALL_M - gap, 1.0])
        target.position = mi.Point3f(*place.tolist())
        delay = np.array(RCSSolver()(theirs, max_depth=3, refraction=False, seed=1).tau).ravel()
        paths = find_paths(mirrors, radar.tx_position_m, up, radar.mid_frequency_hz, order=1, probes_m=place[None])
        counts.append((np.count_nonzero(delay > 0), len(paths) ** 2))
    finite = []
    for depth in DEPTHS_M:
        vertices, faces = sphere(0.1, np.array([3.0, WALL_M - 0.1 + depth, 1.0]), 3)
        found = t2d.simulate(
            static_mesh(vertices, faces), radar=radar, scene=walls, clutter="none", collisions="ignore"
        )
        finite.append(np.isfinite(found.cube[0]).all())
    return Case(
        f"a point {GAPS_M[0] * 1e3:g} mm from a wall",
        at_least("Sionna RT's solver, missing of 4 paths", float(counts[-1][0] - counts[0][0]), 3, "paths"),
        at_most(
            f"missing of 4 at {GAPS_M[0] * 1e3:g} to {GAPS_M[-1] * 1e3:g} mm; samples of a sphere in the wall are finite",
            float(4 - min(ours for _, ours in counts)) if all(finite) else math.nan,
            0,
            "paths",
        ),
    )


def collisions(radar: Radar) -> Case:
    """A walk inside a room, feet on its floor, and the same through a wall: what is said of them."""
    room = Room(name="cell", size_m=(5, 4, 2.5)).scene()
    walk = t2d.trim(t2d.place(recorded(WALK), distance_m=4.3), 0, 2)
    low, high = room.bounds_m
    vertices = t2d.skin(walk).at(np.linspace(0, walk.duration_s, 50))
    alarms = ((vertices < low) | (vertices > high)).any(axis=(1, 2))
    across = Surface(
        name="partition", vertices=np.array([(3.0, -2, 0), (3, 2, 0), (3, 2, 2.5), (3, -2, 2.5)]),
        faces=np.array([[0, 1, 2], [0, 2, 3]]), material="plasterboard", thickness_m=0.0125,
    )  # fmt: skip
    said = []
    for scene in (room, replace(room, surfaces=(*room.surfaces, across))):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            t2d.simulate(walk, radar=radar, scene=scene, method="ellipsoid", reflections=0, clutter="none")
        said.append(any("goes through" in str(each.message) for each in told))
    return Case(
        "a walk inside a room, feet on the floor, and one through its wall",
        at_least(
            "any vertex outside the room's box: instants of the first that are alarms",
            float(alarms.mean()),
            0.3,
            "of all",
        ),
        at_most("wrong verdicts on the two", float(np.mean([said[0], not said[1]])), 0, "of all"),
    )
