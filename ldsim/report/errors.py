"""Errors as reports give them: lengths are in metres everywhere else and in millimetres there."""

from __future__ import annotations

from dataclasses import dataclass

MM_PER_M = 1000.0


@dataclass(frozen=True)
class ErrorSummary:
    """Largest and mean vertex distance over a set of poses, millimetres."""

    max_mm: float
    mean_mm: float
