"""What an autoencoder learns from: coordinates of frames, and forces at some of them."""

from __future__ import annotations

from dataclasses import dataclass

from ldsim.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class PoseForces:
    """Tangents and forces at some of the training poses, for the equilibrium loss.

    Attributes:
        frames: which of the examples they belong to, (p,) int64.
        stiffness: UᵀK(u)U at the true poses u, (p, k, k) float64, N/m in the coordinates of U.
        excess: Uᵀ(f(UUᵀMu) − f(u)), what projection alone adds to the internal force, (p, k) float64.
    """

    frames: Indices
    stiffness: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Examples:
    """Frames to learn from, recorded ones first, then those of synthetic motions.

    Attributes:
        q: their coordinates, (N, k) float64.
        synthetic: how many of them, at the end, are of synthetic motions.
        forces: at some of them; needed where the loss has an equilibrium term.
    """

    q: Array
    synthetic: int = 0
    forces: PoseForces | None = None

    @property
    def recorded(self) -> int:
        """How many are of recordings."""
        return len(self.q) - self.synthetic
