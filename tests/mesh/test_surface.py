"""A coarsened surface keeps to the vertices, the shape and the orientation of the fine one."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.mesh.shapes import beam
from ldsim.mesh.surface import coarsened, surface_triangles
from ldsim.mesh.triangles import Triangles

MESH = beam(length=0.25, resolution=8)
FINE = surface_triangles(MESH)
LIMITS = [400, 150]


def volume(triangles: np.ndarray) -> float:
    return Triangles(MESH.vertices, triangles).volume


@pytest.mark.parametrize("limit", LIMITS)
def test_a_coarse_surface_has_few_vertices_all_of_them_of_the_fine_one(limit):
    coarse = coarsened(MESH.vertices, FINE, limit)
    used = np.unique(coarse)
    assert limit / 3 < len(used) <= limit < len(np.unique(FINE))
    assert np.isin(used, FINE).all()


@pytest.mark.parametrize("limit", LIMITS)
def test_no_triangle_is_without_corners_or_there_twice(limit):
    coarse = coarsened(MESH.vertices, np.concatenate([FINE, np.roll(FINE, 1, axis=1)]), limit)
    assert all(len(set(corners)) == 3 for corners in coarse.tolist())
    assert len({tuple(sorted(corners)) for corners in coarse.tolist()}) == len(coarse)


@pytest.mark.parametrize("limit", LIMITS)
def test_it_encloses_about_the_same_volume_and_looks_outward(limit):
    assert volume(coarsened(MESH.vertices, FINE, limit)) == pytest.approx(volume(FINE), rel=0.2)


def test_a_surface_within_the_limit_stays_as_it_is():
    assert (coarsened(MESH.vertices, FINE, len(np.unique(FINE))) == FINE).all()
