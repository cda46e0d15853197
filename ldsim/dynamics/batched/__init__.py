"""Batched stepping on torch, on a CPU or a GPU; `BatchedStepper` is where to start."""

from ldsim.dynamics.batched.newton import BatchedSolution
from ldsim.dynamics.batched.potential import BatchedLoads
from ldsim.dynamics.batched.stepper import BatchedState, BatchedStepper

__all__ = ["BatchedSolution", "BatchedState", "BatchedStepper", "BatchedLoads"]
