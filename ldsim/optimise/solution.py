"""What an iterative solver returns, whichever solver it was."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Indices


class Reason(IntEnum):
    """Why a minimiser stopped; the compiled minimisers return the number."""

    CONVERGED = 0
    ITERATIONS_SPENT = 1
    NO_DECREASE = 2
    INFINITE_START = 3

    @property
    def words(self) -> str:
        return {
            Reason.CONVERGED: "converged",
            Reason.ITERATIONS_SPENT: "iteration limit reached",
            Reason.NO_DECREASE: "the line search found no decrease",
            Reason.INFINITE_START: "the starting point has infinite energy",
        }[self]


def failures(reasons: Indices) -> str:
    """How many of some steps did not converge, and why most of these, in words; empty where all did."""
    failed = reasons[reasons != Reason.CONVERGED]
    if len(failed) == 0:
        return ""
    commonest = Reason(int(np.bincount(failed).argmax())).words
    return f"{len(failed)} of {len(reasons)} steps did not converge ({commonest})"


class Solution(NamedTuple):
    """The record of one minimisation.

    Attributes:
        value: the objective at the point returned, J.
        gradient_norm: its gradient's Euclidean norm, N.
        iterations, evaluations: steps taken and objective-and-gradient evaluations made.
        reason: why it stopped.
    """

    value: float
    gradient_norm: float
    iterations: int
    evaluations: int
    reason: Reason

    @property
    def converged(self) -> bool:
        return self.reason == Reason.CONVERGED
