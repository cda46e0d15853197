"""The statement of a run: as true as it claims, whatever the errors are like, and of motions that nothing has seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from ldsim.arrays import Array
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.full.options import FullOptions
from ldsim.errors import LostMotionError
from ldsim.mechanics.options import PullOptions
from ldsim.mesh.shapes import beam
from ldsim.pipeline import snapshot as snapshots
from ldsim.pipeline import statement
from ldsim.pipeline.options import StatementOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.pipeline.snapshot import snapshot
from ldsim.pipeline.statement import Bound, about, bound, fresh_motions, sentence
from tests.helpers import changed
from tests.helpers import scene as scene_of
from tests.pipeline.two_tets import made, motions, run_here

TRIALS = 2000


def of_many(draw: Callable[[np.random.Generator, int], Array], n: int, quantile: float, confidence: float) -> Array:
    """The bounds of many runs of the same kind."""
    rng = np.random.default_rng(n)
    return np.array([bound(draw(rng, n), quantile, confidence).error for _ in range(TRIALS)])


# A distribution of errors with its quantile: mild, of heavy tail, of two kinds, and one in which some runs are lost.
DISTRIBUTIONS: dict[str, tuple[Callable[[np.random.Generator, int], Array], Callable[[float], float]]] = {
    "uniform": (lambda rng, n: rng.uniform(size=n), lambda q: q),
    "heavy tail": (lambda rng, n: rng.pareto(0.8, size=n), lambda q: (1 - q) ** (-1 / 0.8) - 1),
    "two kinds": (
        lambda rng, n: np.where(rng.uniform(size=n) < 0.7, 0.0, 10.0) + rng.uniform(size=n),
        lambda q: q / 0.7 if q < 0.7 else 10 + (q - 0.7) / 0.3,
    ),
    "some lost": (
        lambda rng, n: np.where(rng.uniform(size=n) < 0.97, rng.uniform(size=n), np.inf),
        lambda q: q / 0.97 if q < 0.97 else math.inf,
    ),
}


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize(("n", "quantile", "confidence"), [(59, 0.95, 0.95), (120, 0.95, 0.9), (30, 0.8, 0.95)])
def test_the_bound_covers_the_quantile_as_often_as_it_claims(
    name: str, n: int, quantile: float, confidence: float
) -> None:
    draw, true_quantile = DISTRIBUTIONS[name]
    held = float((of_many(draw, n, quantile, confidence) >= true_quantile(quantile)).mean())
    sure = binom.cdf(np.arange(n), n, quantile)
    claimed = float(sure[sure >= confidence][0])
    spread = 4 * math.sqrt(claimed * (1 - claimed) / TRIALS)
    assert claimed - spread <= held <= claimed + spread
    assert claimed >= confidence


def test_fifty_nine_motions_are_the_fewest_for_95_per_cent_at_95() -> None:
    errors = np.arange(1.0, 60.0)
    assert bound(errors, 0.95, 0.95) == Bound(0.95, 0.95, 59.0, 59)
    fewer = bound(errors[:58], 0.95, 0.95)
    assert fewer.error == 58.0 and fewer.quantile < 0.95 and fewer.confidence == 0.95


def test_more_motions_allow_for_some_that_are_worse() -> None:
    errors = np.arange(1.0, 201.0)
    found = bound(np.random.default_rng(0).permutation(errors), 0.95, 0.95)
    assert 190 < found.error < 200
    assert bound(errors, 0.5, 0.95).error < found.error


@pytest.mark.parametrize("n", [1, 5, 20])
def test_of_few_motions_the_largest_covers_less_and_says_so(n: int) -> None:
    rng, found = np.random.default_rng(1), bound(np.ones(n), 0.95, 0.95)
    assert found.quantile == pytest.approx(0.05 ** (1 / n))
    largest = rng.uniform(size=(TRIALS, n)).max(axis=1)
    assert (largest >= found.quantile).mean() == pytest.approx(0.95, abs=0.02)


def test_lost_motions_count_as_the_worst() -> None:
    errors = np.array([0.1, np.nan, 0.2, np.inf, 0.15, 0.3])
    assert bound(errors, 0.5, 0.5).error == 0.3
    lost = bound(errors, 0.9, 0.9)
    assert lost.error == math.inf
    assert sentence(lost, "pulls").startswith("Nothing can be said of ")


def test_the_sentence_says_what_holds_of_what_and_how_surely() -> None:
    pulls = PullOptions(count=1, reach=0.05, stiffness=110)
    options = StatementOptions(motions=59, pulls=pulls)
    said = sentence(Bound(0.95, 0.95, 0.0463, 59), about(options))
    assert said.startswith("95 % of motions like these stay within 4.63 % of the full space")
    for words in ("95 % confidence", "59 fresh ones", "one pull", "20 to 50 mm", "110 N/m"):
        assert words in said


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (0.0463, "stay within 4.63 % of the full space in the latent space (with 95 % confidence"),
        (math.inf, "Nothing can be said of 95 % of motions like these in the latent space: too many"),
    ],
)
def test_the_sentence_names_the_space_where_another_one_is_used(error: float, words: str) -> None:
    found = Bound(0.95, 0.95, error, 59)
    assert words in sentence(found, "pulls", space="latent")
    assert "space" not in sentence(found, "pulls").replace("full space", "")


def test_motions_that_judged_an_earlier_model_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who trains until they are content has looked at them."""
    run = made(tmp_path)
    monkeypatch.setattr(snapshots, "run_motions", run_here)
    monkeypatch.setattr(statement, "run_motions", run_here)
    snapshot(run, motions(), base=tmp_path)
    pulls = PullOptions(count=1, reach=0.1, radius=0.5, frames=2, rest=0)
    seen = []
    for model, count in (("one", 2), ("one", 2), ("two", 2), ("two", 3)):
        statement._run_fresh(run, StatementOptions(motions=count, pulls=pulls), SILENT, model=model)
        seen.append(statement.judged_before(run, model))
    assert seen == [False, False, True, True]
    before = sentence(Bound(0.95, 0.95, 0.0463, 59), "pulls", before=True)
    assert "59 fresh ones that judged an earlier model too" in before and "nothing had seen" not in before


