"""What the reduced space is worth, every element integrated.

For each finished run (make EXPERIMENT=x …): online error of its latent space and of linear ones on every motion,
uninterrupted and restarted from the full space every 0.25 s; how many linear dimensions one latent one is worth; and,
at poses of every motion, how far the forces of the decoded pose would move the solid. `--latent` trains other latent
dimensions as well, with the settings of the run. "Stepped" is the latent space of the run with the cubature rule that
`ldsim simulate` would step it with, where it has one. `--linear` and `--motion` choose what is measured (each space and
motion takes minutes). Every space that is done is kept in `--kept` and not measured again as long as the run has the
same model; interrupted, it goes on with the next. `--pca` measures the streamed PCA against one in memory
(250,000 × 1,000 float32). `--quick` takes 60 frames and three linear dimensions.
Results of each given run go to reproduction/results/space_RUN.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ldsim.jit import one_thread
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.bench.space_parts import latent_of, measure_pca, measure_space, measure_stepped
from reproduction.harness import Row, called, parser, row, show, write_json, write_results

NAME = "space"
DIMENSIONS = (10, 15, 20, 25, 30, 35, 40, 50, 60)
QUICK = (10, 25, 40)
# r of the paper's Table 1.
PAPER_R = {"x": 6, "beam": 10, "elephant": 7, "armadillo": 20}


def kept(path: Path, measure: Callable[[], list[Row]]) -> list[Row]:
    """What a JSON file holds, measured where there is none; says what is going on."""
    if not path.exists():
        started = time.perf_counter()
        print(f"{path.stem} …", file=sys.stderr, flush=True)
        write_json(path, {"kept": measure()})
        print(f"{path.stem}: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    found: list[Row] = json.loads(path.read_text(encoding="utf-8"))["kept"]
    return found


def errors(rows: list[Row], motion: str, kind: str) -> dict[int, float]:
    """Online error by dimension, of the linear or the latent spaces."""
    start = f"online error, {motion}, {kind} "
    found = {int(r["quantity"].removeprefix(start)): r["value"] for r in rows if r["quantity"].startswith(start)}
    return {size: error for size, error in sorted(found.items()) if error is not None}


def worth(latent: float, linear: dict[int, float]) -> float | None:
    """The linear dimension with the same error, interpolated in its logarithm; None beyond what was swept."""
    if not linear or not np.isfinite(latent):
        return None
    k = np.array(sorted(linear))
    errors = np.log([linear[i] for i in k])
    if not errors.min() <= np.log(latent) <= errors.max():
        return None
    falling = np.minimum.accumulate(errors)[::-1]
    return float(np.interp(np.log(latent), falling, k[::-1]))


def measure(run: Run, given: argparse.Namespace) -> list[Row]:
    """The rows of one finished run."""
    name, r, k = run.experiment, run.model.decoder.r, run.basis.k
    place = given.kept / f"{name}-{run.hash('model')[:12]}{'-quick' if given.quick else ''}"
    rows = [
        row(name, "r", r, "", f"<= {PAPER_R[name]}" if name in PAPER_R else None),
        row(name, "k", k),
        row(name, "train stage", float(run.header("model").notes["seconds"]), "s", "<= 60"),
    ]
    latent = [partial(latent_of, run, size, place) for size in sorted({r, *given.latent}) if size <= k]
    swept = given.linear or (QUICK if given.quick else DIMENSIONS)
    linear = [partial(Space.linear, run.scene, run.basis, size) for size in swept if size <= k]
    motions = [motion for motion in run.played.names if motion in (given.motion or run.played.names)]
    part = "".join(f"-{motion}" for motion in given.motion)
    for make in latent + linear:
        space = make()
        measured = partial(measure_space, run, space, motions, given.quick)
        rows += kept(place / f"{name}-{space.name}-{space.r}{part}.json", measured)
    if run.path("cubature").exists() and not given.quick:
        path = place / f"{name}-stepped-{run.hash('cubature')[:12]}{part}.json"
        rows += kept(path, lambda: measure_stepped(run, motions))
    for motion in motions:
        role = run.recorded(motion).role
        rows += worths(rows, name, f"{motion} ({role})", role != "train")
    show(rows, name)
    return rows


def worths(rows: list[Row], name: str, motion: str, unseen: bool) -> list[Row]:
    """kp/r on one motion of every latent space, the linear ones with every element."""
    linear = errors(rows, motion, "linear")
    found = []
    for kind in ("latent", "stepped"):
        for r, error in errors(rows, motion, kind).items():
            kp = worth(error, linear)
            goal = ">= 2.5" if unseen else None
            found.append(row(name, f"kp/r, {motion}, {kind} {r}", None if kp is None else kp / r, "", goal))
    return found


def picture(rows: list[Row], name: str) -> str:
    """Online error against dimension, latent and linear, of training (dashed) and held-out motions."""
    figure, ax = new_axes("dimension, r or k", f"online error of {name}, %")
    own = [r for r in rows if r["model"] == name]
    start = "online error, "
    motions = dict.fromkeys(r["quantity"].split(", ")[1] for r in own if r["quantity"].startswith(start))
    for motion in motions:
        line = "-" if "(heldout)" in motion else "--"
        for kind, colour, marker in (
            ("linear", PALETTE["linear"], "o"),
            ("latent", PALETTE["latent"], "o"),
            ("stepped", PALETTE["latent"], "D"),
        ):
            found = errors(own, motion, kind)
            if found:
                sizes, values = zip(*found.items(), strict=True)
                ax.plot(
                    sizes,
                    100 * np.array(values),
                    line,
                    color=colour,
                    label=f"{kind}, {motion.split(' (')[0]}",
                    marker=marker,
                    markersize=3 if marker == "o" else 5,
                )
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, f"Online error of {name} against the number of dimensions, latent and linear")


def arguments() -> argparse.ArgumentParser:
    found = parser(NAME, __doc__)
    found.add_argument("runs", nargs="*", type=Path, help="folders of finished runs")
    found.add_argument("--latent", type=int, action="append", default=[], help="also train this latent dimension")
    found.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    found.add_argument("--motion", action="append", default=[], metavar="NAME", help="only this motion")
    found.add_argument("--kept", type=Path, default=Path("runs/space"), help="where finished parts are kept")
    found.add_argument("--pca", action="store_true", help="also the streamed PCA against one in memory")
    found.add_argument("--quick", action="store_true", help="60 frames, three linear dimensions")
    return found


def main() -> None:
    given = arguments().parse_args()
    if not given.runs and not given.pca:
        arguments().error("give the folder of a finished run, or --pca")
    with one_thread():
        for folder in given.runs:
            with Run.open(folder) as run:
                record(folder.name, measure(run, given), given.quick)
        if given.pca:
            found = kept(given.kept / f"pca{'-quick' if given.quick else ''}.json", lambda: measure_pca(given.quick))
            show(found, "pca")
            record("pca", found, given.quick)


def record(name: str, rows: list[Row], quick: bool) -> None:
    """Write the results of a run, or of the streamed PCA."""
    write_results(f"space_{name}{'_quick' if quick else ''}", called(NAME), rows)


if __name__ == "__main__":
    main()
