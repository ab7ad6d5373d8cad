"""Spheres, plates, motions and small scenes that several files of tests are built from."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.body import template
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.dataset import Recipe
from t2d_rt.dataset.shards import MadeSample
from t2d_rt.dataset.worker import Plans, make_sample
from t2d_rt.types import PEC, Material, Motion, MovingMesh, Radar, Scene, Surface
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, OPTIONAL_JOINTS

ROOT = Path(__file__).parents[1]
MOTIONS = ROOT / "examples" / "motions"
WALK = MOTIONS / "12_01_walk.bvh"
UP = np.array([0.0, 0.0, 1.0])
ANTENNA_M = np.array([0.0, 0.0, 1.0])
"""Where a preset's radar stands."""

Point = Sequence[float]
ZERO = (0.0, 0.0, 0.0)


def slow_after(count: int, values: Sequence[Any]) -> list[Any]:
    """Values of a parametrised test, of which `make test` takes so many and `make test-all` the others too."""
    told = [each if isinstance(each, tuple) else (each,) for each in values]
    return [pytest.param(*each, marks=[pytest.mark.slow] * (place >= count)) for place, each in enumerate(told)]


# --- meshes ---


def icosphere(level: int, radius_m: float = 1.0, centre_m: Point = ZERO) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a sphere, 20 4^level of them."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=level, radius=radius_m)
    return np.array(mesh.vertices) + np.asarray(centre_m), np.array(mesh.faces)


def moving(
    shape: tuple[np.ndarray, np.ndarray],
    centres_m: np.ndarray,
    times_s: np.ndarray,
    name: str = "ball",
    **options: object,
) -> MovingMesh:
    """A rigid conductor (vertices and faces) that is carried along places (T, 3)."""
    vertices, faces = shape
    places = vertices + np.asarray(centres_m)[:, None]
    return MovingMesh(places, faces, times_s, **{"material": "pec", "name": name, **options})  # type: ignore[arg-type]


def ball(
    start_m: Point,
    velocity_mps: Point = ZERO,
    time_s: float = 0.2,
    *,
    radius_m: float = 0.1,
    level: int = 3,
    frames: int = 5,
    material: str | Material = "pec",
    sagitta_rad: float = 0.3,
) -> MovingMesh:
    """A sphere in straight flight, of a quarter of the facets that a mesh has by itself (0.07 rad)."""
    times = np.linspace(0, time_s, frames)
    track = np.array(start_m) + np.array(velocity_mps) * times[:, None]
    return moving(icosphere(level, radius_m), track, times, material=material, sagitta_rad=sagitta_rad)


def static_mesh(vertices: np.ndarray, faces: np.ndarray, until_s: float = 1.0, **options: object) -> MovingMesh:
    """A conductor that stays where it is."""
    return MovingMesh(np.stack([vertices, vertices]), faces, [0, until_s], PEC, **options)  # type: ignore[arg-type]


# --- surfaces of a scene ---


def plate(
    name: str,
    corners: Sequence[Point],
    material: str | Material = "metal",
    thickness_m: float = 0.01,
    faces: Sequence[Sequence[int]] = ((0, 1, 2), (0, 2, 3)),
) -> Surface:
    """A flat slab with four corners."""
    return Surface(
        name=name, vertices=np.array(corners, float), faces=np.array(faces), material=material, thickness_m=thickness_m
    )


def small_room() -> Scene:
    """A floor and a wall to the left."""
    floor = plate("floor", [(-1, -2, 0), (6, -2, 0), (6, 2, 0), (-1, 2, 0)], "concrete")
    left = plate("left", [(-1, 2, 0), (6, 2, 0), (6, 2, 3), (-1, 2, 3)], "plasterboard")
    return Scene(name="small", surfaces=(floor, left))


# --- recordings ---


