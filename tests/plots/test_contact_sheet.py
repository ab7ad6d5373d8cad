"""Contact sheets: bodies at their places, the near before the far, sizes, refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from builders import rest_pose, walk
from t2d_rt.body import template
from t2d_rt.core.errors import InputError
from t2d_rt.motion import trim
from t2d_rt.view.contact_sheet import (
    COLOURS,
    FLOOR,
    PAPER,
    PIXELS_PER_M,
    cell_image,
    contact_sheet,
    face_colours,
    samples_of,
)

GREEN, RED = np.array([0.1, 0.9, 0.1]), np.array([0.9, 0.1, 0.1])


def square(size_m: float, toward_m: float, height_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Two faces that look at the camera."""
    half = size_m / 2
    corners = [(x, toward_m, height_m + z) for x, z in ((-half, -half), (half, -half), (half, half), (-half, half))]
    return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]])[:, ::-1]


def drawn(image: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Where pixels have the hue of a colour."""
    grey = np.ptp(image, axis=-1) < 0.1
    return ~grey & (image.argmax(axis=-1) == colour.argmax())


def test_a_square_is_as_large_as_it_is_and_where_it_is() -> None:
    vertices, faces = square(0.5, 0.0)
    image = cell_image(vertices, faces, np.tile(GREEN, (2, 1)), (2.0, 2.0))
    rows, columns = np.nonzero(drawn(image, GREEN))
    side = 0.5 * PIXELS_PER_M
    assert len(rows) == pytest.approx(side**2, rel=0.06)
    floor = np.flatnonzero(image[:, 0, 0] < PAPER)[0]
    assert (floor - rows.mean()) / PIXELS_PER_M == pytest.approx(1.0, abs=0.02)
    assert columns.mean() == pytest.approx(image.shape[1] / 2, abs=1)
    assert image[-1, 0, 0] == pytest.approx(FLOOR)


@pytest.mark.parametrize("near_first", [True, False])
def test_near_faces_hide_far_ones_and_backs_are_not_drawn(near_first: bool) -> None:
    near, far = square(0.4, 0.5), square(0.8, -0.5)
    parts = [(near, GREEN), (far, RED)][:: 1 if near_first else -1]
    vertices = np.concatenate([part[0] for part, _ in parts])
    faces = np.concatenate([part[1] + 4 * number for number, (part, _) in enumerate(parts)])
    colours = np.repeat([colour for _, colour in parts], 2, axis=0)
    image = cell_image(vertices, faces, colours, (2.0, 2.0))
    green, red = (drawn(image, colour).sum() / PIXELS_PER_M**2 for colour in (GREEN, RED))
    assert green == pytest.approx(0.16, rel=0.08)
    assert red == pytest.approx(0.64 - 0.16, rel=0.08)
    behind = cell_image(vertices, faces[:, ::-1], colours, (2.0, 2.0))
    assert not drawn(behind, GREEN).any()
    assert not drawn(behind, RED).any()


def test_faces_have_the_colour_of_their_side() -> None:
    colours, form = face_colours("adult"), template("adult")
    middles = form.vertices[form.faces].mean(axis=1)
    feet = middles[:, 2] < 0.3
    left = middles[:, 1] > 0
    assert (colours[feet & left] == COLOURS["left"]).all()
    assert (colours[feet & ~left] == COLOURS["right"]).all()
    assert (colours[middles[:, 2] > form.vertices[:, 2].max() - 0.1] == COLOURS[""]).all()


def image_of(*motions: Any, **options: Any) -> np.ndarray:
    figure = contact_sheet(list(motions), **options)
    return np.asarray(figure.axes[0].images[0].get_array())


def extent_m(image: np.ndarray) -> tuple[float, float]:
    """Width and height of what is drawn in one cell."""
    rows, columns = np.nonzero(np.ptp(image, axis=-1) > 0.02)
    return np.ptp(columns) / PIXELS_PER_M, np.ptp(rows) / PIXELS_PER_M


def test_bodies_have_their_height_and_are_seen_from_where_it_is_said() -> None:
    motion = rest_pose()  # arms apart, facing +x
    form = template().vertices
    breadth, depth, height = np.ptp(form[:, 1]), np.ptp(form[:, 0]), np.ptp(form[:, 2])
    for view, wide in ((0.0, breadth), (90.0, depth)):
        image = image_of(motion, columns=2, view_deg=view)
        width, high = extent_m(image[:, : image.shape[1] // 2])
        assert high == pytest.approx(height, abs=0.06)
        assert width == pytest.approx(wide, abs=0.06)
    front = image_of(motion, columns=2, view_deg=0.0)
    cell = front[:, : front.shape[1] // 2]
    blue = np.nonzero(cell[..., 2] > cell[..., 0] + 0.1)[1].mean()
    red = np.nonzero(cell[..., 0] > cell[..., 2] + 0.2)[1].mean()
    assert blue > red  # the left of one who faces us is on our right


def test_a_walk_goes_to_the_right_whatever_its_heading() -> None:
    piece = trim(walk(), 0.5, 2.0)
    angle = np.radians(130)
    matrix = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    half = np.array([0, 0, np.sin(angle / 2), np.cos(angle / 2)])
    from t2d_rt.motion import quaternions

    turned = replace(
        piece, joints=piece.joints @ matrix.T, rotations=quaternions.multiply(half[None, None], piece.rotations)
    )
    image, again = image_of(piece, columns=3), image_of(turned, columns=3)
    assert image.shape == again.shape
    assert np.abs(image - again).mean() < 0.01


def test_rows_columns_and_labels() -> None:
    piece = trim(walk(), 0.5, 1.5)
    figure = contact_sheet([piece, piece, piece], columns=4, labels=["a$b", "two", "three"], title="T")
    (axes,) = figure.axes
    texts = [each.get_text() for each in axes.texts]
    assert {"a$b", "two", "three", "0.00 s", "0.33 s", "1.00 s", "0 m", "1 m"} <= set(texts)
    assert texts.count("1.00 s") == 3
    assert axes.get_title() == "T"
    height, width = axes.images[0].get_array().shape[:2]  # type: ignore[union-attr]
    assert height % 3 == 0
    assert width % 4 == 0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"motions": []}, "1 to 2048 bodies, got 0"),
        ({"columns": 1}, "columns must be an integer in 2..64"),
        ({"labels": ["a", "b"]}, "labels must be as many as the 1 motions, got 2"),
        ({"body": "giant"}, "unknown body 'giant'"),
        ({"view_deg": "side"}, "view_deg must be a number"),
        ({"motions": [None]}, "motion must be a Motion"),
        ({"motions": None}, "motions must be a list of motions"),
        ({"labels": [3]}, "labels must be a text"),
    ],
)
def test_what_it_cannot_draw(options: dict[str, Any], sentence: str) -> None:
    given: dict[str, Any] = {"motions": [rest_pose()], **options}
    with pytest.raises(InputError, match=sentence):
        contact_sheet(given.pop("motions"), **given)


def test_samples_of_large_triangles_leave_no_gaps() -> None:
    corners = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 0, 1]], [[0, 1, 0], [0.004, 1, 0], [0, 1, 0.004]]])
    points, owner = samples_of(corners, 0.01)
    assert set(owner[points[:, 1] == 1]) == {1}
    edge = np.sort(points[(owner == 0) & (points[:, 2] == 0), 0])
    assert (edge[0], edge[-1]) == (0, 2)
    assert np.diff(edge).max() <= 0.01
