"""What was run, as figures, pictures and the replay ask for it."""

from __future__ import annotations

from ldsim.dynamics.trajectory import Trajectory
from ldsim.report.schema import REDUCED
from ldsim.run import Run


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
    words = {"linear": f"linear, {run.model.kp} modes", "latent": f"latent, {run.model.decoder.r} numbers"}
    return words.get(space, f"{space} space")
