"""One thread for small linear algebra: OpenBLAS pools that wait for each other cost a hundredfold (dependencies.md)."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from threadpoolctl import threadpool_limits


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit every BLAS and OpenMP pool of this process to one thread for the block."""
    with threadpool_limits(limits=1):
        yield
