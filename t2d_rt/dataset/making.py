"""`make_dataset`: makes the samples of a recipe in a folder, shard by shard; finished ones are not made again.

Work is done by processes of this machine (joblib's loky) or of a cluster (dask.distributed).
"""

from __future__ import annotations

import itertools
import json
import logging
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from t2d_rt.core.checks import file_path, integer
from t2d_rt.core.errors import InputError, install, warn
from t2d_rt.core.kernels import common_kernels, has_common_kernels
from t2d_rt.core.plugins import versions
from t2d_rt.core.processes import end_with
from t2d_rt.dataset.lock import locked
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import cell_of, description_of
from t2d_rt.dataset.shards import (
    MANIFEST,
    PLANS,
    RECIPE,
    SHARDS,
    MadeSample,
    Shard,
    file_sha256,
    numbers,
    read_manifest,
    recipe_of,
    remove_spooled,
    shard_faults,
    shard_name,
    spooled,
    sweep,
    write_shard,
    write_spooled,
    write_whole,
)
from t2d_rt.dataset.worker import in_worker, make_plans, make_samples
from t2d_rt.recording.maps import background_settings, check_axes

Task = tuple[Any, ...]
Work = Callable[..., Any]
Scheduler = Callable[[Work, Sequence[Task]], Iterator[Any]]
"""Function that runs a function of `worker` for each set of arguments, and yields the results in any order."""

ADDRESS = re.compile(r"(tcp|tls)://([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]):[0-9]{1,5}")
AT_ONCE = 10_000
"""Greatest number of calls that a scheduler holds at once: ten for each of a thousand workers. A million would need gigabytes."""
LIMITED = "OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "BLIS_NUM", "NUMBA_NUM", "NUMEXPR_NUM", "VECLIB_MAXIMUM"
THREADS = {f"{name}_THREADS": "1" for name in LIMITED}
"""Environment variables that keep libraries from starting as many threads in each worker as there are cores."""
IDLE_S = 300.0
"""How long idle workers wait for the next run [s]."""
RETRIES = 2
"""How often a call is repeated if its worker was lost."""


def scheduler_named(name: str | None, workers: int) -> tuple[Scheduler, int]:
    """The scheduler, and the number of worker processes that share the cores of this machine: 0 if the work is done elsewhere.

    name: None for `workers` processes of this machine, "local:N" or an address for a cluster of dask.
    """
    kernels = common_kernels()
    if name is None:
        alone = workers == 1 and (not kernels or has_common_kernels())
        return here if alone else partial(on_this_machine, workers=workers), workers
    kind, _, rest = name.partition(":")
    if kind == "local" and rest.isdecimal() and int(rest) > 0:
        return partial(on_a_cluster, address=None, workers=int(rest)), int(rest)
    if ADDRESS.fullmatch(name):
        return partial(on_a_cluster, address=name, workers=0), 0
    raise InputError(f"scheduler must be local:N or an address as tcp://host:8786, got {name!r}")


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def here(work: Work, tasks: Sequence[Task]) -> Iterator[Any]:
    """Runs the tasks in this process, one after the other."""
    for task in tasks:
        yield work(*task)


def on_this_machine(work: Work, tasks: Sequence[Task], workers: int) -> Iterator[Any]:
    """Runs the tasks in processes of this machine, which use the kernels common to all machines; the loss of a worker ends the run
    with a single sentence. (joblib's own interface would run a single worker's tasks in this process.)"""
    from joblib.externals.loky import BrokenProcessPool, get_reusable_executor

    environment = THREADS | common_kernels()
    executor = get_reusable_executor(
        workers, timeout=IDLE_S, initializer=end_with, initargs=(os.getpid(),), env=environment
    )
    coming, stopped = iter(tasks), True
    try:
        running = {executor.submit(in_worker, work, *task) for task in itertools.islice(coming, 2 * workers)}
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                running |= {executor.submit(in_worker, work, *task) for task in itertools.islice(coming, 1)}
                yield future.result()
        stopped = False
    except BrokenProcessPool:
        raise InputError(
            "a worker process was lost, as where memory runs out or somebody ends it; run the recipe again, with fewer --workers "
            "where memory is short: what is finished stays"
        ) from None
    finally:
        if stopped:
            executor.shutdown(kill_workers=True)


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Silences a logger that would print a traceback beside the error's single sentence."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def local_cluster(workers: int) -> Any:
    """A dask cluster of `workers` processes on this machine, which use the kernels common to all machines."""
    from dask import config
    from distributed import LocalCluster

    before, kernels = dict(os.environ), common_kernels()
    os.environ.update(kernels)  # otherwise the user's own variables would override those in dask's settings
    try:
        with config.set({f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in kernels.items()}):
            return LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None)
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


