"""Shipped scenes simulated from ten working directories, hostile ones among them: the same bits, and no foreign code runs."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import t2d_rt as t2d
from t2d_rt.core.errors import T2DWarning
from t2d_rt.core.resources import resource
from t2d_rt.propagation.scenes import scene_names
from validation.report import Check, Section

SECONDS = 0.2
FAILED = "failed"
PLUGINS = (
    "ply", "obj", "diffuse", "scene", "merge", "path", "perspective", "hdrfilm", "independent", "itu-radio-material",
)  # fmt: skip
EVIL = '#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fclose(fopen("{marker}", "w")); }}\n'


def run() -> Section:
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        marker = home / "marker"
        found, ran = {}, 0
        for where, folder in _folders(home, marker).items():
            marker.unlink(missing_ok=True)
            found[where] = _checksums_from(folder)
            ran += marker.exists()
    first = next(iter(found.values()))
    columns = [*scene_names(), "free_space"]
    cubes = [(each[column], first[column]) for each in found.values() for column in columns]
    differing = sum(cube != other or cube.startswith(FAILED) for cube, other in cubes)
    return Section(
        title="Working directories",
        checks=[
            Check(what="working directories", measured=len(found), limit=10, unit="", at_least=True),
            Check(what="cubes that differ", measured=differing, limit=0, unit=""),
            Check(what="folders whose plugins ran", measured=ran, limit=0, unit=""),
        ],
        note=f"Each shipped scene with ellipsoids, and free space with a skinned body that occludes itself, "
        f"{SECONDS:g} s of a walk "
        "(CMU 12_01), simulated by a process of its own in each folder. The planted plugins are libraries that write a file when "
        "they are loaded, named like those of Mitsuba; the planted meshes are another room's. The table shows the first digits of "
        "the cubes' SHA-256.",
        table=[
            {"working directory": where, **{column: each[column][:8] for column in columns}}
            for where, each in found.items()
        ],
    )


def _folders(home: Path, marker: Path) -> dict[str, Path]:
    folders = {"empty": home / "empty", "/": Path("/")}
    folders |= {f"scene {name}": resource("scenes", name) for name in scene_names()}
    folders |= {name: home / name for name in ("planted meshes", "planted plugins", "planted meshes and plugins")}
    (home / "empty").mkdir()
    for folder in (home / "planted meshes", home / "planted meshes and plugins"):
        shutil.copytree(resource("scenes", "living_room") / "meshes", folder / "meshes")
    for folder in (home / "planted plugins", home / "planted meshes and plugins"):
        (folder / "plugins").mkdir(parents=True)
        (home / "evil.c").write_text(EVIL.format(marker=marker), encoding="utf-8")
        for plugin in PLUGINS:
            library = folder / "plugins" / f"{plugin}.so"
            subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(home / "evil.c")], check=True)
    return folders


def _checksums_from(folder: Path) -> dict[str, str]:
    """Of the scenes, by a process that works there."""
    project = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", "from validation.robustness.working_directories import main; main()"],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(project)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        return {
            column: f"{FAILED}: {done.stderr.strip().splitlines()[-1:]}" for column in [*scene_names(), "free_space"]
        }
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Prints the checksums of this process's cubes."""
    warnings.simplefilter("ignore", T2DWarning)
    motion = t2d.trim(t2d.load_motion(resource("motions", "12_01_walk.bvh")), 0, SECONDS)
    found = {}
    for scene in [*scene_names(), "free_space"]:
        method = "mesh" if scene == "free_space" else "ellipsoid"
        cube = t2d.simulate(motion, scene=scene, method=method).adc.values
        found[scene] = hashlib.sha256(cube.tobytes()).hexdigest()
    print(json.dumps(found))
