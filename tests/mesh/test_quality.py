"""Radius ratios against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.mesh.tetrahedralize import radius_ratios

REGULAR = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])


def one_tet(points: np.ndarray) -> float:
    return float(radius_ratios(Mesh(points, np.arange(4, dtype=np.int32)[None], "tet4"))[0])


def test_a_regular_tet_has_ratio_one_however_it_is_turned_scaled_or_numbered() -> None:
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    for points in (REGULAR, 0.01 * REGULAR @ turn + 5, REGULAR[[1, 0, 2, 3]]):
        assert one_tet(points) == pytest.approx(1, rel=1e-9)


def test_the_corner_of_a_cube_has_its_closed_form() -> None:
    # r = 3V/S = 1/(3 + √3), R = √3/2
    corner = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    assert one_tet(corner) == pytest.approx(3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2), rel=1e-12)


def test_flat_tets_have_ratio_zero() -> None:
    assert one_tet(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])) == 0
    assert one_tet(np.zeros((4, 3))) == 0


def test_hexes_have_none() -> None:
    with pytest.raises(MeshError, match="cells are hex8"):
        radius_ratios(beam(resolution=1, cell_type="hex8"))
