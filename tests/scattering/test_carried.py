"""Values carried along from a mesh's own vertices to those of its facets: the sparse product, in blocks of rows and in threads."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest
from scipy import sparse

from t2d_rt.core.backend import ALIGNMENT, in_threads, limited_threads
from t2d_rt.scattering.refinement import ROWS_AT_ONCE, apply_operator


@pytest.fixture(params=[1, 2])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    with limited_threads(request.param):
        yield request.param


@pytest.mark.parametrize("rows", [0, 1, ROWS_AT_ONCE, 2 * ROWS_AT_ONCE + 7])
def test_each_row_is_the_product_at_every_instant(rows: int, threads: int) -> None:
    rng = np.random.default_rng(rows)
    operator = sparse.random_array((rows, 40), density=0.2, format="csr", rng=rng, dtype=np.float32)
    values = rng.normal(size=(5, 40, 4)).astype(np.float32)
    found = apply_operator(operator, values)
    assert found.shape == (rows, 5, 4)
    assert found.dtype == np.float32
    assert not rows or found.ctypes.data % ALIGNMENT == 0
    for instant in range(5):
        assert np.array_equal(found[:, instant], operator @ values[instant])


def test_every_item_is_worked_on_once(threads: int) -> None:
    done: list[int] = []
    in_threads(done.append, range(3, 20))
    assert sorted(done) == list(range(3, 20))
    workers: set[int] = set()
    in_threads(lambda _: workers.add(threading.get_ident()), range(20))
    assert len(workers) <= threads
    assert (workers == {threading.get_ident()}) == (threads == 1)
    in_threads(done.append, ())
    assert len(done) == 17


def test_an_error_of_one_item_is_raised(threads: int) -> None:
    def work(item: int) -> None:
        if item == 3:
            raise ValueError("item 3")

    with pytest.raises(ValueError, match="item 3"):
        in_threads(work, range(5))
