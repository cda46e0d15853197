"""What is not of every system is asked for only where it is: the parts that can be checked on one of them."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from ldsim.optimise.elimination import band_order

PACKAGE = Path(__file__).parents[1] / "ldsim"
NOT_EVERYWHERE = {"fcntl", "grp", "msvcrt", "pwd", "pymetis", "resource", "termios"}


def unconditional(tree: ast.Module) -> set[str]:
    """The modules that a module imports wherever it is imported."""
    found = set[str]()
    for node in tree.body:
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.py")), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_no_module_needs_what_only_some_systems_have(file: Path) -> None:
    assert not unconditional(ast.parse(file.read_text("utf-8"))) & NOT_EVERYWHERE


def test_an_order_without_metis_holds_every_node_once_and_keeps_a_chain_narrow() -> None:
    n = 40
    named = np.random.default_rng(0).permutation(n)
    ends = np.concatenate([[named[:-1], named[1:]], [named[1:], named[:-1]]], axis=1)
    graph = csr_array((np.ones(2 * n - 2), tuple(ends)), shape=(n, n))
    order = band_order(graph)
    assert sorted(order) == list(range(n))
    place = np.argsort(order)
    assert np.abs(place[ends[0]] - place[ends[1]]).max() == 1
