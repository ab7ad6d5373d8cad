"""Who works: processes of this machine (joblib), or those of a cluster (dask.distributed)."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from typing import Any

from t2d_rt.core.errors import InputError, install
from t2d_rt.core.processes import end_with
from t2d_rt.dataset.work import Made

Task = tuple[Any, ...]
Scheduler = Callable[[Sequence[Task]], Iterator[list[Made]]]
"""Takes the arguments of calls of `make_samples` and gives what they return, in any order."""

ADDRESS = re.compile(r"(tcp|tls)://([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]):[0-9]{1,5}")
RETRIES = 2
"""Times that a call is repeated whose worker was lost."""


def scheduler_named(name: str | None, workers: int) -> Scheduler:
    """The processes of this machine for None; "local:N" or the address of a scheduler for a cluster of dask."""
    if name is None:
        return here if workers == 1 else lambda tasks: on_this_machine(tasks, workers)
    kind, _, rest = name.partition(":")
    if kind == "local" and rest.isdecimal() and int(rest) > 0:
        return lambda tasks: on_a_cluster(tasks, None, int(rest))
    if ADDRESS.fullmatch(name):
        return lambda tasks: on_a_cluster(tasks, name, 0)
    raise InputError(f"scheduler must be local:N or an address as tcp://host:8786, got {name!r}")


def threads_of(name: str | None, workers: int) -> int:
    """Threads of each worker, so that all of them together take the cores of this machine."""
    if name is None or name.startswith("local:"):
        return max(1, cores() // (workers if name is None else int(name.partition(":")[2])))
    return 1


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def here(tasks: Sequence[Task]) -> Iterator[list[Made]]:
    """In this process."""
    from t2d_rt.dataset.work import make_samples

    for task in tasks:
        yield make_samples(*task)


def on_this_machine(tasks: Sequence[Task], workers: int) -> Iterator[list[Made]]:
    """In processes of this machine."""
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky import BrokenProcessPool

    from t2d_rt.dataset.work import make_samples_in_worker

    try:
        with parallel_config(backend="loky", inner_max_num_threads=1, initializer=end_with, initargs=(os.getpid(),)):
            calls = Parallel(n_jobs=workers, return_as="generator_unordered", pre_dispatch="2*n_jobs")
            results = calls(delayed(make_samples_in_worker)(*task) for task in tasks)
        with closing(results):
            yield from results
    except BrokenProcessPool:
        raise InputError(
            "a worker process was lost, as where memory runs out or somebody ends it; run the recipe again, with fewer --workers "
            "where memory is short: what is finished stays"
        ) from None


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Silences a logger, whose page of traceback would stand beside the one sentence of the error."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def on_a_cluster(tasks: Sequence[Task], address: str | None, workers: int) -> Iterator[list[Made]]:
    """On a cluster of dask: one that runs at an address, or one of so many processes of this machine."""
    try:
        from distributed import CancelledError, Client, KilledWorker, LocalCluster, as_completed
        from distributed.comm import CommClosedError
    except ImportError:
        raise InputError(f"a scheduler needs dask.distributed; {install('cluster')}") from None
    from t2d_rt.dataset.work import make_samples

    cluster: Any = None
    if address is None:
        cluster = LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None)
    try:
        client = Client(cluster if address is None else address, timeout="20s")
    except (OSError, ValueError, OverflowError) as error:
        raise InputError(f"no scheduler answers at {address} ({error}); start one, or check the address") from None
    try:
        if cluster is not None:
            client.run(end_with, os.getpid())
        futures = [client.submit(make_samples, *task, pure=False, retries=RETRIES) for task in tasks]
        for future in as_completed(futures):
            yield future.result()
            future.release()
    except (CancelledError, CommClosedError, KilledWorker) as error:
        reason = getattr(error, "reason", None) or type(error).__name__
        raise InputError(
            f"the cluster {address or 'of this machine'} is lost ({reason}); run the recipe again, here or on another one: what is "
            "finished stays"
        ) from None
    finally:
        with suppress(Exception), _silent("distributed.client"):  # of a scheduler that is lost
            client.close()
        if cluster is not None:
            cluster.close()
