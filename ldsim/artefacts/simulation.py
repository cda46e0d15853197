"""simulation.h5: every motion in every space."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py

from ldsim.arrays import Array
from ldsim.artefacts.store import Header, read_header, reading, write
from ldsim.dynamics.trajectory import Trajectory

Runs = Mapping[str, Mapping[str, Trajectory]]
Fresh = Mapping[str, Array]


def write_simulation(path: Path, header: Header, runs: Runs, fresh: Fresh | None = None) -> None:
    """Write simulation.h5 from space → motion → trajectory, and space → online errors of fresh motions."""
    datasets = {f"fresh/{name}": errors for name, errors in (fresh or {}).items()}
    for space, motions in runs.items():
        for motion, trajectory in motions.items():
            datasets |= {f"runs/{space}/{motion}/{name}": values for name, values in vars(trajectory).items()}
    write(path, header, datasets)


def read_simulation(path: Path) -> tuple[dict[str, dict[str, Trajectory]], Header]:
    """Read simulation.h5."""
    with reading(path, "simulation") as file:
        runs = {
            space: {motion: _trajectory(group) for motion, group in motions.items()}
            for space, motions in file["runs"].items()
        }
        return runs, read_header(file)


def read_fresh(path: Path) -> dict[str, Array]:
    """Space → online errors of the fresh motions; empty where there were none."""
    with reading(path, "simulation") as file:
        return {space: data[:] for space, data in file["fresh"].items()} if "fresh" in file else {}


def _trajectory(group: h5py.Group) -> Trajectory:
    return Trajectory(**{name: data[:] for name, data in group.items()})
