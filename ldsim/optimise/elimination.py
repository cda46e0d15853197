"""How the factor of a sparse symmetric matrix will look, before any number is known: order, tree, supernodes.

Everything here counts the nodes of a graph; each stands for a 3×3 block. Sources: Davis 2006, "Direct Methods for
Sparse Linear Systems", Ch. 4; Ashcraft and Grimes 1989, "The influence of relaxed supernode partitions on the
multifrontal method".
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ldsim.arrays import Indices
from ldsim.jit import njit

if sys.platform != "win32":  # there are no wheels of it for Windows
    import pymetis


@dataclass(frozen=True, eq=False)
class Elimination:
    """The structure of a supernodal factor.

    A supernode is a run of columns that share their rows. Its front consists of its columns, then its rows below them.

    Attributes:
        first: the first column of each supernode, and one past the last column of all, (p + 1,).
        parent: the supernode that takes up each one's update, −1 for a root, (p,).
        row_start: where the rows of each supernode begin in `rows`, (p + 1,).
        rows: rows below the columns of each supernode, ascending, one supernode after another.
        place: of each of these rows in the front of the parent.
        entry_place: of each entry of the matrix in the front that takes it up; −1 above the diagonal.
    """

    first: Indices
    parent: Indices
    row_start: Indices
    rows: Indices
    place: Indices
    entry_place: Indices

    @property
    def entries(self) -> int:
        """Scalars that the factor holds, its explicit zeros included."""
        columns = np.diff(self.first)
        return int(9 * (columns * (columns + np.diff(self.row_start))).sum())


def nested_dissection(graph: csr_array) -> Indices:
    """A fill-reducing order of the nodes of a symmetric graph without diagonal, (f,) int64."""
    if graph.shape[0] < 2 or graph.nnz == 0:
        return np.arange(graph.shape[0], dtype=np.int64)
    if sys.platform == "win32":
        return band_order(graph)
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    order, _ = pymetis.nested_dissection(adjacency)
    return np.asarray(order, dtype=np.int64)


def band_order(graph: csr_array) -> Indices:
    """An order of a symmetric graph's nodes that keeps entries near the diagonal; more fill than nested dissection."""
    return np.asarray(reverse_cuthill_mckee(graph, symmetric_mode=True), dtype=np.int64)


def elimination_order(graph: csr_array) -> Indices:
    """Nested dissection, rearranged so that each parent in the elimination tree follows its last child at once."""
    order = nested_dissection(graph)
    permuted = csr_array(graph[order][:, order])
    parent = _tree(permuted.indptr.astype(np.int64), permuted.indices.astype(np.int64))
    return order[_postorder(parent)]


def eliminate(indptr: Indices, indices: Indices) -> Elimination:
    """The structure of the factor of a symmetric pattern in elimination order, diagonal included, (f + 1,) and (b,)."""
    parent = _tree(indptr, indices)
    counts = _counts(indptr, indices, parent)
    first = _supernodes(parent, counts)
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    above = parent[first[1:] - 1]
    tree = np.where(above >= 0, owner[above], -1)
    row_start = np.concatenate([[0], np.cumsum(counts[first[1:] - 1] - 1)])
    rows = np.empty(row_start[-1], dtype=np.int64)
    place, entry_place = np.empty_like(rows), np.full(len(indices), -1, dtype=np.int64)
    _fill_rows(indptr, indices, first, tree, row_start, rows)
    _fill_places(indptr, indices, first, tree, row_start, rows, place, entry_place)
    return Elimination(first, tree, row_start, rows, place, entry_place)


@njit(cache=True)
def _tree(indptr: Indices, indices: Indices) -> Indices:
    """The elimination tree: of each column the first row below the diagonal of the factor, −1 for a root."""
    n = indptr.shape[0] - 1
    parent, ancestor = np.full(n, -1), np.full(n, -1)
    for i in range(n):
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            while j != -1 and j < i:
                following = ancestor[j]
                ancestor[j] = i
                if following == -1:
                    parent[j] = i
                j = following
    return parent


@njit(cache=True)
def children(parent: Indices) -> tuple[Indices, Indices]:
    """The first child of each node of a forest and the next child of the same parent, ascending; −1 for none."""
    child, sibling = np.full(parent.shape[0], -1), np.full(parent.shape[0], -1)
    for j in range(parent.shape[0] - 1, -1, -1):
        if parent[j] >= 0:
            sibling[j], child[parent[j]] = child[parent[j]], j
    return child, sibling


