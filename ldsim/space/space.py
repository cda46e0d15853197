"""A space that a solid is simulated in: its coordinates, its quadrature, and the way from and to displacements.

    full     u ∈ R^{3n}               every quadrature point
    linear   q ∈ R^k,  u = U q        a weighted few
    latent   z ∈ R^r,  u = U φ(z)     a weighted few

The linear space is the latent one with the identity for φ. Where pins move, u = U φ(z) + L a, with a given.
A run's spaces are made by `Run.space` in ldsim/run.py, with the rule that its `RulePath.stepped` picks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import SolverError
from ldsim.mechanics.scene import Scene
from ldsim.space.basis import Basis
from ldsim.space.compliance import Compliance
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY, Encoder, nearest_latent
from ldsim.space.lifting import Lifting
from ldsim.space.modes import Modes
from ldsim.space.novelty import Novelty


@dataclass(frozen=True, eq=False)
class Space:
    """One of the three, or another of their kind.

    Attributes:
        name: "full", "linear", "latent", or what the caller calls it.
        basis: U; None for the full space.
        decoder, encoder: φ and ψ; identities but in a latent space.
        rule: the quadrature points of a step, with their weights.
        lifting: pins that may move; None where all stand still.
        novelty: how far a latent state is from those trained on; None where that is not known.
        compliance: what forces move beside the coordinates, in a condensed space; None elsewhere.

    Raises:
        SolverError: sizes that do not belong together, which the compiled loops would not notice.
    """

    name: str
    scene: Scene
    basis: Basis | None
    decoder: Decoder
    encoder: Encoder
    rule: CubatureRule
    lifting: Lifting | None = None
    novelty: Novelty | None = None
    compliance: Compliance | None = None

    def __post_init__(self) -> None:
        k, points = 3 * self.scene.mesh.n_vertices, self.rule.points
        if self.basis is not None:
            vertices, k = len(self.basis.fields), self.basis.k
            if vertices != self.scene.mesh.n_vertices:
                raise SolverError(f"the basis has {vertices} vertices, the scene {self.scene.mesh.n_vertices}")
        if self.decoder.k != k:
            raise SolverError(f"the decoder gives {self.decoder.k} coordinates, the space has {k}; train it anew")
        if points.max(initial=0) >= self.scene.points.n_points:
            raise SolverError(
                f"cubature rule has the point {points.max()}, the scene {self.scene.points.n_points} of them; use the "
                "scene it was fitted on"
            )
        if self.rule.maps is not None and self.rule.maps.shape[2] != k:
            raise SolverError(f"cubature has strain maps of {self.rule.maps.shape[2]} columns; the basis has {k}")
        if self.novelty is not None and self.novelty.landmarks.shape[1] != self.decoder.r:
            raise SolverError(f"landmarks have {self.novelty.landmarks.shape[1]} numbers, codes {self.decoder.r}")

    def by_material(self) -> Space:
        """Itself with the rule's points sorted by material, so that a step chooses one once for a block of points."""
        rule = self.rule.sorted_by(self.scene.elements.kind)
        return self if rule is self.rule else replace(self, rule=rule)

    @classmethod
    def full(cls, scene: Scene) -> Space:
        """Every vertex free, every quadrature point."""
        size = 3 * scene.mesh.n_vertices
        return cls("full", scene, None, Decoder.identity(size), IDENTITY, CubatureRule.every(scene))

    @classmethod
    def linear(cls, scene: Scene, basis: Basis, k: int, rule: CubatureRule | None = None) -> Space:
        """The first k columns of a basis; every quadrature point where no rule is given."""
        rule = CubatureRule.every(scene) if rule is None else rule
        return cls("linear", scene, basis.columns(k), Decoder.identity(k), IDENTITY, rule)

    @classmethod
    def latent(
        cls, scene: Scene, basis: Basis, networks: tuple[Decoder, Encoder], rule: CubatureRule | None = None
    ) -> Space:
        """What a decoder makes of a basis; every quadrature point where no rule is given."""
        rule = CubatureRule.every(scene) if rule is None else rule
        return cls("latent", scene, basis, *networks, rule)

    @classmethod
    def condensed(
        cls,
        scene: Scene,
        basis: Basis,
        networks: tuple[Decoder, Encoder],
        rule: CubatureRule,
        squares: Array | None = None,
        turns: bool = False,
    ) -> Space:
        """Coordinates z = VᵀMu of the first r columns of a basis; what the others decode to is in equilibrium with it.

        Args:
            rule: the virtual points of V_eff(z), or points of the mesh.
            squares: ω² of the last columns, (m,) 1/s², which are modes that swing beside z (space/modes.py).
            turns: of these modes, see there.
        """
        coordinates, modes = basis.columns(networks[0].r), None
        if squares is not None and len(squares):
            modes = Modes(np.ascontiguousarray(basis.fields[:, :, -len(squares) :]), squares, turns)
        return cls("latent", scene, basis, *networks, rule, compliance=Compliance(scene, coordinates, modes))

    @property
    def is_condensed(self) -> bool:
        """Whether all but its coordinates is in static equilibrium."""
        return self.compliance is not None

    @property
    def squares(self) -> Array:
        """ω² of the modes that swing beside the coordinates, the last columns of the basis, (m,) 1/s²; mostly none."""
        return (
            np.empty(0) if self.compliance is None or self.compliance.modes is None else self.compliance.modes.squares
        )

    @property
    def turns(self) -> bool:
        """Whether what these modes have of a dent turns with the place that is held."""
        return self.compliance is not None and self.compliance.modes is not None and self.compliance.modes.turns

    @property
    def r(self) -> int:
        """How many coordinates move."""
        return self.decoder.r

    @property
    def reduced_basis(self) -> Basis:
        """U, of a space that has one."""
        assert self.basis is not None, f"the {self.name} space has no basis"
        return self.basis

    @cached_property
    def fields(self) -> Array:
        """U and beside it L, (n, 3, k + l): a displacement is their sum with the coordinates q and a."""
        U = self.reduced_basis.fields
        if self.lifting is None or not self.lifting.count:
            return U
        return np.concatenate([U, self.lifting.fields.reshape(len(U), 3, -1)], axis=2)

    def with_rule(self, rule: CubatureRule) -> Space:
        """The same space with other quadrature points."""
        return replace(self, rule=rule)

    def with_lifting(self, lifting: Lifting | None) -> Space:
        """The same space, prepared for pins that move."""
        return replace(self, lifting=lifting)

    def encode(self, u: NDArray[np.floating]) -> tuple[Array, Array]:
        """z (b, r) and q (b, k) nearest to displacements (b, n, 3), metres, less what moved pins prescribe.

        q is the projection, z the code that decodes nearest to it: φ(z) need not be q.
        """
        if self.basis is None:
            flat = np.asarray(u, dtype=np.float64).reshape(len(u), -1)
            return flat, flat
        q = self.basis.project(u)
        guesses = self.encoder(q)
        if self.is_condensed:  # z = W u is where the equilibrium is, not where the decoder comes nearest
            return guesses, q
        z = np.array([nearest_latent(self.decoder, *pair) for pair in zip(q, guesses, strict=True)])
        return z.reshape(len(u), self.r), q

    def displacement(self, q: Array) -> Array:
        """u = U q, (n, 3) float64, metres, of outer coordinates (k,); of rows of them (b, k), (b, n, 3)."""
        if self.basis is None:
            return q.reshape(*q.shape[:-1], -1, 3)
        return self.basis.displacement(q)
