# SPDX-License-Identifier: Apache-2.0
"""Distributes work over processes of this computer, or over a Dask cluster.

A batch is computed by a pure function, so another worker can compute it again if one is lost; the caller must count
each batch once.
"""

import gc
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import active_children, get_context
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, TypeVar

from mech_twin.capabilities.arguments import whole_number
from mech_twin.errors import StudyError
from mech_twin.process.dependencies import extra_needed
from mech_twin.process.interruption import SIGNALS, end_with_parent

Batch = TypeVar("Batch")
Result = TypeVar("Result")
QUEUED_PER_CORE = 4
RETRIES = 5
NICE = 10  # of what computes beside a run
CONNECT_S = 10.0
MOST_CORES = 1024


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def used_cores(cores: int | None) -> int:
    """Return a requested number of cores; all of this process if None.

    Raises
    ------
    StudyError
        If it is not a whole number from 1 to `MOST_CORES`.
    """
    return available_cores() if cores is None else whole_number("cores", cores, 1, MOST_CORES)


def spread(
    function: Callable[[Batch], Result], batches: Sequence[Batch], cores: int, scheduler: str | None = None
) -> Generator[Result]:
    """Yield the results of all batches as they finish, in any order; closing the generator ends the workers.

    Parameters
    ----------
    function : callable
        Pure, and importable by name in another process.
    batches : sequence
        Arguments of the function.
    cores : int
        Processes on this computer; 1 computes in the present one.
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://127.0.0.1:8786``), which is then used instead.

    Raises
    ------
    StudyError
        If the scheduler cannot be reached or is lost, or a worker process of this computer dies.
    """
    if scheduler is not None:
        yield from _over_cluster(function, batches, scheduler)
    elif cores <= 1 or len(batches) <= 1:
        yield from map(function, batches)
    else:
        try:
            yield from _over_processes(function, batches, min(cores, len(batches)))
        finally:
            gc.collect()  # frees the pool's semaphores; otherwise an end by signal prints a warning


class _Worker(SpawnProcess):
    """A process that does not run the script again that started it, which so needs no guard against that."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802 # its name in multiprocessing
        program = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process_obj)
        finally:
            sys.modules["__main__"] = program


class _Spawn(SpawnContext):
    Process = _Worker


def _over_processes(function: Callable[[Batch], Result], batches: Sequence[Batch], cores: int) -> Iterator[Result]:
    of_program = getattr(function, "func", function).__module__ == "__main__"
    spawn, others = get_context("spawn") if of_program else _Spawn(), set(active_children())
    with _signals_held_back():
        pool = ProcessPoolExecutor(cores, spawn, initializer=_follow_parent, initargs=(os.getpid(),))
    with pool:
        waiting: set[Future[Result]] = set()
        rest = iter(batches)
        try:
            while True:
                for batch in rest:
                    with _signals_held_back():
                        waiting.add(pool.submit(function, batch))
                    if len(waiting) >= QUEUED_PER_CORE * cores:
                        break
                if not waiting:
                    pool.shutdown()  # waits for its thread, whose semaphores would otherwise be reported as leaked
                    return
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BrokenProcessPool as error:
            raise StudyError("a worker process died before the study was done; finished points are kept") from error
        except BaseException:  # the results of the workers are no longer needed
            for worker in set(active_children()) - others:
                worker.kill()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class BesideProcess:
    """Computes in another process, at low priority by default, one task after another; it begins with the first."""

    def __init__(self, priority: int = NICE) -> None:
        self._priority = priority
        self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, _Spawn(), initializer=_follow_parent, initargs=(os.getpid(), self._priority))

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Return the future result of a function that another process can import; a process that died is replaced."""
        with _signals_held_back():
            try:
                return self._pool.submit(function, *arguments)
            except BrokenProcessPool:
                self._pool = self._new_pool()
                return self._pool.submit(function, *arguments)

    def end(self) -> None:
        """Wait for the present task, and end the process."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def _follow_parent(parent: int, priority: int = 0) -> None:
    """End this worker when its parent ends; the parent handles signals sent to all of them."""
    end_with_parent(parent, signal.SIGKILL)
    os.nice(priority)


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Block signals during this context; processes started in it inherit the block."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _over_cluster(function: Callable[[Batch], Result], batches: Sequence[Batch], scheduler: str) -> Iterator[Result]:
    """Yield results of a cluster; batches of a lost worker, and its results not yet fetched, are computed again."""
    client = _client(scheduler)
    with client:
        futures = client.map(function, batches, pure=False, retries=RETRIES)
        for future in _dask().as_completed(futures, loop=client.loop):
            yield _fetched(future, scheduler)
            future.release()


def _dask() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise StudyError(f"--scheduler {extra_needed('cluster')}") from error


def check_scheduler(scheduler: str | None) -> None:
    """Raise a StudyError where a scheduler cannot be reached or has no workers."""
    if scheduler is not None:
        _client(scheduler).close()


def _client(scheduler: str) -> Any:
    try:
        client = _dask().Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, TypeError, ValueError) as error:
        raise StudyError(f"scheduler {scheduler}: no connection within {CONNECT_S:g} s") from error
    if not client.scheduler_info(n_workers=-1)["workers"]:
        client.close()
        raise StudyError(f"scheduler {scheduler}: it has no workers")
    return client


def _fetched(future: Any, scheduler: str) -> Any:
    dask = _dask()
    try:
        return future.result()
    except (dask.CancelledError, dask.KilledWorker) as error:
        raise StudyError(f"scheduler {scheduler}: lost before the study was done; finished points are kept") from error
