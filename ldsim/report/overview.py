"""Runs in a few lines, for the terminal: how far each has come, how good it is, what its report warns of."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

from ldsim.artefacts.store import STAGE_OF, file_hash
from ldsim.errors import ArtefactError
from ldsim.report.schema import RunNumbers, check_report
from ldsim.report.verdict import states
from ldsim.run import REDUCED

PAGE, NUMBERS = Path("report") / "report.html", Path("report") / "report.json"
# What is played and exported; the report tells of those that it was made from.
USED = ("model", "cubature", "simulation")
COLUMNS = ("run", "state", "cells", "verdict", "space", "error", "step", "changed")


def listed(runs: Path) -> list[str]:
    """A table of all runs in a folder, newest last: the verdict, and the numbers of the report's headline.

    Raises:
        ArtefactError: the folder has no run.
    """
    folders = [path for path in runs.iterdir() if (path / "scene.h5").is_file()] if runs.is_dir() else []
    if not folders:
        raise ArtefactError(f"{runs} holds no run; `ldsim make CONFIG` makes one, or say where they lie with --runs")
    rows = [COLUMNS, *(_row(path) for path in sorted(folders, key=_changed))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{text:{width}}" for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def told(folder: Path) -> list[str]:
    """What there is to say of a run: the statement, the state, the main numbers, and the warnings of its report.

    Raises:
        ArtefactError: the folder is no run.
    """
    if not (folder / "scene.h5").is_file():
        raise ArtefactError(f"{folder} is not the folder of a run; give one such as runs/demo, or an artefact's file")
    numbers = report_of(folder)
    if numbers is None:
        return [f"{folder}: {state(folder)}"]
    lines = [f"{numbers.verdict.word}: {numbers.verdict.why}"]
    if is_outdated(folder, numbers):
        lines.insert(0, "warning: what the report tells of was made anew since; `ldsim make CONFIG` makes a new one")
    lines += [] if numbers.statement is None else [numbers.statement.sentence]
    lines.append(
        f"{folder}: {state(folder)}, reported {numbers.created}; {numbers.mesh.cells} {numbers.mesh.cell_type} cells, "
        f"r {numbers.dims.r}, k {numbers.dims.k}"
    )
    for run in numbers.simulate.latent:
        error = run.online_error.relative if run.online_error else None
        found = "no error known" if error is None else f"{100 * error:.3g} % from the full space"
        step = "" if run.median_step_ms is None else f", {1000 * run.median_step_ms:.3g} µs a step"
        lines.append(f"  {run.motion} ({run.role}): {'diverged' if run.diverged else found}{step}")
    return [*lines, *(f"  {line}" for line in read_first(numbers)), f"  {(folder / PAGE).resolve()}"]


def read_first(numbers: RunNumbers) -> list[str]:
    """The warnings, the advice and what to change, as the page of a report has them."""
    turn = (f"to change: {text}" for text in numbers.remedies)
    return [*(f"warning: {text}" for text in numbers.warnings), *numbers.advice, *turn]


def missed(folder: Path, percent: float | None = None, microseconds: float | None = None) -> list[str]:
    """What is to be said where the stated error or a step of the latent space is not known, or not as asked for."""
    numbers, words = report_of(folder), []
    if percent is not None:
        found = numbers.statement.latent.error if numbers is not None and numbers.statement is not None else None
        if numbers is None or numbers.statement is None:
            words.append("no error is stated: set simulate.statement, which says of what motions")
        elif found is None or 100 * found > percent:
            reached = "fresh motions were lost" if found is None else f"the stated error is {100 * found:.3g} %"
            turn = "the report says what to change"
            if not numbers.remedies and numbers.kind == "autoencoder":
                turn = "an autoencoder is not extended; train.kind: condensed is"
            elif not numbers.remedies:
                turn = "with longer `--minutes`, or for a smaller error, it goes on learning"
            words.append(f"{reached}, asked were {percent:g} %; {turn}")
    if microseconds is not None:
        run = None if numbers is None else numbers.headline_runs().get("latent")
        if run is None or run.median_step_ms is None:
            words.append("no time of a step is known: run all stages")
        elif 1000 * run.median_step_ms > microseconds:
            assert numbers is not None
            points = "train.condensed.points" if numbers.kind == "condensed" else "cubature.virtual.points"
            words.append(
                f"a step takes {1000 * run.median_step_ms:.3g} µs, asked were {microseconds:g}; fewer of "
                f"train.hidden, {points} and train.r make it faster"
            )
    return words


def page_of(folder: Path) -> Path:
    """The report of a run.

    Raises:
        ArtefactError: there is none yet.
    """
    if not (folder / PAGE).is_file():
        raise ArtefactError(f"{folder} has no report yet ({state(folder)}); run `ldsim make CONFIG` to its end")
    return (folder / PAGE).resolve()


def state(folder: Path) -> str:
    """How far a run has come: the last stage whose artefact is there, with all before it."""
    stage = ""
    for kind, name in STAGE_OF.items():
        if not (folder / f"{kind}.h5").is_file():
            unfinished = any(folder.glob(f"{kind}.partial/*"))
            return f"done up to {stage}" + (f", {name} begun" if unfinished else "") if stage else "nothing done"
        stage = name
    return "finished" if (folder / PAGE).is_file() else f"done up to {stage}"


def is_outdated(folder: Path, numbers: RunNumbers) -> bool:
    """Whether what lies beside a report is not what it tells of."""
    there = (kind for kind in USED if (folder / f"{kind}.h5").is_file())
    return any(numbers.made_from.inputs.get(kind) != file_hash(folder / f"{kind}.h5") for kind in there)


def report_of(folder: Path) -> RunNumbers | None:
    """The numbers of a run's report; None where there is none that this version reads."""
    try:
        return read_report(folder)
    except ArtefactError:
        return None


