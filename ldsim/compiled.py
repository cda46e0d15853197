"""Where numba keeps compiled kernels: one folder for each state of the numerics' sources.

Numba's disk cache looks only at the file of the kernel itself. A kernel that calls one of another file would go on
running the old code after that file has changed; a changed material once ran as another one without a word.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

KEPT = 8
# The packages whose kernels call one another; what lies above them may only call in.
NUMERICS = ("mechanics", "solvers", "reduction", "dynamics")


def use_kernel_cache() -> None:
    """Point NUMBA_CACHE_DIR, unless it is set, to a folder named after the sources of the numerics."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ldsim" / "kernels"
    folder = root / source_state([Path(__file__).parent / name for name in NUMERICS])
    with contextlib.suppress(OSError):
        if not folder.is_dir():
            folder.mkdir(parents=True)
            _forget_oldest(root)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)


def source_state(packages: Sequence[Path]) -> str:
    """A short hash of the name, size and time of every source file in the folders."""
    digest = hashlib.sha256()
    for path in sorted(path for package in packages for path in package.rglob("*.py")):
        status = path.stat()
        digest.update(f"{path}:{status.st_size}:{status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]


def _forget_oldest(root: Path) -> None:
    folders = sorted((path for path in root.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    for folder in folders[:-KEPT]:
        shutil.rmtree(folder, ignore_errors=True)
