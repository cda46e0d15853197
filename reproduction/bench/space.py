"""What the reduced space is worth, every element integrated: python benchmarks/space.py runs/x --latent 6 --latent 12

For each finished run (make EXPERIMENT=x …): online error of its latent space and of linear ones on every motion,
uninterrupted and restarted from the full space every 0.25 s; how many linear dimensions one latent one is worth; and,
at poses of every motion, how far the forces of the decoded pose would move the solid. `--latent` trains other latent
dimensions as well, with the settings and synthetic motions of the run. "Stepped" is the latent space of the run with
the cubature that `ldsim simulate` would step it with, where it has one. `--linear` and `--motion` choose what is
measured (each space and motion takes minutes). Every space that is done is kept in `--kept` and not measured again
as long as the run has the same model; interrupted, it goes on with the next. `--pca` measures the streamed PCA against
one in memory (250,000 × 1,000 float32). `--quick` takes 60 frames and three linear dimensions.
Results of each given run go to benchmarks/results/space_RUN.json, its frontier to docs/pictures/space_RUN.svg.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from results_file import write_results
from space_parts import Row, Solid, measure_pca, measure_space, measure_stepped, opened, row

from ldsim.artefacts.store import file_hash
from ldsim.jit import one_thread
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg

HERE = Path(__file__).parent
PICTURES = HERE.parent / "docs" / "pictures"
DIMENSIONS = (10, 15, 20, 25, 30, 35, 40, 50, 60)
QUICK = (10, 25, 40)
# r of the paper's Table 1.
PAPER_R = {"x": 6, "beam": 10, "elephant": 7, "armadillo": 20}


def kept(path: Path, measure: Callable[[], list[Row]]) -> list[Row]:
    """The rows of one part, from its file where it has been done; says what is going on."""
    started = time.perf_counter()
    if not path.exists():
        print(f"{path.stem} …", end=" ", file=sys.stderr, flush=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(measure(), ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
        partial.rename(path)
        print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    rows: list[Row] = json.loads(path.read_text(encoding="utf-8"))
    return rows


def show(rows: list[Row]) -> None:
    for r in rows:
        value = "–" if r["value"] is None else f"{r['value']:.4g}"
        print(f"| {r['model']} | {r['quantity']} | {value} | {r['unit']} | {r['goal'] or ''} |", flush=True)


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


def measure(folder: Path, given: argparse.Namespace) -> list[Row]:
    """The rows of one finished run."""
    with opened(folder) as solid:
        name, r, k = solid.name, solid.model[0].r, solid.U.shape[1]
        place = given.kept / f"{name}-{file_hash(folder / 'model.h5')[:12]}{'-quick' if given.quick else ''}"
        rows = [
            row(name, "r", r, "", f"<= {PAPER_R[name]}" if name in PAPER_R else None),
            row(name, "k", k),
            row(name, "train stage", float(solid.header.notes["seconds"]), "s", "<= 60"),
        ]
        show(rows)
        latent = [("latent", size) for size in sorted({r, *given.latent}) if size <= k]
        swept = given.linear or (QUICK if given.quick else DIMENSIONS)
        linear = [("linear", size) for size in swept if size <= k]
        motions = [name for name in solid.snapshots.names if name in (given.motion or solid.snapshots.names)]
        part = "".join(f"-{motion}" for motion in given.motion)
        for kind, size in latent + linear:

            def one(kind: str = kind, size: int = size) -> list[Row]:
                return measure_space(solid, getattr(Solid, kind)(solid, size), motions, given.quick)

            found = kept(place / f"{name}-{kind}-{size}{part}.json", one)
            show(found)
            rows += found
        if solid.cubature is not None and not given.quick:
            digest = file_hash(folder / "cubature.h5")[:12]
            found = kept(place / f"{name}-stepped-{digest}{part}.json", lambda: measure_stepped(solid, motions))
            show(found)
            rows += found
        for motion in motions:
            role = solid.snapshots.recorded(motion).role
            rows += worths(rows, name, f"{motion} ({role})", role == "heldout")
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
    show(found)
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


def main() -> None:
    parser = argparse.ArgumentParser(description="What the reduced space is worth, every element integrated.")
    parser.add_argument("runs", nargs="*", type=Path, help="folders of finished runs")
    parser.add_argument("--latent", type=int, action="append", default=[], help="also train this latent dimension")
    parser.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    parser.add_argument("--motion", action="append", default=[], metavar="NAME", help="only this motion")
    parser.add_argument("--kept", type=Path, default=Path("runs/space"), help="where finished parts are kept")
    parser.add_argument("--pca", action="store_true", help="also the streamed PCA against one in memory")
    parser.add_argument("--quick", action="store_true", help="60 frames, three linear dimensions")
    given = parser.parse_args()
    if not given.runs and not given.pca:
        parser.error("give the folder of a finished run, or --pca")
    print("| model | quantity | value | unit | goal |\n|---|---|---|---|---|")
    with one_thread():
        for folder in given.runs:
            record(folder.name, measure(folder, given), given.quick)
        if given.pca:
            name = f"pca{'-quick' if given.quick else ''}.json"
            found = kept(given.kept / name, lambda: measure_pca(given.quick))
            show(found)
            record("pca", found, given.quick)


def record(name: str, rows: list[Row], quick: bool) -> None:
    """Write the results of a run, or of the streamed PCA, and the frontier of a run."""
    suffix = "_quick" if quick else ""
    write_results(f"space_{name}{suffix}", "python benchmarks/space.py " + " ".join(sys.argv[1:]), rows)
    if not quick and name != "pca":
        (PICTURES / f"space_{name}.svg").write_text(picture(rows, name) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