@njit(cache=True)
def _postorder(parent: Indices) -> Indices:
    """The nodes of a forest, children before parents and every subtree in one run."""
    n, (child, sibling) = parent.shape[0], children(parent)
    order, stack = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    count = 0
    for root in range(n):
        if parent[root] >= 0:
            continue
        stack[0], height = root, 1
        while height > 0:
            j = stack[height - 1]
            if child[j] >= 0:
                stack[height], height = child[j], height + 1
                child[j] = sibling[child[j]]
            else:
                order[count], count, height = j, count + 1, height - 1
    return order


@njit(cache=True)
def _counts(indptr: Indices, indices: Indices, parent: Indices) -> Indices:
    """Entries of each column of the factor, diagonal included: row i holds the paths from its entries up to i."""
    n = parent.shape[0]
    counts, seen = np.ones(n, dtype=np.int64), np.full(n, -1)
    for i in range(n):
        seen[i] = i
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            while j < i and seen[j] != i:
                seen[j] = i
                counts[j] += 1
                j = parent[j]
    return counts


@njit(cache=True)
def _worth_merging(columns: int, zeros: float, entries: float) -> bool:
    """Few explicit zeros, or columns so few that a call costs more than the arithmetic."""
    share = zeros / entries
    return columns <= 4 or (columns <= 16 and share < 0.4) or (columns <= 48 and share < 0.1) or share < 0.05


@njit(cache=True)
def _supernodes(parent: Indices, counts: Indices) -> Indices:
    """First columns of the supernodes and the number of columns; a last child is merged into its parent if worth it."""
    n = parent.shape[0]
    first, entries = np.empty(n + 1, dtype=np.int64), np.empty(n + 1)
    p = 0
    for j in range(n):
        first[p], entries[p], p = j, float(counts[j]), p + 1
        while p > 1 and parent[first[p - 1] - 1] >= first[p - 1]:
            a, below = first[p - 2], counts[j] - 1
            if parent[first[p - 1] - 1] > j:
                break
            columns = j + 1 - a
            dense = columns * below + 0.5 * columns * (columns + 1)
            true = entries[p - 2] + entries[p - 1]
            if not _worth_merging(columns, dense - true, dense):
                break
            entries[p - 2], p = true, p - 1
    first[p] = n
    return first[: p + 1].copy()


@njit(cache=True)
def _add_rows(found: Indices, least: int, s: int, seen: Indices, rows: Indices, filled: int) -> int:
    """Writes what was found from `least` on, each once for supernode s, into `rows` after `filled`; returns its end."""
    for i in found:
        if i >= least and seen[i] != s:
            seen[i], rows[filled] = s, i
            filled += 1
    return filled


@njit(cache=True)
def _fill_rows(
    indptr: Indices, indices: Indices, first: Indices, tree: Indices, row_start: Indices, rows: Indices
) -> None:
    """Rows of each supernode: those of its entries and of its children, below its last column."""
    seen, (child, sibling) = np.full(first[-1], -1), children(tree)
    for s in range(tree.shape[0]):
        stop = first[s + 1]
        filled = _add_rows(indices[indptr[first[s]] : indptr[stop]], stop, s, seen, rows, row_start[s])
        c = child[s]
        while c >= 0:
            filled = _add_rows(rows[row_start[c] : row_start[c + 1]], stop, s, seen, rows, filled)
            c = sibling[c]
        rows[row_start[s] : row_start[s + 1]].sort()


@njit(cache=True)
def _fill_places(
    indptr: Indices,
    indices: Indices,
    first: Indices,
    tree: Indices,
    row_start: Indices,
    rows: Indices,
    place: Indices,
    entry_place: Indices,
) -> None:
    """Where rows and entries go in the fronts that take them up."""
    position = np.empty(first[-1], dtype=np.int64)
    child, sibling = children(tree)
    for s in range(tree.shape[0]):
        columns = first[s + 1] - first[s]
        for j in range(columns):
            position[first[s] + j] = j
        for k in range(row_start[s], row_start[s + 1]):
            position[rows[k]] = columns + k - row_start[s]
        for j in range(first[s], first[s + 1]):
            for k in range(indptr[j], indptr[j + 1]):
                if indices[k] >= j:
                    entry_place[k] = position[indices[k]]
        c = child[s]
        while c >= 0:
            for k in range(row_start[c], row_start[c + 1]):
                place[k] = position[rows[k]]
            c = sibling[c]
