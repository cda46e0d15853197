"""A made-up report that keeps the contract, every number of it different from every other."""

from __future__ import annotations

from typing import Any


def example_report() -> dict[str, Any]:
    """A fresh report.json as a dict, free to be broken by a test."""
    return {
        "experiment": "x",
        "created": "2030-01-02T03:04:05Z",
        "verdict": {"word": "usable", "why": "the latent space is so so."},
        "machine": {"cpu": "a processor", "cores": 3, "gpu": None, "versions": {"ldsim": "0.1.0", "numpy": "2.4.6"}},
        "mesh": {"vertices": 8141, "cells": 29687, "cell_type": "tet4", "quadrature_points": 29688},
        "kind": "autoencoder",
        "dims": {"k": 60, "r": 10, "kp": 37},
        "reconstruction": {
            "train": _errors([(4.01, 0.1471), (28.4, 3.13), (4.02, 0.287), (1.1, 0.0623)]),
            "validation": _errors([(11.21, 0.511), (38.1, 4.1), (8.7, 0.61), (5.1, 0.3012)]),
            "test": _errors([(14.31, 0.611), (40.2, 4.4), (9.6, 0.71), (5.4, 0.3312)]),
        },
        "rest_residual_mm": 0.00012,
        "cubature": {
            "latent": {
                "points": 69,
                "relative_error": {"fitted": 0.0497, "kept_back": 0.1123},
                "virtual": {"points": 32, "relative_error": {"fitted": 0.0873, "kept_back": 0.1012}},
                "stepped": 32,
                "seconds": 4.31,
            },
            "linear": {
                "points": 366,
                "relative_error": {"fitted": 0.0731, "kept_back": None},
                "virtual": None,
                "stepped": 366,
                "seconds": 18.72,
            },
        },
        "simulate": {
            "full": [_run("x_2", "test", 558, 131.9, 188.4, 8.61, 9.51, None)],
            "linear": [_run("x_2", "test", 557, 4.09, 6.03, 10.11, 11.31, (0.2104, 0.0912, 31.41, 3.92))],
            "latent": [
                _run("x_1", "train", 1637, 0.241, 0.312, 11.41, 12.71, (0.0826, 0.0411, 19.21, 1.402)),
                _run("x_2", "test", 556, 0.243, 0.331, 12.21, 13.81, (0.3313, 0.1421, 52.81, 6.173)),
            ],
        },
        "window_seconds": 0.375,
        "space": "latent",
        "frontier": [
            _rung("latent", 10, 32, "x_2", 0.243, 0.3313),
            _rung("linear", 37, 366, "x_2", 4.09, 0.2104),
            _rung("linear_19", 19, 24, "x_2", 0.118, 0.4417),
        ],
        "speedup": {
            "latent_over_linear_equal_error": 16.83,
            "judged_on": "test",
            "latent_error": 0.3313,
            "linear_space": "linear",
            "linear_error": 0.2104,
            "latent_over_linear_kp": 16.92,
            "latent_over_full": 542.1,
            "chosen_over_full": 542.1,
        },
        "statement": {
            "sentence": "95 % of motions like these stay within 4.6 %.",
            "about": "one pull from rest",
            "motions": 58,
            "quantile": 0.951,
            "confidence": 0.952,
            "latent": {"error": 0.0463, "median": 0.0214, "lost": 0},
            "linear": {"error": 0.0474, "median": 0.0225, "lost": 2},
        },
        "rounds": [
            {"error": None, "pulls": 11, "seconds": 131.5, "changed": "train.condensed.rounds 4"},
            {"error": 0.0437, "pulls": 11, "seconds": 118.2, "changed": ""},
        ],
        "made_from": {
            "configuration": "experiment: x\n",
            "settings": "pictures: true\n",
            "inputs": {"scene": "b1946ac9", "model": "591785b7"},
        },
        "stages": {
            "mesh": {"seconds": 1.92, "peak_memory_mb": 412.3},
            "train": {"seconds": 17.3, "peak_memory_mb": 811.9},
        },
        "remedies": ["Set train.r to 14 (now 10)."],
        "warnings": ["On motion x_2 the latent run is far away."],
        "advice": ["For this solid use the latent space of 10 numbers."],
    }


def _errors(pairs: list[tuple[float, float]]) -> dict[str, Any]:
    methods = ("autoencoder", "pca_r", "pca_kp", "pca_k")
    return {name: {"max_mm": top, "mean_mm": mean} for name, (top, mean) in zip(methods, pairs, strict=True)}


def _run(
    motion: str, role: str, frames: int, median: float, p95: float, iterations: float, evaluations: float, error: Any
) -> dict[str, Any]:
    keys = ("relative", "windowed", "max_mm", "mean_mm")
    return {
        "motion": motion,
        "role": role,
        "frames": frames,
        "median_step_ms": median,
        "p95_step_ms": p95,
        "p99_step_ms": 1.5 * p95,
        "iterations": iterations,
        "evaluations": evaluations,
        "online_error": error and dict(zip(keys, error, strict=True)),
        "novelty": None,
        "diverged": False,
    }


def _rung(space: str, dimension: int, points: int, motion: str, median: float, error: float) -> dict[str, Any]:
    return {
        "space": space,
        "dimension": dimension,
        "points": points,
        "motion": motion,
        "role": "test",
        "median_step_ms": median,
        "online_error": error,
        "windowed_error": 0.4 * error,
    }
