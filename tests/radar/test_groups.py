"""Grouping of echoes: what a group may span, and how many groups that takes."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.radar.groups import _grouped


@pytest.mark.parametrize("extent", [0.0, 0.4, 1.0])
def test_no_group_of_several_spans_more_than_one(extent: float) -> None:
    rng = np.random.default_rng(0)
    low = np.cumsum(rng.normal(size=(8, 500)), axis=0).astype(np.float32)
    high = low + extent * rng.random(low.shape, np.float32) if extent else low
    group = _grouped(low, high, (2, 6))
    assert group.min() == 0
    for number in range(group.max() + 1):
        mine = group == number
        assert np.ptp([low[:, mine].min(axis=1), high[:, mine].max(axis=1)], axis=0).max() <= 1


def test_the_first_cells_take_no_more_groups_than_the_features_need() -> None:
    # A grid over ten by ten units holds its items in a hundred cells; halving alone takes 256 groups of 0.625 by 0.625.
    low = np.random.default_rng(0).uniform(0, 10, (2, 5000)).astype(np.float32)
    assert _grouped(low, low, (0, 1)).max() + 1 <= 121
