"""What a score of every step tells of the error of that step, on motions that nothing was fitted to.

Of finished runs, three scores in every frame of the validation and test motions in the latent space: the distance of
the code to the nearest training codes, as `ldsim simulate` warns by it; the same remembered over half a second; and
the constraint force, |(M̃/h² + K̃₀)⁻¹ ∂E/∂q| at the decoded pose in the run's largest linear space, remembered as long.
Beside them the time since the motion began, which knows nothing: what is remembered mostly grows in a short motion,
and is worth what it ranks better than that. For each Spearman's rank correlation with the mean vertex error of the
frame, and the area under the ROC curve of the frames that are further off than nine in ten of the training motions'.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from ldsim.arrays import Array
from ldsim.dynamics.reduced.potential import value_gradient
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.loads import MotionLoads
from ldsim.report.numbers import rank_correlation
from ldsim.run import Run
from ldsim.space.novelty import remembered
from reproduction.harness import PIPELINE, Row, over_runs, row

NAME = "novelty"
USUAL = 0.9


def constraint_force(run: Run, motion: str, played: Trajectory) -> Array:
    """Of each frame, in the mass norm: how far the step would move, were every column free, (N,)."""
    largest = max((name for name in run.cubature if name.startswith("linear")), key=lambda name: run.space(name).r)
    linear, recorded, coordinates = run.space(largest), run.recorded(motion), played.coordinates
    assert coordinates is not None
    stepper, latent = ReducedStepper(linear), run.space("latent")
    loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
    q = np.concatenate([linear.encode(latent.displacement(each)[None])[1] for each in coordinates])
    metric, before = stepper.compiled()[0].metric, np.concatenate([np.zeros((2, q.shape[1])), q])
    found, gradient = np.zeros(len(q)), np.zeros(q.shape[1])
    for i in range(len(q)):
        model, springs, work = stepper.compiled(loads.at(i))
        value_gradient(model, springs, 2 * before[i + 1] - before[i], q[i], work, gradient)
        way = np.linalg.solve(metric, gradient)
        found[i] = np.sqrt(way @ stepper.mass @ way)
    return found


def area(score: Array, bad: NDArray[np.bool_]) -> float:
    """Under the ROC curve: how often a bad frame has a larger score than a good one; NaN where all are of one kind."""
    count = int(bad.sum())
    if count in (0, len(bad)):
        return float("nan")
    return float((rankdata(score)[bad].sum() - count * (count + 1) / 2) / (count * (len(bad) - count)))


def measure(run: Run) -> list[Row]:
    """The rows of one run."""
    name, runs, h = run.folder.name, run.simulation["latent"], run.scene.time_step
    errors = {motion: played.mean_error for motion, played in runs.items()}
    trained = [errors[motion] for motion in runs if run.motions[motion].role == "train"]
    usual = float(np.quantile(np.concatenate([each for each in trained if each is not None]), USUAL))
    rows = list[Row]()
    for motion, played in runs.items():
        role, error = run.motions[motion].role, played.mean_error
        if role == "train" or error is None or played.novelty is None or played.diverged:
            continue
        scores = {
            "distance of codes": played.novelty,
            "distance, remembered": remembered(played.novelty, h),
            "constraint force": remembered(constraint_force(run, motion, played), h),
            "time alone": np.arange(len(error), dtype=np.float64),
        }
        bad = error > usual
        rows.append(row(name, f"share of bad frames, {motion} ({role})", float(bad.mean())))
        for what, score in scores.items():
            rows.append(row(name, f"rank correlation, {what}, {motion} ({role})", rank_correlation(score, played)))
            rows.append(row(name, f"area under ROC, {what}, {motion} ({role})", area(score, bad)))
    return rows


def main() -> None:
    over_runs(NAME, __doc__, measure, PIPELINE)


if __name__ == "__main__":
    main()
