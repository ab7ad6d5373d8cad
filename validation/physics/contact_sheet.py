"""The posed body to look at: `python -m validation.physics.contact_sheet` writes validation/report/contact_sheet.png."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from t2d_rt.body import skin
from t2d_rt.core.resources import resource
from t2d_rt.motion import load_motion, track
from validation.report import FOLDER

LIGHT = np.array([0.45, 0.35, 0.82])
SKIN = np.array([0.93, 0.76, 0.64])
VIEWS = {"front": np.array([1.0, 0.0]), "side": np.array([0.0, 1.0])}
"""Horizontal direction from the body to the camera, in the body's own (forward, left)."""


def heading(joints: np.ndarray) -> np.ndarray:
    """Horizontal unit vectors forward and left (2, 2) of a pose (J, 3), from the hip line."""
    left = (joints[1] - joints[2])[:2]
    left = left / np.linalg.norm(left)
    return np.array([[left[1], -left[0]], left])


def project(vertices: np.ndarray, faces: np.ndarray, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Visible triangles (M, 3, 2), farthest first, and their brightness (M,) for a camera that looks along -towards."""
    camera = np.array([[-towards[1], towards[0], 0.0], [0, 0, 1.0], [*towards, 0.0]])
    corners = (vertices @ camera.T)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    order = np.argsort(corners[..., 2].mean(1))
    order = order[normal[order, 2] > 0]
    return corners[order][..., :2], 0.25 + 0.75 * np.clip(normal[order] @ LIGHT, 0, 1)


def contact_sheet(path: Path, motion_file: str = "12_01_walk.bvh", count: int = 6) -> Path:
    """Front and side views of the body at instants spread over a motion."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    motion = load_motion(resource("motions", motion_file))
    course = track(motion)
    surface = skin(motion, track=course)
    times = np.linspace(0.1, 0.9, count) * motion.duration_s
    posed, (joints, _) = surface.at(times), course(times)
    figure, axes = plt.subplots(len(VIEWS), count, figsize=(2.2 * count, 7), layout="constrained")
    for column, (vertices, pose, time_s) in enumerate(zip(posed, joints, times, strict=True)):
        own = heading(pose)
        for row, (view, direction) in enumerate(VIEWS.items()):
            triangles, brightness = project(vertices - pose[0] * [1, 1, 0], surface.faces, direction @ own)
            axis = axes[row, column]
            colours = brightness[:, None] * SKIN
            axis.add_collection(PolyCollection(triangles, facecolors=colours, edgecolors=colours, linewidths=0.3))
            axis.axhline(0, color="0.6", linewidth=0.8)
            axis.set(xlim=(-0.6, 0.6), ylim=(-0.1, 1.9), aspect="equal", xticks=[], yticks=[])
            axis.set_title(f"{view}, {time_s:.2f} s", fontsize=9)
    figure.suptitle(
        f"{motion_file}: control cage, {len(surface.rest)} vertices, {len(surface.faces)} faces; line: z = 0"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


if __name__ == "__main__":
    print(contact_sheet(FOLDER / "contact_sheet.png"))