def on_a_cluster(work: Work, tasks: Sequence[Task], address: str | None, workers: int) -> Iterator[Any]:
    """Runs the tasks on a dask cluster: one at an address, or `workers` processes of this machine."""
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
        from distributed.comm import CommClosedError
    except ImportError:
        raise InputError(f"a scheduler needs dask.distributed; {install('cluster')}") from None
    cluster: Any = None
    if address is None:
        cluster = local_cluster(workers)
    try:
        client = Client(cluster if address is None else address, timeout="20s")
    except (OSError, ValueError, OverflowError) as error:
        raise InputError(f"no scheduler answers at {address} ({error}); start one, or check the address") from None
    try:
        if cluster is not None:
            client.run(end_with, os.getpid())
        submit, coming = partial(client.submit, work, pure=False, retries=RETRIES), iter(tasks)
        running = as_completed([submit(*task) for task in itertools.islice(coming, AT_ONCE)])
        for future in running:
            for task in itertools.islice(coming, 1):
                running.add(submit(*task))
            yield future.result()
            future.release()
    except (CancelledError, CommClosedError, KilledWorker) as error:
        reason = getattr(error, "reason", None) or type(error).__name__
        raise InputError(
            f"the cluster {address or 'of this machine'} is lost ({reason}); run the recipe again, here or on another one: what is "
            "finished stays"
        ) from None
    finally:
        with suppress(Exception), _silent("distributed.client"):  # errors of a scheduler that was lost
            client.close()
        if cluster is not None:
            cluster.close()


LOG = "log"
MOST_FAILED = 0.05
"""Greatest fraction of the samples that may fail before the run stops."""

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a run."""

    samples: int
    """Number of samples that were asked for; all of them are there, some perhaps as failures."""
    made: int
    """Number of samples that this run has made."""
    failures: tuple[tuple[int, str], ...]
    """Index of each sample that failed, and the reason."""
    seconds: float


def make_dataset(
    recipe: Recipe,
    folder: str | Path,
    *,
    limit: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Makes the samples of a recipe and writes them to a folder; a run that was stopped continues where it stopped.

    limit: number of samples to make, from the first one on; all by default.
    workers: number of processes on this machine; one for each core by default.
    scheduler: "local:N" or the address of a scheduler of dask.distributed, in place of these processes.
    threads: number of threads of each worker; by default the cores are divided evenly.
    progress: called with the fraction done, 0..1.

    The bytes of the files do not depend on the workers, the order in which they finish, or interruptions; only `log` differs.
    Workers use the kernels common to all machines (`common_kernels`). A single worker runs in a process of its own if this process
    has other kernels. The workers of a cluster at an address use their own kernels; there is a warning if these are other ones.
    Raises InputError where the folder is that of another recipe or of another run, where a file is damaged or cannot be written,
    where a worker is lost, and once more than 5 % of the samples have failed.
    """
    begin = time.perf_counter()
    target = file_path("the folder of a data set", folder)
    count = recipe.samples if limit is None else min(integer("limit", limit, 1), recipe.samples)
    workers = cores() if workers is None else integer("workers", workers, 1, 1024)
    take_up, sharing = scheduler_named(scheduler, workers)
    default_threads = max(1, cores() // sharing) if sharing else 1
    threads = default_threads if threads is None else integer("threads", threads, 1, 1024)
    _prepare(target, recipe)
    with locked(target):
        sweep(target)
        run = _Run(recipe, target, count, progress)
        if run.tasks:
            plans = make_plans(recipe, target / PLANS, count, threads, take_up)
            text = recipe.model_dump_json()
            run.write_manifest()  # files on which samples depend, for a run that continues this one
            try:
                for samples in take_up(make_samples, [(text, plans, [index], threads) for index in run.tasks]):
                    run.add(samples)
            except KeyboardInterrupt as stopped:
                stopped.add_note(
                    f"{run.done} of {count} samples are finished and stay in {target}; the same command goes on"
                )
                raise
            finally:
                run.write_log()
        run.write_manifest()
        return Outcome(count, run.made, tuple(run.failures), time.perf_counter() - begin)


def _warn_of_versions(manifest: Path) -> None:
    """Warns if the existing samples were made with other versions."""
    if not manifest.is_file():
        return
    begun, current = read_manifest(manifest.parent).get("versions", {}), versions()
    differing = [f"{name} {begun.get(name)}" for name, version in current.items() if begun.get(name) != version]
    if differing:
        warn(
            f"{manifest.parent} was begun with other versions ({', '.join(differing)}); new samples may differ from theirs"
        )


def _prepare(folder: Path, recipe: Recipe) -> None:
    """Creates the folder of a data set, or checks that it belongs to the same recipe."""
    inputs = recipe.files()
    missing = [name for name, checksum in inputs.items() if checksum is None]
    if missing:
        raise InputError(
            f"recipe {recipe.name} names {missing[0]}, which is no file; correct its name, or put the file there"
        )
    _check_background(recipe)
    place = folder / RECIPE
    if place.is_file():
        stored = recipe_of(folder)
        if stored.hash != recipe.hash:
            raise InputError(
                f"{folder} holds samples of another recipe ({stored.name}, {stored.hash[:8]}) than this one ({recipe.name}, "
                f"{recipe.hash[:8]}); choose another folder"
            )
        _warn_of_versions(folder / MANIFEST)
        for name, checksum in read_manifest(folder).get("inputs", {}).items():
            if inputs.get(name) != checksum:
                raise InputError(
                    f"{name} has changed since {folder} was begun; put it back as it was, or choose another folder"
                )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} exists and is no data set; choose another folder")
    try:
        for path in (folder, folder / SHARDS, folder / LOG):
            path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make {folder}: {error.strerror or error}; choose a writable place") from None
    write_whole(place, recipe.to_yaml().encode())


