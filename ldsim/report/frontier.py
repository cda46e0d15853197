"""Every reduced space of a run beside the others: error against time, and in one sentence which to use."""

from __future__ import annotations

from collections.abc import Sequence

from ldsim.pipeline.choice_of_space import NEARLY, Standing, judging, standings
from ldsim.pipeline.options import SimulateOptions
from ldsim.report.figure import MARKERS, Axis, Figure, Series
from ldsim.report.runs import runs
from ldsim.report.schema import ROLE_NAMES, ROLES
from ldsim.report.wording import counted, readable
from ldsim.run import AUTO, Run

MS_PER_S = 1000.0


def spaces(run: Run) -> list[str]:
    """The reduced spaces that were run: latent, then the linear ones by falling dimension."""
    linear = [name for name in run.simulation if name not in ("full", "latent")]
    return ["latent", *sorted(linear, key=lambda name: -dimension(run, name))]


def dimension(run: Run, space: str) -> int:
    """How many numbers a reduced space moves by."""
    if space == "latent":
        return run.model.decoder.r
    return run.model.kp if space == "linear" else int(space.removeprefix("linear_"))


def points(run: Run, space: str) -> int | None:
    """The quadrature points of the rule that simulate stepped a space with."""
    found = run.header("simulation").notes.get(f"{space}_points")
    return None if found is None else int(found)


def on_role(run: Run, role: str) -> list[Standing]:
    """Every reduced space on all motions of a role together."""
    return judged(run, (role,))[1]


def on_motions(run: Run, names: Sequence[str]) -> list[Standing]:
    """Every reduced space on some motions together."""
    return standings({space: runs(run, space) for space in spaces(run)}, names)


def judged(run: Run, order: Sequence[str]) -> tuple[str, list[Standing]]:
    """The first of some roles that a motion has, on which the spaces are compared, and how they did."""
    roles = {name: recorded.role for name, recorded in run.motions.items() if name in run.simulation["latent"]}
    names = judging(roles, order)
    return roles[names[0]] if names else order[-1], on_motions(run, names)


def told(run: Run, found: Standing) -> str:
    """A space in words, such as `the linear space of 28 columns`."""
    count = dimension(run, found.space)
    latent = found.space == "latent"
    return f"the {'latent' if latent else 'linear'} space of {counted(count, 'number' if latent else 'column')}"


def advice(run: Run) -> list[str]:
    """Which space to use for this solid, in one sentence; none where no error is known."""
    role, found = judged(run, ("validation", "train"))
    space = str(run.header("simulation").notes.get("space", "latent"))
    use = next((each for each in found if each.space == space), None)
    if use is None:
        return []
    if not any(each.error < float("inf") for each in found):
        return [f"Every space diverged on the {ROLE_NAMES[role]} motions, so none is to be used."]
    rival = _rival(use, found)
    beside = f"; {_measured(run, rival)}" if rival is not None else ""
    on = f"on the {ROLE_NAMES[role]} motions{beside}."
    if SimulateOptions.of_dump(run.header("simulation").settings).space != AUTO:
        return [f"As simulate.space says, used is {_measured(run, use)}, {on}"]
    least = f"Chosen as the fastest within {NEARLY:g} times the least error."
    return [f"For this solid use {_measured(run, use)}, {on} {least}"]


def _rival(use: Standing, found: Sequence[Standing]) -> Standing | None:
    """Of the other kind, the one of least error."""
    others = [each for each in found if (each.space == "latent") != (use.space == "latent")]
    return min(others, key=lambda each: each.error, default=None)


def _measured(run: Run, found: Standing) -> str:
    error = "diverged" if found.error == float("inf") else f"{readable(100 * found.error)} % off"
    return f"{told(run, found)} ({error} at {readable(MS_PER_S * found.seconds)} ms a step)"


def frontier_figure(run: Run) -> Figure | None:
    """Error against the time of a step of every reduced space, for the validation and the test motions."""
    series = []
    for role in (role for role in ROLES if role != "train"):
        found = [each for each in on_role(run, role) if 0 < each.error < float("inf")]
        for space in ("linear", "latent"):
            mine = [each for each in found if (each.space == "latent") == (space == "latent")]
            if mine:
                series.append(_marks(run, f"{space}, {ROLE_NAMES[role]}", space, mine, role))
    if not series:
        return None
    return Figure(
        "Online error against the time of a step: every size of the linear space beside the latent one",
        Axis("median step, ms", log=True, margin=0.15),
        Axis("online error, %", log=True, margin=0.15),
        tuple(series),
        height=3.5,
    )


def _marks(run: Run, name: str, space: str, found: Sequence[Standing], role: str) -> Series:
    ordered = sorted(found, key=lambda each: dimension(run, each.space))
    x = tuple(float(f"{MS_PER_S * each.seconds:.7g}") for each in ordered)
    y = tuple(float(f"{100 * each.error:.7g}") for each in ordered)
    labels = tuple(str(dimension(run, each.space)) for each in ordered) if role == "test" else ()
    return Series(name, space, x, y, "marks", MARKERS[space], dashed=role != "test", labels=labels)
