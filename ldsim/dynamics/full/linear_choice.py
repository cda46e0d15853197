"""How the sparse systems of a scene are solved: a factor where it fits in memory, else multigrid."""

from __future__ import annotations

import ctypes
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from ldsim.arrays import Indices
from ldsim.errors import SolverError
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern, vertex_graph
from ldsim.optimise.elimination import Elimination, eliminate, elimination_order
from ldsim.optimise.sparse import factor_bytes

# The share of the memory that the factors of all workers may take; the rest is for meshes, frames and others.
MEMORY_SHARE = 0.4
# Where Linux tells what a container may take, by the second and the first version of control groups.
CONTAINER_LIMITS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


@dataclass(frozen=True, eq=False)
class LinearChoice:
    """A linear solver for a scene.

    Attributes:
        order: the free vertices in the order of the matrix, (f,) int64.
        elimination: the structure of the direct factor; None for multigrid.
        words: which it is and why, for the user.
    """

    order: Indices
    elimination: Elimination | None
    words: str

    @property
    def name(self) -> str:
        return "multigrid" if self.elimination is None else "direct"


def choose(scene: Scene, linear_solver: str, workers: int = 1, memory: float | None = None) -> LinearChoice:
    """The linear solver for a scene.

    Args:
        linear_solver: "direct", "multigrid", or "auto" to go by the size of the factor.
        workers: how many hold a factor at a time.
        memory: that there is, bytes; measured if None.

    Raises:
        SolverError: a direct factor is asked for and is larger than the memory.
    """
    free = scene.free
    unknowns = f"{3 * len(free):,} unknowns"
    if linear_solver == "multigrid":
        return LinearChoice(free, None, f"multigrid, {unknowns}")
    nodes, n = scene.points.nodes, scene.mesh.n_vertices
    order = free[elimination_order(vertex_graph(nodes, free, n))]
    pattern = StiffnessPattern(nodes, order, n)
    elimination = eliminate(pattern.indptr, pattern.columns)
    memory = physical_memory() if memory is None else memory
    size = workers * factor_bytes(elimination)
    words = f"{unknowns}, a factor of up to {factor_bytes(elimination) / 1e6:.2g} MB"
    if linear_solver == "auto" and size > MEMORY_SHARE * memory:
        return LinearChoice(free, None, f"multigrid, {words}")
    if size > memory:
        raise SolverError(
            f"snapshot.linear_solver is direct, but {workers} × {factor_bytes(elimination) / 1e9:.3g} GB for the "
            f"factors of {unknowns} do not fit in {memory / 1e9:.3g} GB of memory; use multigrid or fewer workers"
        )
    return LinearChoice(order, elimination, f"direct, {words}")


def physical_memory() -> float:
    """Memory of this machine, or of the container where that has less, bytes; infinite where nothing tells it."""
    return min((_of_machine(), *map(_container_limit, CONTAINER_LIMITS)))


def _of_machine() -> float:
    if sys.platform == "win32":
        kilobytes = ctypes.c_ulonglong()
        ctypes.windll.kernel32.GetPhysicallyInstalledSystemMemory(ctypes.byref(kilobytes))
        return 1024.0 * kilobytes.value or math.inf
    return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")


def _container_limit(path: Path) -> float:
    try:
        return float(path.read_text(encoding="ascii"))
    except (OSError, ValueError):  # not there, or "max"
        return math.inf
