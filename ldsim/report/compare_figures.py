"""The figures of a comparison, from the records of its runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ldsim.report.figure import MARKERS, Axis, Figure, Series
from ldsim.report.schema import ROLE_NAMES, ROLES
from ldsim.run import REDUCED, SPACES

Record = Mapping[str, Any]
Point = tuple[float, float]


def comparison_figures(records: Sequence[Record]) -> dict[str, Figure]:
    """Name → the figures that there is something to draw in.

    Args:
        records: of `compare.record`.
    """
    names = tuple(record["name"] for record in records)
    rows, height = Axis(names=names), 1.5 + 0.42 * len(records)
    drawn = {
        "error_against_time": Figure(
            "Online error against the time of a step, linear and latent space of each run",
            Axis("median step, ms", log=True, margin=0.2),
            Axis("online error, %", log=True, margin=0.15),
            (*_links(records), *_online(records, lambda i, role, space: _place(records[i], role, space), names)),
            height=3.7,
        ),
        "online_errors": Figure(
            "Online errors of each run on training, validation and test motions",
            Axis("online error, % of the mean displacement", log=True, margin=0.1),
            rows,
            _online(records, lambda i, role, space: _beside(_error(records[i], role, space), i)),
            height=height,
        ),
        "step_times": Figure(
            "Time of a step of each run in the full, the linear and the latent space",
            Axis("median step, ms", log=True, margin=0.1),
            rows,
            tuple(
                _marks(space, space, [_beside(record["step_ms"][space], i) for i, record in enumerate(records)])
                for space in SPACES
            ),
            height=height,
        ),
    }
    some = {
        name: replace(one, series=tuple(series for series in one.series if series.x)) for name, one in drawn.items()
    }
    return {name: figure for name, figure in some.items() if figure.series}


def _online(
    records: Sequence[Record], place: Callable[[int, str, str], Point | None], labels: Sequence[str] = ()
) -> tuple[Series, ...]:
    """The marks of each reduced space and role, one a run; only those of test motions are full."""
    return tuple(
        _marks(
            f"{space}, {ROLE_NAMES[role]}",
            space,
            [place(i, role, space) for i in range(len(records))],
            labels if space == "latent" else (),
            role != "test",
        )
        for role in reversed(ROLES)
        for space in REDUCED
    )


def _marks(
    name: str, space: str, places: Sequence[Point | None], labels: Sequence[str] = (), hollow: bool = False
) -> Series:
    """One mark a run where there is a place for it."""
    x, y = zip(*filter(None, places), strict=True) if any(places) else ((), ())
    kept = tuple(label for label, place in zip(labels, places, strict=False) if place)
    return Series(name, space, x, y, "marks", MARKERS[space], dashed=hollow, labels=kept)


def _links(records: Sequence[Record]) -> list[Series]:
    """From each run's linear to its latent space."""
    ends = [[_place(record, role, space) for space in REDUCED] for record in records for role in ROLES]
    return [Series("", "ink", (start[0], end[0]), (start[1], end[1]), "link") for start, end in ends if start and end]


def _place(record: Record, role: str, space: str) -> Point | None:
    """Step time and error; None where one is not known."""
    step, error = record["step_ms"][space], _error(record, role, space)
    return (step, error) if step and error else None


def _beside(value: float | None, row: int) -> Point | None:
    return (value, row) if value else None


def _error(record: Record, role: str, space: str) -> float | None:
    """The online error in per cent; None where it is not known, or 0, which a logarithmic axis has no place for."""
    relative = (record["online"][role][space] or {}).get("relative")
    return 100 * float(relative) if relative else None
