"""The materials of `mechanics.materials` on tensors: density, stress and tangent in closed form, for many instances.

A second-order tensor field is kept component first, (3, 3, …), so that every operation runs over contiguous memory.
Directions carry one axis more than the deformation gradient, (3, 3, n, r, c) beside (3, 3, n, c).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any, final

import torch
from torch import Tensor

from ldsim.mechanics.materials import material_names, stable_neo_hookean

Formula = Callable[..., Any]

ROOT_ITERATIONS = 60


def product(A: Tensor, B: Tensor) -> Tensor:
    """(A B)_ij = Σ_k A_ik B_kj."""
    return (A[:, :, None] * B[None]).sum(1)


def inner(A: Tensor, B: Tensor) -> Tensor:
    """A : B."""
    return (A * B).sum((0, 1))


def transposed(A: Tensor) -> Tensor:
    return A.transpose(0, 1)


def symmetric(A: Tensor) -> Tensor:
    return 0.5 * (A + transposed(A))


def trace(A: Tensor) -> Tensor:
    return A[0, 0] + A[1, 1] + A[2, 2]


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return torch.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def cofactor(F: Tensor) -> Tensor:
    """cof F = ∂ det F / ∂F."""
    return torch.stack([_cross(F[1], F[2]), _cross(F[2], F[0]), _cross(F[0], F[1])])


def _cofactor_change(F: Tensor, X: Tensor) -> Tensor:
    """The derivative of cof F along X."""
    rows = [_cross(X[i], F[j]) + _cross(F[i], X[j]) for i, j in ((1, 2), (2, 0), (0, 1))]
    return torch.stack(rows)


def _plus_identity(A: Tensor, scale: Tensor | float) -> Tensor:
    """A + scale · I."""
    eye = torch.eye(3, dtype=A.dtype, device=A.device).reshape(3, 3, *([1] * (A.dim() - 2)))
    return A + scale * eye


class Material(ABC):
    """Ψ(F), P = ∂Ψ/∂F and dP = ∂²Ψ/∂F² : X; mu and lam, Pa, have the shape of one component of F or broadcast to it."""

    @abstractmethod
    def density(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        """Ψ, J/m³; infinite where the material does not allow F."""

    @abstractmethod
    def stress(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        """First Piola–Kirchhoff stress, Pa; differentiable in mu and lam. Meaningless where Ψ is infinite."""

    @abstractmethod
    def tangent(self, F: Tensor, X: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        """The derivative of the stress along the directions X; F, mu and lam broadcast against them. Not clamped."""


@final
@dataclass(frozen=True)
class OfInvariants(Material):
    """Ψ = ψ(I₁, J) with I₁ = tr FᵀF: P = 2 ψ₁ F + ψ_J cof F, and the tangent by the chain rule.

    Attributes:
        potential: (I1, J, mu, lam) → ψ.
        slopes: (I1, J, mu, lam) → ψ₁, ψ_J, ψ₁₁, ψ₁_J, ψ_JJ.
    """

    potential: Formula
    slopes: Formula

    def density(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        value: Tensor = self.potential(inner(F, F), _determinant(F), mu, lam)
        return value

    def stress(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        C = cofactor(F)
        by_I1, by_J, *_ = self.slopes(inner(F, F), (F[0] * C[0]).sum(0), mu, lam)
        P: Tensor = 2 * by_I1 * F + by_J * C
        return P

    def tangent(self, F: Tensor, X: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        C = cofactor(F)
        by_I1, by_J, twice_I1, mixed, twice_J = self.slopes(inner(F, F), (F[0] * C[0]).sum(0), mu, lam)
        dI1, dJ = 2 * inner(F, X), inner(C, X)
        along_F, along_C = 2 * (twice_I1 * dI1 + mixed * dJ), mixed * dI1 + twice_J * dJ
        dP: Tensor = 2 * by_I1 * X + by_J * _cofactor_change(F, X) + along_F * F + along_C * C
        return dP


def _determinant(F: Tensor) -> Tensor:
    return (F[0] * _cross(F[1], F[2])).sum(0)


def on_tensors(file: ModuleType) -> OfInvariants:
    """The material of a file that gives `density` and `slopes` without branches: the same source, torch for math."""
    density, slopes = (FunctionType(f.py_func.__code__, {"math": torch}) for f in (file.density, file.slopes))
    return OfInvariants(density, slopes)


def _neo_hookean(I1: Tensor, J: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
    """See mechanics/materials/neo_hookean.py, which sums it otherwise, for the last bits near rest."""
    allowed = torch.where(J > 0, J, 1.0)
    density = 0.5 * mu * (allowed ** (-2 / 3) * I1 - 3) + 0.5 * lam * (J - 1) ** 2
    return torch.where(J > 0, density, torch.inf)


def _neo_hookean_slopes(I1: Tensor, J: Tensor, mu: Tensor, lam: Tensor) -> tuple[Tensor | float, ...]:
    # at J ≤ 0 the stress has no meaning, but a NaN there would reach the other instances' gradients
    J = torch.where(J > 0, J, 1.0)
    first = 0.5 * mu * J ** (-2 / 3)
    pull = first * I1 / J
    return first, lam * (J - 1) - 2 / 3 * pull, 0.0, -2 / 3 * first / J, lam + 10 / 9 * pull / J


def _hookean(E: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
    """μ E:E + λ/2 (tr E)²."""
    return mu * inner(E, E) + 0.5 * lam * trace(E) ** 2


def _hooke(E: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
    """2μ E + λ tr(E) I."""
    return _plus_identity(2 * mu * E, lam * trace(E))


@final
class StVenantKirchhoff(Material):
    """See mechanics/materials/st_venant_kirchhoff.py."""

    def density(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        return _hookean(self._strain(F), mu, lam)

    def stress(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        return product(F, _hooke(self._strain(F), mu, lam))

    def tangent(self, F: Tensor, X: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        change = symmetric(product(transposed(F), X))
        return product(X, _hooke(self._strain(F), mu, lam)) + product(F, _hooke(change, mu, lam))

    @staticmethod
    def _strain(F: Tensor) -> Tensor:
        return 0.5 * _plus_identity(product(transposed(F), F), -1.0)


@final
class FixedCorotated(Material):
    """See mechanics/materials/fixed_corotated.py; the rotation without a singular value decomposition."""

    def density(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        off = F - rotation(F)[0]
        return mu * inner(off, off) + 0.5 * lam * (_determinant(F) - 1) ** 2

    def stress(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        C = cofactor(F)
        J = (F[0] * C[0]).sum(0)
        return 2 * mu * (F - rotation(F)[0]) + lam * (J - 1) * C

    def tangent(self, F: Tensor, X: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        """dR = R [θ]× with (tr S I − S) θ = axial(Rᵀ X − Xᵀ R), S = Rᵀ F (Barbič 2012, "Exact corotational …")."""
        C, (R, trace_S) = cofactor(F), rotation(F)
        J = (F[0] * C[0]).sum(0)
        turn = product(transposed(R), X)
        axial = torch.stack([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        A = _plus_identity(-product(transposed(R), F), trace_S)
        adjugate = cofactor(A)
        angle = (adjugate * axial[:, None]).sum(0) / (A[0] * adjugate[0]).sum(0)
        turned = torch.stack([_cross(R[i], angle) for i in range(3)])
        volumetric = C * inner(C, X) + (J - 1) * _cofactor_change(F, X)
        return 2 * mu * (X - turned) + lam * volumetric


def rotation(F: Tensor) -> tuple[Tensor, Tensor]:
    """The rotation R nearest to F and tr RᵀF = σ₁ + σ₂ + σ₃, the smallest stretch negative where F is inverted.

    With t that trace, (t² − I₁)² = 4 (‖cof F‖² + 2 J t): t is the largest root of a quartic whose roots are all real,
    which Newton's method finds from above, and R = ∂t/∂F by the implicit function theorem.
    """
    C, I1 = cofactor(F), inner(F, F)
    J, I2 = (F[0] * C[0]).sum(0), inner(C, C)
    t = torch.sqrt(3 * I1)
    for _ in range(ROOT_ITERATIONS):
        gap = t * t - I1
        change = (gap * gap - 8 * J * t - 4 * I2) / (4 * t * gap - 8 * J)
        change = torch.where(change > 0, change, 0.0)
        t = t - change
        if not bool((change > 1e-16 * t).any()):
            break
    slope = 4 * t * (t * t - I1) - 8 * J
    FFF = product(F, product(transposed(F), F))
    return (4 * (t * t + I1) * F - 8 * FFF + 8 * t * C) / slope, t


@final
class Linear(Material):
    """See mechanics/materials/linear.py."""

    def density(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        return _hookean(_plus_identity(symmetric(F), -1.0), mu, lam)

    def stress(self, F: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        return _hooke(_plus_identity(symmetric(F), -1.0), mu, lam)

    def tangent(self, F: Tensor, X: Tensor, mu: Tensor, lam: Tensor) -> Tensor:
        return _hooke(symmetric(X), mu, lam)


# A material that is missing here is refused by its name.
TWINS: dict[str, Material] = {
    "neo_hookean": OfInvariants(_neo_hookean, _neo_hookean_slopes),
    "stable_neo_hookean": on_tensors(stable_neo_hookean),
    "st_venant_kirchhoff": StVenantKirchhoff(),
    "fixed_corotated": FixedCorotated(),
    "linear": Linear(),
}


def twins(kinds: Iterable[int]) -> list[Material]:
    """The materials of some numbers, each once, in the order of the numbers.

    Raises:
        SceneError: one has no twin on tensors.
    """
    return [TWINS[name] for name in material_names(kinds, tuple(TWINS), "the batched stepper")]
