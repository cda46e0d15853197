"""The report in a real browser, loaded from disk: what it plays and reads off is what the run holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ldsim.mesh.surface import surface_vertices
from ldsim.report.figure import Axis, Figure, Guide, curve
from ldsim.report.figures import draw_figures
from ldsim.report.page import render_page
from ldsim.report.replay import make_replay
from ldsim.report.runs import reduced_runs
from ldsim.report.schema import RunNumbers
from ldsim.report.svg import drawn
from ldsim.run import Run
from tests.report.example_report import example_report
from tests.report.small_run import FRAMES, LOST_FROM
from tests.viewer.browser import CHROMIUM, Tab, chromium

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

READY = "document.readyState === 'complete' && [...document.querySelectorAll('.plot')].every((frame) => frame.plot)"
REPLAY = "document.querySelector('.replay').replay"
PLOT = "document.querySelector('#hold .plot').plot"  # of error_against_k, the first figure


@pytest.fixture(scope="module")
def page(lost_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with Run.open(lost_folder) as run:
        figures = {name: (figure, drawn(figure)) for name, figure in draw_figures(run, 0.06).items()}
        text = render_page(RunNumbers.model_validate(example_report()), figures, None, make_replay(run))
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def tab() -> Iterator[Tab]:
    with chromium() as some:
        yield some


def show(tab: Tab, page: Path, width: int = 900, height: int = 700) -> Tab:
    tab.complaints.clear()
    tab.requests.clear()
    tab.size(width, height)
    tab.open(page.resolve().as_uri())
    tab.wait(READY)
    return tab


@pytest.fixture
def opened(tab: Tab, page: Path) -> Tab:
    return show(tab, page)


def middle(tab: Tab, selector: str) -> tuple[float, float]:
    """The middle of an element that is scrolled into sight, on the screen."""
    x, y = tab.evaluate(
        f"(() => {{ const e = document.querySelector({selector!r}); e.scrollIntoView({{ block: 'center' }}); "
        "const b = e.getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]; })()"
    )
    return x, y


def set_to(tab: Tab, selector: str, value: int, event: str) -> None:
    """Give a control a value, as a user would."""
    tab.evaluate(
        f"(() => {{ const e = document.querySelector({selector!r}); e.value = {value}; "
        f"e.dispatchEvent(new Event({event!r})); }})()"
    )


def press(tab: Tab, key: str) -> None:
    tab.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    tab.call("Input.dispatchKeyEvent", type="keyUp", key=key)


def test_the_page_loads_without_complaint_and_asks_for_nothing_but_itself(opened: Tab, page: Path) -> None:
    assert opened.evaluate("!document.querySelector('.replay').hidden")
    assert opened.complaints == []
    assert {url for url in opened.requests if not url.startswith("data:")} == {page.resolve().as_uri()}


@pytest.mark.parametrize("space", ["full", "linear", "latent"])
def test_the_replay_moves_the_surface_as_the_run_did(opened: Tab, lost: Run, space: str) -> None:
    opened.evaluate(f"{REPLAY}.choose(1)")
    seen = opened.evaluate(
        f"(() => {{ const r = {REPLAY}, shown = r.motion.spaces.find((one) => one.space === {space!r}); "
        "r.decode(shown, 7); return Array.from(r.surface.positions); })()"
    )
    if space == "full":
        u = lost.snapshots.reader("pull_1")(7, 8)[0].astype(np.float64)
    else:
        q = reduced_runs(lost, "pull_1")[space].coordinates[7]
        u = (lost.basis.matrix[:, : len(q)] @ q).reshape(-1, 3)
    mesh = lost.scene.mesh
    surface = surface_vertices(mesh)
    assert np.abs(u).max() > 0.01 * mesh.diagonal
    np.testing.assert_allclose(np.reshape(seen, (-1, 3)), (mesh.vertices + u)[surface], atol=1e-3 * mesh.diagonal)


def test_scrubbing_shows_a_frame_with_its_time_and_the_runs_own_error(opened: Tab, lost: Run) -> None:
    set_to(opened, ".scrub", 3, "input")
    error = 1000 * reduced_runs(lost, "push")["latent"].mean_error[3]
    seconds = 4 * lost.scene.time_step
    assert opened.evaluate("document.querySelector('.time').textContent") == f"{seconds:.2f} s"
    told = opened.evaluate("document.querySelector('.panel.latent span').textContent")
    assert float(told.split(" mm")[0]) == pytest.approx(error, rel=5e-3)


def test_a_lost_space_says_when_and_is_no_longer_drawn(opened: Tab, lost: Run) -> None:
    seconds = LOST_FROM * lost.scene.time_step
    opened.evaluate(f"{REPLAY}.show({LOST_FROM - 1})")
    assert "mm from full space" in opened.evaluate("document.querySelector('.panel.linear span').textContent")
    # one call, so that no picture of the page's own comes between
    counted = f"{REPLAY}.drawn = 0; {REPLAY}.view.draw = () => {REPLAY}.drawn++; {REPLAY}.show({LOST_FROM})"
    drawn = opened.evaluate(f"(() => {{ {counted}; return {REPLAY}.drawn; }})()")
    assert opened.evaluate("document.querySelector('.panel.linear span').textContent") == f"diverged at {seconds:.2f} s"
    assert drawn == 2


def test_playing_goes_on_to_other_frames_and_pause_stops(opened: Tab) -> None:
    opened.evaluate("document.querySelector('.play').click()")
    opened.wait(f"{REPLAY}.frame !== {REPLAY}.motion.start")
    opened.evaluate("document.querySelector('.play').click()")
    frame = opened.evaluate(f"{REPLAY}.frame")
    assert opened.evaluate(f"new Promise((done) => setTimeout(() => done({REPLAY}.frame), 200))") == frame


def test_every_motion_can_be_chosen_and_says_its_role(opened: Tab) -> None:
    names = opened.evaluate("[...document.querySelector('.motion').options].map((option) => option.textContent)")
    assert names == ["push (validation)", "pull_1 (training)"]
    set_to(opened, ".motion", 1, "change")
    assert opened.evaluate(f"{REPLAY}.motion.name") == "pull_1"
    assert opened.evaluate("Number(document.querySelector('.scrub').max)") == FRAMES["pull_1"] - 1


def test_the_view_turns_by_mouse_finger_and_keys_and_zooms_by_two_fingers(opened: Tab) -> None:
    x, y = middle(opened, ".canvas")
    view = f"[{REPLAY}.camera.azimuth, {REPLAY}.camera.elevation, {REPLAY}.camera.zoom]"
    before = opened.evaluate(view)
    opened.mouse("mousePressed", (x, y))
    opened.mouse("mouseMoved", (x + 50, y + 10))
    opened.mouse("mouseReleased", (x + 50, y + 10))
    assert opened.evaluate(view) == pytest.approx([before[0] - 20, before[1] + 4, 1])
    opened.evaluate("document.querySelector('.canvas').focus()")
    press(opened, "0")
    press(opened, "ArrowRight")
    assert opened.evaluate(view)[0] == pytest.approx(before[0] - 4.8)
    press(opened, "0")
    opened.touch("touchStart", [(x - 50, y), (x + 50, y)])
    opened.touch("touchMove", [(x - 100, y), (x + 100, y)])
    opened.touch("touchEnd", [])
    assert opened.evaluate(view)[2] == pytest.approx(2, rel=0.05)


def test_a_figure_gives_back_the_values_that_were_plotted(opened: Tab, lost: Run) -> None:
    read = opened.evaluate(
        f"{PLOT}.curves.map(({{ name, scales: [X, Y], points }}) => "
        "[name, points.map(([x, y]) => [X.value(X.place(x)), Y.value(Y.place(y))])])"
    )
    true = {
        "max, training": lost.pca.max_error,
        "mean, training": lost.pca.mean_error,
        "max, validation": lost.pca.validation_max_error,
        "mean, validation": lost.pca.validation_mean_error,
    }
    assert {name for name, _ in read} == set(true)
    for name, points in read:
        modes = np.arange(len(true[name]))
        np.testing.assert_allclose(np.array(points)[:, 0], modes, atol=1e-9)
        np.testing.assert_allclose(np.array(points)[:, 1], 1000 * true[name], rtol=1e-6)


def place_of(tab: Tab, curve: int, index: int) -> tuple[float, float]:
    """Where a point of the first figure's curve is on the screen."""
    middle(tab, "#hold .plot svg")
    x, y = tab.evaluate(
        f"(() => {{ const p = {PLOT}, [x, y] = p.curves[{curve}].points[{index}], b = p.svg.getBoundingClientRect(), "
        "unit = b.width / 374; return [b.left + p.x.place(x) * unit, b.top + p.y.place(y) * unit]; })()"
    )
    return x, y


