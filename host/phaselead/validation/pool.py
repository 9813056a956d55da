"""Many cases at once: on the cores of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

from phaselead.errors import BadInput
from phaselead.validation.journal import Outcome
from phaselead.validation.trial import try_case

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run_cases(
    folder: str, names: Sequence[str], done: Callable[[Outcome], None], *, jobs: int, scheduler: str | None = None
) -> None:
    """Run the named cases and call ``done`` with each outcome as it arrives. An interrupt ends the workers.

    Raises BadInput for a scheduler that cannot be used.
    """
    if not names:
        return
    source = _over_cluster(folder, names, scheduler) if scheduler else _over_cores(folder, names, jobs)
    for outcome in source:
        done(outcome)


def _over_cores(folder: str, names: Sequence[str], jobs: int) -> Iterator[Outcome]:
    if jobs <= 1:
        yield from (try_case(folder, name) for name in names)
        return
    with _single_threaded():
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(min(jobs, len(names)), mp_context=context, initializer=_ignore_interrupt)
        futures = {pool.submit(try_case, folder, name): name for name in names}
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            workers = list(pool._processes.values()) if pool._processes else []
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()
            raise
        pool.shutdown()


@contextmanager
def _single_threaded() -> Iterator[None]:
    """One thread for the numerical libraries of each worker, since there are as many workers as cores."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _ignore_interrupt() -> None:
    """Ctrl-C reaches every process of the terminal; only the parent acts on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _over_cluster(folder: str, names: Sequence[str], scheduler: str) -> Iterator[Outcome]:
    try:
        from distributed import Client
        from distributed import as_completed as finished
    except ImportError:
        raise BadInput("--scheduler needs Dask; install it with: pip install 'phaselead[cluster]'") from None
    try:
        client: Any = Client(scheduler, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise BadInput(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
    with client:
        futures = [client.submit(try_case, folder, name, pure=False) for name in names]
        try:
            for future in finished(futures):
                yield future.result()
        except BaseException:
            client.cancel(futures)
            raise
