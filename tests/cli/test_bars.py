"""Bars count what takes the time: what is compiled before and in the first step is no measure of the others."""

from __future__ import annotations

import io

import pytest
from tqdm import tqdm

from ldsim.cli.stage import _Bar


class Clock:
    """Seconds that pass when they are told to."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("first", [1, 10])
def test_the_time_that_is_left_is_told_by_the_steps_after_the_first(first: int) -> None:
    clock = Clock()
    with tqdm(total=100 + first, disable=False, file=io.StringIO(), mininterval=0, miniters=1) as shown:
        shown._time = clock  # type: ignore[attr-defined]
        shown.start_t = shown.last_print_t = clock.now
        bar = _Bar(shown)
        clock.now += 60
        bar.update(first)
        assert shown.format_dict["rate"] is None and shown.n == first
        for _ in range(20):
            clock.now += 0.5
            bar.update()
        rate = shown.format_dict["rate"] or (shown.n - shown.initial) / shown.format_dict["elapsed"]
    assert rate == pytest.approx(2.0, rel=0.01)
    assert shown.n == first + 20
