"""Many instances of one reduced model at once, by the C library on several threads.

batch = BatchedSimulator.load("runs/x", 64)
pulls = batch.grab(point, targets)
batch.step(100)
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from ctypes import byref, c_void_p, sizeof
from itertools import repeat
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import SolverError
from ldsim.run import AUTO, Run
from ldsim.runtime.library import UNSIGNED, NativeModel, NativeSolid, Record, local_library
from ldsim.runtime.model_file import model_bytes


class BatchedSimulator:
    """n solids of one model; each has grabs, gravity and pins of its own and none notices the others.

    The steps are those of the C library, the same to the last bit whatever the number of threads. For gradients, and
    for graphics cards, see `ldsim.dynamics.batched`.

    Attributes:
        solids: the instances, for whatever is not done to all at once.

    Args:
        threads: as many as there are processors where it is left out.

    Raises:
        SolverError: fewer than one instance or thread.
    """

    def __init__(self, model: NativeModel, count: int, threads: int | None = None, max_grabs: int = 8) -> None:
        threads = (os.cpu_count() or 1) if threads is None else threads
        if count < 1 or threads < 1:
            raise SolverError(f"{count} instances on {threads} threads; expected at least one of each")
        self.model = model
        self.solids = [NativeSolid(model, max_grabs) for _ in range(count)]
        self._pointers = (c_void_p * count)(*(solid.pointer.value for solid in self.solids))
        self._records = (Record * count)()
        self._bounds = np.linspace(0, count, min(threads, count) + 1).astype(int)
        self._pool = ThreadPoolExecutor(len(self._bounds) - 1) if len(self._bounds) > 2 else None

    @classmethod
    def load(
        cls, run: str | Path, count: int, space: str = AUTO, *, threads: int | None = None, max_grabs: int = 8
    ) -> BatchedSimulator:
        """So many instances of a finished run, or of a model.ldsim that was exported from one.

        Args:
            run: its folder, or the file; of a condensed model the file is there at once, and the folder takes seconds.
            space: "latent", "linear", "linear_20"; "auto" for the one that simulate chose.

        Raises:
            ArtefactError: an artefact is missing or damaged.
            ExportError: the C library does not have what the space needs.
            SolverError: the file is no model, or there is no C compiler.
        """
        if Path(run).is_file():
            data = Path(run).read_bytes()
        else:
            with Run.open(run) as opened:
                data = model_bytes(opened.space(space))
        return cls(NativeModel(local_library(), data), count, threads, max_grabs)

    def __repr__(self) -> str:
        threads = f"{len(self._bounds) - 1} thread{'s' * (self._pool is not None)}"
        r = self.model.info.r
        solids = f"{len(self)} solid{'s' * (len(self) != 1)} of {r} number{'s' * (r != 1)}"
        return f"<BatchedSimulator: {solids} on {threads}>"

    def __len__(self) -> int:
        return len(self.solids)

    def grab(
        self, point: ArrayLike, targets: ArrayLike, stiffness: float | None = None, radius: float | None = None
    ) -> Indices:
        """Take hold of each instance near a point, (3,) or (n, 3), and pull it to its target; numbers of the grabs.

        Raises:
            SolverError: an instance refuses; none is held then that was not before.
        """
        grabs, points, places = list[int](), self._each(point, "point"), self._each(targets, "target")
        try:
            for solid, at, to in zip(self.solids, points, places, strict=True):
                grabs.append(solid.grab(at, to, stiffness, radius))
        except Exception:
            # their numbers would be lost, and they could never be let go
            for solid, grab in zip(self.solids, grabs, strict=False):
                solid.release(grab)
            raise
        return np.array(grabs, dtype=np.int64)

    def move(self, grabs: Indices, targets: ArrayLike) -> None:
        for solid, grab, target in zip(self.solids, self._numbers(grabs), self._each(targets, "target"), strict=True):
            solid.move(grab, target)

    def release(self, grabs: Indices) -> None:
        for solid, grab in zip(self.solids, self._numbers(grabs), strict=True):
            solid.release(grab)

    def set_gravity(self, gravity: ArrayLike) -> None:
        """One for all, (3,) m/s², or one each, (n, 3)."""
        for solid, own in zip(self.solids, self._each(gravity, "gravity"), strict=True):
            solid.set_gravity(own)

    def step(self, steps: int = 1) -> NDArray[np.int64]:
        """So many steps of every instance; outcomes of the last ones, (n,), numbers of ldsim_outcome: 0 is solved.

        Raises:
            ValueError: the number of steps is not positive, or too large for the library.
        """
        starts, stops = self._bounds[:-1].tolist(), self._bounds[1:].tolist()
        if self._pool is None:
            self._piece(0, len(self), steps)
        else:  # a call into the library frees the interpreter's lock
            list(self._pool.map(self._piece, starts, stops, repeat(steps)))
        return np.array([record.outcome for record in self._records], dtype=np.int64)

    def reset(self) -> None:
        for solid in self.solids:
            solid.reset()

    @property
    def z(self) -> Array:
        """Coordinates, (n, r) float64."""
        return np.array([solid.z for solid in self.solids])

    def displacement(self, vertices: NDArray[np.integer] | None = None) -> Array:
        """u of some vertices, or of all, (n, v, 3) float64, metres."""
        if vertices is None:
            return np.array([solid.displacements() for solid in self.solids])
        return np.array([solid.displacement(vertices) for solid in self.solids])

    def _piece(self, start: int, stop: int, steps: int) -> None:
        first, records = byref(self._pointers, start * sizeof(c_void_p)), byref(self._records, start * sizeof(Record))
        self.model.step_many(first, stop - start, steps, records)

    def _numbers(self, grabs: Indices) -> list[int]:
        given = np.asarray(grabs)
        if given.shape != (len(self),) or given.dtype.kind not in "iu":
            found = f"{given.dtype} of the shape {given.shape}"
            raise SolverError(f"grabs are {found}; they must be the whole numbers that grab gave, ({len(self)},)")
        numbers = [int(number) for number in given]
        for number in numbers:
            if not 0 <= number < UNSIGNED:  # the library would take 2³² + 1, and 1 − 2³², for 1
                raise SolverError(f"there is no grab {number}; give the numbers that grab gave")
        return numbers

    def _each(self, values: ArrayLike, name: str) -> Array:
        given = np.asarray(values, dtype=np.float64)
        if given.shape not in ((3,), (len(self), 3)):
            raise SolverError(f"{name} has the shape {given.shape}; it must be (3,), or ({len(self)}, 3) for one each")
        return np.broadcast_to(given, (len(self), 3))
