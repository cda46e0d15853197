"""Material properties of each cell: for the whole solid, changed in regions, or read cell by cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.errors import SceneError
from ldsim.mechanics.materials import material_number

Number = TypeVar("Number", float, Array)


@dataclass(frozen=True, eq=False)
class Properties:
    """The material of each cell.

    Attributes:
        kind: number of its model, (m,) int8 (`mechanics.materials.MATERIALS`).
        youngs_modulus: (m,) float64, Pa.
        poisson_ratio: (m,) float64.
        density: (m,) float64, kg/m³.

    Raises:
        SceneError: a number that is not allowed, with its cell; a model that does not exist.
    """

    kind: NDArray[np.int8]
    youngs_modulus: Array
    poisson_ratio: Array
    density: Array

    def __post_init__(self) -> None:
        ratio = self.poisson_ratio
        _check("Young's modulus", self.youngs_modulus, self.youngs_modulus > 0, "positive, Pa")
        _check(
            "Poisson's ratio",
            ratio,
            (ratio > -1) & (ratio < 0.5 - 1e-6),
            "more than -1 and less than 0.5 by a millionth",
        )
        _check("density", self.density, self.density > 0, "positive, kg/m³")

    @classmethod
    def uniform(
        cls, n_cells: int, model: str, youngs_modulus: float, poisson_ratio: float, density: float
    ) -> Properties:
        """One material throughout; Pa, kg/m³."""
        return cls(
            np.full(n_cells, material_number(model), dtype=np.int8),
            np.full(n_cells, youngs_modulus, dtype=np.float64),
            np.full(n_cells, poisson_ratio, dtype=np.float64),
            np.full(n_cells, density, dtype=np.float64),
        )

    def changed(
        self,
        cells: NDArray[np.bool_] | None = None,
        *,
        model: str | None = None,
        youngs_modulus: float | Array | None = None,
        poisson_ratio: float | Array | None = None,
        density: float | Array | None = None,
        youngs_factor: float = 1.0,
    ) -> Properties:
        """With other values in some cells, (m,) bool, or in all; arrays are of all cells, (m,), and what is None stays.

        Args:
            youngs_factor: multiplies Young's modulus as it then is.
        """
        where = np.ones(len(self.kind), dtype=bool) if cells is None else cells
        kind = self.kind if model is None else np.where(where, np.int8(material_number(model)), self.kind)

        def pick(new: float | Array | None, old: Array) -> Array:
            return old if new is None else np.where(where, new, old)

        modulus = pick(youngs_modulus, self.youngs_modulus)
        return Properties(
            kind.astype(np.int8),
            np.where(where, youngs_factor * modulus, modulus),
            pick(poisson_ratio, self.poisson_ratio),
            pick(density, self.density),
        )


def _check(name: str, values: Array, allowed: NDArray[np.bool_], words: str) -> None:
    wrong = np.flatnonzero(~(allowed & np.isfinite(values)))
    if len(wrong):
        raise SceneError(f"{name} of cell {wrong[0]} is {values[wrong[0]]:g}; it must be {words}")


def lame_parameters(youngs_modulus: Number, poisson_ratio: Number) -> tuple[Number, Number]:
    """μ = E / 2(1 + ν) and λ = E ν / (1 + ν)(1 − 2ν), Pa; of one material, or of each entry of two arrays."""
    mu = youngs_modulus / (2 * (1 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return mu, lam
