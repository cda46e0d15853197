"""The check of report.json: it accepts what keeps the contract and names what breaks it."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest

from ldsim.report.schema import check_report
from tests.report.example_report import example_report

FREE_NAMES = (("machine", "versions"), ("stages",), ("made_from", "inputs"))


def key_paths(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """The path of every key that the contract demands."""
    if isinstance(value, dict):
        for key, child in value.items():
            if path not in FREE_NAMES:
                yield (*path, key)
            yield from key_paths(child, (*path, key))
    elif isinstance(value, list) and value:
        yield from key_paths(value[0], (*path, 0))


def leaf_paths(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """The path of every value that holds no others."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from leaf_paths(child, (*path, key))
    if not isinstance(value, dict | list):
        yield path


def parent_of(report: Any, path: tuple) -> Any:
    for key in path[:-1]:
        report = report[key]
    return report


def dotted(path: tuple) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")


def test_the_example_keeps_the_contract():
    assert check_report(example_report()) == []


def test_what_survives_json_still_keeps_the_contract():
    assert check_report(json.loads(json.dumps(example_report()))) == []


@pytest.mark.parametrize("path", list(key_paths(example_report())), ids=dotted)
def test_each_missing_key_is_named(path):
    report = example_report()
    del parent_of(report, path)[path[-1]]
    assert check_report(report) == [f"{dotted(path)} is missing"]


@pytest.mark.parametrize("path", list(leaf_paths(example_report())), ids=dotted)
def test_each_value_of_a_wrong_type_is_named(path):
    report = example_report()
    parent_of(report, path)[path[-1]] = ["not a value"]
    (violation,) = check_report(report)
    assert violation.startswith(f"{dotted(path)} is ['not a value']; expected ")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("mesh", "cells"), 3.5),
        (("mesh", "cells"), True),
        (("rest_residual_mm",), float("nan")),
        (("speedup", "latent_over_full"), float("inf")),
        (("experiment",), None),
        (("simulate", "latent", 0, "role"), "heldout"),
        (("simulate", "latent", 0, "diverged"), 1),
        (("simulate", "latent"), {}),
        (("stages",), []),
        (("mesh",), None),
    ],
)
def test_values_that_json_or_the_contract_do_not_know_are_named(path, value):
    report = example_report()
    parent_of(report, path)[path[-1]] = value
    (violation,) = check_report(report)
    assert violation.startswith(f"{dotted(path)} is {value!r}; expected ")


@pytest.mark.parametrize("path", [(), ("mesh",), ("simulate", "latent", 1, "online_error"), ("stages",)], ids=dotted)
def test_unknown_keys_are_named_with_the_known_ones(path):
    report = example_report()
    parent_of(report, (*path, "typo"))["typo"] = {}
    (violation,) = check_report(report)
    assert violation.startswith(f"{dotted((*path, 'typo'))} is unknown; known are ")


@pytest.mark.parametrize(
    "path",
    [
        ("dims", "kp"),
        ("machine", "gpu"),
        ("reconstruction", "test"),
        ("cubature", "linear"),
        ("simulate", "latent", 0, "online_error"),
        ("simulate", "latent", 0, "iterations"),
    ],
    ids=dotted,
)
def test_what_was_not_measured_may_be_null(path):
    report = copy.deepcopy(example_report())
    parent_of(report, path)[path[-1]] = None
    assert check_report(report) == []


def test_something_else_than_an_object_is_one_violation():
    assert len(check_report([])) == 1
