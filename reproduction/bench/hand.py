"""Motions by hand: each solid of reproduction/bench/solids.py recorded by `ldsim record`, and how far its model is off.

A scripted pointer in a browser takes the place of a hand: it takes hold of a place that it sees, drags it across the
screen from one point to the next as hands do (quick in the middle, slow at both ends), waits, lets go, and takes hold
elsewhere. The recorder's own spring and grip are used, the page is looked at as it opens, and nothing that is recorded
was learned from. Solids that are not made yet are left out; their rows of earlier results stay. Results go
to reproduction/results/hand.json.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.mechanics.motion import Motion
from ldsim.pipeline.comparison import Reference
from ldsim.pipeline.options import MotionOptions
from ldsim.pipeline.snapshot import motion
from ldsim.run import Run
from reproduction.bench.solid_files import COARSE, SOLIDS, write_solid
from reproduction.harness import PIPELINE, Row, add_results, called, parser, row, show
from reproduction.reduced_runs import played
from tests.viewer.browser import Tab, chromium

NAME, ASKED = "hand", 0.1
# Drags, points that each goes to, how far away (a share of the solid on the screen) and how long a way takes, seconds.
DRAGS, POINTS, FAR, SECONDS = 4, 2, (0.1, 0.25), (0.8, 2.0)
EVENT_S = 0.016
SEEN = """(() => { const seen = [], all = ldsim.positions(0).length / 3;
  for (let i = 0; i < all; i++) {
    const [offsetX, offsetY] = ldsim.screen(0, i);
    if (ldsim.stage.hit({ offsetX, offsetY })) seen.push([offsetX, offsetY]);
  } return seen; })()"""


def record(config: Path, output: Path, seed: int) -> None:
    """Record a motion of a configuration's solid with a scripted pointer, on a coarse mesh where it has one."""
    command = [sys.executable, "-m", "ldsim", "record", config.name, "--output", str(output)]
    if (coarse := f"{config.stem}_coarse") in COARSE:
        command += ["--mesh", str(write_solid(coarse, config.parent))]
    with subprocess.Popen(
        [*command, "--no-browser", "--until-closed"], cwd=config.parent, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        url = next(line.strip() for line in process.stdout if line.startswith("http"))
        with chromium() as tab:
            tab.size(1280, 800)
            tab.open(url)
            tab.wait("window.ldsim !== undefined && ldsim.ready")
            _click(tab, "record")
            tab.wait("document.body.classList.contains('recording')")
            _drag(tab, np.random.default_rng(seed))
            _click(tab, "record")
            tab.wait("!document.body.classList.contains('recording')")
        for _ in process.stdout:
            pass


def _click(tab: Tab, button: str) -> None:
    tab.evaluate(f"document.getElementById('{button}').click()")


def _drag(tab: Tab, rng: np.random.Generator) -> None:
    for _ in range(DRAGS):
        places = np.array(tab.evaluate(SEEN))
        size = float(np.ptp(places, axis=0).max())
        at = places[rng.integers(len(places))]
        tab.mouse("mousePressed", (at[0], at[1]))
        home = at
        for _ in range(POINTS):
            angle, far = rng.uniform(0, 2 * np.pi), size * rng.uniform(*FAR)
            to = home + far * np.array([np.cos(angle), np.sin(angle)])
            seconds = rng.uniform(*SECONDS)
            begun, share = time.perf_counter(), 0.0
            while share < 1.0:
                time.sleep(EVENT_S)
                share = min((time.perf_counter() - begun) / seconds, 1.0)
                # least jerk (Flash and Hogan 1985, "The coordination of arm movements", Eq. 3)
                place = at + (to - at) * share**3 * (10 - 15 * share + 6 * share**2)
                tab.mouse("mouseMoved", (place[0], place[1]))
            at = to
        tab.mouse("mouseReleased", (at[0], at[1]))
        time.sleep(rng.uniform(0.3, 1.0))


def off(run: Run, recorded: Motion) -> list[Row]:
    """The rows of one recording."""
    frames, held = list[Array](), {}
    stepper = FullStepper(run.scene)
    for frame in simulate(stepper, recorded):
        frames.append(stepper.displacement(frame.state).astype(np.float32))
        held = dict(frame.held)
    full = np.array(frames)
    found = played(
        ReducedStepper(run.space("latent"), run.reduced_options), Reference(recorded, held, lambda a, b: full[a:b])
    )
    drag = recorded.drags[0]
    far = max(np.linalg.norm(each.targets - each.targets[0], axis=1).max() for each in recorded.drags)
    return [
        row(run.experiment, "frames", len(full)),
        row(run.experiment, "drags", len(recorded.drags)),
        row(run.experiment, "farthest way of a target", float(far), "m"),
        row(run.experiment, "stiffness", drag.stiffness, "N/m"),
        row(run.experiment, "largest displacement", float(np.linalg.norm(full, axis=2).max()), "m"),
        row(run.experiment, "online error by hand", found.relative_error, goal=f"<= {ASKED}"),
    ]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument(
        "solids", nargs="*", choices=[*SOLIDS, []], help="which; all that are made where none is named"
    )
    arguments.add_argument("--folder", type=Path, default=Path("runs") / "solids", help="where files and runs lie")
    given = arguments.parse_args()
    folder = given.folder.resolve()
    for seed, name in enumerate(SOLIDS):
        config, output = folder / f"{name}.yaml", folder / f"{name}_by_hand.csv"
        if (given.solids and name not in given.solids) or not (folder / "runs" / name / "simulation.h5").exists():
            continue
        if not output.exists():
            record(config, output, seed)
        with Run(folder / "runs" / name, name) as run:
            options = MotionOptions(name="by_hand", role="test", recording=str(output))
            rows = off(run, motion(run.scene, options))
        show(rows, name)
        add_results(NAME, called(NAME), rows, [*PIPELINE, "reproduction/bench/solid_files.py"])


if __name__ == "__main__":
    main()
