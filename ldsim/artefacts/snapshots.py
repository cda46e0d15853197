"""snapshots.h5 and tests.h5: the full-space run of every motion, read in pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.artefacts.store import Header, optional, pieces, read_header, reading
from ldsim.errors import ArtefactError
from ldsim.mechanics.motion import Drag, Motion, Support

CHUNK_BYTES = 128 << 20
# The model learns from the first, choices and thresholds may look at the second, nothing before simulate reads the
# third.
ROLES = ("train", "validation", "test")
STATISTICS = ("iterations", "evaluations", "reason")


@dataclass(frozen=True, eq=False)
class Recorded:
    """A motion as it ran in the full space.

    Attributes:
        motion: what pulled.
        role: one of `ROLES`.
        held: held vertices of each drag.
        iterations, evaluations, reason, seconds: of each frame, (N,).
        identity: hash of all that the run depends on.
    """

    motion: Motion
    role: str
    held: Mapping[int, Indices]
    iterations: Indices
    evaluations: Indices
    reason: Indices
    seconds: Array
    identity: str = ""

    def pulls(self, frame: int) -> list[tuple[Indices, Array]]:
        """What is held in a frame, (g,) vertices, and where to, (3,) metres, by every drag that pulls in it."""
        drags, held = self.motion.drags, self.held
        return [(held[i], drags[i].targets[frame - drags[i].start]) for i in self.motion.active(frame) if i in held]


def motion_arrays(motion: Motion, held: Mapping[int, Indices]) -> dict[str, NDArray[np.generic]]:
    """A motion and its held vertices as arrays."""
    drags, supports = motion.drags, motion.supports
    vertices = [held.get(i, np.empty(0, dtype=np.int64)) for i in range(len(drags))]
    some: dict[str, NDArray[np.generic]] = {} if motion.gravity is None else {"gravity": motion.gravity}
    if supports:
        some["support_maps"] = np.stack([support.maps for support in supports])
        some["support_vertices"] = np.concatenate([support.vertices for support in supports])
        some["support_count"] = np.array([len(support.vertices) for support in supports], dtype=np.int64)
    return {
        "drag_start": np.array([drag.start for drag in drags], dtype=np.int64),
        "drag_frames": np.array([len(drag.targets) for drag in drags], dtype=np.int64),
        "drag_point": np.array([drag.point for drag in drags], dtype=np.float64).reshape(-1, 3),
        "drag_radius": np.array([drag.radius for drag in drags], dtype=np.float64),
        "drag_stiffness": np.array([drag.stiffness for drag in drags], dtype=np.float64),
        "drag_at_rest": np.array([drag.at_rest for drag in drags], dtype=bool),
        "targets": np.concatenate([np.empty((0, 3)), *(drag.targets for drag in drags)]),
        "held": np.concatenate([np.empty(0, dtype=np.int64), *vertices]),
        "held_count": np.array([len(v) for v in vertices], dtype=np.int64),
        **some,
    }


def read_motion(group: h5py.Group, name: str) -> tuple[Motion, dict[int, Indices]]:
    """A motion and its held vertices from the group that holds its arrays."""
    targets = pieces(group["targets"][:], group["drag_frames"][:])
    held = pieces(group["held"][:], group["held_count"][:])
    columns = [group[key][:] for key in ("drag_start", "drag_point", "drag_radius", "drag_stiffness", "drag_at_rest")]
    drags = tuple(
        Drag(int(start), point, target, float(radius), float(stiffness), bool(at_rest))
        for start, point, radius, stiffness, at_rest, target in zip(*columns, targets, strict=True)
    )
    settled = {i: vertices for i, vertices in enumerate(held) if len(vertices)}
    return Motion(name, int(group.attrs["frames"]), drags, optional(group, "gravity"), _supports(group)), settled


def _supports(group: h5py.Group) -> tuple[Support, ...]:
    if "support_maps" not in group:
        return ()
    vertices = pieces(group["support_vertices"][:], group["support_count"][:])
    return tuple(Support(*pair) for pair in zip(vertices, group["support_maps"][:], strict=True))


class Snapshots:
    """snapshots.h5 or tests.h5, open for reading until it is closed; displacements are read in chunks of bounded size.

    Args:
        n_vertices: of the scene, where that is known.
        kind: "snapshots" or "tests".
    """

    def __init__(self, path: Path, n_vertices: int | None = None, kind: str = "snapshots") -> None:
        self._path = path
        with ExitStack() as stack:
            file = stack.enter_context(reading(path, kind, {} if n_vertices is None else {"n": n_vertices}))
            self.header: Header = read_header(file)
            groups = file["motions"] if "motions" in file else {}
            ordered = sorted(groups, key=lambda name: int(groups[name].attrs["order"]))
            self._groups = {name: groups[name] for name in ordered}
            self._recorded = {name: _recorded(groups[name], name) for name in ordered}
            self._open = stack.pop_all()

    def beside(self, others: Snapshots) -> Snapshots:
        """These motions and after them others, open as long as both are."""
        both = copy(self)
        both._groups, both._recorded = self._groups | others._groups, self._recorded | others._recorded
        both._open = ExitStack()
        return both

    def __enter__(self) -> Snapshots:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._open.close()

    @property
    def names(self) -> list[str]:
        """Motions in the order of the configuration."""
        return list(self._recorded)

    def with_role(self, role: str) -> list[str]:
        return [name for name, found in self._recorded.items() if found.role == role]

    def recorded(self, name: str) -> Recorded:
        """A motion with its statistics, without the displacements.

        Raises:
            ArtefactError: there is none of that name.
        """
        if name not in self._recorded:
            raise ArtefactError(f"motion {name!r} was not recorded; known are {', '.join(self._recorded)}")
        return self._recorded[name]

    def frames(self, name: str) -> int:
        return self._recorded[name].motion.frames

    def reader(self, name: str) -> Callable[[int, int], NDArray[np.float32]]:
        """The function (start, stop) → frames start … stop − 1 of a motion, (frames, n, 3) float32, metres."""

        def read(start: int, stop: int) -> NDArray[np.float32]:
            found = self._read(name, start, stop)
            if not np.isfinite(found).all():
                raise ArtefactError(
                    f"{self._path}, motion {name!r}: a displacement in the frames {start} … {stop - 1} is not finite; "
                    "delete it and run make"
                )
            return found

        return read

    def frame_reader(self, names: list[str]) -> Callable[[int], NDArray[np.float32]]:
        """The function t → frame t of the given motions one after the other, (n, 3) float32, metres."""
        ends = np.cumsum([self.frames(name) for name in names])
        readers = [self.reader(name) for name in names]

        def frame(t: int) -> NDArray[np.float32]:
            i = int(np.searchsorted(ends, t, side="right"))
            local = t - (int(ends[i - 1]) if i else 0)
            found: NDArray[np.float32] = readers[i](local, local + 1)[0]
            return found

        return frame

    def copy_into(self, name: str, group: h5py.Group) -> None:
        """Copy a motion into its group of another file."""
        for key, data in self._groups[name].items():
            data.file.copy(data, group, name=key)
        group.attrs["identity"] = self._recorded[name].identity

    def chunks(self, names: list[str]) -> Iterator[NDArray[np.float32]]:
        """Rows of displacements (b, 3n) float32 of the given motions, in bounded pieces."""
        for name in names:
            frames, n, _ = self._groups[name]["displacements"].shape
            rows = max(CHUNK_BYTES // (n * 12), 1)
            for start in range(0, frames, rows):
                part = self._read(name, start, min(start + rows, frames))
                yield part.reshape(len(part), -1)

    def _read(self, name: str, start: int, stop: int) -> NDArray[np.float32]:
        try:
            found: NDArray[np.float32] = self._groups[name]["displacements"][start:stop]
        except OSError as error:
            raise ArtefactError(
                f"{self._path} is damaged ({str(error).splitlines()[0]}); delete it and run make"
            ) from error
        return found


def _recorded(group: h5py.Group, name: str) -> Recorded:
    """A motion with its statistics, which is what it says of itself."""
    motion, held = read_motion(group, name)
    role = group.attrs["role"]
    if role not in ROLES or len(group["displacements"]) != motion.frames:
        raise ValueError(f"motion {name!r} has the role {role!r} and {len(group['displacements'])} of its frames")
    columns = (group[key][:] for key in (*STATISTICS, "seconds"))
    recorded = Recorded(motion, role, held, *columns)
    return replace(recorded, identity=str(group.attrs.get("identity", "")))
