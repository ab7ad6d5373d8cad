"""Data sets under adversity: runs killed at random moments, worker and scheduler of a cluster killed, the memory of a long run."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2d_rt.core.memory import resident_bytes
from t2d_rt.dataset import Recipe, make_dataset
from t2d_rt.dataset.worker import make_sample
from validation.report import Check, Section

KILLS, LONG, SETTLED, CLUSTER_KILL_S = 20, 1000, 100, 25.0
LOST_LIMIT_S = 60.0
GROWTH_LIMIT, MEMORY_LIMIT_GB = 0.05, 2.0
SAMPLES, SEED = 24, 0

RECIPE = """
classes: [bending, jumping, sitting]
descriptions_per_class: 8
samples_per_description: 50
radar: table2-uniform
conditions: [{name: ellipsoids, method: ellipsoid}]
duration_s: 1.0
attempts: 1
products: {spectrogram: {size: [32, 32]}}
samples_per_shard: 4
"""


def run() -> Section:
    """The section of the report."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "recipe.yaml").write_text(RECIPE)
        recipe = Recipe.read(folder / "recipe.yaml")
        begin = time.perf_counter()
        make_dataset(recipe, folder / "whole", workers=2, limit=SAMPLES)
        took_s = time.perf_counter() - begin
        wanted = contents(folder / "whole")
        kills = killed(folder, took_s)
        differing = contents(folder / "killed") != wanted
        cluster = cluster_killed(recipe, folder)
        other = contents(folder / "cluster") != wanted
        lost = scheduler_lost(folder)
        after = contents(folder / "lost") != wanted
        memory = held(recipe)
    settled = memory[SETTLED - 1]
    return Section(
        title="Data sets",
        checks=[
            Check(what="runs killed before the set was complete", measured=kills, limit=KILLS, unit="", at_least=True),
            Check(what="killed and resumed: files that differ", measured=float(differing), limit=0, unit=""),
            Check(what="workers of a cluster killed", measured=cluster, limit=1, unit="", at_least=True),
            Check(what="worker of a cluster killed: files that differ", measured=float(other), limit=0, unit=""),
            Check(what="scheduler lost: exit code 2 (1: yes)", measured=float(lost.code == 2), limit=1, unit="", at_least=True),
            Check(what="scheduler lost: sentences told", measured=float(lost.sentences), limit=1, unit=""),
            Check(what="scheduler lost: time until the run ended", measured=lost.seconds, limit=LOST_LIMIT_S, unit="s"),
            Check(what="scheduler lost and resumed: files that differ", measured=float(after), limit=0, unit=""),
            Check(
                what=f"memory of a worker, growth after the first {SETTLED} of {LONG} samples",
                measured=float(memory[SETTLED:].max() / settled - 1), limit=GROWTH_LIMIT, unit="",
            ),
            Check(what="memory of a worker", measured=float(memory.max()) / 1e9, limit=MEMORY_LIMIT_GB, unit="GB"),
        ],
        note=f"{SAMPLES} samples of 1 s by ellipsoids, in shards of 4. A run is killed (SIGKILL), with its workers, at a random "
        "moment of the time that a whole one takes; the next one goes on, and the last is left alone. All files but the logs are "
        f"compared. A cluster of two processes loses one after {CLUSTER_KILL_S:g} s."
        " Another, of two workers and a scheduler that the run connects to, loses its scheduler once the first shard is written; "
        "processes of this machine complete the set.",
    )  # fmt: skip


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a data set but its logs."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.parent.name != "log"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def killed(folder: Path, took_s: float) -> int:
    """How many runs were killed before the set was complete; a last one completes it. A set that is complete first is begun anew.

    took_s: time of a whole run [s]; a run is killed within that.
    """
    rng, out = np.random.default_rng(SEED), folder / "killed"
    command = [
        sys.executable, "-m", "t2d_rt", "dataset", str(folder / "recipe.yaml"), "-o", str(out), "--limit", str(SAMPLES),
        "--workers",
    ]  # fmt: skip
    count = 0
    while count < KILLS:
        # One process by itself, or with workers of its own, which end with it.
        process = subprocess.Popen([*command, str(1 + count % 2)], start_new_session=True, stderr=subprocess.DEVNULL)
        try:
            process.wait(timeout=float(rng.uniform(0.2, 1.0) * took_s))
            shutil.rmtree(out)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            count += 1
    subprocess.run([*command, "2"], check=True)
    return count


def cluster_killed(recipe: Recipe, folder: Path) -> int:
    """How many workers were killed while a cluster of two made the set."""
    done: list[int] = []

    def kill() -> None:
        time.sleep(CLUSTER_KILL_S)
        children = [pid for pid in worker_processes() if pid != os.getpid()]
        if children:
            os.kill(children[0], signal.SIGKILL)
            done.append(children[0])

    thread = threading.Thread(target=kill)
    thread.start()
    make_dataset(recipe, folder / "cluster", scheduler="local:2", limit=SAMPLES)
    thread.join()
    return len(done)


@dataclass(frozen=True, slots=True)
class Lost:
    """How a run ended whose scheduler was killed."""

    code: int
    sentences: int
    seconds: float
    """From there to the end."""


def scheduler_lost(folder: Path) -> Lost:
    """Kills the scheduler of a run, and lets processes of this machine complete the set."""
    out, address = folder / "lost", folder / "scheduler.json"
    options = ["--scheduler-file", str(address), "--no-dashboard"]
    begin = [sys.executable, "-m"]
    scheduler = [*begin, "distributed.cli.dask_scheduler", *options, "--host", "127.0.0.1", "--port", "0"]
    worker = [*begin, "distributed.cli.dask_worker", *options, "--nthreads", "1", "--no-nanny", "--death-timeout", "10"]
    command = [
        *begin, "t2d_rt", "dataset", str(folder / "recipe.yaml"), "-o", str(out), "--limit", str(SAMPLES),
    ]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [subprocess.Popen(scheduler, **quiet)]
    try:
        while not address.exists() or not address.read_text().strip():
            if processes[0].poll() is not None:
                raise RuntimeError(f"the scheduler ended with {processes[0].returncode} before it told its address")
            time.sleep(0.2)
        processes += [subprocess.Popen(worker, **quiet) for _ in range(2)]
        where = json.loads(address.read_text())["address"]
        run = subprocess.Popen(
            [*command, "--scheduler", where], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        processes.append(run)
        while run.poll() is None and not any(out.glob("shards/*.jsonl")):
            time.sleep(0.1)
        processes[0].kill()
        killed_s = time.perf_counter()
        _, told = run.communicate(timeout=10 * LOST_LIMIT_S)
        took_s = time.perf_counter() - killed_s
    finally:
        for each in processes:
            each.kill()
            each.wait()
    subprocess.run([*command, "--workers", "2"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    lines = [line for line in told.replace("\r", "\n").splitlines() if line.strip() and "%|" not in line]
    return Lost(run.returncode, len(lines), took_s)


def worker_processes() -> list[int]:
    """Processes that this one has started for dask."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            words = (path / "cmdline").read_text()
        except OSError:
            continue
        if parent == os.getpid() and "spawn_main" in words:
            found.append(int(path.name))
    return found


def held(recipe: Recipe) -> np.ndarray:
    """Memory of a process after each of many samples [bytes], (sample,)."""
    found = []
    for index in range(LONG):
        make_sample(recipe, {}, index)
        found.append(resident_bytes())
    return np.array(found, float)
