"""A data set of 500 samples by a cluster of two workers, of which one is killed half way: nothing is lost."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from t2d_rt.dataset import Recipe, make_dataset
from t2d_rt.dataset.making import local_cluster, make_samples
from validation.report import Section, at_least, at_most

SAMPLES, ALONE = 500, 24
"""Samples of the run, and of the one that it is compared with: whole shards, made by this process."""
MOST_BYTES = 50_000
"""That a sample sends through the scheduler: a map of 128 x 128 half-precision levels has 33 kB."""


def recipe() -> Recipe:
    """Samples of a second by ellipsoids; of the classes whose motions can be that short."""
    return Recipe(
        name="lost-worker", classes=("walking", "running", "sitting", "bending", "jumping", "dancing"),
        descriptions_per_class=84, samples_per_description=1, radar="table2", duration_s=1.0,
        conditions=[{"name": "only", "method": "ellipsoid"}], samples_per_shard=ALONE,
        products={"spectrogram": {"range_gate_m": "scene"}},
    )  # fmt: skip


def sent_bytes(task: tuple[Any, ...]) -> tuple[int, int]:
    """What distributed sends for a call, and for what it returns [byte]."""
    from distributed.protocol import serialize, to_serialize
    from distributed.utils import nbytes

    def size(value: Any) -> int:
        _, frames = serialize(to_serialize(value).data)
        return sum(nbytes(each) for each in frames)

    return size(task), size(make_samples(*task))


def run() -> Section:
    """The run with its killed worker, beside the first shard made alone."""
    found = recipe()
    killed: list[float] = []
    with tempfile.TemporaryDirectory() as folder, local_cluster(2) as cluster:
        together, alone = Path(folder) / "together", Path(folder) / "alone"

        def progress(done: float) -> None:
            if done >= 0.5 and not killed:
                next(iter(cluster.workers.values())).process.process.kill()
                killed.append(time.perf_counter())

        begin = time.perf_counter()
        outcome = make_dataset(
            found, together, limit=SAMPLES, scheduler=cluster.scheduler_address, threads=1, progress=progress
        )
        seconds = time.perf_counter() - begin
        make_dataset(found, alone, limit=ALONE, workers=1, threads=1)
        same = [
            (together / "shards" / name).read_bytes() == (alone / "shards" / name).read_bytes()
            for name in ("00000.npz", "00000.jsonl")
        ]
        stored = sum(each.stat().st_size for each in (together / "shards").iterdir()) / SAMPLES
    asked, given = sent_bytes((found.model_dump_json(), {}, [0], 1))
    first, second = killed[0] - begin, seconds - (killed[0] - begin)
    table = [{
        "samples": SAMPLES, "until the kill": f"{first:.0f} s", "after it": f"{second:.0f} s",
        "asked of a worker": f"{asked / 1e3:.1f} kB", "returned": f"{given / 1e3:.1f} kB", "on disk": f"{stored / 1e3:.1f} kB",
    }]  # fmt: skip
    checks = [
        at_least("samples made", outcome.made, SAMPLES),
        at_most("samples failed", len(outcome.failures), 0),
        at_least("files as made alone", sum(same), len(same)),
        at_most("through the scheduler, a sample", asked + given, MOST_BYTES, "byte"),
    ]
    note = (
        f"{SAMPLES} samples of 1 s by ellipsoids through dask.distributed with two workers. One is killed (SIGKILL) half way; its "
        f"nanny starts another. The first {ALONE} samples are also made by one process: the files are the same bytes."
    )
    return Section(title="A worker is lost", note=note, checks=checks, table=table, charts=[])
