"""One thread for small linear algebra: OpenBLAS pools that wait for each other cost a hundredfold.

Large loops that release the interpreter's lock (compiled kernels, matrix products) may share out the cores instead.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from threadpoolctl import threadpool_limits

Part = TypeVar("Part")
Result = TypeVar("Result")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit every BLAS and OpenMP pool of this process to one thread for the block."""
    with threadpool_limits(limits=1):
        yield


def in_threads(work: Callable[[Part], Result], parts: Iterable[Part], threads: int = 0) -> Iterator[Result]:
    """The results of `work` on each part, in order; at most `threads` at a time, 0 for one a core."""
    count = threads or os.cpu_count() or 1
    if count == 1:
        yield from map(work, parts)
        return
    with ThreadPoolExecutor(count) as pool:
        yield from pool.map(work, parts)