def point_cube(radar: Radar, ranges_m: np.ndarray, rcs_m2: float = 1.0) -> np.ndarray:
    """ADC cube (chirp, 1, sample) of a point by the radar equation, at one range in each chirp."""
    ranges = ranges_m[:, None]
    cycles = 2 * ranges / SPEED_OF_LIGHT * (radar.carrier_hz + radar.slope_hz_per_s * radar.sample_times_s)
    return (np.sqrt(radar.received_power_w(rcs_m2, ranges)) * np.exp(2j * np.pi * (cycles % 1)))[:, None]


# --- motions ---


@cache
def walk() -> Motion:
    """The bundled walk (CMU 12_01), not placed."""
    return t2d.load_motion(WALK)


def rest_pose(*, seed: int | None = None, ends: bool = True, frames: int = 5) -> Motion:
    """A motion that holds the template's own rest pose, its file's zero pose turned at random."""
    rest = template().joints
    names = CANONICAL_JOINTS + (tuple(OPTIONAL_JOINTS) if ends else ())
    parents = CANONICAL_PARENTS + tuple(names.index(OPTIONAL_JOINTS[n]) for n in names[22:])
    joints = np.tile([rest[name] for name in names], (frames, 1, 1))
    rotation = Rotation.identity(len(names)) if seed is None else Rotation.random(len(names), rng=seed)
    quaternions = np.tile(rotation.as_quat(), (frames, 1, 1))
    return Motion(joints=joints, rotations=quaternions, rate_hz=30.0, names=names, parents=parents)


JOINT_CENTRES = {
    "hip": "Hip", "knee": "Knee", "ankle": "Ankle", "shoulder": "Shoulder", "elbow": "Elbow", "wrist": "Wrist", "foot": "BigToe",
}  # fmt: skip
"""Names that pose estimators give, behind L or R, to the joints of a side."""


def joint_centres(motion: Motion) -> dict[str, np.ndarray]:
    """Tracks (T, 3) [m] by the names of pose estimators."""
    found = {"Neck": motion.joints[:, motion.index("neck")], "Head": motion.joints[:, motion.index("head_top")]}
    for side in ("left", "right"):
        for joint, part in JOINT_CENTRES.items():
            found[f"{side[0].upper()}{part}"] = motion.joints[:, motion.index(f"{side}_{joint}")]
    return found


def write_c3d(path: Path, tracks: dict[str, np.ndarray], rate_hz: float) -> Path:
    """Tracks (T, 3) [m] as points in millimetres."""
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [rate_hz]
    file["parameters"]["POINT"]["LABELS"]["value"] = tuple(tracks)
    file["parameters"]["POINT"]["UNITS"]["value"] = ("mm",)
    points = 1e3 * np.stack(list(tracks.values()), axis=1).transpose(2, 1, 0)
    file["data"]["points"] = np.concatenate([points, np.ones_like(points[:1])])
    file.write(str(path))
    return path


# --- samples of a data set ---


def remember_samples(patch: pytest.MonkeyPatch, known: dict[tuple[str, int], MadeSample]) -> None:
    """Samples of a recipe that this process has made are not made again."""

    def remembered(recipe: Recipe, plans: Plans, index: int) -> MadeSample:
        key = recipe.model_dump_json(), index
        if key not in known:
            known[key] = make_sample(recipe, plans, index)
        return replace(known[key], record=dict(known[key].record))

    patch.setattr("t2d_rt.dataset.worker.make_sample", remembered)


def within(seconds: float, done: Callable[[], bool]) -> bool:
    """Whether something comes true before so much time has passed."""
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


# --- scene files ---

HEADER = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
"""
POINTS, FACES = "0 0 0\n1 0 0\n1 2 0\n0 2 0\n", "3 0 1 2\n3 0 2 3\n"
WALL = HEADER + POINTS + FACES
REF = '<ref id="mat-itu_concrete" name="bsdf"/>'


def shape(file: str = "wall.ply", inside: str = REF, kind: str = "ply", name: str = "wall") -> str:
    return f'<shape type="{kind}" id="{name}"><string name="filename" value="{file}"/>{inside}</shape>'
