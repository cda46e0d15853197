"""The page in a real browser: it draws what the server steps, and its hand is felt as the Python API says."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording
from ldsim.simulator import Simulator, full_simulator, load
from ldsim.viewer.player import PlayedMotion
from ldsim.viewer.playground import play_server, record_server
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.server import Server
from tests.simulator.playable import solid
from tests.viewer.browser import CHROMIUM, Tab, chromium
from tests.viewer.served import served

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (apt-get install chromium)")

READY = "window.ldsim !== undefined && ldsim.ready"


@pytest.fixture(scope="module")
def server(playable: Path) -> Server:
    return play_server(playable, ["latent"], 0, until_closed=False)


@pytest.fixture(scope="module")
def url(server: Server) -> Iterator[str]:
    with served(server) as address:
        yield address


@pytest.fixture(scope="module")
def browser() -> Iterator[Tab]:
    with chromium() as tab:
        tab.size(640, 480)
        yield tab


@pytest.fixture
def tab(browser: Tab, url: str) -> Iterator[Tab]:
    """The page, freshly opened, paused at rest without gravity; it must not have complained by the end."""
    yield from opened(browser, url)


def opened(browser: Tab, url: str) -> Iterator[Tab]:
    browser.complaints.clear()
    browser.requests.clear()
    browser.open(url)
    browser.wait(READY)
    click(browser, "fold")
    still(browser)
    yield browser
    assert browser.complaints == []
    hosts = {urlsplit(address).hostname for address in browser.requests if not address.startswith("data:")}
    assert hosts == {"127.0.0.1"}


def click(tab: Tab, name: str) -> None:
    tab.evaluate(f"document.getElementById('{name}').click()")


def still(tab: Tab) -> None:
    if not tab.evaluate("document.getElementById('pause').title.startsWith('Go on')"):
        click(tab, "pause")
    if tab.evaluate("document.getElementById('gravity').checked"):
        click(tab, "gravity")
    tab.wait(
        "document.getElementById('pause').title.startsWith('Go on') && !document.getElementById('gravity').checked"
    )
    click(tab, "reset")
    tab.wait("ldsim.q(0).every((x) => x === 0)")


def positions(tab: Tab, space: int = 0) -> Array:
    return np.array(tab.evaluate(f"ldsim.positions({space})")).reshape(-1, 3)


def expected(sim: Simulator) -> Array:
    moved: Array = (sim.scene.mesh.vertices + sim.displacement())[sim.surface.vertices]
    return moved


def facing_vertex(tab: Tab, sim: Simulator) -> tuple[int, tuple[float, float]]:
    """A vertex far from the pins that the pointer hits, and where it is in the window."""
    rest = sim.surface.rest
    tip = rest[:, 0].max()
    corner = min(np.flatnonzero(rest[:, 0] > tip - 1e-9), key=lambda i: tab.evaluate(f"ldsim.screen(0, {i})[1]"))
    x, y = tab.evaluate(f"ldsim.screen(0, {corner})")
    mx, my = tab.evaluate(f"ldsim.place(0, {rest[rest[:, 0] > tip - 1e-9].mean(axis=0).tolist()})")
    return int(corner), (x + 0.3 * (mx - x), y + 0.3 * (my - y))


def test_the_page_draws_what_the_api_computes(tab: Tab, playable: Path) -> None:
    sim = load(playable)
    np.testing.assert_allclose(positions(tab), sim.surface.rest, atol=1e-7)
    click(tab, "gravity")
    for _ in range(5):
        click(tab, "step")
    sim.step(5)
    assert np.abs(sim.displacement()).max() > 1e-3
    difference = f"Math.max(...ldsim.q(0).map((x, i) => Math.abs(x - {sim.coordinates.tolist()}[i])))"
    tab.wait(f"{difference} < 1e-6")
    np.testing.assert_allclose(positions(tab), expected(sim), atol=1e-6)
    assert 0 < tab.evaluate("ldsim.bytes") <= 4096


def test_a_drag_with_the_mouse_moves_the_surface_as_the_api_says(tab: Tab, playable: Path, server: Server) -> None:
    sim = load(playable)
    sim.gravity = (0, 0, 0)
    _, (x, y) = facing_vertex(tab, sim)
    to = (x - 30, y - 60)
    tab.mouse("mousePressed", (x, y))
    tab.mouse("mouseMoved", (x - 10, y - 30))
    tab.mouse("mouseMoved", to)
    tab.wait("ldsim.grabs === 1")
    (held,) = server._session.hands.held.values()
    end = time.monotonic() + 60
    while not np.allclose(tab.evaluate(f"ldsim.place(0, {held.target.tolist()})"), to, atol=1.5):
        assert time.monotonic() < end, "the target is not where the pointer is"
    sim.set_grabs(server._session._shown[0].grabs)
    for _ in range(15):
        click(tab, "step")
    sim.step(15)
    assert np.abs(sim.displacement()).max() > 1e-3
    difference = f"Math.max(...ldsim.q(0).map((x, i) => Math.abs(x - {sim.coordinates.tolist()}[i])))"
    tab.wait(f"{difference} < 1e-6")
    np.testing.assert_allclose(positions(tab), expected(sim), atol=1e-6)
    before = np.hypot(*(np.array((x, y)) - to))
    after = np.hypot(*(np.array(tab.evaluate(f"ldsim.place(0, {held.handles[0].centroid.tolist()})")) - to))
    assert after < before
    tab.mouse("mouseReleased", to)
    tab.wait("ldsim.grabs === 0")


def test_shift_leaves_the_pull_behind_and_a_click_on_it_takes_it_away(tab: Tab, playable: Path, server: Server) -> None:
    _, at = facing_vertex(tab, load(playable))
    to = (at[0], at[1] - 50)
    tab.mouse("mousePressed", at, shift=True)
    tab.mouse("mouseMoved", to, shift=True)
    tab.mouse("mouseReleased", to, shift=True)
    tab.wait("ldsim.grabs === 1")
    drawn = tab.evaluate("ldsim.drawn")
    time.sleep(0.3)
    tab.wait(f"ldsim.drawn > {drawn} + 2")  # the ball is clicked where it is drawn
    assert tab.evaluate("ldsim.grabs") == 1
    tab.mouse("mousePressed", to)
    tab.mouse("mouseReleased", to)
    tab.wait("ldsim.grabs === 0")


def test_undo_takes_a_pull_back_and_a_motion_is_played_from_its_name(tab: Tab, playable: Path, server: Server) -> None:
    session = server._session
    _, at = facing_vertex(tab, load(playable))
    tab.mouse("mousePressed", at)
    tab.mouse("mouseMoved", (at[0], at[1] - 50))
    tab.wait("ldsim.grabs === 1")
    for _ in range(3):
        click(tab, "step")
    tab.wait("ldsim.q(0).some((x) => Math.abs(x) > 1e-4)")
    tab.mouse("mouseReleased", (at[0], at[1] - 50))
    tab.evaluate("dispatchEvent(new KeyboardEvent('keydown', { key: 'z', ctrlKey: true }))")
    tab.wait("ldsim.q(0).every((x) => x === 0) && ldsim.grabs === 0")
    tip = session._shown[0].surface.rest[session._shown[0].surface.rest[:, 0].argmax()]
    drag = Drag(0, tip, np.tile(tip + [0.0, 0.05, 0.0], (4, 1)), 0.03, 25.0)
    session.player.add("lifted", PlayedMotion(Motion("lifted", 4, (drag,)), "test"))
    click(tab, "reset")
    tab.wait("document.getElementById('motions').textContent === 'lifted · test'")
    click(tab, "replay")
    tab.wait("document.getElementById('replay').title === 'Stop'")
    for _ in range(3):
        click(tab, "step")
    tab.wait("ldsim.grabs === 1 && document.querySelectorAll('#pulls circle').length === 1")
    for _ in range(2):
        click(tab, "step")
    tab.wait("document.getElementById('replay').title.startsWith('Play') && ldsim.grabs === 0")


def test_what_has_only_a_sign_says_what_it_is_and_the_pad_where_it_is(tab: Tab) -> None:
    named = "(element.getAttribute('aria-label') ?? element.textContent)"
    nameless = f"[...document.querySelectorAll('button')].filter((element) => !/[a-z]{{3}}/i.test({named}))"
    assert tab.evaluate(f"{nameless}.map((element) => element.outerHTML)") == []
    assert tab.evaluate("document.getElementById('pause').getAttribute('aria-label')") == "Go on (space)"
    pad = "document.getElementById('tilt')"
    read = f"['now', 'min', 'max', 'text'].map((name) => {pad}.getAttribute(`aria-value${{name}}`))"
    assert tab.evaluate(read) == ["0", "0", "90", "0° from upright"]
    tab.evaluate(f"{pad}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'ArrowUp', bubbles: true }}))")
    assert tab.evaluate(read) == ["9", "0", "90", "9° from upright"]


def test_the_space_bar_pauses_but_where_it_opens_what_has_the_focus(tab: Tab) -> None:
    tab.evaluate("window.pauses = 0; document.getElementById('pause').onclick = () => (window.pauses += 1)")
    for place, pauses in (("summary", 0), ("#stage", 1)):
        event = "new KeyboardEvent('keydown', { key: ' ', bubbles: true, cancelable: true })"
        tab.evaluate(f"document.querySelector('{place}').dispatchEvent({event})")
        assert tab.evaluate("window.pauses") == pauses


def test_a_finger_pulls_too(tab: Tab, playable: Path) -> None:
    _, (x, y) = facing_vertex(tab, load(playable))
    tab.touch("touchStart", [(x, y)])
    tab.touch("touchMove", [(x, y - 40)])
    tab.wait("ldsim.grabs === 1")
    tab.touch("touchEnd", [])
    tab.wait("ldsim.grabs === 0")


def test_a_drag_beside_the_solid_turns_the_view_and_pulls_nothing(tab: Tab) -> None:
    before = tab.evaluate("ldsim.screen(0, 0)")
    tab.mouse("mousePressed", (10, 240))
    tab.mouse("mouseMoved", (60, 225))
    tab.mouse("mouseMoved", (110, 215))
    tab.mouse("mouseReleased", (110, 215))
    tab.wait(f"Math.hypot(ldsim.screen(0, 0)[0] - {before[0]}, ldsim.screen(0, 0)[1] - {before[1]}) > 5")
    assert tab.evaluate("ldsim.grabs") == 0


def test_spaces_side_by_side_colours_points_and_mesh_are_drawn_without_complaint(tab: Tab) -> None:
    for name in ("Linear", "Full"):
        tab.evaluate(f"[...document.querySelectorAll('.space')].find((b) => b.textContent === '{name}').click()")
        tab.wait(f"[...document.querySelectorAll('.space[aria-pressed=true]')].some((b) => b.textContent === '{name}')")
    tab.wait("ldsim.ready && document.querySelectorAll('#statistics tr').length === 3")
    click(tab, "gravity")
    click(tab, "pause")
    for colour in ("displacement", "energy", "stress", "novelty", "plain"):
        tab.evaluate(
            f"(() => {{ const c = document.getElementById('colour'); c.value = '{colour}'; c.onchange(); }})()"
        )
        drawn = tab.evaluate("ldsim.drawn")
        tab.wait(f"ldsim.drawn > {drawn + 1}")
        if colour in ("energy", "stress"):
            tab.wait("!document.getElementById('high').textContent.includes('…')")
    for name in ("points", "wireframe", "theme"):
        click(tab, name)
        drawn = tab.evaluate("ldsim.drawn")
        tab.wait(f"ldsim.drawn > {drawn}")
        click(tab, name)
    tab.size(390, 700)  # a phone: the names of three solids stand side by side
    drawn = tab.evaluate("ldsim.drawn")
    tab.wait(f"document.querySelectorAll('.label b').length === 3 && innerWidth === 390 && ldsim.drawn > {drawn + 2}")
    boxes = sorted(
        tab.evaluate(
            "[...document.querySelectorAll('.label')]"
            ".map((e) => e.getBoundingClientRect()).map(({ left, right }) => [left, right])"
        )
    )
    assert all(left >= -1 and right <= 391 for left, right in boxes), boxes
    assert all(right <= left + 3 for (_, right), (left, _) in pairwise(boxes))
    tab.size(640, 480)
    for name in ("Linear", "Full"):
        tab.evaluate(f"[...document.querySelectorAll('.space')].find((b) => b.textContent === '{name}').click()")
    tab.wait("document.querySelectorAll('#statistics tr').length === 1")


def turn(tab: Tab, name: str, on: bool) -> None:
    """Show a space, or no longer."""
    tab.evaluate(f"[...document.querySelectorAll('.space')].find((b) => b.textContent === '{name}').click()")
    shown = 1 + on
    tab.wait(f"ldsim.stage.shapes.length === {shown} && document.querySelectorAll('#statistics tr').length === {shown}")
    drawn = tab.evaluate("ldsim.drawn")
    tab.wait(f"ldsim.drawn > {drawn} + 1")


def test_a_space_that_could_not_be_fetched_is_asked_for_again(tab: Tab) -> None:
    tab.evaluate(
        "(() => { const fetched = window.fetch; let failures = 2; window.fetch = (name, ...more) => "
        "name === 'space/linear' && failures-- > 0 ? Promise.reject(new TypeError('cut off')) : fetched(name, ...more)"
        "; })()"
    )
    turn(tab, "Linear", on=True)
    assert "(cut off); trying again" in tab.evaluate("document.getElementById('notice').textContent")
    turn(tab, "Linear", on=False)


def test_a_lost_connection_is_told_and_taken_up_again(tab: Tab) -> None:
    tab.evaluate("ldsim.source.socket.close()")
    tab.wait("document.body.classList.contains('lost')")
    assert "connection is lost" in tab.evaluate("document.getElementById('notice').textContent")
    tab.wait("!document.body.classList.contains('lost')")
    frame = tab.evaluate("ldsim.frame")
    tab.wait(f"ldsim.frame > {frame}")


def test_the_page_says_what_is_missing_without_webgl(browser: Tab, url: str) -> None:
    script = browser.call(
        "Page.addScriptToEvaluateOnNewDocument", source="HTMLCanvasElement.prototype.getContext = () => null"
    )
    try:
        browser.open(url)
        browser.wait("document.body.innerText.includes('This browser has no WebGL 2; try another')")
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])


def test_the_gpu_decodes_what_the_cpu_does(browser: Tab, url: str, playable: Path) -> None:
    for tab in opened(browser, url + "?decode=gpu"):
        assert tab.evaluate("ldsim.gpu") is True
        click(tab, "gravity")
        for _ in range(6):
            click(tab, "step")
        sim = load(playable)
        sim.step(6)
        difference = f"Math.max(...ldsim.q(0).map((x, i) => Math.abs(x - {sim.coordinates.tolist()}[i])))"
        tab.wait(f"{difference} < 1e-6")
        decoded = np.array(tab.evaluate("ldsim.decoded(0)")).reshape(-1, 3)
        np.testing.assert_allclose(decoded, expected(sim), atol=1e-6)


# Counts what is on the graphics card, by kind.
COUNTING = """
window.onCard = {};
for (const kind of ["Buffer", "Framebuffer", "Program", "Shader", "Texture", "VertexArray"]) {
  const gl = WebGL2RenderingContext.prototype, live = new Set();
  const made = gl[`create${kind}`], deleted = gl[`delete${kind}`];
  gl[`create${kind}`] = function (...given) {
    const one = made.apply(this, given);
    live.add(one);
    return one;
  };
  gl[`delete${kind}`] = function (one) {
    live.delete(one);
    deleted.call(this, one);
  };
  Object.defineProperty(onCard, kind, { get: () => live.size, enumerable: true });
}
"""


@pytest.mark.parametrize("decode", ["gpu", "cpu"])
def test_a_space_that_is_no_longer_shown_leaves_nothing_on_the_graphics_card(
    browser: Tab, url: str, decode: str
) -> None:
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=COUNTING)
    try:
        for tab in opened(browser, f"{url}?decode={decode}"):
            click(tab, "points")
            drawn = tab.evaluate("ldsim.drawn")
            tab.wait(f"ldsim.drawn > {drawn} + 1")
            before = tab.evaluate("({ ...onCard })")
            for name in ("Linear", "Full"):
                turn(tab, name, on=True)
                more = tab.evaluate("({ ...onCard })")
                assert more["Buffer"] > before["Buffer"] and more["VertexArray"] > before["VertexArray"]
                turn(tab, name, on=False)
                assert tab.evaluate("({ ...onCard })") == before
            assert before["Shader"] == 0
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])


def test_a_pull_is_recorded_in_the_browser_and_played_back(browser: Tab, tmp_path: Path) -> None:
    body = solid(1)
    recorder = Recorder(tmp_path / "motion.csv", (25.0, 0.05), {"recorded_on": "beam"})
    with served(record_server(body, "beam", recorder, 0, until_closed=False)) as url:
        for tab in opened(browser, url):
            click(tab, "record")
            tab.wait("document.body.classList.contains('recording')")
            _, (x, y) = facing_vertex(tab, full_simulator(body))
            for _ in range(3):
                click(tab, "step")
            tab.mouse("mousePressed", (x, y))
            tab.mouse("mouseMoved", (x, y - 60))
            tab.wait("ldsim.grabs === 1")
            for _ in range(10):
                click(tab, "step")
            tab.wait("ldsim.q(0).some((x) => Math.abs(x) > 1e-3)")
            tab.mouse("mouseReleased", (x, y - 60))
            tab.wait("ldsim.grabs === 0")
            click(tab, "record")
            tab.wait("document.getElementById('motions').textContent.includes('motion · 13 frames')")
            motion = read_recording(tmp_path / "motion.csv", "m")
            assert [(drag.start, drag.stop) for drag in motion.drags] == [(3, 13)]
            click(tab, "replay")
            tab.wait("document.getElementById('replay').title === 'Stop'")
            for _ in range(14):
                click(tab, "step")
            tab.wait("document.getElementById('replay').title.startsWith('Play')")
