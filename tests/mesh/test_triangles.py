"""What a closed surface encloses, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.triangles import Triangles, face_volumes, winding_number
from tests.mesh.surfaces import box, surface_of, together, turned_over


def test_a_box_encloses_its_volume_wherever_it_lies() -> None:
    for offset in (0.0, 100.0):
        assert box([0.2, 0.3, 0.5], offset).volume == pytest.approx(0.03, rel=1e-9)
    assert turned_over(box([0.2, 0.3, 0.5])).volume == pytest.approx(-0.03, rel=1e-12)


def test_the_volumes_of_the_faces_add_up() -> None:
    assert face_volumes(surface_of("catapult")).sum() == pytest.approx(surface_of("catapult").volume, rel=1e-12)


def test_a_surface_winds_once_around_what_is_inside_and_never_around_what_is_outside() -> None:
    surface, generator = surface_of("catapult"), np.random.default_rng(0)
    for point in surface.vertices.mean(axis=0) + 0.3 * generator.standard_normal((20, 3)):
        assert round(winding_number(surface, point), 9) in (0, 1)
    in_the_arm, in_front_of_it = [0, 0.1, 0], [0.03, 0.1, 0]
    assert winding_number(surface, in_the_arm) == pytest.approx(1, abs=1e-12)
    assert winding_number(surface, in_front_of_it) == pytest.approx(0, abs=1e-12)
    assert winding_number(turned_over(surface), in_the_arm) == pytest.approx(-1, abs=1e-12)
    assert winding_number(together(surface, surface), in_the_arm) == pytest.approx(2, abs=1e-12)


POINTS = np.eye(3)
BAD = {
    "shape": (lambda: Triangles(POINTS[:, :2], np.array([[0, 1, 2]])), "vertices have shape"),
    "none": (lambda: Triangles(POINTS, np.empty((0, 3), dtype=int)), "triangles have shape"),
    "nan": (lambda: Triangles(POINTS * np.nan, np.array([[0, 1, 2]])), "vertex 0 has coordinates"),
    "index": (lambda: Triangles(POINTS, np.array([[0, 1, 3]])), r"triangle 0 refers to vertices \[0, 1, 3\]"),
}


@pytest.mark.parametrize("make, message", BAD.values(), ids=BAD.keys())
def test_what_is_no_surface_is_refused(make, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(MeshError, match=message):
        make()