def test_hovering_says_the_nearest_points_values(opened: Tab, lost: Run) -> None:
    x, y = place_of(opened, 0, 2)
    opened.mouse("mouseMoved", (x + 3, y - 2))
    told = opened.evaluate(f"{PLOT}.told.innerText").splitlines()
    error = 1000 * lost.pca.max_error[2]
    assert [line.strip() for line in told[:2]] == ["max, training", "number of PCA modes: 2"]
    label, value = told[2].strip().split(": ")
    assert label == "vertex distance, mm" and float(value) == pytest.approx(error, rel=1e-3)


def test_a_drag_zooms_the_range_of_an_axis_and_a_double_click_takes_it_back(opened: Tab) -> None:
    paths = f"[...{PLOT}.svg.querySelectorAll('.curve')].map((curve) => curve.getAttribute('d'))"
    seen = f"[{PLOT}.x.value({PLOT}.x.from), {PLOT}.x.value({PLOT}.x.to)]"
    ticks = f"{PLOT}.x.ticks()"
    before, all_ticks = opened.evaluate(paths), opened.evaluate(ticks)
    (x1, y), (x2, _) = place_of(opened, 0, 1), place_of(opened, 0, 3)
    x1, x2 = x1 - 3, x2 + 3
    opened.mouse("mousePressed", (x1, y))
    opened.mouse("mouseMoved", ((x1 + x2) / 2, y + 2))
    opened.mouse("mouseMoved", (x2, y + 4))
    opened.mouse("mouseReleased", (x2, y + 4))
    low, high = opened.evaluate(seen)
    assert 0.9 < low < 1 and 3 < high < 3.1
    assert opened.evaluate(f"[{PLOT}.y.zoomed, {PLOT}.whole.hidden]") == [False, False]
    assert opened.evaluate(ticks) == [1, 1.5, 2, 2.5, 3]
    assert opened.evaluate(paths) != before
    opened.mouse("mousePressed", (x1, y))
    opened.mouse("mouseReleased", (x1, y))
    opened.evaluate(f"{PLOT}.svg.dispatchEvent(new MouseEvent('dblclick'))")
    assert opened.evaluate(seen) == pytest.approx([-0.2, 4.2], abs=1e-6)
    assert opened.evaluate(paths) == before
    assert opened.evaluate(ticks) == all_ticks and {0, 2, 4} <= set(all_ticks)


