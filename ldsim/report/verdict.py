"""What a report comes to in a word: whether the space that simulate chose is good enough, and why."""

from __future__ import annotations

from typing import TypeGuard

from ldsim.dynamics.trajectory import LARGE_ONLINE_ERROR
from ldsim.report.schema import ROLE_NAMES, ROLES, FrontierRun, RunNumbers, Statement, Verdict
from ldsim.report.wording import counted, readable

# Beyond this online error a motion is another one.
USELESS_ONLINE_ERROR = 0.3
# The share of motions that a statement has to be of.
MOST = 0.8


def verdict(report: RunNumbers) -> Verdict:
    """In a word, by the worst motion of the role that judges, or by the statement where there is one."""
    role = max((run.role for run in report.frontier), key=ROLES.index, default="train")
    runs = [run for run in report.frontier if run.space == report.space and run.role == role]
    name = "latent space" if report.space == "latent" else "linear space"
    told = f"the {name} of {counted(runs[0].dimension or 0, 'number')}" if runs else f"the {name}"
    error, where = _error(report, runs)
    stated = report.statement
    if error is None and states(stated) and report.space in ("latent", "linear"):
        why = f"{told} was lost in {stated[report.space].lost} of {stated.motions} fresh motions."
        return Verdict(word="do not use", why=why)
    if error is None:
        own = report.simulate[report.space] if report.space in ("latent", "linear") else []
        lost = any(run.diverged for run in own)
        if report.space != "latent":  # without an error it was lost, if there was anything to be judged by
            lost |= bool(runs) and any(run.online_error is not None for run in report.frontier)
        return Verdict(
            word="do not use" if lost else "not judged",
            why=f"{told} {'was lost' if lost else 'has no full-space run to be judged by'}.",
        )
    good, usable = error <= LARGE_ONLINE_ERROR, error <= USELESS_ONLINE_ERROR
    why = f"{told} stays within {readable(100 * error)} % {where}{_beside_full(report)}."
    return Verdict(word="good" if good else "usable" if usable else "do not use", why=why)


def states(statement: Statement | None) -> TypeGuard[Statement]:
    """Whether a statement is of most motions: from a few fresh ones it is of a share that says little."""
    return statement is not None and (statement.quantile or 0) >= MOST


def _error(report: RunNumbers, runs: list[FrontierRun]) -> tuple[float | None, str]:
    """What the space stays within, and of what; None where it was lost or nothing is known."""
    statement = report.statement
    if states(statement) and report.space in ("latent", "linear"):
        share, sure = (f"{100 * (each or 0):.3g} %" for each in (statement.quantile, statement.confidence))
        return statement[
            report.space
        ].error, f"of how far fresh motions move it, in {share} of them ({sure} confidence)"
    errors = [run.online_error for run in runs]
    if not errors or any(error is None for error in errors):
        return None, ""
    seen = {
        "train": "which it learned from",
        "validation": "which choices were made by",
        "test": "which nothing had seen",
    }
    about = f"of the mean displacement on the {ROLE_NAMES[runs[0].role]} motions, {seen[runs[0].role]}"
    return max(error for error in errors if error is not None), about


def _beside_full(report: RunNumbers) -> str:
    """How a step compares with one of the full space, in the numbers of the headline."""
    run, ratio = report.headline(), report.speedup.chosen_over_full
    if run is None or run.median_step_ms is None or ratio is None:
        return ""
    said = f"in {readable(ratio)} times less time than" if ratio > 1 else "and no faster than"
    return f"; it steps in {readable(run.median_step_ms)} ms, {said} the full space"
