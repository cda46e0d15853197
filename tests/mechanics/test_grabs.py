"""Grabs: what means nothing is refused when one is made, and what is meant is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ldsim.errors import MotionError
from ldsim.mechanics.grabs import Grab

TIP = np.array([0.4, 0.1, 0.0])
GOOD = Grab(np.array([3, 5]), TIP, 40.0)

BAD_GRABS: dict[str, tuple[dict[str, Any], str]] = {
    "a negative vertex": ({"vertices": np.array([3, -1])}, "from -1 to 3; they must be 0 or more"),
    "no vertex": ({"vertices": np.array([], dtype=np.int64)}, "int64 of the shape .0,.; .* at least one"),
    "vertices by mask": ({"vertices": np.ones(12, dtype=bool)}, "are bool of the shape .12,."),
    "fractions of vertices": ({"vertices": np.array([1.0])}, "are float64 of the shape .1,.; they must be whole"),
    "vertices in rows": ({"vertices": np.array([[3], [5]])}, "int64 of the shape .2, 1."),
    "a target in a plane": ({"target": TIP[:2]}, "the target of a grab is .0.4, 0.1.; it must be three finite"),
    "a target for each vertex": ({"target": np.zeros((2, 3))}, "target of a grab is"),
    "a target nowhere": ({"target": np.array([0.0, 0.0, np.nan])}, "target of a grab is .0.0, 0.0, nan"),
    "a target beyond all": ({"target": np.array([np.inf, 0.0, 0.0])}, "target of a grab is .inf"),
    "a spring that pushes": ({"stiffness": -3000.0}, "stiffness of a grab is -3000.0; it must be one positive"),
    "a spring that is none": ({"stiffness": 0.0}, "stiffness of a grab is 0.0"),
    "an unknown stiffness": ({"stiffness": np.nan}, "stiffness of a grab is nan"),
    "a rigid spring": ({"stiffness": np.inf}, "stiffness of a grab is inf"),
    "several stiffnesses": ({"stiffness": np.array([30.0])}, "stiffness of a grab is .30.0."),
}


@pytest.mark.parametrize("change, message", BAD_GRABS.values(), ids=BAD_GRABS.keys())
def test_a_grab_that_means_nothing_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(MotionError, match=message):
        replace(GOOD, **change)


def test_a_grab_keeps_the_arrays_that_it_was_given() -> None:
    # steps know what is held by the array that says so
    for kind in (np.int64, np.int32, np.uint8):
        vertices = np.array([3, 5], dtype=kind)
        assert Grab(vertices, TIP, 40.0).vertices is vertices
    assert GOOD.target is TIP


def test_a_grab_of_lists_and_whole_numbers_is_of_arrays() -> None:
    made = Grab([3, 5], TIP.tolist(), 40)  # type: ignore[arg-type]
    np.testing.assert_array_equal(made.vertices, GOOD.vertices)
    np.testing.assert_array_equal(made.target, TIP)
    assert made.target.dtype == np.float64 and isinstance(made.stiffness, float)
