"""Wrong calls of public functions and classes: one sentence with the name that was meant."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt import dataset, learn, plots, signal
from t2d_rt.core.errors import InputError

RADAR = t2d.Radar.preset("array-3x4", samples=64)
RECORDING: Any = t2d.Recording(
    np.random.default_rng(0).normal(size=(600, RADAR.antennas, 64)).astype(np.complex64), RADAR
)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: RECORDING.plot(foo=1), "Recording.plot has no option 'foo'; choose one of title, ax, cmap, dynamic_range_db"),
        (lambda: RECORDING.plot(titel="a walk"), r"Recording.plot has no option 'titel'; did you mean title\?"),
        (lambda: RECORDING.plot_range_time(limit_db=(-90, -40)), r"has no option 'limit_db'; did you mean limits_db\?"),
        (lambda: RECORDING.plot_range_doppler(gosts=True), r"plot_range_doppler has no option 'gosts'; did you mean ghosts\?"),
        (lambda: RECORDING.plot_point_cloud(limits_db=(-90, -40)), "'limits_db'; choose one of title, ax, cmap, width_in$"),
        (lambda: RECORDING.range_angle(elevation_deg=1), r"Recording.range_angle has no option 'elevation_deg'; did you mean"),
        (lambda: RECORDING.again(devise="cpu"), r"Recording.again has no option 'devise'; did you mean device\?"),
        (lambda: RECORDING.save(), "Recording.save: missing a required argument: 'path'; it takes path, overwrite, figure"),
        (lambda: RECORDING.radar.received_power_w(rcs=1), r"Radar.received_power_w has no option 'rcs'; did you mean rcs_m2\?"),
        (lambda: t2d.simulate("walk", meethod="mesh"), r"simulate has no option 'meethod'; did you mean method\?"),  # type: ignore[call-overload]
        (lambda: t2d.place(t2d.example("walk"), distance=3), r"place has no option 'distance'; did you mean distance_m\?"),  # type: ignore[call-arg]
        (lambda: t2d.add_noise(), "add_noise: missing a required argument: 'recording'; it takes recording"),  # type: ignore[call-arg]
        (lambda: t2d.scenes(1), "scenes: too many positional arguments; it takes nothing"),  # type: ignore[call-arg]
        (lambda: t2d.Radar("table2"), "Radar: too many positional arguments; it takes options by name"),  # type: ignore[call-arg]
        (lambda: t2d.Viewer(RECORDING, titels=["a"]), r"Viewer has no option 'titels'; did you mean titles\?"),  # type: ignore[call-arg]
        (lambda: plots.plot_scene(scene=1, radar=2), r"plot_scene has no option 'radar'; did you mean radar_m\?"),  # type: ignore[call-overload]
        (lambda: signal.stft(1, windw=2), r"stft has no option 'windw'; did you mean"),  # type: ignore[call-arg]
        (lambda: dataset.sample(), "sample: missing a required argument: "),  # type: ignore[call-arg]
        (lambda: learn.model_names(1), "model_names: too many positional arguments"),  # type: ignore[call-arg]
    ],
)  # fmt: skip
def test_a_wrong_call_is_told_in_one_sentence(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as told:
        call()
    assert isinstance(told.value, TypeError)  # as Python's own


def test_public_functions_are_themselves() -> None:
    """They keep signature, docstring and pickle; and an error of theirs is theirs."""
    for value in (t2d.load_motion, t2d.simulate, signal.stft, plots.plot_spectrogram):
        assert pickle.loads(pickle.dumps(value)) is value
        assert value.__doc__
    assert "tolerance_db" in inspect.signature(t2d.simulate).parameters
    assert t2d.simulate is t2d.simulate
    with pytest.raises(TypeError, match=r"^mine$"):
        t2d.simulate(Mine())  # type: ignore[arg-type]


class Mine:
    """Raises what no library should hide."""

    @property
    def __class__(self) -> Any:
        raise TypeError("mine")
