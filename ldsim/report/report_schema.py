"""What report.json must look like: one table, and the check of a report against it.

The table is the contract for every program that reads a run. A value that was not measured is null, never missing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")
SPACES = ("full", "linear", "latent")
ROLES = ("train", "heldout")
METHODS = ("autoencoder", "pca_r", "pca_kp", "pca_k")


class Shape(ABC):
    """What one value of a report may be."""

    @abstractmethod
    def violations(self, value: object, path: str) -> list[str]:
        """What is wrong with `value`, one sentence each, naming `path`; empty when nothing is."""


@final
@dataclass(frozen=True)
class Scalar(Shape):
    """A string, number, whole number or truth value; numbers must be finite, because JSON knows no other."""

    types: tuple[type, ...]
    name: str
    nullable: bool = False
    choices: tuple[str, ...] = ()

    def violations(self, value: object, path: str) -> list[str]:
        allowed = f"one of {', '.join(self.choices)}" if self.choices else self.name
        allowed += " or null" if self.nullable else ""
        finite = not (isinstance(value, float) and not math.isfinite(value))
        known = not self.choices or value in self.choices
        # A bool is an int to Python, but not to JSON: compare the type itself.
        good = type(value) in self.types and finite and known
        return [] if good or (self.nullable and value is None) else [f"{path} is {value!r}; expected {allowed}"]


@final
@dataclass(frozen=True)
class Record(Shape):
    """An object with exactly these keys."""

    fields: Mapping[str, Shape]
    nullable: bool = False

    def violations(self, value: object, path: str) -> list[str]:
        if value is None and self.nullable:
            return []
        if not isinstance(value, Mapping):
            return [f"{path or 'the report'} is {value!r}; expected an object with keys {', '.join(self.fields)}"]
        found = [f"{_join(path, key)} is missing" for key in self.fields if key not in value]
        found += [
            f"{_join(path, str(key))} is unknown; known are {', '.join(self.fields)}"
            for key in value
            if key not in self.fields
        ]
        for key, shape in self.fields.items():
            if key in value:
                found += shape.violations(value[key], _join(path, key))
        return found


@final
@dataclass(frozen=True)
class Table(Shape):
    """An object with any keys, or any of some keys, whose values are all alike."""

    values: Shape
    keys: tuple[str, ...] = ()

    def violations(self, value: object, path: str) -> list[str]:
        if not isinstance(value, Mapping):
            return [f"{path} is {value!r}; expected an object"]
        found = []
        for key, entry in value.items():
            if self.keys and key not in self.keys:
                found.append(f"{_join(path, str(key))} is unknown; known are {', '.join(self.keys)}")
            else:
                found += self.values.violations(entry, _join(path, str(key)))
        return found


@final
@dataclass(frozen=True)
class Sequence(Shape):
    """A list whose entries are all alike; it may be empty."""

    entries: Shape

    def violations(self, value: object, path: str) -> list[str]:
        if not isinstance(value, list):
            return [f"{path} is {value!r}; expected a list"]
        return [text for i, entry in enumerate(value) for text in self.entries.violations(entry, f"{path}[{i}]")]


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


TEXT = Scalar((str,), "a string")
TEXT_OR_NULL = Scalar((str,), "a string", nullable=True)
NUMBER = Scalar((int, float), "a finite number", nullable=True)
COUNT = Scalar((int,), "a whole number", nullable=True)
TRUTH = Scalar((bool,), "true or false")

ERRORS = Record({"max_mm": NUMBER, "mean_mm": NUMBER}, nullable=True)
RECONSTRUCTION = Record(dict.fromkeys(METHODS, ERRORS), nullable=True)
FORCE_ERROR = Record({"train": NUMBER, "heldout": NUMBER})
CUBATURE = Record(
    {
        "points": COUNT,
        "relative_error": FORCE_ERROR,
        "virtual": Record({"points": COUNT, "relative_error": FORCE_ERROR}, nullable=True),
        "seconds": NUMBER,
    },
    nullable=True,
)
ONLINE_ERROR = Record({"relative": NUMBER, "windowed": NUMBER, "max_mm": NUMBER, "mean_mm": NUMBER}, nullable=True)
TRUST = Record(
    dict.fromkeys(("median", "threshold", "distrusted", "rank_correlation", "rank_correlation_remembered"), NUMBER),
    nullable=True,
)
SIMULATION = Record(
    {
        "motion": TEXT,
        "role": Scalar((str,), "a string", choices=ROLES),
        "frames": COUNT,
        "median_step_ms": NUMBER,
        "p95_step_ms": NUMBER,
        "iterations": NUMBER,
        "evaluations": NUMBER,
        "online_error": ONLINE_ERROR,
        "trust": TRUST,
        "diverged": TRUTH,
    }
)

REPORT = Record(
    {
        "experiment": TEXT,
        "created": TEXT,
        "machine": Record({"cpu": TEXT, "cores": COUNT, "gpu": TEXT_OR_NULL, "versions": Table(TEXT)}),
        "mesh": Record({"vertices": COUNT, "cells": COUNT, "cell_type": TEXT, "quadrature_points": COUNT}),
        "dims": Record({"k": COUNT, "r": COUNT, "kp": COUNT}),
        "reconstruction": Record(dict.fromkeys(ROLES, RECONSTRUCTION)),
        "rest_residual_mm": NUMBER,
        "cubature": Record({"latent": CUBATURE, "linear": CUBATURE}),
        "simulate": Record({space: Sequence(SIMULATION) for space in SPACES}),
        "speedup": Record({"latent_over_linear": NUMBER, "latent_over_full": NUMBER}),
        "stages": Table(Record({"seconds": NUMBER, "peak_memory_mb": NUMBER}), keys=STAGES),
        "warnings": Sequence(TEXT),
    }
)


def check_report(report: object) -> list[str]:
    """Every way in which `report` breaks the contract of report.json, one sentence each; empty when it keeps it."""
    return REPORT.violations(report, "")
