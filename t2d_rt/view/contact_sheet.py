"""Contact sheets: skinned bodies over time, one row for each motion, drawn with a z-buffer.

Matplotlib's polygons in three dimensions take seconds for one body; here 64 bodies take about two.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.body import template
from t2d_rt.core.checks import instance, integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.pipeline.targets import skin
from t2d_rt.plots.canvas import blank_figure, drawable
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_CELLS = 2048
"""Greatest number of bodies on a sheet."""

PIXELS_PER_M = 84
OVERSAMPLING = 2
"""Pixels of the z-buffer along each side of a pixel of the sheet."""

BELOW_M, LEAST_HEIGHT_M, LEAST_WIDTH_M, MARGIN_M, HEADROOM_M = 0.15, 2.0, 1.3, 0.12, 0.2
"""Extent of a cell: depth that is shown below the floor, least height above the floor, least width, and margins at the sides and
above [m]."""

TRAVEL_M = 0.5
"""Motions that travel less than this [m] are seen relative to the direction that the person faces at the beginning."""

COLOURS = {"": (0.80, 0.78, 0.74), "left": (0.42, 0.60, 0.85), "right": (0.88, 0.52, 0.42)}
"""Colours of trunk and head, and of the limbs on either side."""
PAPER, FLOOR, LINE = 1.0, 0.93, 0.55
"""Grey levels above the floor, below it, and of the floor's line."""

DPI, LABELS_IN, TITLE_IN = 160, 1.6, 0.35
"""Pixels per inch of a sheet, and space for labels and for the title [inch]."""

LIGHT = np.array([0.35, 0.80, 0.50])
"""Direction towards the light in the picture's frame: right, towards the camera, up."""


def contact_sheet(
    motions: Sequence[Motion],
    *,
    labels: Sequence[str] | None = None,
    columns: int = 8,
    body: str = "adult",
    view_deg: float = 90.0,
    title: str | None = None,
) -> Figure:
    """Skinned bodies over time: a row for each motion, `columns` instants from its begin to its end.

    view_deg: azimuth of the camera about the vertical [deg]: 0 is ahead of the person, in the direction of travel (or that they
        face, if there is none); 90 is at the person's right, so that they walk to the right of the picture.
    The body is at the centre of each cell; the floor is a line, the left limbs are blue and the right ones red.
    """
    rows = [checked_motion(motion) for motion in instance("motions", motions, (list, tuple), "a list of motions")]
    integer("columns", columns, 2, 64)
    number("view_deg", view_deg, -360, 360, unit="degrees")
    names = [f"{number}" for number in range(1, len(rows) + 1)] if labels is None else list(labels)
    if not rows or len(rows) * columns > MOST_CELLS:
        raise InputError(f"a sheet has 1 to {MOST_CELLS} bodies, got {len(rows)} motions at {columns} instants")
    if len(names) != len(rows):
        raise InputError(f"labels must be as many as the {len(rows)} motions, got {len(names)}")
    projected = [_projected(motion, body, columns, view_deg) for motion in rows]
    faces = template(body).faces
    high = max(LEAST_HEIGHT_M, max(float(bodies[..., 2].max()) for bodies in projected) + HEADROOM_M)
    spans = [float(np.ptp(cell[:, 0])) for bodies in projected for cell in bodies]
    size = max(LEAST_WIDTH_M, max(spans) + MARGIN_M), high
    colour = face_colours(body)
    image = np.concatenate(
        [np.concatenate([cell_image(cell, faces, colour, size) for cell in bodies], axis=1) for bodies in projected]
    )
    times = [np.linspace(0, motion.duration_s, columns) for motion in rows]
    return _figure(image, [drawable("labels", name) for name in names], times, size, title)


def _projected(motion: Motion, body: str, columns: int, view_deg: float) -> np.ndarray:
    """Vertices (columns, V, 3) in the picture's frame: right, towards the camera, up [m]."""
    ahead = _direction(motion)
    angle = math.radians(view_deg)
    camera = math.cos(angle) * ahead + math.sin(angle) * np.array([ahead[1], -ahead[0], 0.0])
    axes = np.stack([np.cross([0.0, 0.0, 1.0], camera), camera, [0.0, 0.0, 1.0]])
    return skin(motion, body).at(np.linspace(0, motion.duration_s, columns)) @ axes.T


def _direction(motion: Motion) -> np.ndarray:
    """Horizontal unit vector (3,) from the first to the last position of the pelvis, or in the direction that the body faces at
    first."""
    gone = (motion.joints[-1, 0] - motion.joints[0, 0]) * [1, 1, 0]
    if np.linalg.norm(gone) < TRAVEL_M:
        left, right = (motion.joints[0, motion.index(f"{side}_hip")] for side in ("left", "right"))
        gone = np.cross(left - right, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(gone))
    return gone / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])


