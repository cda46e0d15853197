"""What was run, as figures, pictures and the replay ask for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.artefacts.snapshots import ROLES, Recorded
from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.simulate import residual
from ldsim.report.wording import counted
from ldsim.run import REDUCED, Run


def tests_first(run: Run) -> dict[str, Recorded]:
    """Every motion as it ran in the full space, those first that nothing had seen."""
    return dict(sorted(run.motions.items(), key=lambda entry: -ROLES.index(entry[1].role)))


def runs(run: Run, space: str) -> dict[str, Trajectory]:
    """Motion → its run in a space, in the order of the configuration."""
    done = run.simulation.get(space, {})
    return {name: done[name] for name in run.motions if name in done}


def reduced_runs(run: Run, motion: str) -> dict[str, Trajectory]:
    """Reduced space → its run of a motion, where there is one."""
    return {space: found[motion] for space in REDUCED if motion in (found := runs(run, space))}


def dimensions(run: Run) -> dict[str, int]:
    """The dimensions that figures point out."""
    return {"r": run.model.decoder.r, "kp": run.model.kp, "k": run.basis.k}


def title(run: Run, space: str) -> str:
    """A space with the numbers that it moves by."""
    linear, latent = counted(run.model.kp, "mode"), counted(run.model.decoder.r, "number")
    words = {"linear": f"linear, {linear}", "latent": f"latent, {latent}"}
    return words.get(space, f"{space} space")


def displacements(run: Run, space: str, motion: str) -> Callable[[Indices, Indices | slice], Array]:
    """The function (frames (N,), vertices (v,)) → u of a motion in a space, (N, v, 3) metres.

    In a reduced space u = U q + L a, and of a condensed one what is beside it; of the full space one frame is read at a
    time.
    """
    if space == "full":
        read = run.played.reader(motion)
        return lambda frames, vertices: np.stack([read(t, t + 1)[0][vertices] for t in frames.tolist()])
    coordinates, beside = runs(run, space)[motion].coordinates, residual(run, space, motion)
    assert coordinates is not None, "reduced runs keep their coordinates"
    q, fields = coordinates, run.basis_of(space).fields[:, :, : coordinates.shape[1]]
    if run.every_lifting.count:
        fields = np.concatenate([fields, run.every_lifting.fields.reshape(len(fields), 3, -1)], axis=2)
        q = np.hstack([q, run.every_lifting.coordinates(run.motions[motion].motion)[: len(q)]])

    def displacement(frames: Indices, vertices: Indices | slice) -> Array:
        u: Array = np.einsum("tk,vik->tvi", q[frames], fields[vertices], optimize=True)
        if beside is not None:
            for i, t in enumerate(frames.tolist()):
                u[i] += beside(t, coordinates[t])[vertices]
        return u

    return displacement
