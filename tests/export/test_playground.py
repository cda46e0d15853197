"""The playground in a real browser, loaded from disk: it asks for nothing, and a pull does what it does in Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.export.playground import assembled, compressed, inflated, write_playground
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mesh.surface import Surface
from ldsim.run import Run
from tests.viewer.browser import CHROMIUM, Tab, chromium

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

# A triangle that faces the camera, far from the pins: its middle on the screen.
FIND_PLACE = """
(() => {
  const { stage, camera } = ldsim, shape = stage.shapes[0], p = shape.current(), { triangles } = shape.surface;
  let best = null, far = -Infinity;
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((i) => 3 * triangles[t + i]);
    const middle = [0, 1, 2].map((axis) => corners.reduce((sum, c) => sum + p[c + axis] / 3, 0));
    const [x, y] = camera.toScreen(middle), ray = camera.ray(x, y), hit = shape.surface.hit(ray.origin, ray.direction);
    if (hit && Math.hypot(...hit.point.map((h, i) => h - middle[i])) < 1e-5 && middle[0] > far) {
      far = middle[0];
      best = [x, y];
    }
  }
  return best;
})()
"""
STEPS = 20
LIVE = Path(__file__).parents[2] / "docs" / "live" / "demo.html"


@pytest.fixture(scope="module")
def page(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "playground.html"
    with Run.open(run_folder) as run:
        write_playground(run, path)
    return path


@pytest.fixture(scope="module")
def tab() -> Iterator[Tab]:
    with chromium() as some:
        yield some


@pytest.mark.parametrize("size", [0, 1, 3, 4, 1003])
def test_what_is_compressed_comes_back_whole(size: int) -> None:
    data = np.random.default_rng(size).bytes(size)
    assert inflated(compressed(data)) == data


def test_numbers_take_less_room_taken_apart_than_compressed_alone() -> None:
    numbers = np.random.default_rng(1).standard_normal(3000).astype(np.float32).tobytes()
    assert len(compressed(numbers)) < 0.915 * 4 / 3 * len(numbers)


def test_a_page_is_assembled_with_todays_library_whatever_it_had() -> None:
    about, models = {"title": "solid"}, {"latent": compressed(b"model")}
    old = assembled(about, {**models, "runtime": compressed(b"an old library")})
    assert old == assembled(about, models)


def show(tab: Tab, page: Path, width: int = 1000, height: int = 700) -> Tab:
    """The page, loaded from disk and stepping."""
    tab.complaints.clear()
    tab.requests.clear()
    tab.size(width, height)
    tab.open(page.resolve().as_uri())
    tab.wait("document.readyState === 'complete' && window.ldsim && ldsim.source.seconds > 0")
    return tab


def test_the_space_that_simulate_chose_is_shown_first_under_its_name(
    tab: Tab, run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Run.open(run_folder) as run:
        size = f"linear_{run.model.kp - 1}"
        monkeypatch.setattr(Run, "cubature", {**run.cubature, size: replace(run.cubature["linear"], virtual=None)})
        monkeypatch.setattr(Run, "chosen", size)
        write_playground(run, tmp_path / "page.html")
    show(tab, tmp_path / "page.html")
    assert tab.evaluate("ldsim.source.names") == [size]
    buttons = "[...document.querySelectorAll('#spaces button')].map((each) => [each.textContent, each.ariaPressed])"
    assert tab.evaluate(buttons) == [["Latent", "false"], [size.replace("linear_", "Linear "), "true"]]
    assert tab.complaints == []


@pytest.fixture
def opened(tab: Tab, page: Path) -> Tab:
    return show(tab, page)


def rest(tab: Tab) -> None:
    """Back to rest, while the clock stands."""
    tab.evaluate("ldsim.source.send('pause', { value: true }); ldsim.source.send('reset')")
    tab.wait("ldsim.q(0).every((x) => x === 0)")


def pull(opened: Tab, space: str = "latent") -> dict[str, Any]:
    """Rest, then a pull with the mouse while the clock stands; the pull as the page has it of a space."""
    rest(opened)
    x, y = opened.evaluate(FIND_PLACE)
    opened.mouse("mousePressed", (x, y))
    for step in range(1, 6):
        opened.mouse("mouseMoved", (x + 4 * step, y - 14 * step))
    state = opened.evaluate(
        "JSON.stringify([...ldsim.source.pulls.values()].map(({ held, aims }) => "
        f"({{ held, target: aims.{space}, stiffness: ldsim.source.pull.stiffness }})))"
    )
    (only,) = json.loads(state)
    found: dict[str, Any] = only
    return found


def test_the_page_steps_without_an_error_and_asks_for_nothing_but_itself(opened: Tab, page: Path) -> None:
    opened.wait("ldsim.q(0).some((q) => q !== 0)")
    assert opened.complaints == []
    assert set(opened.requests) == {page.resolve().as_uri()}
    opened.wait("document.querySelector('#statistics .latent')?.textContent.includes(' ms')")


@pytest.mark.parametrize("space", ["latent", "linear"])
def test_a_drag_with_the_mouse_moves_the_surface_as_python_says(opened: Tab, run: Run, space: str) -> None:
    opened.evaluate(f"ldsim.source.send('spaces', {{ value: [{space!r}] }})")
    opened.wait(f"ldsim.ready && ldsim.stage.shapes[0].space.space === {space!r}")
    held = pull(opened, space)
    opened.evaluate(f"for (let i = 0; i < {STEPS}; i++) ldsim.source.stepOnce()")
    opened.wait(f"ldsim.q(0).every((x, i) => x === Math.fround(ldsim.source.solids.{space}.features[i]))")
    seen = np.array(opened.evaluate("ldsim.positions(0)")).reshape(-1, 3)
    opened.mouse("mouseReleased", (0, 0))
    body = run.scene
    stepper = run.stepper(space)
    assert isinstance(stepper, ReducedStepper)
    state = stepper.rest()
    grab = Grab(np.array(held["held"]), np.array(held["target"]), held["stiffness"])
    for _ in range(STEPS):
        state, _ = stepper.step(state, Loads((grab,)))
    u = stepper.displacement(state)
    surface = Surface.of(body.mesh)
    assert np.abs(u).max() > 0.01 * body.mesh.diagonal
    np.testing.assert_allclose(seen, (body.mesh.vertices + u)[surface.vertices], atol=1e-6 * body.mesh.diagonal)
    assert opened.complaints == []


def test_a_drag_beside_the_solid_turns_the_view_and_pulls_nothing(opened: Tab) -> None:
    before = opened.evaluate("ldsim.camera.azimuth")
    opened.mouse("mousePressed", (30, 120))
    opened.mouse("mouseMoved", (90, 120))
    assert opened.evaluate("ldsim.source.pulls.size") == 0
    opened.mouse("mouseReleased", (90, 120))
    assert opened.evaluate("ldsim.camera.azimuth") == pytest.approx(before - 24)


def test_two_fingers_on_the_solid_are_two_pulls(opened: Tab) -> None:
    rest(opened)
    x, y = opened.evaluate(FIND_PLACE)
    beside = [(x + a, y + b) for a in (-3, 0, 3) for b in (-3, 0, 3) if a or b]
    hits = opened.evaluate(
        f"{json.dumps(beside)}.map(([offsetX, offsetY]) => Boolean(ldsim.stage.hit({{ offsetX, offsetY }})))"
    )
    opened.touch("touchStart", [(x, y)])
    opened.wait("ldsim.stage.grabs.length === 1")  # the second finger lands where the first pull is drawn
    opened.touch("touchStart", [(x, y), beside[hits.index(True)]])
    assert opened.evaluate("ldsim.source.pulls.size") == 2
    opened.touch("touchEnd", [])
    assert opened.evaluate("ldsim.source.pulls.size") == 0


def test_releasing_gravity_and_stiffness_act_on_the_next_step(opened: Tab) -> None:
    pull(opened)
    opened.mouse("mouseReleased", (0, 0))
    assert opened.evaluate("ldsim.source.pulls.size") == 0
    opened.evaluate("document.getElementById('gravity').click()")
    rest(opened)
    opened.evaluate("ldsim.source.stepOnce()")
    assert opened.evaluate("Math.max(...ldsim.source.solids.latent.features.map(Math.abs))") == 0
    opened.evaluate("window.scale = 0; ldsim.source.solids.latent.setStiffness = (value) => { scale = value; }")
    opened.evaluate("stiffness.value = 0.3; stiffness.dispatchEvent(new Event('input'))")
    assert opened.evaluate("scale") == pytest.approx(10**0.3)


def test_a_space_that_is_turned_on_is_where_its_pulls_have_brought_it(opened: Tab) -> None:
    pull(opened)
    opened.evaluate("for (let i = 0; i < 40; i++) ldsim.source.stepOnce()")
    state = "[ldsim.source.seconds, ...Object.values(ldsim.source.solids).map((solid) => Array.from(solid.features))]"
    before = opened.evaluate(state)
    opened.evaluate("document.querySelector('#spaces .linear').click()")
    opened.wait("ldsim.stage.shapes.length === 2 && ldsim.q(1).some((x) => x !== 0)")
    assert opened.evaluate(state) == before  # nobody began anew
    rest_shape = np.array(opened.evaluate("Array.from(ldsim.stage.shapes[0].solid.rest)"))
    for i in (0, 1):  # both hang on the pull
        assert np.abs(np.array(opened.evaluate(f"ldsim.positions({i})")) - rest_shape).max() > 0.1
    assert opened.evaluate("ldsim.source.pulls.size") == 1
    opened.mouse("mouseReleased", (0, 0))
    assert opened.complaints == []


def test_a_motion_of_the_run_is_played_as_python_steps_it_and_a_hand_ends_it(opened: Tab, run: Run) -> None:
    rest(opened)
    recorded = run.recorded("pull_1")
    assert "pull_1" in opened.evaluate("document.getElementById('motions').textContent")
    opened.evaluate("ldsim.source.send('take', { value: 'pull_1' }); document.getElementById('replay').click()")
    stepper, features = run.stepper("latent"), "Array.from(ldsim.source.solids.latent.features)"
    assert isinstance(stepper, ReducedStepper)
    for frame in simulate(stepper, recorded.motion, held=dict(recorded.held)):
        opened.evaluate("ldsim.source.stepOnce()")
        np.testing.assert_allclose(opened.evaluate(features), frame.state.q, atol=1e-6)
    assert np.abs(opened.evaluate(features)).max() > 1e-3
    assert opened.evaluate("document.getElementById('replay').title") == "Stop"
    opened.evaluate("ldsim.source.stepOnce()")  # the motion is over
    assert opened.evaluate("[ldsim.source.playing, ldsim.source.pulls.size]") == [None, 0]
    opened.evaluate("document.getElementById('replay').click(); for (let i = 0; i < 5; i++) ldsim.source.stepOnce()")
    x, y = opened.evaluate(FIND_PLACE)
    opened.mouse("mousePressed", (x, y))
    assert opened.evaluate("[ldsim.source.playing, ldsim.source.pulls.size]") == [None, 1]
    opened.mouse("mouseReleased", (x, y))
    assert opened.complaints == []


def test_a_pull_at_a_pin_is_told(opened: Tab) -> None:
    rest(opened)
    opened.evaluate("""(() => {
      const { rest, pinned } = ldsim.stage.shapes[0].solid, at = 3 * pinned.indexOf(1);
      const point = Array.from(rest.slice(at, at + 3));
      ldsim.source.pull.radius = 1e-6;
      ldsim.source.send("grab", { id: 1, point, target: point });
    })()""")
    opened.wait("document.getElementById('notice').textContent.includes('pinned')")
    assert opened.evaluate("ldsim.source.pulls.size") == 0


def test_pause_stops_the_clock_and_step_makes_one_step(opened: Tab) -> None:
    opened.evaluate("window.steps = 0; ldsim.source.stepOnce = () => { steps++; }")
    opened.wait("steps > 0")
    opened.evaluate("document.getElementById('pause').click(); steps = 0")
    assert opened.evaluate("new Promise((done) => setTimeout(() => done(steps), 200))") == 0
    opened.evaluate("document.getElementById('step').click()")
    assert opened.evaluate("steps") == 1


def test_undo_brings_back_the_pose_and_the_pulls_from_before_the_last_pull(opened: Tab) -> None:
    pull(opened)
    opened.evaluate("ldsim.source.poses = []; for (let i = 0; i < 5; i++) ldsim.source.stepOnce()")
    before = opened.evaluate("Array.from(ldsim.source.solids.latent.features)")
    opened.evaluate("document.getElementById('reset').click(); ldsim.source.stepOnce()")
    assert opened.evaluate("Array.from(ldsim.source.solids.latent.features)") != before
    opened.evaluate("dispatchEvent(new KeyboardEvent('keydown', { key: 'u' }))")
    assert opened.evaluate("Array.from(ldsim.source.solids.latent.features)") == before
    assert opened.evaluate("ldsim.source.pulls.size") == 1
    opened.evaluate("dispatchEvent(new KeyboardEvent('keydown', { key: 'z', ctrlKey: true }))")
    opened.wait("document.getElementById('notice').textContent.startsWith('nothing to undo')")
    opened.mouse("mouseReleased", (0, 0))
    assert opened.complaints == []


@pytest.mark.parametrize("width", [360, 1400])
def test_the_controls_fit_the_width_and_leave_room_for_the_solid(tab: Tab, page: Path, width: int) -> None:
    left, right, top, bottom = show(tab, page, width, 740).evaluate(
        "(({ left, right, top, bottom }) => [left, right, top, bottom])"
        "(document.getElementById('panel').getBoundingClientRect())"
    )
    assert 0 <= left < right <= width and 0 <= top < bottom <= 740
    assert left > 0.6 * width or top > 0.6 * 740


def test_the_page_says_what_is_missing_without_webgl(tab: Tab, page: Path, tmp_path: Path) -> None:
    without = tmp_path / "without.html"
    text = page.read_text(encoding="utf-8")
    without.write_text(text.replace('getContext("webgl2"', 'getContext("webgl-none"'), encoding="utf-8")
    tab.open(without.resolve().as_uri())
    tab.wait("document.getElementById('overlay')?.hidden === false && !document.getElementById('model')")
    assert "This browser has no WebGL 2" in tab.evaluate("document.getElementById('overlay').textContent")


def test_a_drag_while_time_stands_still_is_told(opened: Tab) -> None:
    pull(opened)
    assert opened.wait("document.getElementById('notice').textContent").startswith("Paused")
    opened.mouse("mouseReleased", (0, 0))


def test_help_the_first_view_a_scale_and_a_picture_are_a_key_away(opened: Tab) -> None:
    def press(key: str) -> None:
        opened.evaluate(f"dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}' }}))")

    press("?")
    assert opened.evaluate("document.getElementById('manual').open")
    opened.evaluate("document.getElementById('manual').close()")
    before = opened.evaluate("ldsim.camera.azimuth")
    opened.evaluate("ldsim.camera.azimuth += 30")
    press("0")
    assert opened.evaluate("ldsim.camera.azimuth") == before
    ruler = opened.evaluate(
        "(({ textContent, offsetWidth }) => [textContent, offsetWidth])(document.getElementById('ruler'))"
    )
    assert ruler[0].endswith("m") and 30 < ruler[1] <= 141
    opened.evaluate("HTMLAnchorElement.prototype.click = function () { window.saved = [this.download, this.href]; }")
    press("c")
    assert opened.wait("window.saved")[0].endswith(".png") and opened.evaluate("saved[1].startsWith('blob:')")
    assert opened.complaints == []


def test_the_live_page_of_the_documentation_steps_and_plays(tab: Tab) -> None:
    """Its models are those of the demo as `make pictures` found it, its library is today's."""
    show(tab, LIVE)
    # stepped by hand: between two pictures of a loaded machine a whole pull can pass
    tab.evaluate("ldsim.source.send('pause', { value: true })")
    tab.evaluate("document.getElementById('replay').click()")
    tab.evaluate("for (let i = 0; i < 20; i++) ldsim.source.stepOnce()")
    assert tab.evaluate("ldsim.source.pulls.size") == 1
    assert tab.evaluate("Math.max(...ldsim.source.frame().spaces[0].q.map(Math.abs))") > 1e-3
    tab.wait("document.querySelector('#statistics .latent')?.textContent.includes('fine')")
    assert tab.complaints == []


def test_on_a_phone_and_in_a_cell_of_a_notebook_the_controls_begin_folded(tab: Tab, page: Path) -> None:
    assert "folded" in show(tab, page, 830, 480).evaluate("document.body.className")
    height = "document.getElementById('panel').offsetHeight"
    assert show(tab, page, 390, 844).evaluate(height) < 0.15 * 844
    tab.evaluate("document.getElementById('fold').click()")
    assert 0.15 * 844 < tab.evaluate(height) <= 0.46 * 844
