"""Some of the quadrature points, cut out of the mesh with the rows of the basis that move them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.mechanics.elastic import Elements

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Part:
    """Some quadrature points with the rows of the basis at their vertices, renumbered from 0.

    Attributes:
        points: their numbers in the scene, (c,).
        elements: the points themselves.
        rows: U at their vertices, (v, 3, k).
    """

    points: Indices
    elements: Elements
    rows: Array

    @classmethod
    def of(cls, elements: Elements, U: Array, points: Indices) -> Part:
        vertices, nodes = np.unique(elements.nodes[points], return_inverse=True)
        part = Elements(
            nodes.reshape(elements.nodes[points].shape).astype(np.int32),
            elements.gradients[points],
            elements.weights[points],
            elements.kind[points],
            elements.mu[points],
            elements.lam[points],
        )
        return cls(points, part, np.ascontiguousarray(U.reshape(-1, 3, U.shape[1])[vertices]))

    def fields(self, q: Array) -> Array:
        """U q at the vertices of the part for a batch q, (T, k) → (T, v, 3)."""
        fields: Array = (q @ self.rows.reshape(-1, self.rows.shape[2]).T).reshape(len(q), -1, 3)
        return fields