def test_keys_walk_along_a_curve_change_it_and_zoom(opened: Tab) -> None:
    opened.evaluate("document.querySelector('#hold .plot').focus()")
    for key in ("ArrowRight", "ArrowRight"):
        press(opened, key)
    assert "number of PCA modes: 1" in opened.evaluate(f"{PLOT}.told.textContent")
    press(opened, "ArrowDown")
    assert opened.evaluate(f"{PLOT}.told.textContent").startswith("mean, training number of PCA modes: 1")
    press(opened, "+")
    low, high = opened.evaluate(f"{PLOT}.x.window")
    assert high - low == pytest.approx(0.5)
    press(opened, "0")
    assert not opened.evaluate(f"{PLOT}.x.zoomed")


@pytest.mark.parametrize("width", [390, 1200])
def test_nothing_is_wider_than_the_page(tab: Tab, page: Path, width: int) -> None:
    assert show(tab, page, width).evaluate("document.documentElement.scrollWidth") <= width


def test_no_table_of_a_wide_page_has_to_be_shifted(tab: Tab, page: Path) -> None:
    wider = "[...document.querySelectorAll('.scroll')].filter((box) => box.scrollWidth > box.clientWidth + 1).length"
    assert show(tab, page, 1050, 800).evaluate(wider) == 0  # with longer names it is the width of 1280


