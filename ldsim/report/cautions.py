"""What a reader of a report must know before the numbers: derived from the report itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldsim.report.html import readable

LARGE_ONLINE_ERROR = 0.1
HELDOUT_GAP = 3.0


def cautions(report: Mapping[str, Any], cubature_tolerance: float | None = None) -> list[str]:
    """Warnings that report.json alone can tell, the gravest first.

    Args:
        report: as `check_report` accepts it.
        cubature_tolerance: relative error that was asked of cubature; None skips that check.

    Returns:
        Sentences: diverged runs, held-out motions missed by more than 10 %, latent steps slower than linear
        ones, cubature worse than asked for, and spaces that reconstruct held-out frames three times worse than those
        they were trained on.
    """
    return [
        *_diverged(report),
        *_large_online_errors(report),
        *_slower_than_linear(report),
        *_cubature_misses(report, cubature_tolerance),
        *_reconstruction_gaps(report),
    ]


def _diverged(report: Mapping[str, Any]) -> list[str]:
    return [
        f"The {space} run of motion {run['motion']} diverged; its times end where it did, and it has no errors."
        for space, runs in report["simulate"].items()
        for run in runs
        if run["diverged"]
    ]


def _large_online_errors(report: Mapping[str, Any]) -> list[str]:
    found = []
    for space, runs in report["simulate"].items():
        for run in runs:
            error = (run["online_error"] or {}).get("relative")
            if run["role"] == "heldout" and error is not None and error > LARGE_ONLINE_ERROR:
                found.append(
                    f"On motion {run['motion']}, which nothing was fitted to, the {space} run is "
                    f"{readable(100 * error)} % of the mean displacement away from full space."
                )
    return found


def _slower_than_linear(report: Mapping[str, Any]) -> list[str]:
    faster = report["speedup"]["latent_over_linear"]
    if faster is None or faster >= 1:
        return []
    return [
        f"A latent step takes {readable(1 / faster)} times as long as a step in the linear space that holds the "
        "training poses as well."
    ]


def _cubature_misses(report: Mapping[str, Any], tolerance: float | None) -> list[str]:
    found = []
    for space, cubature in report["cubature"].items():
        reached = cubature and cubature["relative_error"]["train"]
        if tolerance is not None and reached is not None and reached > tolerance:
            found.append(
                f"Cubature of the {space} space stopped at a relative error of {readable(reached)}; "
                f"{tolerance:g} was asked for."
            )
    return found


def _reconstruction_gaps(report: Mapping[str, Any]) -> list[str]:
    train, heldout = (report["reconstruction"][role] or {} for role in ("train", "heldout"))
    seen, unseen = ((errors.get("autoencoder") or {}).get("max_mm") for errors in (train, heldout))
    if seen is None or unseen is None or unseen <= HELDOUT_GAP * seen:
        return []
    return [
        f"The autoencoder misses held-out frames by up to {readable(unseen)} mm, against {readable(seen)} mm on the "
        "frames it was trained on."
    ]