def read_report(folder: Path) -> RunNumbers:
    """The numbers of a run's report.

    Raises:
        ArtefactError: it is missing, unreadable or of another version.
    """
    path = folder / NUMBERS
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ArtefactError(f"{path} does not exist; run `ldsim report CONFIG` of that run first") from error
    except (OSError, ValueError, RecursionError) as error:
        raise ArtefactError(f"{path} cannot be read: {error}; run `ldsim report CONFIG` of that run again") from error
    violations = check_report(content)
    if violations:
        more = f" (and {len(violations) - 1} more)" if len(violations) > 1 else ""
        raise ArtefactError(
            f"{path} is not what this version of ldsim writes: {violations[0]}{more}; "
            "run `ldsim report CONFIG` of that run again"
        )
    return RunNumbers.model_validate(content)


def _row(folder: Path) -> tuple[str, ...]:
    numbers, changed = report_of(folder), datetime.fromtimestamp(_changed(folder), UTC).strftime("%Y-%m-%d %H:%M")
    if numbers is None:
        return folder.name, state(folder), "", "", "", "", "", changed
    run = numbers.headline()
    error = run.online_error if run else None
    if states(numbers.statement) and numbers.space in REDUCED:
        error = numbers.statement[numbers.space].error
    percent = "" if error is None else f"{100 * error:.2g} %"
    step = f"{1000 * run.median_step_ms:.2g} µs" if run and run.median_step_ms is not None else ""
    space = f"{'latent' if numbers.space == 'latent' else 'linear'} {run.dimension}" if run else ""
    how_far = "report is outdated" if is_outdated(folder, numbers) else state(folder)
    return folder.name, how_far, str(numbers.mesh.cells), numbers.verdict.word, space, percent, step, changed


def _changed(folder: Path) -> float:
    """When its newest artefact was written."""
    return max(path.stat().st_mtime for path in folder.glob("*.h5"))
