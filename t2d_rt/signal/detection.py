"""How Texas Instruments' devices detect points in a cube, and the chirps and detection settings of shipped sensors."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from t2d_rt.core.checks import unknown_name
from t2d_rt.core.files import read_yaml
from t2d_rt.types.fields import Count, Fields, Number
from t2d_rt.types.radar import Radar
from t2d_rt.types.ti_cfg import Source, numbers, read_commands

Steps = Annotated[Count, Field(ge=0, le=1000)]
Some = Annotated[Count, Field(ge=1, le=1000)]
Ratio = Annotated[Number, Field(gt=0)]
Angle = Annotated[Number, Field(gt=0, le=30)]
View = Annotated[Number, Field(gt=0, lt=90)]
Part = Annotated[Number, Field(ge=0, le=1)]
Loading = Annotated[Number, Field(gt=0, le=1)]


class Detection(Fields):
    """Settings of point detection on a device of Texas Instruments; the defaults are 3D people tracking's 6 m configuration
    (IWR6843AOP).

    People tracking searches a map of range and azimuth, the out-of-box demo of the SDK one of range and Doppler; `over` chooses.
    """

    noun: ClassVar[str] = "detection"

    over: Literal["azimuth", "doppler"] = "azimuth"
    """Second axis of the map that is searched. "azimuth": Capon's power, tested along both axes. "doppler": the mean logarithm of
    the antennas' powers, tested along range alone."""
    range_window: str = "hann"
    """Window of the range FFT."""
    range_skip: tuple[Steps, Steps] = (4, 4)
    """Range bins at the near and the far end that are not searched."""
    angle_skip: tuple[Steps, Steps] = (2, 2)
    """Azimuths at either end that are not tested; they still count as training cells."""
    training_cells: tuple[Some, Some] = (8, 12)
    """Number of training cells on one side, along range and azimuth; the noise is their mean on the quieter side."""
    guard_cells: tuple[Steps, Steps] = (4, 12)
    """Number of guard cells between the training cells and the tested cell, along range and azimuth."""
    thresholds: tuple[Ratio, Ratio] = (5.0, 8.0)
    """Least ratio of power to noise, along range and azimuth. A peak over azimuth at its range only needs the former."""
    side_lobe: Part = 0.4
    """Over azimuth: least power relative to that of the strongest azimuth at the same range."""
    group: tuple[bool, bool] = (False, False)
    """Over Doppler: whether a detection must be no weaker than its neighbours along range and along Doppler."""
    second_peak: Part = 0.5
    """Over Doppler: least amplitude of a second azimuth in a cell relative to the first; 1 accepts none."""
    azimuths: Annotated[Count, Field(ge=8, le=4096)] = 64
    """Over Doppler: length of the azimuth FFT."""
    steps_deg: tuple[Angle, Angle] = (0.75, 3.0)
    """Over azimuth: steps of the search over azimuth and elevation about boresight [deg]."""
    loading: tuple[Loading, Loading] = (0.001, 0.03)
    """Over azimuth: diagonal loading of the covariance, relative to the mean power of the antennas, for azimuth and for
    elevation."""
    field_of_view_deg: tuple[View, View] = (70.0, 70.0)
    """Greatest azimuth and elevation of a point [deg]."""
    most_points: Annotated[Count, Field(ge=1, le=10_000)] = 150
    """Greatest number of points in a frame: over azimuth the strongest (no known recording has more), over Doppler the first in the
    device's order, from zero speed over receding to approaching."""

    @classmethod
    def from_ti_cfg(cls, source: Source) -> Self:
        """Settings from a .cfg file of the 3D people-tracking demo, or from its lines."""
        commands = read_commands(source)
        cfar = numbers(commands, "dynamicRACfarCfg", 13)[1:]
        azimuth, elevation = numbers(commands, "dynamicRangeAngleCfg", 3), numbers(commands, "dynamic2DAngleCfg", 3)
        view = numbers(commands, "fovCfg", 3)
        whole = [int(value) for value in cfar[:8]]
        return cls(
            range_skip=(whole[0], whole[1]), angle_skip=(whole[2], whole[3]), training_cells=(whole[4], whole[5]),
            guard_cells=(whole[6], whole[7]), thresholds=(cfar[8], cfar[9]), side_lobe=cfar[10],
            steps_deg=(azimuth[1], elevation[1]), loading=(azimuth[2], elevation[2]),
            field_of_view_deg=(view[1], view[2]),
        )  # fmt: skip


def sensors() -> list[str]:
    """Names that `sensor` accepts."""
    return sorted(_packaged())


def sensor(name: str, **changes: object) -> tuple[Radar, Detection]:
    """Radar and detection settings of the sensor behind a published set of points, "mars" or "radhar"; `changes` override fields of
    the radar."""
    sensor_files, key = _packaged(), str(name).lower().replace("_", "-")
    if key not in sensor_files:
        raise unknown_name("sensor", name, sorted(sensor_files))
    settings = read_yaml(sensor_files[key], noun="sensor", example="radar, changes and detection")
    return Radar.preset(settings["radar"], **{**settings["changes"], **changes}), Detection(**settings["detection"])


@cache
def _packaged() -> dict[str, Path]:
    folder = Path(str(files("t2d_rt"))) / "signal" / "sensors"
    return {path.stem: path for path in folder.glob("*.yaml")}