def test_fresh_motions_are_drawn_alike_and_independently() -> None:
    scene = scene_of(beam(0.3, 0.05, 0.05, 3, cell_type="hex8"))
    options = StatementOptions(motions=400, pulls=PullOptions(count=1, seed=7, reach=0.1, frames=10, rest=0))
    motions = fresh_motions(scene, options)
    drags = [motion.drags[0] for motion in motions]
    directions = np.array([drag.targets[-1] - drag.point for drag in drags])
    lengths = np.linalg.norm(directions, axis=1)
    assert 0.04 <= lengths.min() and lengths.max() <= 0.1 and lengths.mean() == pytest.approx(0.07, rel=0.05)
    # no direction is preferred: of n unit vectors the mean is of the size n^-1/2
    assert np.linalg.norm((directions / lengths[:, None]).mean(axis=0)) < 3 / math.sqrt(len(drags))
    # and none tells of the next
    following = np.einsum("ni,ni->n", directions[1:] / lengths[1:, None], directions[:-1] / lengths[:-1, None])
    assert abs(following.mean()) < 3 / math.sqrt(3 * len(following))
    assert len({tuple(drag.point) for drag in drags}) > 100
    again = fresh_motions(scene, options)
    assert all(np.array_equal(a.drags[0].targets, b.drags[0].targets) for a, b in zip(motions, again, strict=True))
    other = fresh_motions(scene, options.replace(pulls=options.pulls.replace(seed=8)))
    assert not np.array_equal(other[0].drags[0].targets, motions[0].drags[0].targets)


@pytest.fixture
def solvers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[FullOptions]]:
    """Of a run whose snapshots have some settings of the solver: those of fresh motions, where any are run."""
    run, ran = made(tmp_path), list[FullOptions]()
    options = StatementOptions(motions=2, pulls=PullOptions(count=1, reach=0.1, radius=0.5, frames=2, rest=0))

    def noted(scene: Path, folder: Path, motions: Any, solver: FullOptions, *_: Any, **__: Any) -> dict[str, str]:
        ran.append(solver)
        return run_here(scene, folder, motions, solver)

    def of(**settings: object) -> list[FullOptions]:
        snapshot(run, motions(**settings), base=tmp_path)
        ran.clear()
        statement._run_fresh(run, options, SILENT)
        return list(ran)

    monkeypatch.setattr(snapshots, "run_motions", run_here)
    monkeypatch.setattr(statement, "run_motions", noted)
    return of


def test_who_asks_for_more_fresh_motions_waits_for_those_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, ran = made(tmp_path), list[list[str]]()

    def noted(scene: Path, folder: Path, motions: Any, solver: FullOptions, *_: Any, **__: Any) -> dict[str, str]:
        ran.append([each.name for each in motions])
        return run_here(scene, folder, motions, solver)

    monkeypatch.setattr(snapshots, "run_motions", run_here)
    monkeypatch.setattr(statement, "run_motions", noted)
    snapshot(run, motions(), base=tmp_path)
    pulls = PullOptions(count=1, reach=0.1, radius=0.5, frames=2, rest=0)
    for count in (2, 3, 1):
        statement._run_fresh(run, StatementOptions(motions=count, pulls=pulls), SILENT)
    assert ran == [["fresh_0", "fresh_1"], ["fresh_2"], []]


