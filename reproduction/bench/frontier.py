"""Error against the time of a step of every reduced space of a solid, three seeds or fewer, the same treatment for all.

    python -m reproduction.bench.frontier configs/demo.yaml

A condensed space by the configuration, and an autoencoder on the same scene and motions, with what
reproduction/bench/autoencoders.yaml says of the solid; its basis is that of all spaces. Weights, poses, candidates and
virtual points depend on the seed, so each seed trains and fits anew. The linear spaces are those of the autoencoder:
the same synthetic motions in their basis, the same fits, closures that are judged, and the same stop. First everything
is made; then the motions are run in one space after another, with nothing else at work. `--again` runs them anew where
that was not so. With `--farther 1.5` the synthetic pulls go half as far again, as own pulls of a condensed space do;
their experiment is <experiment>_far, without a condensed space. Beside a condensed space stand two floors, the errors
of linear elasticity in the full space and in the condensed one, which tell how nonlinear each motion is. Results go to
reproduction/results/frontier_<experiment>.json.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from ldsim.errors import SettingsError
from ldsim.pipeline.choice_of_space import LATENT, Standing, equal_error
from ldsim.report.frontier import dimension, on_motions, points
from ldsim.report.schema import ROLES
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.settings import Settings, load_settings, settings_of
from reproduction.bench.condensed import asked, floors
from reproduction.harness import PIPELINE, ROOT, Row, called, finished, linked, parser, row, show, write_results

NAME, OTHERS = "frontier", ROOT / "reproduction" / "bench" / "autoencoders.yaml"
SEEDS = (1, 2, 3)
ONCE = ("mesh", "snapshot", "pca")
SHARED = ("scene", "snapshots", "tests", "basis")
COLOURS = {"linear": "linear", "condensed": "latent", "autoencoder": "second"}
STEP, ERROR = "median step", "online error"
MEASURED = re.compile(rf"{STEP}, (.+), (\w+) (\d+), .*, seed (\d+)")  # motions, kind, dimension and seed
# Where the number of a mark may stand beside it, points.
CORNERS = ((8, 6), (8, -6), (-8, 6), (-8, -6))
NUMBERS = {1: "one seed", 2: "two seeds", 3: "three seeds"}
SUMMED = re.compile("error, |step, |.* over ")  # what has a range over the seeds


def compared_with(condensed: Settings) -> Settings:
    """The autoencoder of the same scene and motions, in the basis that all spaces have."""
    others = yaml.safe_load(OTHERS.read_text(encoding="utf-8"))
    if condensed.experiment not in others:
        raise SettingsError(f"{OTHERS.name} has no {condensed.experiment}; it has {', '.join(others)}")
    same = condensed.model_dump(mode="json", include={"experiment", "mesh", "snapshot"}, exclude_unset=True)
    return settings_of(same | others[condensed.experiment], OTHERS.name)


def seeded(settings: Settings, seed: int, first: Settings) -> Settings:
    """A configuration with another seed, in the basis of `first`, whose linear sizes no other one fits again."""
    cubature = settings.cubature.replace(seed=seed)
    if settings is not first:
        cubature = cubature.replace(linear_sizes=())
    train = settings.train.replace(seed=seed)
    return settings.model_copy(update={"pca": first.pca, "train": train, "cubature": cubature})


def farther(settings: Settings, times: float) -> Settings:
    """A configuration whose synthetic pulls go so many times as far, of an experiment of its own."""
    synthetic = settings.pca.synthetic
    if times == 1 or synthetic is None:
        return settings
    pca = settings.pca.replace(synthetic=synthetic.replace(reach=times * synthetic.reach))
    return settings.model_copy(update={"experiment": f"{settings.experiment}_far", "pca": pca})


def made(
    kinds: Sequence[Settings], base: Path, runs: Path, again: bool, seeds: Sequence[int] = SEEDS
) -> Iterator[tuple[str, int, Path]]:
    """Kind, seed and folder of every run, all made before the first is stepped.

    Args:
        kinds: a configuration for each kind of latent space; the first has the basis and the linear spaces.
        base: the folder that their paths are relative to.
    """
    wanted, first = [], kinds[0]
    shared = finished(runs / first.experiment, first, ONCE, base)
    for settings in kinds:
        for seed in seeds:
            folder = linked(shared, runs / f"{first.experiment}_{settings.train.kind}_{seed}", SHARED)
            own = seeded(settings, seed, first)
            finished(folder, own, ("train", "cubature"), base)
            wanted.append((settings.train.kind, seed, folder, own))
    for kind, seed, folder, own in wanted:
        if again:
            (folder / "simulation.h5").unlink(missing_ok=True)
        yield kind, seed, finished(folder, own, ("simulate",), base)


def rows_of(model: str, kind: str, seed: int, run: Run, linear: bool) -> list[Row]:
    """What a run measured of its latent space, and of its linear ones where they are wanted."""
    rows = []
    for motions, names, spaces in judged(run):
        learned = run.motions[names[0]].role == "train"
        for found in spaces:
            latent = found.space == "latent"
            if latent or linear:
                sizes = f"{dimension(run, found.space)}, {points(run, found.space)} points"
                label = f"{motions}, {kind if latent else 'linear'} {sizes}, seed {seed}"
                goal = asked(model, names) if latent and kind == "condensed" and not learned else None
                rows.append(row(model, f"{ERROR}, {label}", found.error, "", goal))
                rows.append(row(model, f"{STEP}, {label}", 1e3 * found.seconds, "ms"))
    return rows


def judged(run: Run) -> Iterator[tuple[str, list[str], list[Standing]]]:
    """Every space on the motions of a role together, and on each of them where a role has several: label, motions."""
    for role in ROLES:
        names = [name for name in run.simulation["latent"] if run.motions[name].role == role]
        if names:
            yield role, names, on_motions(run, names)
        for name in names if len(names) > 1 else ():
            yield f"{name} ({role})", [name], on_motions(run, [name])


def compared(model: str, rows: Sequence[Row]) -> list[Row]:
    """Every latent space beside the linear ones of its seed, and the best of those, from the rows of all runs."""
    found = []
    for motions in dict.fromkeys(told[1] for r in rows if (told := MEASURED.fullmatch(r["quantity"]))):
        own = list(marks(rows, motions))
        for seed in sorted({mark.seed for mark in own}):
            linear = [standing(mark) for mark in own if mark.seed == seed and mark.kind == "linear"]
            if best := min(linear, key=lambda each: each.error, default=None):
                found += error_and_step(model, f"{motions}, best linear, seed {seed}", best)
            for mark in (mark for mark in own if mark.seed == seed and mark.kind != "linear"):
                latent, equal, best = equal_error([standing(mark), *linear])
                label = f"{motions}, {mark.kind}, seed {seed}"
                found += error_and_step(model, label, standing(mark))
                if latent is not None and best is not None and math.isfinite(latent.error):
                    ratio = math.nan if equal is None else equal.seconds / latent.seconds
                    found.append(row(model, f"linear step over latent step at equal error, {label}", ratio))
                    found.append(
                        row(model, f"least linear error over latent error, {label}", best.error / latent.error)
                    )
    return found


def standing(mark: Mark) -> Standing:
    """A mark as what the choice of a space compares."""
    return Standing("linear" if mark.kind == "linear" else LATENT, mark.error, mark.ms / 1e3)


def error_and_step(model: str, label: str, found: Standing) -> list[Row]:
    """The two rows of a space that stand beside those of others."""
    return [
        row(model, f"error, {label}", found.error),
        row(model, f"step, {label}", 1e6 * found.seconds, "µs"),
    ]


def over_seeds(model: str, rows: Sequence[Row], seeds: Sequence[int] = SEEDS) -> list[Row]:
    """Of every ratio, error and step the least, the middle one and the largest, where no seed lacks it.

    A seed has no ratio of steps where no linear space is as good, none of errors where all linear spaces were lost, and
    no rows of either where the latent space was.
    """
    found: list[Row] = []
    names = dict.fromkeys(r["quantity"].rsplit(", seed", 1)[0] for r in rows if SUMMED.match(r["quantity"]))
    for name in names:
        values = [r["value"] for r in rows if r["quantity"].startswith(f"{name}, seed")]
        if len(values) < len(seeds) or None in values:
            found.append(row(model, f"{name}, seeds in which the latent space was lost", len(seeds) - len(values)))
            found.append(row(model, f"{name}, seeds that have none", values.count(None)))
            continue
        for what, value in zip(("least", "middle", "largest"), np.quantile(values, (0, 0.5, 1)), strict=True):
            found.append(row(model, f"{name}, {what}", float(value)))
    return found


class Mark(NamedTuple):
    """A space of one seed: kind, dimension, seed, median step in ms and online error."""

    kind: str
    dimension: int
    seed: int
    ms: float
    error: float


def marks(rows: Sequence[Row], motions: str) -> Iterator[Mark]:
    """Every space on the motions of a role, or on one of them; the error of one that was lost is infinite."""
    value = {r["quantity"]: r["value"] for r in rows}
    for name, ms in value.items():
        if (told := MEASURED.fullmatch(name)) and told[1] == motions:
            error = value[name.replace(STEP, ERROR, 1)]
            ms, error = math.nan if ms is None else ms, math.inf if error is None else error
            yield Mark(told[2], int(told[3]), int(told[4]), ms, error)


def picture(rows: Sequence[Row], model: str) -> str:
    """Online error on the test motions against the median step: every space, every seed."""
    figure, ax = new_axes("median step, ms; numbers: dimension", "online error, test motions, %", height=3.6)
    named, all_marks = set(), [mark for mark in marks(rows, "test") if math.isfinite(mark.error)]
    for mark in all_marks:
        label = "" if mark.kind in named else mark.kind
        ax.plot(mark.ms, 100 * mark.error, "o", color=PALETTE[COLOURS[mark.kind]], markersize=4, label=label)
        named.add(mark.kind)
    for axis in "xy":
        log_scale(ax, axis)
    legend(ax)
    taken = list(ax.transData.transform([(mark.ms, 100 * mark.error) for mark in all_marks]))
    for mark in (each for each in all_marks if each.seed == SEEDS[0]):  # the other seeds differ by a column or two
        at, pixels = (mark.ms, 100 * mark.error), figure.dpi / 72
        here = ax.transData.transform(at)
        ways = [(corner, here + pixels * np.array(corner)) for corner in CORNERS]
        corner, place = max(ways, key=lambda way: min(math.dist(way[1], other) for other in taken))
        taken.append(place)
        ax.annotate(
            str(mark.dimension), at, corner, textcoords="offset points", ha="center", va="center", fontsize=7,
            color=PALETTE[COLOURS[mark.kind]],
        )  # fmt: skip
    seeds = NUMBERS[len({mark.seed for mark in all_marks})]
    return to_svg(figure, f"Online error on the test motions of {model} against the median time of a step, {seeds}")


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("configuration", type=Path, help="of a condensed space")
    arguments.add_argument("--runs", type=Path, default=Path("runs") / NAME, help="where runs lie")
    arguments.add_argument("--seeds", type=int, choices=SEEDS, default=len(SEEDS), help="how many of them")
    arguments.add_argument("--again", action="store_true", help="step the motions anew")
    arguments.add_argument("--farther", type=float, default=1.0, help="synthetic pulls go so many times as far")
    given = arguments.parse_args()
    condensed = load_settings(given.configuration)
    other = farther(compared_with(condensed), given.farther)
    kinds = [other, condensed] if given.farther == 1 else [other]
    rows, model, seen, seeds = list[Row](), other.experiment, set[int](), SEEDS[: given.seeds]
    for kind, seed, folder in made(kinds, given.configuration.parent, given.runs.resolve(), given.again, seeds):
        with Run.open(folder) as run:
            rows += rows_of(model, kind, seed, run, linear=seed not in seen)
            seen.add(seed)
            if kind == "condensed" and seed == SEEDS[0]:
                for motion in run.played.names:
                    rows += floors(run, motion, f"{motion} ({run.recorded(motion).role})")
    rows += compared(model, rows)
    rows += over_seeds(model, rows, seeds)
    show(rows, model)
    own = [str(path.resolve().relative_to(ROOT)) for path in (given.configuration, OTHERS)]
    write_results(f"{NAME}_{model}", called(NAME), rows, inputs=[*PIPELINE, *own])


if __name__ == "__main__":
    main()
