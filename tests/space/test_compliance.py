"""Compliance: what is known of grabs is shared by threads, and of many grabs the first is forgotten."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Thread, current_thread, main_thread
from time import sleep

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.space import compliance as module
from ldsim.space.compliance import Compliance
from tests.space.test_relaxation import beam, modes

BODY = beam()
ENDS = [np.array([vertex]) for vertex in np.flatnonzero(BODY.mesh.vertices[:, 0] > 0.29)]


class Interrupted(dict[bytes, Array]):
    """Where one thread asks which grab is the first, another one forgets it, and is slow to keep its own."""

    def __init__(self, compliance: Compliance) -> None:
        self.compliance, self.others = compliance, ENDS[3:4]

    def __iter__(self) -> Iterator[bytes]:
        found = super().__iter__()
        if self.others:
            other = Thread(target=self.compliance.of_grab, args=(self.others.pop(),))
            other.start()
            other.join(0.5)
        return found

    def __setitem__(self, key: bytes, value: Array) -> None:
        if current_thread() is not main_thread():
            sleep(1.0)
        super().__setitem__(key, value)


def test_a_grab_is_forgotten_while_another_thread_asks_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """As own pulls do that run in parallel and hold more places than are kept."""
    monkeypatch.setattr(module, "REMEMBERED", 2)
    compliance = Compliance(BODY, modes(BODY, 2))
    first = compliance.of_grab(ENDS[0])
    compliance._known = Interrupted(compliance)
    for held in ENDS[:3]:
        compliance.of_grab(held)
    np.testing.assert_array_equal(compliance.of_grab(ENDS[0]), first)
    assert len(compliance._known) == 2