def face_colours(body: str) -> np.ndarray:
    """Colour (F, 3) of each face of a body, by the side of the limb that moves it."""
    form = template(body)
    carriers = form.weights[form.faces].sum(axis=1).argmax(axis=1)
    sides = [name.split("_")[0] if "_" in name and "collar" not in name else "" for name in CANONICAL_JOINTS]
    return np.array([COLOURS[side] for side in sides])[carriers]


def cell_image(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, size_m: tuple[float, float]) -> np.ndarray:
    """Picture of a body as seen from the camera, (height, width, 3) in 0..1; `vertices` (V, 3) are right, towards the camera,
    up."""
    scale = PIXELS_PER_M * OVERSAMPLING
    width, height = (OVERSAMPLING * math.ceil(PIXELS_PER_M * length_m) for length_m in (size_m[0], size_m[1] + BELOW_M))
    image = np.full((height, width, 3), PAPER)
    floor = height - round(BELOW_M * scale)
    image[floor:] = FLOOR
    image[floor : floor + OVERSAMPLING] = LINE
    middle = 0.5 * (vertices[:, 0].min() + vertices[:, 0].max())
    corners = vertices[faces]
    normal = unit(edge_cross(corners))
    front = normal[:, 1] > 0
    shade = 0.45 + 0.55 * np.clip(normal[front] @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    points, face = samples_of(corners[front], 1.0 / scale)
    return drawn_into(
        image, points, (colours[front] * shade[:, None])[face], scale, (width / 2 - middle * scale, floor)
    )


def drawn_into(
    image: np.ndarray, points: np.ndarray, colours: np.ndarray, scale: float, origin: tuple[float, float]
) -> np.ndarray:
    """Draws points (N, 3), right, towards the camera, up [m], into an image (height, width, 3) with `scale` pixels per metre, in
    which the point 0 is at column and row `origin`; returns it with squares of OVERSAMPLING averaged to one pixel."""
    height, width = image.shape[:2]
    column = np.floor(origin[0] + points[:, 0] * scale).astype(int)
    row = np.floor(origin[1] - points[:, 2] * scale).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    order = np.argsort(points[inside, 1], kind="stable")  # far points first, so that near ones are drawn over them
    image[row[inside][order], column[inside][order]] = colours[inside][order]
    return image.reshape(height // OVERSAMPLING, OVERSAMPLING, width // OVERSAMPLING, OVERSAMPLING, 3).mean(axis=(1, 3))


def samples_of(corners: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) on triangles (F, 3, 3), at most `spacing_m` apart, and the index of the triangle of each, (N,)."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    counts = np.maximum(np.ceil(longest / spacing_m), 1).astype(int)
    points, owners = [np.zeros((0, 3))], [np.zeros(0, int)]
    for count in np.unique(counts):
        members = np.flatnonzero(counts == count)
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        within = i + j <= count
        first, second = i[within] / count, j[within] / count
        weights = np.stack([1 - first - second, first, second], axis=1)
        points.append((weights @ corners[members]).reshape(-1, 3))
        owners.append(np.repeat(members, len(weights)))
    return np.concatenate(points), np.concatenate(owners)


def _figure(
    image: np.ndarray, labels: list[str], times: list[np.ndarray], size: tuple[float, float], title: str | None
) -> Figure:
    rows, columns = len(labels), len(times[0])
    height, width = image.shape[0] / rows, image.shape[1] / columns
    wide, tall = image.shape[1] / DPI + LABELS_IN, image.shape[0] / DPI + TITLE_IN
    figure = blank_figure(wide, tall)
    figure.set_layout_engine("none")  # labels outside the axes, which a layout engine would ignore
    axes: Axes = figure.add_axes((1 - image.shape[1] / DPI / wide, 0, image.shape[1] / DPI / wide, 1 - TITLE_IN / tall))
    axes.imshow(image, interpolation="none", aspect="equal")
    for row, (label, instants) in enumerate(zip(labels, times, strict=True)):
        axes.axhline(row * height - 0.5, color="0.75", linewidth=0.5)
        for column, instant in enumerate(instants):
            place = (column + 0.04) * width, (row + 0.03) * height
            axes.text(*place, f"{instant:.2f} s", fontsize=6, color="0.35", va="top", parse_math=False)
        floor = (row + 1) * height - BELOW_M * PIXELS_PER_M
        for level in range(int(size[1]) + 1):
            place = -4, floor - level * PIXELS_PER_M
            axes.plot([-3, 0], [place[1]] * 2, color="0.4", linewidth=0.6, clip_on=False)
            axes.text(*place, f"{level} m", fontsize=5, color="0.4", ha="right", va="center")
        lines = textwrap.wrap(label, 24, max_lines=5, placeholder=" ...")
        axes.text(-34, (row + 0.5) * height, "\n".join(lines), fontsize=7, ha="right", va="center", parse_math=False)
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    axes.set_axis_off()
    if title is not None:
        axes.set_title(drawable("title", title), fontsize=10, parse_math=False)
    return figure
