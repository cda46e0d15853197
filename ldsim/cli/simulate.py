"""`ldsim simulate`: run the motions in the full, the latent and the linear spaces, and compare."""

from __future__ import annotations

import numpy as np

from ldsim.cli.stage import Call, stage_command
from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.simulate import simulate


@stage_command("simulate", "Run the motions in the full, the latent and the linear spaces, and compare.")
def command(call: Call) -> None:
    runs = simulate(call.run, call.settings.simulate, call.progress, call.settings.snapshot)
    call.done("simulation", "; ".join(_summary(space, motions) for space, motions in runs.items()))


def _summary(space: str, motions: dict[str, Trajectory]) -> str:
    seconds = np.concatenate([trajectory.seconds for trajectory in motions.values()])
    return f"{space} {1e3 * np.nanmedian(seconds):.3g} ms a step"
