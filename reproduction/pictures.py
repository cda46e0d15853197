"""Every picture and film of README and the guide but two_commands.webp, from the demo's run and the configurations.

    make pictures                                  all of them; needs runs/demo, runs/ci and Chromium
    python -m reproduction.pictures film gallery   some: film, pages, gallery, drawings

They go to docs/pictures/, the demo's live page to docs/live/, and what each shows, with its hash, to
docs/pictures/made.json: a test fails where that has changed since. The film's numbers go to
reproduction/results/demo.json. The notebook's drawings are made from the results that they show, which benchmarks have
measured. two_commands.webp shows a run of many minutes, and is made by `python -m reproduction.bench.two_commands
--folder FOLDER`, or of that run again with --film.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ldsim.cli.stage import Bars
from ldsim.export.playback import playback
from ldsim.export.playground import write_playground
from ldsim.jit import one_thread
from ldsim.mesh.surface import surface_triangles
from ldsim.pipeline.mesh import mesh
from ldsim.report.camera import look_at_broadside, upright
from ldsim.report.compare import compare
from ldsim.report.drawing import Movement, moving_pictures, webp
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.viewer.playground import play_server, record_server
from ldsim.viewer.recorder import Recorder
from reproduction.bench import frontier, full_space
from reproduction.gallery import pictures as example_pictures
from reproduction.harness import CONFIGS, PICTURES, PIPELINE, RESULTS, ROOT, Row, note, parser, row, write_results
from tests.viewer.browser import Tab, chromium
from tests.viewer.served import served

LIVE = ROOT / "docs" / "live" / "demo.html"
LARGEST = 600_000  # bytes
# The demo is pulled at fast: a quarter of its speed can be followed.
FILM_SECONDS, FILM_FRAMES, FILM_WIDTH, SLOWER = 1.0, 50, 520, 4
# What the pages look like is in these.
PLAYGROUND = ["ldsim/web/pages/playground.html", "ldsim/web/pages/playground.css", "ldsim/web/pages/palette.css"]
REPORT = ["ldsim/report/templates/report.html", "ldsim/report/templates/style.css", "ldsim/web/pages/palette.css"]
COMPARISON = ["ldsim/report/templates/compare.html", *REPORT[1:]]
DEMO = "configs/demo.yaml"


def keep(name: str, data: bytes, shows: Sequence[str]) -> None:
    """Write a picture that shows these files of the project."""
    assert len(data) < LARGEST, f"{name} has {len(data)} bytes"
    (PICTURES / name).write_bytes(data)
    note(name, shows)
    print(f"docs/pictures/{name}: {len(data) / 1000:.0f} kB")


def film(runs: Path) -> None:
    """The demo pulled at in a motion that nothing had seen: finite elements and the space that simulate chose."""
    report = json.loads((runs / "demo" / "report" / "report.json").read_text(encoding="utf-8"))
    with Run.open(runs / "demo") as run:
        space, h = run.chosen, run.scene.time_step
        motion = next(name for name, each in run.motions.items() if each.role == "test")
        step = {name: _entry(report, name, motion)["median_step_ms"] for name in ("full", space)}
        words = {
            "full": f"finite elements: {step['full']:.3g} ms a step",
            space: f"the model: {step[space]:.2g} ms a step",
        }
        shown = [playback(run, motion, name) for name in words]
        moved = np.array([np.linalg.norm(shown[0].displacement(i), axis=1).mean() for i in range(shown[0].frames)])
        length = min(round(FILM_SECONDS / h), shown[0].frames)
        first = int(np.clip(int(moved.argmax()) - length // 2, 0, shown[0].frames - length))
        frames = range(first, first + length, max(length // FILM_FRAMES, 1))
        turn = upright(run.scene.gravity)
        rest = run.scene.mesh.vertices @ turn.T
        movements = []
        for one, title in zip(shown, words.values(), strict=True):
            positions = np.stack([rest + one.displacement(i) @ turn.T for i in frames])
            movements.append(Movement.pulled(title, positions, map(one.pulls, frames), turn))
        view = look_at_broadside(rest, np.concatenate([each.positions for each in movements]))
        pictures = moving_pictures(movements, surface_triangles(run.scene.mesh), view, FILM_WIDTH)
        keep("demo.webp", webp(list(pictures), SLOWER * h * frames.step), [DEMO])
        cells = run.scene.mesh.n_cells
    error = _entry(report, space, motion)["online_error"]["relative"]
    rows = [
        *_of_spaces(report),
        row("demo", "cells", cells),
        row("demo", "full step over the chosen space's", report["speedup"]["chosen_over_full"]),
        row("demo", "median step, full, test", step["full"], "ms"),
        row("demo", "median step, chosen, test", step[space], "ms"),
        row("demo", "online error, chosen, test", error),
    ]
    write_results("demo", "make pictures", rows, report["machine"], report["created"], [*PIPELINE, DEMO])


def _of_spaces(report: Any) -> list[Row]:
    """Errors and steps of both reduced spaces, motion by motion."""
    rows = []
    for space in ("linear", "latent"):
        for entry in report["simulate"][space]:
            error = entry["online_error"]
            rows.append(row("demo", f"online error, {space}, {entry['motion']}", error and error["relative"]))
            rows.append(row("demo", f"median step, {space}, {entry['motion']}", entry["median_step_ms"], "ms"))
    return rows


def _entry(report: Any, space: str, motion: str) -> Any:
    return next(entry for entry in report["simulate"][space] if entry["motion"] == motion)


def pages(runs: Path) -> None:
    """The pages of `ldsim play`, `record`, `report`, `compare` and the exported playground, in a browser."""
    with chromium() as tab, one_thread():
        tab.size(1280, 800)
        _exported(tab, runs / "demo")
        _reported(tab, runs)
        _played(tab, runs / "demo")
        _recorded(tab)


READY = "window.ldsim !== undefined && ldsim.ready"
# A place on the solid near its vertex that reaches farthest up and to the right, which an arm of the demo ends in.
TIP = """(() => {
  const places = Array.from({ length: ldsim.positions(0).length / 3 }, (_, i) => ldsim.screen(0, i));
  const tip = places.reduce((best, p) => (p[0] - p[1] > best[0] - best[1] ? p : best));
  const middle = [0, 1].map((axis) => places.reduce((sum, p) => sum + p[axis] / places.length, 0));
  for (let t = 0.05; t < 1; t += 0.02) {
    const [offsetX, offsetY] = tip.map((x, axis) => x + t * (middle[axis] - x));
    if (ldsim.stage.hit({ offsetX, offsetY })) return [offsetX, offsetY];
  }
})()"""


def _pull(tab: Tab, way: tuple[float, float]) -> None:
    """Take hold a little inside of the tip, and pull."""
    at = tab.evaluate(TIP)
    tab.mouse("mousePressed", at)
    for i in range(1, 9):
        tab.mouse("mouseMoved", (at[0] + way[0] * i / 8, at[1] + way[1] * i / 8))
    tab.wait("ldsim.grabs === 1 || ldsim.source.pulls?.size === 1")
    time.sleep(4)  # until it hangs on the pull


def _picture(tab: Tab, name: str) -> bytes:
    path = PICTURES / name
    tab.picture(path)
    return path.read_bytes()


def _played(tab: Tab, run: Path) -> None:
    with served(play_server(run, ["latent", "linear", "full"], 0, until_closed=False)) as url:
        tab.open(url)
        tab.wait(READY)
        _pull(tab, (50, -70))
        keep("play.webp", _picture(tab, "play.webp"), [DEMO, *PLAYGROUND])
        tab.mouse("mouseReleased", (0, 0))


def _recorded(tab: Tab) -> None:
    section = load_settings(CONFIGS / "demo.yaml").mesh
    assert section.shape is not None
    folder = PICTURES / "temporary"
    with Run(folder, "demo") as run:
        scene = mesh(run, section.replace(shape=section.shape.replace(resolution=2)), Bars(), CONFIGS)
    recorder = Recorder(folder / "motion.csv", (30.0, 0.02), {})
    with served(record_server(scene, "demo", recorder, 0, until_closed=False)) as url:
        tab.open(url)
        tab.wait(READY)
        tab.evaluate("document.getElementById('record').click()")
        _pull(tab, (60, -80))
        keep("record.webp", _picture(tab, "record.webp"), [DEMO, *PLAYGROUND])
        tab.mouse("mouseReleased", (0, 0))
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()


def _exported(tab: Tab, run: Path) -> None:
    with Run.open(run) as opened:
        write_playground(opened, LIVE)
    note(LIVE.name, [DEMO])
    tab.open(LIVE.as_uri())
    tab.wait(f"{READY} && ldsim.source.seconds > 0")
    _pull(tab, (50, -70))
    keep("playground.webp", _picture(tab, "playground.webp"), [DEMO, *PLAYGROUND])
    tab.mouse("mouseReleased", (0, 0))


def _reported(tab: Tab, runs: Path) -> None:
    tab.open((runs / "demo" / "report" / "report.html").resolve().as_uri())
    tab.wait("document.querySelector('figure.replay')?.replay !== undefined")
    tab.evaluate("document.querySelector('figure.replay').scrollIntoView()")
    time.sleep(1)
    keep("report.webp", _picture(tab, "report.webp"), [DEMO, *REPORT])
    page = PICTURES / "temporary.html"
    compare([runs / "demo", runs / "ci"], page)
    tab.open(page.as_uri())
    time.sleep(1)
    keep("compare.webp", _picture(tab, "compare.webp"), [DEMO, "configs/ci.yaml", *COMPARISON])
    page.unlink()
    page.with_suffix(".json").unlink()


def gallery(runs: Path) -> None:
    """Every example: at rest, and where its first motion moves it most, in the full space."""
    for config, data in example_pictures(runs):
        keep(f"example_{config.stem}.webp", data, [f"configs/{config.name}"])


def drawn(_: Path) -> None:
    """What the notebook shows of measurements, from their results."""
    shown = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    for file in (*sorted(RESULTS.glob("frontier_*.json")), RESULTS / "full_space_scaling.json"):
        if f"/{file.stem}.svg)" in shown:
            rows: list[Row] = json.loads(file.read_text(encoding="utf-8"))["rows"]
            solid = file.stem.removeprefix("frontier_")
            svg = full_space.picture(rows) if solid == file.stem else frontier.picture(rows, solid)
            keep(f"{file.stem}.svg", f"{svg}\n".encode(), [str(file.relative_to(ROOT))])


KINDS: dict[str, Callable[[Path], None]] = {"film": film, "pages": pages, "gallery": gallery, "drawings": drawn}


def main() -> None:
    arguments = parser("pictures", __doc__, "")
    arguments.add_argument("kinds", nargs="*", choices=[*KINDS, []], help="some only")
    arguments.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs")
    chosen = arguments.parse_args()
    for kind in chosen.kinds or KINDS:
        KINDS[kind](chosen.runs)


if __name__ == "__main__":
    main()
