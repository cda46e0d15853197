"""The playground in a real browser, loaded from disk: it asks for nothing, and a pull does what it does in Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.reduced.stepper import ReducedState, ReducedStepper
from ldsim.export.playground import write_playground
from ldsim.export.source import Source, surface_of
from ldsim.mechanics.motion import Grab
from tests.viewer.browser import CHROMIUM, Tab, chromium

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

# A triangle that faces the camera, far from the pins: its middle on the screen.
FIND_PLACE = """
(() => {
  const { solid, view } = playground, p = solid.positions;
  playground.decode();
  let best = null, far = -Infinity;
  for (let t = 0; t < solid.triangles.length; t += 3) {
    const corners = [0, 1, 2].map((i) => 3 * solid.triangles[t + i]);
    const middle = [0, 1, 2].map((axis) => corners.reduce((sum, c) => sum + p[c + axis] / 3, 0));
    const [x, y] = view.toScreen(middle), ray = view.ray(x, y), hit = solid.rayHit(ray.origin, ray.direction);
    if (hit && Math.hypot(...hit.map((h, i) => h - middle[i])) < 1e-5 && middle[0] > far) {
      far = middle[0];
      best = [x, y];
    }
  }
  return best;
})()
"""
STEPS = 20


@pytest.fixture(scope="module")
def page(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "playground.html"
    write_playground(Source(run_folder), path)
    return path


@pytest.fixture(scope="module")
def tab() -> Iterator[Tab]:
    with chromium() as some:
        yield some


def show(tab: Tab, page: Path, width: int = 1000, height: int = 700) -> Tab:
    """The page, loaded from disk and stepping."""
    tab.complaints.clear()
    tab.requests.clear()
    tab.size(width, height)
    tab.open(page.resolve().as_uri())
    tab.wait("document.readyState === 'complete' && window.playground && playground.iterations !== undefined")
    return tab


@pytest.fixture
def opened(tab: Tab, page: Path) -> Tab:
    return show(tab, page)


def pull(opened: Tab) -> dict[str, Any]:
    """Rest, then a pull with the mouse while the clock stands; the pull as the page has it."""
    opened.evaluate("playground.pause(true); playground.reset()")
    x, y = opened.evaluate(FIND_PLACE)
    opened.mouse("mousePressed", (x, y))
    for step in range(1, 6):
        opened.mouse("mouseMoved", (x + 4 * step, y - 14 * step))
    state = opened.evaluate(
        "JSON.stringify([...playground.pulls.values()].map(({ held, spring }) => "
        "({ held, target: Array.from(spring.target), stiffness: spring.stiffness })))"
    )
    (only,) = json.loads(state)
    found: dict[str, Any] = only
    return found


def test_the_page_steps_without_an_error_and_asks_for_nothing_but_itself(opened: Tab, page: Path) -> None:
    opened.wait("playground.stepper.q.some((q) => q !== 0)")
    assert opened.complaints == []
    assert set(opened.requests) == {page.resolve().as_uri()}
    opened.wait("document.getElementById('numbers').textContent.includes('iterations')")


@pytest.mark.parametrize("space", ["latent", "linear"])
def test_a_drag_with_the_mouse_moves_the_surface_as_python_says(opened: Tab, source: Source, space: str) -> None:
    opened.evaluate(f"playground.choose({space!r})")
    held = pull(opened)
    opened.evaluate(f"for (let i = 0; i < {STEPS}; i++) playground.stepOnce(); playground.decode()")
    seen = np.array(opened.evaluate("Array.from(playground.solid.positions)")).reshape(-1, 3)
    opened.mouse("mouseReleased", (0, 0))
    some, body = source.spaces[space], source.scene
    stepper = ReducedStepper(body, some.U, some.decoder, some.cubature, tolerance=1e-9)
    state = ReducedState.at_rest(some.decoder)
    grab = Grab(np.array(held["held"]), np.array(held["target"]), held["stiffness"])
    for _ in range(STEPS):
        state, _ = stepper.step(state, [grab])
    u = stepper.displacement(state)
    surface = surface_of(body.mesh)
    assert np.abs(u).max() > 0.01 * body.mesh.diagonal
    np.testing.assert_allclose(seen, (body.mesh.vertices + u)[surface.vertices], atol=1e-6 * body.mesh.diagonal)
    assert opened.complaints == []


def test_a_drag_beside_the_solid_turns_the_view_and_pulls_nothing(opened: Tab) -> None:
    before = opened.evaluate("playground.view.azimuth")
    opened.mouse("mousePressed", (30, 120))
    opened.mouse("mouseMoved", (90, 120))
    assert opened.evaluate("playground.pulls.size") == 0
    opened.mouse("mouseReleased", (90, 120))
    assert opened.evaluate("playground.view.azimuth") == pytest.approx(before - 24)


def test_two_fingers_on_the_solid_are_two_pulls(opened: Tab) -> None:
    opened.evaluate("playground.pause(true); playground.reset()")
    x, y = opened.evaluate(FIND_PLACE)
    opened.touch("touchStart", [(x, y), (x - 3, y + 3)])
    assert opened.evaluate("playground.stepper.potential.springs.length") == 2
    opened.touch("touchEnd", [])
    assert opened.evaluate("playground.stepper.potential.springs.length") == 0


def test_releasing_gravity_and_stiffness_act_on_the_next_step(opened: Tab) -> None:
    pull(opened)
    opened.mouse("mouseReleased", (0, 0))
    assert opened.evaluate("playground.stepper.potential.springs.length") == 0
    opened.evaluate("document.getElementById('gravity').click()")
    opened.evaluate("playground.reset(); playground.stepOnce()")
    assert opened.evaluate("Math.max(...playground.stepper.q.map(Math.abs))") == 0
    opened.evaluate("stiffness.value = 1; stiffness.dispatchEvent(new Event('input'))")
    assert opened.evaluate("playground.stepper.potential.stiffer") == 2


def test_pause_stops_the_clock_and_step_makes_one_step(opened: Tab) -> None:
    opened.evaluate("playground.steps = 0; playground.stepOnce = () => { playground.steps++; }")
    opened.evaluate("playground.pause(true); playground.steps = 0")
    assert opened.evaluate("new Promise((done) => setTimeout(() => done(playground.steps), 200))") == 0
    opened.evaluate("document.getElementById('single').click()")
    assert opened.evaluate("playground.steps") == 1


@pytest.mark.parametrize("width", [360, 1400])
def test_the_controls_fit_the_width_and_leave_room_for_the_solid(tab: Tab, page: Path, width: int) -> None:
    box = show(tab, page, width, 740).evaluate(
        "(({ left, right, top }) => [left, right, top])(document.getElementById('controls').getBoundingClientRect())"
    )
    assert box[0] >= 0
    assert box[1] <= width
    assert box[2] > 0.6 * 740


def test_the_page_says_what_is_missing_without_webgl(tab: Tab, page: Path, tmp_path: Path) -> None:
    without = tmp_path / "without.html"
    text = page.read_text(encoding="utf-8")
    without.write_text(text.replace('getContext("webgl2"', 'getContext("webgl-none"'), encoding="utf-8")
    tab.open(without.resolve().as_uri())
    tab.wait("document.getElementById('message')?.hidden === false")
    assert "needs WebGL 2" in tab.evaluate("document.getElementById('message').textContent")
