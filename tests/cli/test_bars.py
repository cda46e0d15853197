"""Bars count what takes the time: what is compiled before and in the first step is no measure of the others."""

from __future__ import annotations

import io

import pytest
from numba.core.event import trigger_event
from tqdm import tqdm

from ldsim.cli.stage import Bars, _Bar
from ldsim.jit import while_compiling


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


def test_the_clock_stands_still_while_kernels_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr("ldsim.jit.time", clock)
    clock.perf_counter = clock  # type: ignore[attr-defined]
    out = io.StringIO()
    with tqdm(total=100, disable=False, file=out, mininterval=0, miniters=1) as shown:
        shown._time = clock  # type: ignore[attr-defined]
        shown.start_t = shown.last_print_t = clock.now
        bar = _Bar(shown)
        with while_compiling(bar.compiling, bar.compiled):
            for step in range(40):
                if step in (0, 15):
                    with trigger_event("numba:compile"), trigger_event("numba:compile"):  # one compiles another
                        clock.now += 300
                clock.now += 0.5
                bar.update()
        rate = shown.format_dict["rate"] or (shown.n - shown.initial) / shown.format_dict["elapsed"]
    assert rate == pytest.approx(2.0, rel=0.01)
    assert "compiling, once" in out.getvalue()


def test_what_is_opened_says_once_that_it_compiles(capsys: pytest.CaptureFixture[str]) -> None:
    with Bars().opening("runs/demo"):
        for _ in range(2):
            with trigger_event("numba:compile"):
                pass
    assert capsys.readouterr().err == "opening runs/demo\ncompiling, once on this machine\n"
    with Bars().opening("runs/demo"):
        pass
    assert capsys.readouterr().err == "opening runs/demo\n"
