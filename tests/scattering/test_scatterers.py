"""Scatterers have one signature: one of one's own takes a class and a line, and its echoes are in the cube with their labels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from typing_extensions import override

import t2d_rt as t2d
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.pipeline import prepare
from t2d_rt.pipeline.prepare import Preparation
from t2d_rt.types import Accuracy, EchoArrays, Echoes, Motion, Radar
from t2d_rt.types.scatterer import EchoLabels, FrameBlock, Poses, Scatterer, Visibility

RCS_M2 = 0.3
RADAR = Radar.preset("table2")


@dataclass(frozen=True, kw_only=True, eq=False)
class PelvisPoint(Scatterer):
    """A point at the pelvis, the same from all sides."""

    target: int
    place: CubicSpline
    radar: Radar

    @property
    @override
    def labels(self) -> EchoLabels:
        return EchoLabels.of(1, target=self.target)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        range_m = np.linalg.norm(self.place(block.times_s) - self.radar.tx_position_m, axis=1)[:, None]
        amplitude = self.radar.link_amplitude * np.sqrt(RCS_M2) / range_m**2
        return EchoArrays(2 * range_m / SPEED_OF_LIGHT, amplitude.astype(np.complex64))


def pelvis(preparation: Preparation, number: int, times_s: np.ndarray) -> Iterator[Scatterer]:
    motion, radar = preparation.model.targets[number], preparation.model.radar
    if isinstance(motion, Motion):
        place = CubicSpline(np.arange(len(motion.joints)) / motion.rate_hz, motion.joints[:, 0])
        yield PelvisPoint(times_s=times_s, target=number, place=place, radar=radar, echoes=1)


def walk(stop_s: float = 1.6) -> Motion:
    return t2d.place(t2d.trim(t2d.example("walk"), 1.0, stop_s), distance_m=4.0)


def test_a_scatterer_of_ones_own_takes_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def cube() -> np.ndarray:
        accuracy = {"synthesis_error_db": -90.0, "surface_rate_hz": 200.0}
        return np.asarray(t2d.simulate(walk(), radar=RADAR, method="ellipsoid", accuracy=accuracy).adc)

    without = cube()
    monkeypatch.setattr(prepare, "SCATTERERS", (*prepare.SCATTERERS, pelvis))
    found = cube() - without
    frames_s = np.arange(len(walk().joints)) / walk().rate_hz
    times_s, place = np.linspace(0.0, frames_s[-1], 200), CubicSpline(frames_s, walk().joints[:, 0])
    range_m = np.linalg.norm(place(times_s) - RADAR.tx_position_m, axis=1)[:, None]
    alone = Echoes(
        times_s=times_s,
        delay_s=2 * range_m / SPEED_OF_LIGHT,
        amplitude=RADAR.link_amplitude * np.sqrt(RCS_M2) / range_m**2,
    )
    expected = t2d.synthesize(alone, RADAR)
    assert np.sum(np.abs(found - expected) ** 2) < 1e-5 * np.sum(np.abs(expected) ** 2)


@pytest.mark.usefixtures("coarse_bodies")
@pytest.mark.parametrize("method", ["ellipsoid", "mesh"])
def test_each_echo_tells_where_it_comes_from(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepare, "SCATTERERS", (*prepare.SCATTERERS, pelvis))
    experiment = Experiment.without_targets(RADAR, method=method, collisions="ignore")
    room = set_up([walk(1.1)], "empty_room", experiment).model
    prepared = prepare.prepare(room, Accuracy(), "specular")
    labels = EchoLabels.joined(part.labels for part in prepared.parts)
    assert sum(part.echoes for part in prepared.parts) == len(labels.target) == len(labels.path)
    assert set(labels.path[labels.target == 0]) == {pair.name for pair in room.pairs(Accuracy()).pairs}  # type: ignore[union-attr]
    static = labels.target == -1
    assert 0 < static.sum() == sum(each.echoes for each in prepared.static)
    assert set(labels.bounces[static]) == {0}
    assert set(labels.bounces[~static]) == {1}
    points = (labels.target == 0) & (labels.face == -1) & (labels.ellipsoid == -1)
    assert points.sum() == 1  # the point at the pelvis alone has no face and no ellipsoid
    limit = 17 if method == "ellipsoid" else len(room.geometries[0].faces)
    assert max(labels.face.max(), labels.ellipsoid.max()) < limit
