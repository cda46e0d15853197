"""Where numba keeps compiled kernels: one folder for each state of the numerics' sources.

Numba's disk cache looks only at the file of the kernel itself. A kernel that calls one of another file would go on
running the old code after that file has changed; a changed material once ran as another one without a word.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

KEPT = 8
# Folders used this lately are kept whatever their number, for another process may be writing to them.
LATELY_S = 24 * 3600.0
# The packages whose kernels call one another; what lies above them may only call in.
NUMERICS = ("mechanics", "solvers", "reduction", "dynamics")


def use_kernel_cache() -> None:
    """Point NUMBA_CACHE_DIR, unless it is set, to a folder named after the sources of the numerics.

    Numba reads the variable when it is imported; where that came first, its setting is changed.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ldsim" / "kernels"
    folder = root / source_state([Path(__file__).parent / name for name in NUMERICS])
    with contextlib.suppress(OSError):
        if not folder.is_dir():
            folder.mkdir(parents=True)
            forget_oldest(root)
        os.utime(folder)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        if "numba" in sys.modules:
            sys.modules["numba"].config.CACHE_DIR = str(folder)


def source_state(packages: Sequence[Path]) -> str:
    """A short hash of the name, size and time of every source file in the folders."""
    digest = hashlib.sha256()
    for path in sorted(path for package in packages for path in package.rglob("*.py")):
        status = path.stat()
        digest.update(f"{path}:{status.st_size}:{status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]


def forget_oldest(root: Path) -> None:
    """Delete the folders that nobody used lately, but for the newest few."""
    used = sorted((path.stat().st_mtime, path) for path in root.iterdir() if path.is_dir())
    for time_used, folder in used[:-KEPT]:
        if time.time() - time_used > LATELY_S:
            shutil.rmtree(folder, ignore_errors=True)
