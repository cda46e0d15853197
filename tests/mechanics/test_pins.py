"""Pins hold what they say and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import SceneError
from ldsim.mechanics.pins import Ball, Pin, Slab, pinned_vertices

LINE = np.stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)], axis=1)


@pytest.mark.parametrize(
    ("pin", "held"),
    [
        (Slab("x", at_max=False, thickness=0.15), [0, 1]),
        (Slab("x", at_max=True, thickness=0.15), [9, 10]),
        (Ball((0.5, 0, 0), 0.11), [4, 5, 6]),
    ],
)
def test_a_pin_holds_the_vertices_of_its_region(pin: Pin, held: list[int]) -> None:
    assert np.flatnonzero(pinned_vertices(LINE, [pin])).tolist() == held


def test_pins_add_up() -> None:
    both = pinned_vertices(LINE, [Slab("x", False, 0.05), Slab("x", True, 0.05)])
    assert np.flatnonzero(both).tolist() == [0, 10]


@pytest.mark.parametrize(
    ("pin", "message"),
    [(Ball((5, 0, 0), 0.1), "pins no vertex; the solid spans"), (Slab("y", False, 1.0), "hold all 11 vertices")],
)
def test_pins_that_hold_nothing_or_everything_are_refused(pin: Pin, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        pinned_vertices(LINE, [pin])
