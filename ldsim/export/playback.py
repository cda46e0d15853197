"""One motion of a finished run in one space, frame by frame, as the exporters see it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.errors import ExportError
from ldsim.export.drawn import Drawn
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.skin import Skin
from ldsim.pipeline.simulate import residual, simulated_scene
from ldsim.run import AUTO, SPACES, Run
from ldsim.space.lifting import Lifting

# Columns that what is beside the coordinates of a condensed space is cut down to, for formats that play columns.
BESIDE = 12


@dataclass(frozen=True, eq=False)
class Playback:
    """One motion in one space, ready to be written out.

    Attributes:
        motion, space: their names.
        scene: the solid.
        frame_seconds: time between two frames, s; frame i is the state at (i + 1) times it.
        frames: how many there are.
        displacement: frame → u, (n, 3) float64, metres.
        beside: frame → what of it is not U q, of a condensed space; None elsewhere.
        U: basis of a reduced space, and beside it the fields of pins that move, (3n, k); None for the full space.
        coordinates: their coordinates in each frame, (frames, k); None for the full space.
        lost: frames left out at the end because the run diverged there.
        pulls: frame → what is held, (g,) vertices, and where to, (3,) metres, of every drag that pulls in it.
        skin: what is drawn in place of the mesh's boundary.
    """

    motion: str
    space: str
    scene: Scene
    frame_seconds: float
    frames: int
    displacement: Callable[[int], Array]
    beside: Callable[[int], Array] | None = None
    U: Array | None = None
    coordinates: Array | None = None
    lost: int = 0
    pulls: Callable[[int], list[tuple[Indices, Array]]] = lambda _: []
    skin: Skin | None = None

    @cached_property
    def drawn(self) -> Drawn:
        """The surface that moves.

        Raises:
            MeshError: the skin lies far outside of the solid.
        """
        return Drawn.of(self.mesh, self.skin)

    @property
    def title(self) -> str:
        return f"{self.motion}-{self.space}"

    @property
    def mesh(self) -> Mesh:
        return self.scene.mesh

    def reduced(self, format: str) -> tuple[Array, Array]:
        """U and the coordinates of each frame, for a format that plays them.

        What a condensed space has beside them follows as its principal components over the frames, `BESIDE` at most.

        Raises:
            ExportError: the motion is of the full space, which has no basis.
        """
        if self.U is None or self.coordinates is None:
            raise ExportError(
                f"{format} plays the columns of a basis and the full space has none; "
                "use --space linear or latent, or the format ply or vtk"
            )
        used = self.U.any(axis=0)  # of a condensed space some columns are features of V_eff, which move nothing
        U, coordinates = self.U[:, used], self.coordinates[:, used]
        if self.beside is None:
            return U, coordinates
        rows = np.stack([self.beside(frame).ravel() for frame in range(self.frames)])
        shares = np.linalg.eigh(rows @ rows.T)[1][:, -BESIDE:]
        return np.hstack([U, rows.T @ shares]), np.hstack([coordinates, shares])

    def time(self, frame: int) -> float:
        """When a frame is, s."""
        return (frame + 1) * self.frame_seconds

    def thinned(self, every: int) -> Playback:
        """One frame of `every`, the last of each: frame i is still the state at (i + 1) times the new interval."""
        kept = range(every - 1, self.frames, every)
        if not kept:
            raise ExportError(
                f"--every {every} leaves none of the {self.frames} frames of {self.motion}; give a smaller number"
            )
        read, beside, pulls = self.displacement, self.beside, self.pulls
        return replace(
            self,
            frame_seconds=self.frame_seconds * every,
            frames=len(kept),
            displacement=lambda frame: read(kept[frame]),
            beside=None if beside is None else lambda frame: beside(kept[frame]),
            pulls=lambda frame: pulls(kept[frame]),
            coordinates=None if self.coordinates is None else self.coordinates[kept.start :: every],
        )


def playback(run: Run, motion: str | None, space: str) -> Playback:
    """A motion in a space; the first motion of the run where none is named. The run must stay open while it is read.

    Raises:
        ExportError: there is no such motion or space, or the run diverged in its first frame.
    """
    space = run.chosen if space == AUTO else space
    if space not in SPACES:
        _known("space", space, (*SPACES, *(name for name in run.simulation if name not in SPACES)))
    motions = run.played.names
    if space == "full":
        return _full(run, _known("motion", motion or motions[0], motions))
    ran = run.simulation[space]
    name = _known("motion", motion or next(name for name in motions if name in ran), ran)
    coordinates = ran[name].coordinates
    assert coordinates is not None, "reduced runs keep their coordinates"
    finite = np.asarray(np.isfinite(coordinates).all(axis=1), dtype=bool)
    frames = len(finite) if finite.all() else int(finite.argmin())
    if frames == 0:
        raise ExportError(f"motion {name!r} diverged in the first frame of the {space} space; nothing to export")
    played = run.recorded(name).motion
    lifting = Lifting.of(run.scene, [played])
    U = np.hstack([run.basis_of(space).matrix[:, : coordinates.shape[1]], lifting.fields])
    q = np.hstack([coordinates[:frames], lifting.coordinates(played)[:frames]])
    moved = residual(run, space, name)
    beside = None if moved is None else lambda frame: moved(frame, coordinates[frame])

    def displacement(frame: int) -> Array:
        u: Array = (U @ q[frame]).reshape(-1, 3)
        return u if beside is None else u + beside(frame)

    scene = simulated_scene(run)
    h, lost, pulls = scene.time_step, len(finite) - frames, run.recorded(name).pulls
    return Playback(name, space, scene, h, frames, displacement, beside, U, q, lost, pulls)


def _full(run: Run, motion: str) -> Playback:
    read = run.played.reader(motion)

    def displacement(frame: int) -> Array:
        return np.asarray(read(frame, frame + 1)[0], dtype=np.float64)

    h, pulls = run.scene.time_step, run.recorded(motion).pulls
    return Playback(motion, "full", run.scene, h, run.played.frames(motion), displacement, pulls=pulls)


def _known(what: str, name: str, known: Iterable[str]) -> str:
    """The name, if it is one of the known ones."""
    names = list(known)
    if name not in names:
        raise ExportError(f"unknown {what} {name!r}; known are {', '.join(names)}")
    return name
