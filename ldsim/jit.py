"""Compiled loops: the decorators, where their machine code is kept, and how threads share them out.

Numba's disk cache looks only at the file of the kernel itself. A kernel that calls one of another file would go on
running the old code after that file has changed; a changed material once ran as another one without a word. So each
file's kernels lie in a folder named after that file's content and the content of all that it imports. Every other
module takes `njit` and `kernel` from here, so that numba is told so before it compiles anything.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from numba.core import event
from numba.core.caching import _CacheLocator
from threadpoolctl import threadpool_limits

from ldsim.arrays import Array

KEPT_DAYS = 30
PACKAGE = Path(__file__).parent
IMPORT = re.compile(r"^\s*(?:from|import)\s+(ldsim[\w.]*)", re.MULTILINE)


def kernel_cache() -> Path:
    """The folder of all compiled kernels."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ldsim" / "kernels"


@cache
def source_state(path: Path, package: Path = PACKAGE) -> str:
    """A short hash of a source file and of all files of the package that it imports, directly or not."""
    todo, seen = [path], set[Path]()
    while todo:
        current = todo.pop()
        if current in seen:
            continue
        seen.add(current)
        for name in IMPORT.findall(current.read_text(encoding="utf-8")):
            place = package.parent.joinpath(*name.split("."))
            # `from a.package import file` names the package alone, so each of its files counts
            todo += [file for file in (place.with_suffix(".py"), *place.glob("*.py")) if file.is_file()]
    digest = hashlib.sha256()
    for file in sorted(seen):
        digest.update(f"{file.relative_to(package.parent)}\n".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def kernels_of(path: Path) -> Path:
    """The folder of the kernels of a source file, as it and what it imports are now."""
    checked = "-checked" if numba.config.BOUNDSCHECK else ""  # type: ignore[attr-defined]
    return kernel_cache() / f"{path.stem}-{source_state(path)}{checked}"


def are_kept(path: Path) -> bool:
    """Whether there is machine code of a source file of this package from before."""
    return any(kernels_of(path).glob("*.nbc"))


def forget_unused(root: Path) -> None:
    """Delete the folders of kernels that nobody used for a month."""
    with contextlib.suppress(OSError):
        for folder in root.iterdir():
            if time.time() - folder.stat().st_mtime > KEPT_DAYS * 24 * 3600:
                shutil.rmtree(folder, ignore_errors=True)


class SourceLocator(_CacheLocator):
    """Where the machine code of a function of this package is kept: a folder for each state of its sources.

    Numba asks for it by name (`NUMBA_CACHE_LOCATOR_CLASSES`). The folder is named after the content of the sources,
    not their place, so copies of the project share it.
    """

    def __init__(self, folder: Path, line: int) -> None:
        self._folder, self._line = folder, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> SourceLocator | None:
        """None where the function is not of this package, or the user chose a folder, or none can be written."""
        path = Path(py_file)
        if "NUMBA_CACHE_DIR" in os.environ or not path.is_relative_to(PACKAGE):
            return None
        folder = kernels_of(path)
        try:
            if not folder.is_dir():
                folder.mkdir(parents=True)
                forget_unused(folder.parent)
            os.utime(folder)
        except OSError:
            return None
        return cls(folder, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)


numba.config.CACHE_LOCATOR_CLASSES = ",".join(  # type: ignore[attr-defined]
    [
        f"{__name__}.SourceLocator",
        *("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "IPythonCacheLocator"),
    ]
)

Loop = TypeVar("Loop", bound=Callable[..., Any])
Part = TypeVar("Part")
Result = TypeVar("Result")


# A function that says neither inherits both from whatever calls it first, and its machine code is then kept for every
# other caller: after another first run, the same step had other last bits. So both are always said.
STRICT: dict[str, Any] = {"fastmath": False, "error_model": "python", "forceinline": False}


@overload
def njit(function: Loop, /) -> Loop: ...
@overload
def njit(**options: object) -> Callable[[Loop], Loop]: ...
def njit(function: Any = None, /, **options: object) -> Any:
    """Numba's `njit`, to be used bare or with options; strict arithmetic unless they say otherwise."""
    return numba.njit(function, **{**STRICT, **options})


def kernel(**options: object) -> Callable[[Loop], Loop]:
    """Compile with numba, cached, without the interpreter's lock and without memory management.

    Numba counts the references to each array that a function is handed or takes a part of, and each count is an atomic
    operation: a step had hundreds. Without its memory management nothing is counted, and what would allocate does not
    compile. Assigning a whole array may allocate, so arrays are copied by `copy`.

    Args:
        options: more of numba's, such as fastmath.
    """
    every: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False, **options}
    return njit(**every)


class Compiling(event.Listener):
    """What is told of kernels that are compiled, not those that were kept; one that another compiles is part of it."""

    def __init__(self, begun: Callable[[], None], done: Callable[[float], None]) -> None:
        self._begun, self._done, self._depth, self._since = begun, done, 0, 0.0

    def on_start(self, event: object) -> None:
        self._depth += 1
        if self._depth == 1:
            self._since = time.perf_counter()
            self._begun()

    def on_end(self, event: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._done(time.perf_counter() - self._since)


@contextlib.contextmanager
def while_compiling(begun: Callable[[], None], done: Callable[[float], None]) -> Iterator[None]:
    """In the block, call `begun` before this process compiles a kernel, and then `done` with the seconds it took."""
    with event.install_listener("numba:compile", Compiling(begun, done)):
        yield


@kernel()
def copy(source: Array, target: Array) -> None:
    """target ← source, one-dimensional arrays of one length."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit every BLAS and OpenMP pool of this process to one thread for the block.

    Pools that wait for each other on few cores make small linear algebra a hundred times slower.
    """
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