def _check_background(recipe: Recipe) -> None:
    """Refuses a background model that does not fit a radar of the recipe, and warns of another band, before anything is made."""
    if recipe.background is None or recipe.products.spectrogram is None:
        return
    for radar in dict.fromkeys(condition.radar or recipe.radar for condition in recipe.conditions):
        background_settings(recipe.background, level_db=recipe.background_level_db, carrier_hz=radar.carrier_hz)
        check_axes(recipe.background, radar, {})


class _Run:
    """State of a run: the shards that exist, and those that are being made."""

    def __init__(self, recipe: Recipe, folder: Path, count: int, progress: Progress | None) -> None:
        self._recipe, self._folder, self._count, self._progress = recipe, folder, count, progress
        manifest = read_manifest(folder)
        self._files: dict[str, str] = dict(manifest.get("files", {}))
        self._made_on: set[str] = set(manifest.get("made_on", []))
        """Processors and kernels with which samples of the folder were made."""
        self._seen: set[str] = set()
        """Processors and kernels with which samples of this run were made."""
        self._waiting: dict[int, dict[int, MadeSample]] = {}
        self._inputs = recipe.files()
        self._log: list[dict[str, Any]] = []
        self.failures: list[tuple[int, str]] = []
        self.made = 0
        self.done = 0
        self._counts: dict[int, tuple[int, int]] = {}
        """For each existing shard, the number of samples and how many of them failed."""
        self.tasks: list[int] = []
        """Indices of the samples that are missing."""
        finished = self._finished()
        spooled_samples = {sample.record["index"]: sample for sample in spooled(folder, recipe)}
        remove_spooled(folder, [index for index in spooled_samples if index // recipe.samples_per_shard in finished])
        for number in range(-(-count // recipe.samples_per_shard)):
            if number not in finished:
                indices = self._indices(number)
                self.tasks += [index for index in indices if index not in spooled_samples]
                samples = [spooled_samples[index] for index in indices if index in spooled_samples]
                if samples:
                    self._take(samples)

    def _indices(self, number: int) -> list[int]:
        """Indices of the samples in a shard, as far as they are asked for."""
        size = self._recipe.samples_per_shard
        return list(range(number * size, min((number + 1) * size, self._count)))

    def _finished(self) -> set[int]:
        """Numbers of the complete, valid shards; an invalid one stops the run before anything is computed."""
        finished = set()
        for number in numbers(self._folder):
            name = shard_name(number)
            for shard_fault in shard_faults(self._folder, number, self._recipe):
                raise InputError(shard_fault)
            for kind in ("npz", "jsonl"):
                path = self._folder / SHARDS / f"{name}.{kind}"
                checksum = file_sha256(path)
                if self._files.setdefault(path.name, checksum) != checksum:
                    raise InputError(
                        f"{path} does not match its checksum; remove both files of the shard and run it again, which makes it anew"
                    )
            records = Shard.of(self._folder, number, self._recipe).records
            self._check_records(number, records)
            self._count_records(number, records)
            if len(records) >= len(self._indices(number)):  # a shard of a run with a lower limit may lack samples
                finished.add(number)
                # A larger run may have made more samples; their failures count for that run.
                requested = [MadeSample(record) for record in records if record["index"] < self._count]
                self.done += len(requested)
                self._note_failures(requested)
        return finished

    def _check_records(self, number: int, records: Sequence[dict[str, Any]]) -> None:
        """Refuses a shard with other samples than this recipe has there; the manifest may not list its checksum yet."""
        first = number * self._recipe.samples_per_shard
        for index, record in enumerate(records, start=first):
            if record.get("index") != index or index >= self._recipe.samples:
                expected = None
            else:
                cell = cell_of(self._recipe, index)
                expected = cell.activity, description_of(self._recipe, cell).sentence
            if expected != (record.get("class"), record.get("sentence")):
                raise InputError(
                    f"{self._folder / SHARDS / shard_name(number)}.jsonl does not hold the samples of this recipe; remove both "
                    "files of the shard and run it again, which makes it anew"
                )

    def _count_records(self, number: int, records: Sequence[dict[str, Any]]) -> None:
        """Records for the manifest how many samples a shard has, and how many of them failed."""
        self._counts[number] = len(records), sum(record["failure"] is not None for record in records)

    def add(self, samples: Sequence[MadeSample]) -> None:
        """Takes samples from a worker, stores them, and writes the shard if they complete it."""
        self._log += [{"index": sample.record["index"], "seconds": dict(sample.seconds)} for sample in samples]
        self.made += len(samples)
        for sample in samples:
            self._note_machine(sample)
            write_spooled(self._folder, sample)
        self._take(samples)

    def _take(self, samples: Sequence[MadeSample]) -> None:
        """Takes samples of a single shard, and writes it when none is missing."""
        number = samples[0].record["index"] // self._recipe.samples_per_shard
        waiting = self._waiting.setdefault(number, {})
        waiting |= {sample.record["index"]: sample for sample in samples}
        self.done += len(samples)
        self._note_failures(samples)
        if len(waiting) == len(self._indices(number)):
            shard = [waiting[index] for index in sorted(waiting)]
            if self._counts.pop(number, None) is not None:
                self.write_manifest()  # without the smaller shard that is replaced, whose checksums differ
            self._files |= write_shard(self._folder, number, shard)
            self._count_records(number, [sample.record for sample in shard])
            del self._waiting[number]
            self.write_manifest()
            remove_spooled(self._folder, waiting)
        if self._progress is not None:
            self._progress(min(1.0, self.done / self._count))

    def _note_machine(self, sample: MadeSample) -> None:
        """Records in the manifest with what a sample was made, before the sample itself is stored; warns once of a worker with its
        own kernels."""
        if sample.machine in self._seen:
            return
        self._seen.add(sample.machine)
        if sample.machine not in self._made_on:
            self._made_on.add(sample.machine)
            self.write_manifest()
        set_as = " ".join(f"{name}='{value}'" for name, value in common_kernels().items())
        if set_as and not sample.common:
            warn(
                f"a worker computes with {sample.machine}: its samples may differ from those of other machines in a last bit; "
                f"start the workers with {set_as}"
            )

    def _note_failures(self, samples: Sequence[MadeSample]) -> None:
        """Records which samples failed, and stops the run if they are too many."""
        self.failures += [
            (sample.record["index"], sample.record["failure"]) for sample in samples if sample.record["failure"]
        ]
        if len(self.failures) > max(1.0, MOST_FAILED * self._count):
            index, reason = self.failures[-1]
            raise InputError(
                f"{len(self.failures)} of {self._count} samples failed, more than {MOST_FAILED:.0%}, the last one, {index}, for: "
                f"{reason}; what is finished stays"
            )

    def write_manifest(self) -> None:
        """Writes the list of files; it has the same bytes for the same recipe and samples."""
        names = [f"{shard_name(number)}.{kind}" for number in sorted(self._counts) for kind in ("npz", "jsonl")]
        samples, failed = (sum(count[place] for count in self._counts.values()) for place in (0, 1))
        manifest = {
            "recipe": self._recipe.name,
            "recipe_hash": self._recipe.hash,
            "versions": versions(),
            "made_on": sorted(self._made_on),
            "inputs": self._inputs,
            "samples": samples,
            "failed": failed,
            "files": {name: self._files[name] for name in names},
        }
        write_whole(self._folder / MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode())

    def write_log(self) -> None:
        """Writes how long each sample took; this is the only file that differs from run to run."""
        if self._log:
            lines = "".join(f"{json.dumps(entry)}\n" for entry in self._log)
            write_whole(self._folder / LOG / f"{time.time_ns()}.jsonl", lines.encode())
