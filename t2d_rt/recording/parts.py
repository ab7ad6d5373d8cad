"""The parts of a recording: the echoes of each segment, path pair, target or number of bounces, and which of them dominate a
cell."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import override

from t2d_rt.core.checks import instance, number, shown, unknown_name
from t2d_rt.core.constants import decibel
from t2d_rt.core.cube_storage import ScratchFile
from t2d_rt.core.cubes import DiskCube
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.pipeline.parts import PartNames
from t2d_rt.plots.parts import Poses
from t2d_rt.recording.maps import background, labelled
from t2d_rt.signal.doppler import part_spectrograms
from t2d_rt.types import Ellipsoids
from t2d_rt.types.scatterer import EchoLabels

if TYPE_CHECKING:
    import xarray as xr

    from t2d_rt.pipeline.echo_model import Model
    from t2d_rt.recording.recording import Recording

GROUPS: Mapping[str, tuple[str, ...]] = {
    "head": ("head", "neck"),
    "trunk": ("chest", "abdomen", "pelvis"),
    "arms": tuple(f"{side}_{name}" for side in ("left", "right") for name in ("upper_arm", "forearm", "hand")),
    **{f"{name}s": (f"left_{name}", f"right_{name}") for name in ("thigh", "shank")},
    "feet": ("left_foot", "right_foot"),
}
"""Limbs, into which the segments of a body are grouped for pictures."""
NONE = "the recording has no parts; simulate with split='segment', 'path', 'target' or 'bounce'"

MOST_POSES = 24
"""Greatest number of bodies drawn above one spectrogram."""


class Parts(Mapping[str, "Recording"]):
    """The parts of a recording by name. Each is a recording without receiver noise, and together they add up to the echoes of the
    whole.

    Samples of a part are computed when they are read. Maps of the parts are stacked along an axis `part`.
    """

    def __init__(self, whole: Recording, cubes: Mapping[str, DiskCube]) -> None:
        self._whole, self._cubes = whole, dict(cubes)
        self._spectrogram: xr.DataArray | None = None

    @override
    def __getitem__(self, name: str) -> Recording:
        if name not in self._cubes:
            raise KeyError(f"there is no part {name!r}; there are {', '.join(self._cubes) or 'none'}")
        return self._whole._of_part(name, self._cubes[name])

    @override
    def __iter__(self) -> Iterator[str]:
        return iter(self._cubes)

    @override
    def __len__(self) -> int:
        return len(self._cubes)

    def __repr__(self) -> str:
        return f"Parts({', '.join(self._cubes) or 'none: simulate with split='})"

    @property
    def cubes(self) -> dict[str, DiskCube]:
        """ADC cube of each part by the part's name."""
        return dict(self._cubes)

    def grouped(self, groups: Mapping[str, Sequence[str]] = GROUPS) -> Parts:
        """Combines parts to groups, whose samples are summed before any map is made; parts in no group stay by themselves.

        groups: names of the groups, and of the parts in each; by default the limbs of a body. Groups without a part are left out.
        """
        members = self.members(groups)
        file = ScratchFile()
        cubes = {name: _sum([self._cubes[part] for part in parts], file) for name, parts in members.items()}
        return Parts(self._whole, cubes)

    def members(self, groups: Mapping[str, Sequence[str]] = GROUPS) -> dict[str, list[str]]:
        """Names of the parts in each group, by the group's name; a part in no group is a group by itself."""
        if groups is not GROUPS:
            self._check(groups)
        members_by_group: dict[str, list[str]] = {}
        # Where there are several targets, the name of each stands before the names of its segments.
        whose = dict.fromkeys(cube.rpartition(": ")[0] for cube in self._cubes)
        for target, (name, members) in itertools.product(whose, groups.items()):
            before = f"{target}: " if target else ""
            mine = [cube for cube in self._cubes if cube in members or cube.removeprefix(before) in members]
            mine = [part for part in mine if part.rpartition(": ")[0] == target]
            if mine:
                members_by_group[before + name] = mine
        grouped_parts = set(itertools.chain(*members_by_group.values()))
        single_parts = {name: [name] for name in self._cubes if name not in grouped_parts}
        if twice := sorted(members_by_group.keys() & single_parts.keys()):
            raise InputError(f"groups has {twice[0]!r} for a name, which another part has; choose another one")
        return members_by_group | single_parts

    def _check(self, groups: Any) -> None:
        """Refuses groups that do not map names to lists of parts, that have an unknown part, or that hold a part twice."""
        instance("groups", groups, Mapping, "a mapping of names to lists of parts")
        part_names = {cube.rpartition(": ")[2] for cube in self._cubes} | self._cubes.keys()
        held: set[str] = set()
        for name, members in groups.items():
            texts = isinstance(members, list | tuple) and all(isinstance(member, str) for member in members)
            if not isinstance(name, str) or not texts:
                raise InputError(f"groups must map names to lists of parts, got {shown({name: members})}")
            for member in members:
                if member not in part_names:
                    raise InputError(f"groups: {unknown_name('part', member, sorted(part_names))}")
                if member in held:
                    raise InputError(f"groups has the part {member} twice; name it once")
                held.add(member)

    @property
    def spectrogram(self) -> xr.DataArray:
        """Spectrograms of the parts, power [dB re 1 W] (part, velocity_mps, time_s), with the options of the whole recording."""
        if self._spectrogram is None:
            self._spectrogram = self._stacked([part.spectrogram for part in self.values()])
        return self._spectrogram

    @property
    def contributions(self) -> xr.DataArray:
        """Contribution of each part to the power of the whole spectrogram [W], (part, velocity_mps, time_s); all of them add up to
        it.

        The contribution of a part is Re(S_p S*), S_p its short-time spectrum and S that of all echoes: each of two parts gets half
        of their interference, and a part that lowers the sum has a negative contribution. What the receiver adds to the power of
        the echoes is a part of its own, `receiver`, and a learned background another, `background`.
        """
        whole = self._whole
        if not self._cubes:
            raise InputError(NONE)
        options = {**whole.processing, "mti": whole._mti}
        spectrograms = part_spectrograms([*self._cubes.values()], whole.radar, **options)
        powers = {
            name: spectrogram.power.astype(np.float64) for name, spectrogram in zip(self, spectrograms, strict=True)
        }
        image, settings = whole.spectrogram, whole.settings.get("background")
        left = 10.0 ** (image.values.astype(np.float64) / 10.0) - np.sum([*powers.values()], axis=0)
        added: dict[str, np.ndarray] = {}
        if settings is not None:
            learned = background(image.velocity_mps.values, image.time_s.values, settings)
            added["background"] = learned.power_w(settings["level_db"]).astype(np.float64)
        if whole.noise_dbm is not None:
            added["receiver"] = left - sum(added.values())
        if common_names := sorted(powers.keys() & added.keys()):
            raise InputError(
                f"a part has the name {common_names[0]}, which another one of the contributions has; group it by another name"
            )
        axes = {"velocity_mps": spectrograms[0].velocity_mps, "time_s": spectrograms[0].time_s}
        powers |= added
        coordinates = {"part": [*powers], **axes}
        return labelled("contributions", np.stack([*powers.values()]), ("part", *axes), coordinates, {"units": "W"})

    def range_doppler_at(self, time_s: float | None = None, *, interval_s: float | None = None) -> xr.DataArray:
        """Range-Doppler maps of the parts, power [dB re 1 W] (part, velocity_mps, range_m); options as in `Recording`."""
        return self._stacked([part.range_doppler_at(time_s, interval_s=interval_s) for part in self.values()])

    def range_angle(
        self, time_s: float | None = None, *, interval_s: float | None = None, **options: Any
    ) -> xr.DataArray:
        """Range-azimuth maps of the parts, power [dB re 1 W] (part, range_m, azimuth_rad); options as in `Recording`."""
        return self._stacked([part.range_angle(time_s, interval_s=interval_s, **options) for part in self.values()])

    def levels(self, start_s: float = 0.0, stop_s: float | None = None) -> xr.Dataset:
        """Levels of the parts (part): `level_db` [dB re 1 W], the power of the spectrogram summed over speeds and averaged over its
        columns, and `strongest_fraction` 0..1, the fraction of that power in cells where no other part is stronger.

        start_s, stop_s: limits of the columns that are used [s]; all by default.
        """
        import xarray as xr

        times_s = self._whole.spectrogram.time_s.values
        first, last = number("start_s", start_s), times_s[-1] if stop_s is None else number("stop_s", stop_s)
        inside = (times_s >= first) & (times_s <= last)
        if not inside.any():
            problem = f"the spectrogram has no column in {first:.4g}..{last:.4g} s, but in {times_s[0]:.4g}..{times_s[-1]:.4g} s"
            raise InputError(f"{problem}; change start_s and stop_s")
        shape = len(self._whole.spectrogram), int(inside.sum())
        totals, greatest, owner = np.zeros(len(self)), np.zeros(shape), np.full(shape, -1)
        for row, name in enumerate(self):
            level_db = self[name].spectrogram if self._spectrogram is None else self._spectrogram[row]
            power = 10 ** (level_db.values[:, inside] / 10)
            totals[row] = power.sum(axis=0).mean()
            owner = np.where(power > greatest, row, owner)
            greatest = np.maximum(power, greatest)
        fractions = [greatest[owner == row].sum() / shape[1] / total for row, total in enumerate(totals)]
        of_parts = ("part", decibel(totals), {"units": "dB re 1 W"})
        return xr.Dataset({"level_db": of_parts, "strongest_fraction": ("part", fractions)}, {"part": list(self)})

    def strongest(self, velocity_mps: float, time_s: float) -> xr.Dataset:
        """The parts in a cell of the spectrogram, strongest first: `level_db` [dB re 1 W] of each in the nearest cell, and
        `relative_db` [dB] relative to the whole recording there.

        Parts interfere, so that one may be stronger than the whole, whose level is the attribute `level_db`.
        """
        import xarray as xr

        part_levels, whole = self.spectrogram, self._whole.spectrogram
        speeds, times = part_levels.velocity_mps.values, part_levels.time_s.values
        for name, value, axis in (("velocity_mps", velocity_mps, speeds), ("time_s", time_s, times)):
            half = abs(axis[1] - axis[0]) / 2 if len(axis) > 1 else np.inf
            low, high = axis.min() - half, axis.max() + half
            if not low <= number(name, value) <= high:
                raise InputError(f"{name} must lie on the spectrogram, {low:.4g}..{high:.4g}, got {shown(value)}")
        place = {
            "velocity_mps": int(np.abs(speeds - velocity_mps).argmin()),
            "time_s": int(np.abs(times - time_s).argmin()),
        }
        level, total = part_levels.isel(place), float(whole.isel(place))
        levels = xr.Dataset({"level_db": level, "relative_db": level - total}).sortby("level_db", ascending=False)
        levels.level_db.attrs, levels.relative_db.attrs = {"units": "dB re 1 W"}, {"units": "dB"}
        return levels.assign_attrs(level_db=total)

    def _stacked(self, maps: Sequence[xr.DataArray]) -> xr.DataArray:
        import xarray as xr

        if not maps:
            raise InputError(NONE)
        names = xr.DataArray(list(self), dims="part", name="part")
        return xr.concat(maps, dim=names, combine_attrs="override").rename(f"{maps[0].name}_of_parts")


