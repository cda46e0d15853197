"""Compiled steps of a batch: what they hand on from step to step, and how threads, callers and processes share them."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from ldsim.dynamics.reduced.advance import advance
from ldsim.mechanics.loads import Loads
from tests.dynamics.batched.solids import batched, body, curved, march, pulls, serial


def test_steps_go_on_from_what_the_last_one_kept_and_share_their_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    stepper = batched(body(), curved())
    loads = stepper.loads([pulls(body(), seed) for seed in range(5)])
    state = march(stepper, loads, 3)
    anew = replace(state, kept=torch.zeros_like(state.kept))
    (kept, solution), (made, other) = stepper.step(state, loads), stepper.step(anew, loads)
    np.testing.assert_allclose(kept.q, made.q, atol=1e-9)
    assert not torch.equal(kept.kept, made.kept) and solution.converged.all() and other.converged.all()
    monkeypatch.setattr(torch, "get_num_threads", lambda: 3)
    np.testing.assert_array_equal(stepper.step(state, loads)[0].q, kept.q)


def test_coordinates_that_a_step_hands_out_are_those_of_the_decoder_and_of_the_start_where_it_was_lost() -> None:
    stepper = batched(body(), curved(), max_iterations=2)  # so that some stop early
    loads = stepper.loads([pulls(body(), seed) for seed in range(4)])
    state, _ = stepper.step(stepper.rest(4), loads)
    np.testing.assert_allclose(state.q, stepper.model.decoder(state.z), atol=1e-14)
    far = replace(state, z=1e3 * state.z + 1e3, z_previous=1e3 * state.z + 1e3, kept=torch.zeros_like(state.kept))
    after, solution = stepper.step(far, loads)
    assert len(solution.lost) == 4
    np.testing.assert_array_equal(after.q, state.q)


def test_grabs_come_and_go_and_two_callers_share_a_stepper() -> None:
    stepper = batched(body(), curved())
    held = [pulls(body(), seed).grabs for seed in (1, 2)]
    acting = [stepper.loads([Loads(grabs[:count]) for grabs in held]) for count in (0, 1, 2, 1, 0)]

    def run() -> Tensor:
        state = stepper.rest(2)
        for loads in acting:
            state, _ = stepper.step(state, loads)
        return state.q

    with ThreadPoolExecutor(2) as callers:
        first, *others = [each.result() for each in [callers.submit(run) for _ in range(4)]]
    alone = serial(stepper.space)
    expected = alone.rest()
    assert len(advance.signatures) == 1  # the step is compiled once for both
    for count in (0, 1, 2, 1, 0):
        expected, _ = alone.step(expected, Loads(held[0][:count]))
    np.testing.assert_allclose(first[0], expected.q, atol=1e-8)
    assert all(torch.equal(first, each) for each in others)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "get_num_threads", lambda: 2)
    stepper = batched(body(), curved())
    loads = stepper.loads([pulls(body(), 1), pulls(body(), 2)])
    state, _ = stepper.step(stepper.rest(2), loads)
    child = multiprocessing.get_context("fork").Process(target=stepper.step, args=(state, loads))
    child.start()
    child.join(60)
    alive = child.is_alive()
    child.kill()
    assert not alive and child.exitcode == 0
