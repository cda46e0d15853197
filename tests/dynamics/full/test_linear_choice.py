"""Direct where the factor fits in memory, multigrid where it does not; and the steppers agree."""

from __future__ import annotations

import ctypes
import math
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.full import linear_choice
from ldsim.dynamics.full.linear_choice import choose, physical_memory
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.errors import SolverError
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mesh.shapes import beam
from ldsim.optimise.sparse import factor_bytes
from tests.helpers import scene

BODY = scene(beam(0.4, 0.1, 0.1, 3), "neo_hookean")


def test_auto_goes_by_the_memory_of_all_workers() -> None:
    direct = choose(BODY, "direct")
    assert direct.elimination is not None
    size = factor_bytes(direct.elimination)
    assert choose(BODY, "auto", workers=1, memory=3 * size).name == "direct"
    assert choose(BODY, "auto", workers=2, memory=3 * size).name == "multigrid"
    assert choose(BODY, "auto", workers=1, memory=size).name == "multigrid"


@pytest.mark.parametrize("name", ["direct", "multigrid"])
def test_what_is_asked_for_is_taken_and_named(name: str) -> None:
    choice = choose(BODY, name)
    assert choice.name == name
    assert choice.words.startswith(f"{name}, {3 * len(BODY.free):,} unknowns")
    np.testing.assert_array_equal(np.sort(choice.order), BODY.free)


def test_a_direct_factor_beyond_the_memory_is_refused_before_it_is_made() -> None:
    with pytest.raises(SolverError, match="snapshot.linear_solver is direct, but 2 × .* do not fit in 1e-06 GB"):
        choose(BODY, "direct", workers=2, memory=1000.0)


@pytest.mark.parametrize(("limit", "found"), [("5000000\n", 5e6), ("max\n", math.inf), (None, math.inf)])
def test_a_container_may_have_less_memory_than_its_machine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limit: str | None, found: float
) -> None:
    monkeypatch.setattr(linear_choice, "CONTAINER_LIMITS", (tmp_path / "memory.max",))
    machine = physical_memory()
    if limit is not None:
        (tmp_path / "memory.max").write_text(limit)
    assert physical_memory() == min(found, machine) and 1e8 < machine < math.inf


@pytest.mark.parametrize(("kilobytes", "found"), [(16 << 20, 2.0**34), (0, math.inf)], ids=["told", "not told"])
def test_windows_tells_its_memory_in_another_way(monkeypatch: pytest.MonkeyPatch, kilobytes: int, found: float) -> None:
    def ask(place: Any) -> None:
        place._obj.value = kilobytes

    kernel = SimpleNamespace(GetPhysicallyInstalledSystemMemory=ask)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel), raising=False)
    monkeypatch.delattr(os, "sysconf")
    monkeypatch.setattr(linear_choice, "CONTAINER_LIMITS", ())
    assert physical_memory() == found


@pytest.mark.parametrize("quasistatic", [False, True])
@pytest.mark.parametrize("rival", [("lbfgs", "multigrid"), ("newton", "direct"), ("newton", "multigrid")])
def test_every_way_of_solving_takes_the_same_steps(rival: tuple[str, str], quasistatic: bool) -> None:
    held = np.flatnonzero(BODY.mesh.vertices[:, 0] > 0.4 - 1e-9)
    ends = []
    for method, linear_solver in (rival, ("lbfgs", "direct")):
        stepper = FullStepper(
            BODY, FullOptions(tolerance=1e-8, method=method, linear_solver=linear_solver, quasistatic=quasistatic)
        )
        state = stepper.rest()
        for frame in range(3):
            state, solution = stepper.step(state, Loads((Grab(held, np.array([0.35, 0.04 * frame, 0.02]), 200.0),)))
            assert solution.converged
        ends.append(state.u)
    assert np.abs(ends[1]).max() > 1e-3
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-6 * np.abs(ends[1]).max())


def test_newton_needs_few_iterations_and_a_hessian_in_each() -> None:
    stepper = FullStepper(BODY, FullOptions(tolerance=1e-9, method="newton"))
    _, solution = stepper.step(stepper.rest(), Loads())
    assert solution.converged
    assert 1 <= solution.iterations <= 4
    assert stepper.factorisations == solution.iterations


def test_a_quasi_static_frame_does_not_depend_on_the_one_before() -> None:
    n = BODY.mesh.n_vertices
    stepper = FullStepper(BODY, FullOptions(tolerance=1e-9, quasistatic=True))
    moving = FullState(np.zeros((n, 3)), 0.01 * BODY.mesh.vertices, np.zeros((n, 3)))
    first, _ = stepper.step(stepper.rest(), Loads())
    second, _ = stepper.step(moving, Loads())
    np.testing.assert_allclose(first.u, second.u, atol=1e-7 * np.abs(first.u).max())
