"""Between poses and samples numbers stay on the device: a GPU waits for each copy to the host."""

from __future__ import annotations

import drjit as dr
import pytest

import t2d_rt as t2d

OF_BLOCK = 3
"""Delays, amplitudes and their slopes."""
OF_WINDOW = 1
"""Fields of the buckets, of which samples are made, of a transmitter and up to four receivers."""
OF_SAMPLES = 1
"""What of a body at a chunk of sample times is occluded."""


@pytest.mark.parametrize(
    ("radar", "transmitters"), [("table2", 1), pytest.param("array-3x4", 3, marks=pytest.mark.slow)]
)
def test_a_block_is_copied_to_the_host_this_often(
    radar: str, transmitters: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies: list[str] = []
    for name in ("numpy", "__array__"):
        copied = getattr(dr.ArrayBase, name)
        monkeypatch.setattr(
            dr.ArrayBase, name, lambda *given, of=copied, **options: (copies.append(""), of(*given, **options))[1]
        )
    walk = t2d.trim(t2d.example("walk"), 1.0, 1.2)  # one block, one window
    t2d.simulate(walk, radar=radar, device="cpu")
    assert len(copies) == OF_BLOCK + OF_WINDOW * transmitters + OF_SAMPLES
