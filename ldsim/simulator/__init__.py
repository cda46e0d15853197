"""The simulator as a Python API: a finished run, or a scene, that is grabbed and stepped.

    from ldsim import load
    sim = load("runs/x")
    pull = sim.grab(point, target)
    sim.step()

`play`, `record` and scripts all step through it.
"""

from ldsim.simulator.from_run import full_simulator, load
from ldsim.simulator.records import Outcome, SavedState, StepRecord
from ldsim.simulator.simulator import Handle, Simulator

__all__ = [
    "Handle",
    "Outcome",
    "SavedState",
    "Simulator",
    "StepRecord",
    "full_simulator",
    "load",
]
