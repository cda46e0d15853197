"""Where motions run side by side: processes of this machine, which listen on no port, or a Dask cluster."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from ldsim.errors import SolverError


class WorkerDied(SolverError):
    """A process ended in the middle of a motion."""


@dataclass(frozen=True)
class Workers:
    """Processes to give motions to.

    Attributes:
        pool: what takes tasks.
        died: what a task ends with whose process died.
        tries: how often a motion is begun before its deaths are told; a cluster counts them by itself.
    """

    pool: Executor
    died: type[Exception]
    tries: int


@contextlib.contextmanager
def started(workers: int, scheduler: str | None) -> Iterator[Workers]:
    """Workers for the length of a block; where it ends by an error, those of this machine end at once.

    Args:
        workers: processes to start on this machine, where no scheduler is given.
        scheduler: address of a Dask scheduler that is running, such as `tls://host:8786`.

    Raises:
        SolverError: nothing that is a Dask scheduler answers at the address, or Dask is not installed.
    """
    if scheduler is not None:
        with _dask(scheduler) as found:
            yield found
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _attend)
    try:
        yield Workers(pool, BrokenProcessPool, tries=3)
        pool.shutdown()
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.kill()  # every frame is on disk
        pool.shutdown(cancel_futures=True)
        raise


def _attend() -> None:
    """In a worker: Ctrl-C is left to the parent, and without a parent there is no worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


def _dask(scheduler: str) -> contextlib.AbstractContextManager[Workers]:
    try:
        dask = importlib.import_module("ldsim.pipeline.dask_cluster")
    except ImportError as error:
        raise SolverError(
            f"a scheduler needs Dask, which is not installed ({error}); pip install 'ldsim[cluster]', or leave "
            "--scheduler out to run on this machine"
        ) from error
    found: contextlib.AbstractContextManager[Workers] = dask.connected(scheduler)
    return found


def result(future: Future[None], died: type[Exception] = BrokenProcessPool) -> None:
    """Raise what a task failed with, in words where the task itself was not at fault.

    Raises:
        WorkerDied: its process did.
        SolverError: it ran out of memory, the scheduler went away, or the worker lacks a package.
    """
    try:
        future.result()
    except died as error:
        raise WorkerDied(
            "worker processes died again and again on one motion (out of memory?); finished frames are kept — run "
            "again to continue, with a smaller snapshot.workers if memory is short; a script of your own has to call "
            'this below `if __name__ == "__main__":`'
        ) from error
    except MemoryError as error:
        raise SolverError(
            f"a worker ran out of memory ({error or 'allocation failed'}); finished frames are kept — run again to "
            "continue, with a smaller snapshot.workers or linear_solver: multigrid"
        ) from error
    except CancelledError as error:
        raise SolverError("the Dask scheduler went away; finished frames are kept — run again to continue") from error
    except ImportError as error:
        raise SolverError(
            f"a worker cannot import what it needs ({error}); install the same version of ldsim there as here"
        ) from error
