"""Where motions run side by side: a Dask cluster on this machine, or one that is there already."""

from __future__ import annotations

import contextlib
import logging
import signal
import warnings
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future

import dask
from distributed import Client, LocalCluster, WorkerPlugin
from distributed.scheduler import KilledWorker

from ldsim.errors import SolverError

CONNECT_SECONDS = 10
# A worker is deaf while it compiles or factorises, which may take minutes; that does not make it dead.
CONFIGURATION = {
    "distributed.scheduler.worker-ttl": None,
    "distributed.comm.timeouts.connect": f"{CONNECT_SECONDS}s",
    "distributed.admin.tick.limit": "1h",
}


class LeaveInterruptsToTheParent(WorkerPlugin):
    """Ctrl-C reaches every process of the terminal; the workers end when the parent does, without a traceback."""

    def setup(self, worker: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def executor(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """An executor whose tasks run in other processes; a task whose process dies is run again, three times at most.

    Args:
        workers: processes to start on this machine, where no scheduler is given.
        scheduler: address of a Dask scheduler that is running, such as `tcp://host:8786`.

    Raises:
        SolverError: nothing that is a Dask scheduler answers at the address.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(CONFIGURATION))
        if scheduler is not None:
            client = stack.enter_context(_client(scheduler))
        else:
            client = stack.enter_context(Client(stack.enter_context(local_cluster(workers))))
            client.register_plugin(LeaveInterruptsToTheParent())
        pool: Executor = client.get_executor(pure=False)
        yield pool


def result(future: Future[None]) -> None:
    """Raise what a task failed with, in words where the task itself was not at fault.

    Raises:
        SolverError: its workers died, the scheduler went away, or the worker lacks a package.
    """
    try:
        future.result()
    except KilledWorker as error:
        raise SolverError(
            "worker processes died again and again on one motion (out of memory?); finished frames are kept — run "
            "again to continue, with a smaller snapshot.workers if memory is short"
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


def local_cluster(workers: int) -> LocalCluster:
    """Processes of one thread each, that are never restarted for their memory and end when this process does."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=None,
            silence_logs=logging.CRITICAL,
        )


def _client(scheduler: str) -> Client:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        return Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SolverError(
            f"no Dask scheduler answers at {scheduler!r} ({reason}); start one with `dask scheduler`, give the address "
            "that it prints, or leave --scheduler out to run on this machine. Finished frames are kept"
        ) from error