def poses_of(model: Model, split: Any, members: Mapping[str, Sequence[str]], count: int) -> Poses:
    """Surfaces of the targets at `count` instants of the record, seen from the side with the radar on the right.

    members: the parts in each group, by the name of the group that their faces get.
    """
    if split not in ("segment", "target"):
        raise InputError(
            f"bodies have the colours of their parts; simulate with split='segment' or 'target', not {split!r}"
        )
    ahead = -np.asarray(model.radar.axes)[0] * [1.0, 1.0, 0.0]
    right = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array([1.0, 0.0, 0.0])
    axes = np.stack([right, np.cross(right, [0.0, 0.0, 1.0]), [0.0, 0.0, 1.0]])
    first, last = model.span_s
    times_s = (np.arange(count) + 0.5) / count * (last - first)
    group = {part: name for name, member_parts in members.items() for part in member_parts}
    corners, names, called = [], [], PartNames(split, model)
    for target, geometry in enumerate(model.geometries):
        solid = geometry.solid()
        face = np.arange(len(solid.faces))
        kind = "ellipsoid" if isinstance(geometry, Ellipsoids) else "face"
        place = face * len(geometry.names) // len(face) if isinstance(geometry, Ellipsoids) else face
        labels = EchoLabels.of(len(face), target=target, **{kind: place})
        names += [group.get(part, part) for part in called.of(labels)]
        corners.append((solid.vertices_at(first + times_s) @ axes.T)[:, solid.faces])
    corners_m = np.concatenate(corners, axis=1)
    across = corners_m[..., 0]
    across -= (across.max(axis=(1, 2)) + across.min(axis=(1, 2)))[:, None, None] / 2  # each one above its own time
    corners_m[..., 2] -= corners_m[..., 2].min()
    return Poses(times_s=times_s, corners_m=corners_m, parts=names)


def _sum(cubes: Sequence[DiskCube], file: ScratchFile) -> DiskCube:
    return cubes[0] if len(cubes) == 1 else DiskCube(ProductRows.sum_of([_rows(cube) for cube in cubes], file))


def _rows(cube: DiskCube) -> ProductRows:
    assert isinstance(cube.rows, ProductRows), "parts are made of products"
    return cube.rows


def write_parts(folder: Path, cubes: Mapping[str, DiskCube]) -> None:
    """Writes one .npz file for each part, with the products from which its samples are computed."""
    folder.mkdir()
    for place, (name, cube) in enumerate(cubes.items()):
        arrays: dict[str, Any] = {"name": np.array(name), **_rows(cube).arrays()}
        np.savez(folder / f"{place}.npz", **arrays)


def read_parts(folder: Path) -> dict[str, DiskCube]:
    """The cubes of the parts by name, as `write_parts` wrote them."""
    cubes: dict[str, DiskCube] = {}
    scratch = ScratchFile()
    for path in sorted(folder.glob("[0-9]*.npz"), key=lambda file_path: int(file_path.stem)):
        with np.load(path, allow_pickle=False) as file:
            cubes[str(file["name"])] = DiskCube(ProductRows.from_arrays(file, scratch))
    return cubes
