"""Vectors of three components: against NumPy's own norm and product, for all kinds of numbers and shapes."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.geometry.vectors import edge_cross, unit, vector_product


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, np.float32, np.float64])
def test_unit_vectors_are_those_of_any_kind_of_number(kind: type) -> None:
    """Squares of integers would wrap around: of 100 in a byte, of 100 000 in four."""
    size = 100 if kind is np.int8 else 100_000
    found = unit(np.array([[size, 0, 0], [0, 0, 0], [0, -size, size]], dtype=kind))
    np.testing.assert_allclose(found, [[1, 0, 0], [0, 0, 0], [0, -(0.5**0.5), 0.5**0.5]], atol=1e-6)


@pytest.mark.parametrize("shape", [(3,), (0, 3), (5, 3), (4, 2, 3), (6, 2), (2, 3, 4)])
def test_unit_vectors_have_the_shape_that_was_given(shape: tuple[int, ...]) -> None:
    vectors = np.random.default_rng(0).normal(size=shape)
    found = unit(vectors)
    assert found.shape == shape
    np.testing.assert_array_equal(found, vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


@pytest.mark.parametrize(
    ("one", "other"), [((3,), (3,)), ((0, 3), (3,)), ((5, 3), (3,)), ((4, 2, 3), (2, 3)), ((4, 1, 3), (2, 3))]
)
def test_products_are_those_of_numpy(one: tuple[int, ...], other: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=one), rng.normal(size=other)
    np.testing.assert_array_equal(vector_product(first, second), np.cross(first, second))
    found, known = (each(first.astype(np.float32), second.astype(np.float32)) for each in (vector_product, np.cross))
    assert found.dtype == known.dtype
    np.testing.assert_array_equal(found, known)


@pytest.mark.parametrize("shape", [(3, 3), (0, 3, 3), (5, 3, 3), (2, 4, 3, 3)])
def test_edges_span_what_they_span(shape: tuple[int, ...]) -> None:
    corners = np.random.default_rng(0).normal(size=shape)
    a, b, c = np.moveaxis(corners, -2, 0)
    found = edge_cross(corners)
    assert found.shape == shape[:-1]
    np.testing.assert_array_equal(found, np.cross(b - a, c - a))
