"""A Dask cluster that somebody else started: the one owner of Dask, imported only where a scheduler is named.

Whoever reaches a Dask scheduler or worker runs code there (SECURITY.md). TLS certificates are those of Dask's own
configuration, `distributed.comm.tls`; an address that begins with tls:// uses nothing without them.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import dask
from distributed import Client, Security
from distributed.scheduler import KilledWorker

from ldsim.errors import SolverError
from ldsim.pipeline.cluster import Workers

CONNECT_SECONDS = 10
# A worker is deaf while it compiles or factorises, which may take minutes; that does not make it dead.
CONFIGURATION = {
    "distributed.scheduler.worker-ttl": None,
    "distributed.comm.timeouts.connect": f"{CONNECT_SECONDS}s",
    "distributed.admin.tick.limit": "1h",
}


@contextlib.contextmanager
def connected(scheduler: str) -> Iterator[Workers]:
    """The workers of a scheduler; a motion whose worker dies is begun three times more at most.

    Raises:
        SolverError: nothing that is a Dask scheduler answers at the address.
    """
    with dask.config.set(CONFIGURATION), _client(scheduler) as client:
        yield Workers(client.get_executor(pure=False), KilledWorker, tries=1)


def _client(scheduler: str) -> Client:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        return Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False, security=Security())
    except (OSError, ValueError, ImportError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SolverError(
            f"no Dask scheduler answers at {scheduler!r} ({reason}); start one with `dask scheduler`, give the address "
            "that it prints, or leave --scheduler out to run on this machine. Finished frames are kept"
        ) from error