def test_motions_that_the_full_space_loses_are_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is stated is of those that there is something to compare with, and says so."""
    run, told, going = made(tmp_path), list[str](), list[bool]()

    def losing(scene: Path, folder: Path, motions: Any, solver: FullOptions, *_: Any, **kept: Any) -> dict[str, str]:
        going.append(kept["going_on"])
        lost = [each for each in motions if each.name in bad]
        run_here(scene, folder, [each for each in motions if each not in lost], solver)
        return {each.name: f"motion {each.name}: frame 1: a cell is inverted" for each in lost}

    monkeypatch.setattr(snapshots, "run_motions", run_here)
    monkeypatch.setattr(statement, "run_motions", losing)
    snapshot(run, motions(), base=tmp_path)
    pulls = PullOptions(count=1, reach=0.1, radius=0.5, frames=2, rest=0)
    progress = Progress()
    monkeypatch.setattr(progress, "tell", told.append)

    def named(count: int) -> list[str]:
        statement._run_fresh(run, StatementOptions(motions=count, pulls=pulls), progress)
        with Snapshots(run.path("fresh"), kind="tests") as found:
            return list(found.names)

    bad = {"fresh_1"}
    assert named(3) == ["fresh_0", "fresh_2"] and statement.left_out(run) == 1
    assert told == [
        "note: the full space loses 1 of 3 fresh motions, which are left out of what is stated: motion fresh_1: frame "
        "1: a cell is inverted"
    ]
    assert named(4) == ["fresh_0", "fresh_2", "fresh_3"] and statement.left_out(run) == 1
    assert going and all(going)
    run.path("fresh").unlink()
    bad = {"fresh_0", "fresh_1"}
    with pytest.raises(LostMotionError, match="every fresh motion is lost: motion fresh_0: frame 1"):
        named(2)
    said = sentence(Bound(0.95, 0.95, 0.0463, 59), "pulls", lost=2)
    assert "59 fresh ones that nothing had seen; the full space itself lost 2 more, which are left out; pulls" in said


def test_as_many_fresh_motions_run_side_by_side_as_snapshots_and_by_their_linear_solver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, asked = made(tmp_path), list[tuple[str, int]]()
    monkeypatch.setattr(snapshots, "run_motions", run_here)
    snapshot(run, motions(), base=tmp_path)

    def noted(
        scene: Path, folder: Path, motions: Any, solver: FullOptions, workers: int, *_: Any, **__: Any
    ) -> dict[str, str]:
        asked.append((solver.linear_solver, workers))
        return run_here(scene, folder, motions, solver)

    monkeypatch.setattr(statement, "run_motions", noted)
    options = StatementOptions(motions=4, pulls=PullOptions(count=1, reach=0.1, radius=0.5, frames=2, rest=0))
    for how in (motions(workers=1, linear_solver="multigrid"), motions(workers=9), None):
        run.path("fresh").unlink(missing_ok=True)
        statement._run_fresh(run, options, SILENT, how)
    assert asked == [("multigrid", 1), ("direct", 4), ("direct", 2)]


def test_fresh_motions_are_solved_as_the_snapshots_are(solvers: Callable[..., list[FullOptions]]) -> None:
    (solver,) = solvers(method="newton", tolerance=1e-4, max_iterations=99)
    assert (solver.method, solver.tolerance, solver.max_iterations) == ("newton", 1e-4, 99)
    assert not solvers(method="newton", tolerance=1e-4, max_iterations=99)
    assert not solvers(method="newton", tolerance=1e-4, max_iterations=99, linear_solver="direct")
    assert len(solvers(method="newton", tolerance=1e-5, max_iterations=99)) == 1


@pytest.mark.parametrize("quasistatic", [False, True])
def test_fresh_motions_of_an_earlier_version_are_kept_where_the_solver_is_the_usual_one(
    solvers: Callable[..., list[FullOptions]], tmp_path: Path, quasistatic: bool
) -> None:
    solvers(quasistatic=quasistatic)
    with changed(tmp_path / "run" / "fresh.h5") as file:
        del file.attrs["solver"]
        file.attrs["quasistatic"] = int(quasistatic)
    assert not solvers(quasistatic=quasistatic)
    assert len(solvers(quasistatic=quasistatic, tolerance=1e-5)) == 1
