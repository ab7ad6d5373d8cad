"""Draws the body templates in their rest pose, from the front and from their right, beside a scale of heights.

python meshes/draw_bodies.py docs/images/bodies.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image

from t2d_rt.body import Template, bodies, template
from t2d_rt.geometry.curved import control_points, surface_rows

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

VIEWS = (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]))
"""Towards who looks: from the front, then from the body's right."""
ORDER = ("child", "woman", "old", "heavy", "man", "adult")
GAP_M, PANEL_HEIGHT_M = 0.12, 1.95


def surface(body: Template) -> tuple[np.ndarray, np.ndarray]:
    """Corners (F, 3, 3) and unit normals (F, 3) of the smooth surface in its flat quarters."""
    corner, middle = np.eye(3), (np.eye(3) + np.roll(np.eye(3), -1, axis=0)) / 2
    parts = [np.stack([corner[i], middle[i], middle[i - 1]]) for i in range(3)] + [middle]
    count = len(body.faces)
    weights = np.tile(np.concatenate(parts), (count, 1))
    rows = surface_rows(body.faces, len(body.vertices), np.repeat(np.arange(count), 12), weights)
    corners = (rows @ (control_points(body.faces, len(body.vertices)) @ body.vertices)).reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def draw(axis: plt.Axes, corners: np.ndarray, normals: np.ndarray, view: np.ndarray, left_m: float) -> float:
    """One view with its left edge at `left_m`; returns its right edge."""
    right = np.cross([0.0, 0.0, 1.0], view)
    seen = normals @ view > 0
    corners, normals = corners[seen], normals[seen]
    order = np.argsort(corners.mean(1) @ view)
    flat = np.stack([corners @ right, corners[..., 2]], -1)[order]
    flat[..., 0] += left_m - flat[..., 0].min()
    light = view - 0.5 * right + np.array([0, 0, 0.7])
    shade = 0.25 + 0.7 * np.clip(normals[order] @ light / np.linalg.norm(light), 0, 1)
    colours = shade[:, None] * np.array([0.98, 0.95, 0.92])
    axis.add_collection(PolyCollection(list(flat), facecolors=colours, edgecolors=colours, linewidths=0.3))
    return float(flat[..., 0].max())


def main(path: Path) -> None:
    """Draws all bodies into one PNG."""
    figure, axis = plt.subplots(figsize=(14, 2.75), dpi=100)
    at = 0.0
    for name in sorted(bodies(), key=lambda each: ORDER.index(each) if each in ORDER else len(ORDER)):
        body, start = template(name), at
        corners, normals = surface(body)
        for view in VIEWS:
            at = draw(axis, corners, normals, view, at) + GAP_M
        axis.text(
            (start + at - GAP_M) / 2, -0.06, f"{name}, {body.stature_m:.2f} m", ha="center", va="top", fontsize=10
        )
        at += GAP_M
    axis.set(xlim=(-GAP_M, at), ylim=(0, PANEL_HEIGHT_M), aspect="equal", xticks=[], yticks=np.arange(0, 2, 0.25))
    axis.set_ylabel("height [m]")
    axis.yaxis.grid(True, color="0.85", linewidth=0.6)
    axis.set_axisbelow(True)
    for side in ("top", "right", "bottom"):
        axis.spines[side].set_visible(False)
    figure.subplots_adjust(left=0.045, right=0.995, top=0.98, bottom=0.1)
    figure.savefig(path)
    Image.open(path).convert("P", palette=Image.Palette.ADAPTIVE, colors=128).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
