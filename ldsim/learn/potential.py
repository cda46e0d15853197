"""The network of a condensed space: V_eff(z) and the pose slaved to z, with the derivatives that a fit compares.

A fit asks for the force ∇V_eff, its change along a direction, the slaved pose and its change along another. Each is
written out, changes carried forwards and forces backwards through the layers, and so is the gradient of a loss of them,
which goes the same ways back: what is named counted there, or begins with on_, is the gradient of the loss by
something. As operations of torch the same numbers took twice as long, most of it between the operations
(docs/notebook/2026-11-26-making.md, "Fits without torch").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy.linalg import solve_triangular

from ldsim.arrays import Numbers
from ldsim.learn.network import layers, perceptron
from ldsim.learn.options import TrainOptions
from ldsim.learn.passes import pass_back, pass_back_adjoint, pass_out, pass_out_adjoint
from ldsim.learn.stress import stresses, stresses_adjoint
from ldsim.space.activation import ACTIVATIONS


class Derivatives(NamedTuple):
    """What a fit compares; or the gradient of its loss by these.

    Attributes:
        force: ∇V_eff, and image, its change along v, (b, r).
        slaved: the slaved coordinates, and along, their change along w, (b, k).
    """

    force: Numbers
    image: Numbers
    slaved: Numbers
    along: Numbers


class Strains(NamedTuple):
    """What V_eff is made of, the same for all poses.

    Attributes:
        maps: G of all points, (9c, r + m): the leading columns such that the Hessian at rest is the identity.
        weights: of the points, (c,).
        rows: Q, (10c, r), with QᵀQ the Hessian at rest if the maps were as they are learned.
        root: its Cholesky factor C, (r, r), lower; the leading maps are those that are learned times C⁻ᵀ.
    """

    maps: Numbers
    weights: Numbers
    rows: Numbers
    root: Numbers


@dataclass(frozen=True, eq=False)
class _Layer:
    """What one layer gave. Its rows are b poses and rest, then changes along v and w of each pose, r of rest.

    Attributes:
        before: rows that came in. moved: changes before the activation, (2b + r, n).
        slope, curvature, third: derivatives of the activation at each pose and at rest, (b + 1, n).
    """

    before: Numbers
    moved: Numbers
    slope: Numbers
    curvature: Numbers
    third: Numbers


@dataclass(frozen=True, eq=False)
class Tape:
    """What the way back reads of an evaluation.

    Attributes:
        inputs: y, v and w, (b, r). layers: of the inner layers. last: rows that came into the last one.
        at_rest: changes of the features at rest, (r, m).
        strains: of V_eff. both: [y, f] and below it its change along v, (2b, r + m); strained: G times it.
        stressed: P/μ of each and its change, (2b, 9c); forces: on [y, f], and their changes, (2b, r + m).
        backs: of each inner layer the forces that come back to it, and those that go on, (2b, n) each.
    """

    inputs: tuple[Numbers, Numbers, Numbers]
    layers: list[_Layer]
    last: Numbers
    at_rest: Numbers
    strains: Strains
    both: Numbers
    strained: Numbers
    stressed: Numbers
    forces: Numbers
    backs: list[tuple[Numbers, Numbers]]


@dataclass(frozen=True, eq=False)
class PotentialNetwork:
    """V_eff and the slaved coordinates as functions of y, in units in which the samples are of size one.

    At rest both are exact to first order by construction: the Hessian of V_eff is the identity, and the slaved
    coordinates move as T₀ does.

    Attributes:
        weights, biases: of the layers, (in, out) and (out,). activation: between them.
        maps: of the points, as they are learned, (9c, r + m). logarithms: of their weights, (c,).
        ratio: λ/μ of the material of each point, (c,).
        spread: root mean square of each slaved coordinate, (k,).
        tangents: of the slaved coordinates at rest, (r, k).
    """

    weights: tuple[Numbers, ...]
    biases: tuple[Numbers, ...]
    activation: str
    maps: Numbers
    logarithms: Numbers
    ratio: Numbers
    spread: Numbers
    tangents: Numbers

    @classmethod
    def drawn(cls, ratio: Numbers, spread: Numbers, tangents: Numbers, options: TrainOptions) -> PotentialNetwork:
        """One to begin with, by torch's own random numbers; float64."""
        r, points, features = len(tangents), len(ratio), options.condensed.features
        network = perceptron([r, *options.layers, features + len(spread)], options.nonlinearity)
        # small strains, so that no point starts inverted
        maps = 0.15 / math.sqrt(r) * torch.randn(9 * points, r + features)
        last = network[-1]
        assert isinstance(last, torch.nn.Linear)
        torch.nn.init.normal_(last.weight, 0.0, 0.1 / math.sqrt(last.in_features))
        weights, biases = map(tuple, layers(network))
        logarithms = np.full(points, math.log(3.0 / points))
        drawn = cls(weights, biases, options.nonlinearity, maps.numpy(), logarithms, ratio, spread, tangents)
        return drawn.in_precision(np.float64)

    def in_precision(self, dtype: type[np.floating]) -> PotentialNetwork:
        """A copy with arrays of another type, which all that is made of them then has too."""

        def copied(array: Numbers) -> Numbers:
            return np.array(array, dtype=dtype, order="C")

        arrays = self.maps, self.logarithms, self.ratio, self.spread, self.tangents
        weights, biases = (tuple(map(copied, each)) for each in (self.weights, self.biases))
        return PotentialNetwork(weights, biases, self.activation, *map(copied, arrays))

    @property
    def features(self) -> int:
        """How many learned functions of y the points see beside it, m."""
        return int(self.maps.shape[1]) - len(self.tangents)

    @property
    def parameters(self) -> list[Numbers]:
        """All that is learned; the gradient has the same order."""
        return [*self.weights, *self.biases, self.maps, self.logarithms]

    def at_rest(self) -> Numbers:
        """The Jacobian of the network for y = 0, (r, m + k)."""
        none = np.zeros((0, len(self.tangents)))
        found: Numbers = self._outwards(none, none, none)[1][1:] @ self.weights[-1]
        return found

    def strains(self) -> Strains:
        """The strain maps as they are learned, with the leading columns made such that rest is exact."""
        r, c, weights = len(self.tangents), len(self.ratio), np.exp(self.logarithms)
        learned = self.maps[:, :r].reshape(c, 3, 3, r)
        trace = learned[:, 0, 0] + learned[:, 1, 1] + learned[:, 2, 2]
        strain = 0.5 * (learned + learned.transpose(0, 2, 1, 3)).reshape(c, 9, r)
        # Ψ/μ = ‖ε‖² + ½ (λ/μ) (tr ε)² for small strains
        rows = np.concatenate([math.sqrt(2) * strain, (np.sqrt(self.ratio)[:, None] * trace)[:, None]], axis=1)
        rows *= np.sqrt(weights)[:, None, None]
        rows = rows.reshape(10 * c, r)
        root = np.linalg.cholesky(rows.T @ rows)
        leading = solve_triangular(root, self.maps[:, :r].T, lower=True, check_finite=False).T
        return Strains(np.hstack([leading, self.maps[:, r:]]), weights, rows, root)

    def derivatives(self, y: Numbers, v: Numbers, w: Numbers, strains: Strains) -> tuple[Derivatives, Tape]:
        """At y, (b, r), changed along v and w, (b, r); and what `gradient` reads."""
        (b, r), m = y.shape, self.features
        passed, last = self._outwards(y, v, w)
        out = last @ self.weights[-1]
        value, moved = out[: b + 1], out[b + 1 :]  # the last bias drops out, for what is at rest is taken off
        J = moved[2 * b :]
        tangents = self.tangents - J[:, m:] * self.spread
        slaved = (value[:b, m:] - value[b, m:]) * self.spread + y @ tangents
        along = moved[b : 2 * b, m:] * self.spread + w @ tangents
        # f and its change, and the forces on [y, f]; those on f go back through the layers
        straight = np.concatenate([y, v])
        f = np.concatenate([value[:b, :m] - value[b, :m], moved[:b, :m]]) - straight @ J[:, :m]
        both = np.hstack([straight, f])
        strained = both @ strains.maps.T
        stressed = stresses(strained, self.ratio)
        forces = _weighted(stressed, strains.weights) @ strains.maps
        back, backs = forces[:, r:] @ self.weights[-1][:, :m].T, list[tuple[Numbers, Numbers]]()
        for layer, W in zip(reversed(passed), reversed(self.weights[:-1]), strict=True):
            passing = np.empty_like(back)
            pass_back(back, layer.slope, layer.curvature, layer.moved, passing)
            backs.append((back, passing))
            back = passing @ W.T
        found = forces[:, :r] + back - forces[:, r:] @ J[:, :m].T
        tape = Tape((y, v, w), passed, last, J[:, :m], strains, both, strained, stressed, forces, backs[::-1])
        return Derivatives(found[:b], found[b:], slaved, along), tape

    def gradient(self, tape: Tape, counts: Derivatives) -> list[Numbers]:
        """That of a loss by each of the parameters.

        Args:
            counts: by each of the derivatives.
        """
        (y, v, w), m, spread, J = tape.inputs, self.features, self.spread, tape.at_rest
        (b, r), W, weights = y.shape, self.weights, [np.zeros_like(each) for each in self.weights]
        G, forces = tape.strains.maps, tape.forces
        # the adjoint of the way back through the layers, from y to f
        counted = np.concatenate([counts.force, counts.image])
        J_features = -counted.T @ forces[:, r:]
        on_forces = np.hstack([counted, -counted @ J])
        beside = list[tuple[Numbers, Numbers]]()
        for i, ((back, passing), layer) in enumerate(zip(tape.backs, tape.layers, strict=True)):
            weights[i] += counted.T @ passing
            on_passing, counted = counted @ W[i], np.empty_like(back)
            on_value, on_moved = np.empty_like(back[:b]), np.empty_like(back[:b])
            pass_back_adjoint(
                on_passing, back, (layer.slope, layer.curvature, layer.third), layer.moved, counted, on_value, on_moved
            )
            beside.append((on_value, on_moved))
        weights[-1][:, :m] += counted.T @ forces[:, r:]
        on_forces[:, r:] += counted @ W[-1][:, :m]
        # the points
        on_weighted = on_forces @ G.T
        maps = _weighted(tape.stressed, tape.strains.weights).T @ on_forces
        logarithms = np.einsum("bsi,bsi->s", *(x.reshape(2 * b, -1, 9) for x in (on_weighted, tape.stressed)))
        on_strained = stresses_adjoint(tape.strained, self.ratio, _weighted(on_weighted, tape.strains.weights))
        maps += on_strained.T @ tape.both
        on_f = on_strained @ G[:, r:]
        # the last layer: values of poses and rest, changes along v and w and those of rest
        on_out = np.zeros((3 * b + 1 + r, m + len(spread)), dtype=G.dtype)
        scaled, changed = counts.slaved * spread, counts.along * spread
        on_out[:b, :m], on_out[:b, m:] = on_f[:b], scaled
        on_out[b] = -on_out[:b].sum(axis=0)
        on_out[b + 1 : 2 * b + 1, :m], on_out[2 * b + 1 : 3 * b + 1, m:] = on_f[b:], changed
        on_out[3 * b + 1 :, :m] = J_features - y.T @ on_f[:b] - v.T @ on_f[b:]
        on_out[3 * b + 1 :, m:] = -y.T @ scaled - w.T @ changed
        # that of the way out through the layers
        biases = [np.zeros_like(self.biases[-1])]
        weights[-1] += tape.last.T @ on_out
        for i in range(len(tape.layers) - 1, -1, -1):
            layer, on_after = tape.layers[i], on_out @ W[i + 1].T
            on_out = np.empty_like(on_after)
            pass_out_adjoint(on_after, layer.slope, layer.curvature, layer.moved, beside[i], on_out)
            weights[i] += layer.before.T @ on_out
            biases.append(on_out[: b + 1].sum(axis=0))
        learned, others = self._of_maps(tape.strains, maps)
        return [*weights, *biases[::-1], learned, logarithms * tape.strains.weights + others]

    def _of_maps(self, strains: Strains, counted: Numbers) -> tuple[Numbers, Numbers]:
        """The gradient of a loss by the learned maps and by the logarithms, from that by G, (9c, r + m)."""
        r, c, C = len(self.tangents), len(self.ratio), strains.root

        # G = M C⁻ᵀ, with C as Murray 2016 (arXiv 1602.07527, Sec. 3) differentiates it
        def solved(right: Numbers) -> Numbers:
            """C⁻ᵀ of columns."""
            found: Numbers = solve_triangular(C, right, lower=True, trans=1, check_finite=False)
            return found

        inner = -np.tril(counted[:, :r].T @ strains.maps[:, :r])
        inner[np.diag_indices(r)] *= 0.5
        on_hessian = solved(solved(inner).T).T
        on_rows = strains.rows @ (on_hessian + on_hessian.T)
        by_point = (on_rows * strains.rows).reshape(c, -1).sum(axis=1)
        on_rows = on_rows.reshape(c, 10, r) * np.sqrt(strains.weights)[:, None, None]
        on_strain = math.sqrt(2) * on_rows[:, :9].reshape(c, 3, 3, r)
        learned = 0.5 * (on_strain + on_strain.transpose(0, 2, 1, 3))
        learned[:, range(3), range(3)] += (np.sqrt(self.ratio)[:, None] * on_rows[:, 9])[:, None]
        return np.hstack([solved(counted[:, :r].T).T + learned.reshape(-1, r), counted[:, r:]]), 0.5 * by_point

    def _outwards(self, y: Numbers, v: Numbers, w: Numbers) -> tuple[list[_Layer], Numbers]:
        """Through all layers but the last; the rows that come to it, see `_Layer`."""
        (b, r), passed = y.shape, list[_Layer]()
        rows = np.concatenate([y, np.zeros((1, r)), v, w, np.eye(r)], dtype=self.maps.dtype)
        for W, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = rows @ W
            slope, curvature, third = (np.empty_like(x[: b + 1]) for _ in range(3))
            moved = x[b + 1 :].copy()
            pass_out(ACTIVATIONS[self.activation], bias, moved, (slope, curvature, third), x)
            passed.append(_Layer(rows, moved, slope, curvature, third))
            rows = x
        return passed, rows


def _weighted(rows: Numbers, weights: Numbers) -> Numbers:
    """Times the weight of each point, (2b, 9c)."""
    found: Numbers = (rows.reshape(len(rows), -1, 9) * weights[:, None]).reshape(rows.shape)
    return found
