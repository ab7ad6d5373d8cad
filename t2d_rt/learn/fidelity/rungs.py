"""The same events simulated in several ways: bodies of ellipsoids or a mesh, in free space or a room, with and without noise."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import array, file_path
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.learn.adapters.parrad import BINS, RADARS, ROWS
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.twins import MERGED, RECIPE, TwinRecipe, maps_of_events, noise_seed, range_mean_levels, staged
from t2d_rt.recording.add_noise import add_noise
from t2d_rt.scattering.ellipsoid import PhaseFrom
from t2d_rt.simulate import simulate
from t2d_rt.types import Receiver
from t2d_rt.types.target import Method

ROOM = "empty_room"
FILES = "[0-9]*.npz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One way to simulate an event."""

    name: str
    title: str
    method: Method
    phase_from: PhaseFrom = "specular"
    scene: str = "free_space"
    noise: bool = True

    @property
    def simulation(self) -> tuple[Method, PhaseFrom, str]:
        """What rungs with and without noise share."""
        return self.method, self.phase_from, self.scene


RUNGS = (
    Rung(name="centre-clean", title="ellipsoids from the centre, no noise", method="ellipsoid", phase_from="centre", noise=False),
    Rung(name="centre", title="ellipsoids from the centre", method="ellipsoid", phase_from="centre"),
    Rung(name="specular-clean", title="ellipsoids from the specular point, no noise", method="ellipsoid", noise=False),
    Rung(name="specular", title="ellipsoids from the specular point", method="ellipsoid"),
    Rung(name="mesh-clean", title="mesh, no noise", method="mesh", noise=False),
    Rung(name="mesh", title="mesh", method="mesh"),
    Rung(name="specular-room", title="ellipsoids from the specular point, room", method="ellipsoid", scene=ROOM),
    Rung(name="mesh-room", title="mesh, room", method="mesh", scene=ROOM),
)  # fmt: skip
"""Least fidelity first; the paper's ellipsoids are those from the centre. With noise, unless the title says otherwise."""
HIGHEST = RUNGS[-1].name


def make_rungs(recipe: TwinRecipe, folder: str | Path, *, progress: Callable[[float], None] | None = None) -> Path:
    """Writes the events of a recipe by all rungs, a file each; those that are there stay, so that a stopped run goes on.

    recipe: of which scene and method are left aside.
    """
    target = file_path("the folder of events", folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the folder {target}: {error.strerror or error}; choose a writable place"
        ) from None
    # Without their number: more events of the same recipe join those that are there.
    plain = {name: value for name, value in asdict(recipe).items() if name not in ("per_class", "scene", "method")}
    told = json.dumps({**plain, "rungs": [asdict(each) for each in RUNGS]}, indent=1)
    known = target / RECIPE
    if any(target.glob(FILES)) and (not known.is_file() or known.read_text(encoding="utf-8") != told):
        raise InputError(f"{target} holds events of another recipe; give another folder")
    with replacing(known, lambda: None) as new:
        new.write_text(told, encoding="utf-8")
    for index in range(recipe.count):
        path = target / f"{index:05d}.npz"
        if not path.exists():
            made = event(recipe, index)
            with replacing(path, lambda: None) as new, new.open("wb") as file:
                np.savez(file, **made)
        if progress is not None:
            progress((index + 1) / recipe.count)
    return target


def event(recipe: TwinRecipe, index: int) -> dict[str, Any]:
    """Levels (rung, radar, row, bin) [dB], label, and the CPU time of each rung's simulation [s], (rung,)."""
    found = staged(recipe, index)
    levels = np.zeros((len(RUNGS), len(RADARS), ROWS, BINS), dtype=np.float16)
    seconds = np.zeros(len(RUNGS))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        for number, radar in enumerate(found.radars):
            for simulation in dict.fromkeys(each.simulation for each in RUNGS):
                method, phase_from, scene = simulation
                began = time.process_time()
                clean = simulate(
                    found.motion, radar=radar, scene=scene, method=method, phase_from=phase_from, reflections=1, clutter="none",
                    seed=noise_seed(recipe, index, number), progress=False,
                )  # fmt: skip
                taken_s = time.process_time() - began
                for place, rung in enumerate(RUNGS):
                    if rung.simulation == simulation:
                        began = time.process_time()
                        recording = add_noise(clean, Receiver()) if rung.noise else clean
                        levels[place, number] = range_mean_levels(np.asarray(recording.adc.values)[:, 0])[:ROWS]
                        seconds[place] += taken_s + time.process_time() - began
    return {"levels": levels, "label": found.label, "sentence": found.sentence, "seconds": seconds}


@dataclass(frozen=True, slots=True, kw_only=True)
class RungEvents:
    """The events of a folder as maps, rung by rung."""

    maps: Mapping[str, LabelledMaps]
    seconds: Mapping[str, np.ndarray]
    """CPU time of each event's simulation by both radars [s], (E,)."""


def read_rungs(folder: str | Path, count: int | None = None) -> RungEvents:
    """The events of a folder, in the four classes that PARrad's real events are told apart in.

    count: the first so many of them; all by default.
    """
    target = file_path("the folder of events", folder)
    files = sorted(target.glob(FILES))[:count]
    if not files:
        raise InputError(f"{target} holds no events; t2d-rt benchmark fidelity makes them")
    found = [_read(path) for path in files]
    labels, names = [MERGED[label] for label, _, _ in found], [path.stem for path in files]
    return RungEvents(
        maps={
            rung.name: maps_of_events([levels[place] for _, levels, _ in found], labels, names)
            for place, rung in enumerate(RUNGS)
        },
        seconds={rung.name: np.array([seconds[place] for _, _, seconds in found]) for place, rung in enumerate(RUNGS)},
    )  # fmt: skip


def _read(path: Path) -> tuple[str, np.ndarray, np.ndarray]:
    """Label, levels (rung, radar, row, bin) and seconds (rung,) of an event's file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            label = str(file["label"])
            levels = array("its levels", file["levels"], (len(RUNGS), len(RADARS), ROWS, BINS), limit=1e6)
            seconds = array("its seconds", file["seconds"], (len(RUNGS),))
        if label not in MERGED:
            raise InputError(f"it is of class '{label}'")
    except Exception as error:  # NumPy and zipfile raise what they like of a damaged file
        raise InputError(
            f"{path} is no event of this study ({error or type(error).__name__}); remove it and make it again"
        ) from None
    return label, levels, seconds