def page_of(figure: Figure, folder: Path) -> Path:
    """A report whose first figure it is."""
    file, figures = folder / "a.html", {"error_against_k": (figure, drawn(figure))}
    file.write_text(render_page(RunNumbers.model_validate(example_report()), figures, None), encoding="utf-8")
    return file


def test_words_in_a_figure_keep_apart_and_within_it(tab: Tab, tmp_path: Path) -> None:
    """Lines that cross near the right end and at the top, as those of the spaces do."""
    line = curve("error", "linear", np.arange(41), np.geomspace(100, 0.01, 41))
    guides = (Guide(20, "condensed max 20 mm"), Guide(0.3, "condensed mean 0.3 mm"), Guide(40, "kp = k = 40", "x"))
    figure = Figure(
        "Errors", Axis("modes"), Axis("mm", log=True), (line,), guides=(*guides, Guide(100, "top")), height=3.5
    )
    *boxes, whole = show(tab, page_of(figure, tmp_path), 1280, 800).evaluate(
        "[...document.querySelectorAll('#hold .plot .guide text'), document.querySelector('#hold .plot svg[role=img]')]"
        ".map((e) => e.getBoundingClientRect()).map(({ left, top, right, bottom }) => [left, top, right, bottom])"
    )
    assert len(boxes) == 4, boxes
    for i, (left, top, right, bottom) in enumerate(boxes):
        assert right <= whole[2] - 4 and top >= whole[1] + 4
        for other in boxes[:i]:
            assert right <= other[0] or other[2] <= left or bottom <= other[1] + 3 or other[3] <= top + 3
    levels = tab.evaluate(
        "[...document.querySelectorAll('#hold .plot .guide:not(.upright) path')]"
        ".map((e) => e.getBoundingClientRect().top)"
    )
    assert len(levels) == 3
    assert not [(box, y) for box in boxes for y in levels if box[1] + 2 < y < box[3] - 2]


def test_words_in_a_figure_keep_off_its_curves(tab: Tab, tmp_path: Path) -> None:
    """A peak just where the words about a line near the top would stand first."""
    x = np.linspace(0, 1, 101)
    peak = curve("error", "linear", x, 0.2 + 0.8 * np.exp(-(((x - 0.9) / 0.02) ** 2)))
    figure = Figure("Errors", Axis("s"), Axis("mm", zero=True), (peak,), guides=(Guide(1.0, "warned of above 1"),))
    crossed = show(tab, page_of(figure, tmp_path), 1280, 800).evaluate(
        """(() => {
          const words = document.querySelector('#hold .plot .guide text').getBoundingClientRect();
          const path = document.querySelector('#hold .plot svg[role=img] .curve'), to = path.getScreenCTM();
          return Array.from({ length: 2000 }, (_, i) => path.getPointAtLength((path.getTotalLength() * i) / 2000))
            .map((point) => point.matrixTransform(to))
            .some(({ x, y }) => x > words.left && x < words.right && y > words.top + 2 && y < words.bottom - 2);
        })()"""
    )
    assert crossed is False


def test_without_webgl_the_replay_stays_away_and_figures_still_answer(tab: Tab, page: Path) -> None:
    without = page.with_name("without.html")
    text = page.read_text(encoding="utf-8").replace('getContext("webgl2"', 'getContext("none"')
    without.write_text(text, encoding="utf-8")
    show(tab, without)
    assert tab.evaluate("document.querySelector('.replay').hidden")
    assert tab.complaints == []


def test_without_script_and_on_paper_there_is_no_replay_and_every_figure(tab: Tab, page: Path) -> None:
    shown = "getComputedStyle(document.querySelector('.replay')).display"
    show(tab, page).call("Emulation.setEmulatedMedia", media="print")
    assert tab.evaluate(shown) == "none"
    tab.call("Emulation.setEmulatedMedia", media="")
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    tab.open(page.resolve().as_uri())
    tab.wait("document.readyState === 'complete'")
    assert tab.evaluate(shown) == "none"
    assert tab.evaluate("document.querySelectorAll('.plot svg').length") > 5
    assert tab.evaluate("document.querySelectorAll('.plot.live').length") == 0
    tab.call("Emulation.setScriptExecutionDisabled", value=False)
