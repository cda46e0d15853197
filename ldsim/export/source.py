"""A finished run as the exporters see it: one motion in one space, frame by frame, or the reduced model."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import StoredModel, read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.simulation import read_simulation
from ldsim.artefacts.snapshots import Recorded, Snapshots
from ldsim.artefacts.store import Header, check_inputs
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.errors import ExportError
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.surface import surface_triangles, surface_vertices
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting

Array = NDArray[np.float64]

SPACES = ("full", "linear", "latent")


@dataclass(frozen=True, eq=False)
class Playback:
    """One motion in one space, ready to be written out.

    Attributes:
        motion, space: their names.
        scene: the solid.
        frame_seconds: time between two frames, s; frame i is the state at (i + 1) times it.
        frames: how many there are.
        displacement: frame → u, (n, 3) float64, metres.
        U: basis of a reduced space, and beside it the fields of pins that move, (3n, k); None for the full space.
        coordinates: their coordinates in each frame, (frames, k); None for the full space.
        lost: frames left out at the end because the run diverged there.
    """

    motion: str
    space: str
    scene: Scene
    frame_seconds: float
    frames: int
    displacement: Callable[[int], Array]
    U: Array | None = None
    coordinates: Array | None = None
    lost: int = 0

    @property
    def title(self) -> str:
        return f"{self.motion}-{self.space}"

    @property
    def mesh(self) -> Mesh:
        return self.scene.mesh

    def reduced(self, format: str) -> tuple[Array, Array]:
        """U and the coordinates of each frame, for a format that plays them.

        Raises:
            ExportError: the motion is of the full space, which has no basis.
        """
        if self.U is None or self.coordinates is None:
            raise ExportError(
                f"{format} plays the columns of a basis and the full space has none; "
                "use --space linear or latent, or the format ply or vtk"
            )
        return self.U, self.coordinates

    def time(self, frame: int) -> float:
        """When a frame is, s."""
        return (frame + 1) * self.frame_seconds

    def thinned(self, every: int) -> Playback:
        """Every so-manyth frame only, starting so that frame i is still the state at (i + 1) times the new interval."""
        kept = range(every - 1, self.frames, every)
        if not kept:
            raise ExportError(f"--every {every} leaves none of the {self.frames} frames of {self.motion}")
        read = self.displacement
        return replace(
            self,
            frame_seconds=self.frame_seconds * every,
            frames=len(kept),
            displacement=lambda frame: read(kept[frame]),
            coordinates=None if self.coordinates is None else self.coordinates[kept.start :: every],
        )


@dataclass(frozen=True, eq=False)
class Surface:
    """The boundary of a mesh with its own numbering.

    Attributes:
        vertices: the mesh's vertices that lie on it, (v,) int32.
        triangles: indices into `vertices`, (t, 3) int32, outward.
    """

    vertices: NDArray[np.int32]
    triangles: NDArray[np.int32]


def surface_of(mesh: Mesh) -> Surface:
    vertices = surface_vertices(mesh)
    triangles = np.searchsorted(vertices, surface_triangles(mesh)).astype(np.int32)
    return Surface(vertices, triangles)


@dataclass(frozen=True, eq=False)
class ReducedSpace:
    """A space to step in: its basis (3n, k), decoder and cubature."""

    U: Array
    decoder: Decoder
    cubature: CubatureRule


class Source:
    """The artefacts of one run's folder, read when needed.

    Raises:
        ExportError: there is no such folder.
        ArtefactError: an artefact that is needed is missing, damaged or of another run.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise ExportError(f"run folder {folder} does not exist; expected a folder with scene.h5, such as runs/demo")
        self.folder = folder

    def path(self, kind: str) -> Path:
        """The file of an artefact."""
        return self.folder / f"{kind}.h5"

    def _check(self, header: Header, *inputs: str) -> None:
        """Refuse an artefact that was made from other files than those beside it, or for another experiment."""
        path = self.path(header.kind)
        check_inputs(path, header, {name: self.path(name) for name in inputs})
        experiment = header.notes.get("experiment")
        if experiment != self.experiment:
            raise ExportError(f"{path} belongs to the experiment {experiment!r}, expected {self.experiment!r}")

    @cached_property
    def _read_scene(self) -> tuple[Scene, Header]:
        return read_scene(self.path("scene"))

    @property
    def scene(self) -> Scene:
        return self._read_scene[0]

    @property
    def experiment(self) -> str:
        return str(self._read_scene[1].notes.get("experiment"))

    @cached_property
    def basis(self) -> Array:
        stored, header = read_basis(self.path("basis"), self.scene)
        self._check(header, "scene")
        return stored.basis.matrix

    @cached_property
    def model(self) -> StoredModel:
        model, header = read_model(self.path("model"))
        self._check(header, "basis")
        return model

    @cached_property
    def runs(self) -> dict[str, dict[str, Trajectory]]:
        runs, header = read_simulation(self.path("simulation"))
        self._check(header, "scene", "basis")
        return runs

    @cached_property
    def spaces(self) -> dict[str, ReducedSpace]:
        """The reduced spaces by name, as `ldsim simulate` runs them."""
        cubature, header = read_cubature(self.path("cubature"))
        self._check(header, "scene", "basis", "model")
        narrow = np.ascontiguousarray(self.basis[:, : self.model.kp])
        return {
            "latent": ReducedSpace(self.basis, self.model.decoder, cubature["latent"].stepped),
            "linear": ReducedSpace(narrow, Decoder.identity(self.model.kp), cubature["linear"].stepped),
        }

    def recorded(self, motion: str) -> Recorded:
        """What pulled in a motion, and which vertices it held."""
        with Snapshots(self.path("snapshots")) as snapshots:
            return snapshots.recorded(_known("motion", motion, snapshots.names))

    @cached_property
    def motions(self) -> list[str]:
        """Motions in the order of the configuration."""
        with Snapshots(self.path("snapshots")) as snapshots:
            self._check(snapshots.header, "scene")
            return snapshots.names

    def playback(self, motion: str | None, space: str) -> Playback:
        """A motion in a space; the first motion of the run where none is named.

        Raises:
            ExportError: there is no such motion or space, or the run diverged in its first frame.
        """
        _known("space", space, SPACES)
        if space == "full":
            return self._full(_known("motion", motion or self.motions[0], self.motions))
        ran = self.runs[space]
        name = _known("motion", motion or next(name for name in self.motions if name in ran), ran)
        coordinates = ran[name].coordinates
        assert coordinates is not None, "reduced runs keep their coordinates"
        finite = np.asarray(np.isfinite(coordinates).all(axis=1), dtype=bool)
        frames = len(finite) if finite.all() else int(finite.argmin())
        if frames == 0:
            raise ExportError(f"motion {name!r} diverged in the first frame of the {space} space; nothing to export")
        played = self.recorded(name).motion
        lifting = Lifting.of(self.scene, [played])
        U = np.hstack([self.basis[:, : coordinates.shape[1]], lifting.fields])
        q = np.hstack([coordinates[:frames], lifting.coordinates(played)[:frames]])
        h = self.scene.time_step
        return Playback(
            name, space, self.scene, h, frames, lambda i: (U @ q[i]).reshape(-1, 3), U, q, len(finite) - frames
        )

    def _full(self, motion: str) -> Playback:
        def read(frame: int) -> Array:
            with Snapshots(self.path("snapshots")) as snapshots:
                return np.asarray(snapshots.reader(motion)(frame, frame + 1)[0], dtype=np.float64)

        with Snapshots(self.path("snapshots")) as snapshots:
            frames = snapshots.frames(motion)
        return Playback(motion, "full", self.scene, self.scene.time_step, frames, read)


def _known(what: str, name: str, known: Iterable[str]) -> str:
    """The name, if it is one of the known ones."""
    names = list(known)
    if name not in names:
        raise ExportError(f"unknown {what} {name!r}; known are {', '.join(names)}")
    return name
