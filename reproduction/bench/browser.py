"""What the pages in the browser cost.

Needs Chromium, and draws as it can there: the first row says by what. Of each finished run, at 1280 × 800:

    play        from the command to its address, from there to the first picture; while pulled: pictures and steps a
                second, and the bytes of a frame
    playground  the size of the page, the time to its first step, pictures and steps a second; and what a step takes of
                the latent space that is pulled to and fro, the least of 41 batches of 100
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ldsim.export.playground import write_playground
from ldsim.run import Run
from reproduction.harness import Row, called, parser, row, show, write_results
from tests.viewer.browser import Tab, chromium

NAME = "browser"
SECONDS = 5.0
RENDERER = """(() => {
  const gl = document.createElement('canvas').getContext('webgl2');
  return gl.getParameter(gl.getExtension('WEBGL_debug_renderer_info').UNMASKED_RENDERER_WEBGL);
})()"""
# The vertex whose place in the window is nearest to the middle of all: it is surely on the solid.
MIDDLE = """(() => {
  const count = ldsim.positions(0).length / 3, places = [];
  for (let i = 0; i < count; i += Math.ceil(count / 500)) places.push(ldsim.screen(0, i));
  const mean = [0, 1].map((axis) => places.reduce((sum, p) => sum + p[axis] / places.length, 0));
  const far = (p) => Math.hypot(p[0] - mean[0], p[1] - mean[1]);
  return places.reduce((best, p) => (far(p) < far(best) ? p : best));
})()"""
# Milliseconds from the start of the page's loading until a condition holds, asked in every picture.
WHEN = """new Promise((done) => {
  const look = () => ((%s) ? done(performance.now()) : requestAnimationFrame(look));
  look();
})"""
# Pictures that the browser shows in some milliseconds, and what a counter gained in them.
COUNT = """new Promise((done) => {
  const start = performance.now(), first = %s;
  let shown = 0;
  const look = (now) => {
    shown += 1;
    if (now - start < %f) requestAnimationFrame(look);
    else done([shown / (now - start) * 1000, (%s - first) / (now - start) * 1000]);
  };
  requestAnimationFrame(look);
})"""
COUNT_STEPS = """steps = 0;
once = ldsim.source.stepOnce;
ldsim.source.stepOnce = function () {
  steps += 1;
  once.call(this);
};"""
# Microseconds of a step. The clock of a page is too coarse for a single one.
STEP = """(() => {
  const { solids, models, pull } = ldsim.source, solid = solids.latent, model = models.latent, count = 100;
  const vertex = model.movable.lastIndexOf(1), point = Array.from(model.rest.slice(3 * vertex, 3 * vertex + 3));
  const grab = solid.grab(model.held(point, pull.radius), point, pull.stiffness), reach = pull.radius;
  const batch = (_, number) => {
    const start = performance.now();
    for (let k = 0; k < count; k++) {
      const way = reach * Math.sin((number * count + k) / 30);
      solid.move(grab, point.map((x) => x + way));
      solid.step();
    }
    return (1e3 * (performance.now() - start)) / count;
  };
  const times = Array.from({ length: 41 }, batch).sort((a, b) => a - b);
  solid.release(grab);
  return times[0];
})()"""


def rates(tab: Tab, counter: str) -> tuple[float, float]:
    """Pictures, and increments of a counter, a second."""
    pictures, steps = tab.evaluate(COUNT % (counter, 1e3 * SECONDS, counter))
    return float(pictures), float(steps)


def play(tab: Tab, run: Path) -> list[Row]:
    started = time.perf_counter()
    command = [sys.executable, "-m", "ldsim", "play", str(run), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as server:
        try:
            assert server.stdout is not None
            url = next(word for line in server.stdout for word in line.split() if word.startswith("http://"))
            up = time.perf_counter() - started
            tab.open(url)
            first = tab.evaluate(WHEN % "window.ldsim?.ready && ldsim.drawn > 0") / 1e3
            x, y = tab.evaluate(MIDDLE)
            tab.mouse("mousePressed", (x, y))
            tab.mouse("mouseMoved", (x + 60, y - 40))
            tab.wait("ldsim.grabs === 1")
            pictures, steps = rates(tab, "ldsim.frame")
            size = tab.evaluate("ldsim.bytes")
            tab.mouse("mouseReleased", (x + 60, y - 40))
        finally:
            server.terminate()
    return [
        row(run.name, "play: from the command to the address", up, "s"),
        row(run.name, "play: from the address to the first picture", first, "s", "<= 3"),
        row(run.name, "play: pictures a second, pulled", pictures, "1/s"),
        row(run.name, "play: frames a second from the server, pulled", steps, "1/s"),
        row(run.name, "play: bytes of a frame, one pull, one space", size, "B", "<= 4096"),
    ]


def playground(tab: Tab, run: Path) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder, Run.open(run) as opened:
        page = Path(folder) / "playground.html"
        write_playground(opened, page)
        size = page.stat().st_size / 1e6
        tab.open(page.as_uri())
        first = tab.evaluate(WHEN % "window.ldsim && ldsim.source.seconds > 0") / 1e3
        tab.evaluate(COUNT_STEPS)
        pictures, steps = rates(tab, "steps")
        step = tab.evaluate(STEP)
    return [
        row(run.name, "playground: size", size, "MB", "<= 15"),
        row(run.name, "playground: from the file to the first step", first, "s"),
        row(run.name, "playground: pictures a second", pictures, "1/s"),
        row(run.name, "playground: steps a second", steps, "1/s"),
        row(run.name, "playground: a step, pulled", step, "µs", "<= 40"),
    ]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    given = arguments.parse_args()
    rows: list[Row] = []
    for run in given.runs:
        with chromium() as tab:
            tab.size(1280, 800)
            if not rows:
                rows.append(row("all", "drawn by", tab.evaluate(RENDERER)))
            rows += play(tab, run) + playground(tab, run)
    show(rows)
    print(write_results("browser", called(NAME), rows))


if __name__ == "__main__":
    main()
