"""What own runs save: full-space frames that random pulls need, and that a condensed space needs which explores.

A condensed space learns from relaxed poses. They can be those of recorded pulls alone, or of few recorded pulls and of
where its own runs go under other pulls (`train.condensed.rounds`), which no full-space frame is needed for. Both are
given the same number of relaxed poses, the same fit and the same configuration by `ldsim new`, and are judged by the
same pulls, in the mean and by the worst of them. Results go to reproduction/results/enrichment.json.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from ldsim.arrays import Array
from ldsim.pipeline.convergence import pull_errors
from ldsim.run import Run
from ldsim.settings import Settings, load_settings
from ldsim.settings.new import NewOptions, new
from reproduction.harness import PIPELINE, Row, called, finished, parser, row, show, write_results

NAME = "enrichment"
# Shapes, cubes across their thinnest sides, and the coordinates of their spaces.
SOLIDS = {"slender_cross": (2, 8), "beam": (2, 6), "mounted_bar": (2, 6)}
SEEDS = (1, 2, 3)
# Recorded pulls that own runs start from, and recorded pulls alone.
STARTED, ALONE = 4, (4, 6, 7, 8, 16, 32)
# As many times the frames are asked for, at least; so many are tried in any case.
HALF = 2
# Relaxed poses in all, of these in each of two rounds; gradients of the last fit; pulls that judge.
POSES, EXPLORED, STEPS, JUDGES = 320, 80, 3000, 20
STAGES = ("mesh", "snapshot", "pca", "train")


def configured(base: Settings, pulls: int, own: bool, seed: int, r: int) -> Settings:
    """A configuration by `ldsim new` with so many recorded pulls, and own runs or none."""
    content = yaml.safe_load(base.dump(defaults=False))
    train, judges = content["snapshot"]["motions"][0], content["snapshot"]["motions"][2]
    train["pulls"] |= {"count": pulls, "seed": 100 * seed}
    judges["pulls"] |= {"count": JUDGES, "seed": 7}
    content["experiment"] = f"{base.experiment}_{seed}_{pulls}{'_own' if own else ''}"
    content["snapshot"]["motions"] = [train, judges]
    poses = {"poses": POSES - 2 * EXPLORED, "explored": EXPLORED, "rounds": 2} if own else {"poses": POSES, "rounds": 0}
    content["train"] = {"r": r, "seed": seed, "condensed": {"steps": STEPS, **poses}}
    return Settings(**content)


def measured(base: Settings, runs: Path, pulls: int, own: bool, seed: int, r: int) -> tuple[Array, int]:
    """Errors of the pulls that judge, and full-space frames that were learned from."""
    settings = configured(base, pulls, own, seed, r)
    folder = finished(runs / settings.experiment, settings, STAGES, runs)
    with Run(folder, settings.experiment) as run:
        errors, names = pull_errors(run), run.snapshots.with_role("train")
        return errors, sum(run.snapshots.frames(name) for name in names)


def of_solid(name: str, runs: Path) -> list[Row]:
    """The rows of a solid: each seed with own runs, and with recorded pulls alone until these are as good."""
    resolution, r = SOLIDS[name]
    config = runs / f"{name}.yaml"
    if not config.exists():
        new(None, NewOptions(shape=name, resolution=resolution, output=config), runs)
    base, rows = load_settings(config), list[Row]()
    for seed in SEEDS:
        errors, frames = measured(base, runs, STARTED, True, seed, r)
        rows += _rows(name, f"seed {seed}, {STARTED} pulls and own runs", errors, frames)
        wanted = {"mean": float(errors.mean()), "worst": float(errors.max())}
        tried: list[tuple[float, dict[str, float]]] = []
        for pulls in ALONE:
            errors, other = measured(base, runs, pulls, False, seed, r)
            rows += _rows(name, f"seed {seed}, {pulls} pulls alone", errors, other)
            tried.append((other / frames, {"mean": float(errors.mean()), "worst": float(errors.max())}))
            if tried[-1][0] >= HALF and min(found["mean"] for _, found in tried) <= wanted["mean"]:
                break
        for kind, error in wanted.items():
            needed = next((times for times, found in tried if found[kind] <= error), None)
            quantity = f"seed {seed}, frames of pulls alone for the same {kind} error"
            if needed is None:
                quantity += ", more than"
            rows.append(row(name, quantity, tried[-1][0] if needed is None else needed, "times", f">= {HALF}"))
    return rows


def _rows(name: str, what: str, errors: Array, frames: int) -> list[Row]:
    return [
        row(name, f"{what}: full-space frames", frames),
        row(name, f"{what}: mean error", float(errors.mean())),
        row(name, f"{what}: worst error", float(np.max(errors))),
    ]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("--runs", type=Path, default=Path("runs") / NAME, help="where runs lie")
    given, rows = arguments.parse_args(), list[Row]()
    given.runs.mkdir(parents=True, exist_ok=True)
    for name in SOLIDS:
        rows += of_solid(name, given.runs.resolve())
        show(rows, name)
        write_results(NAME, called(NAME), rows, inputs=PIPELINE)


if __name__ == "__main__":
    main()
