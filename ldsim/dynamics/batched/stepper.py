"""Thousands of instances of one reduced model, stepped together and differentiable through the converged step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ldsim.arrays import Array, Indices
from ldsim.dynamics.batched.compiled import CompiledSteps
from ldsim.dynamics.batched.newton import BatchedSolution, minimise
from ldsim.dynamics.batched.potential import BatchedLoads, BatchedModel
from ldsim.dynamics.batched.warped import BatchedSeries, Pulled, Swing
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import AT_REST, ReducedState, numbers_of_a_state
from ldsim.errors import SolverError
from ldsim.mechanics.grabs import check_within
from ldsim.mechanics.loads import Loads
from ldsim.optimise.solution import Reason
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space

# Numbers in the largest temporary, (9, n, r, c), above which a batch is taken in pieces: on a CPU what its caches hold.
LARGEST_TEMPORARY = {"cpu": 1 << 19, "cuda": 1 << 26}
DTYPES = (torch.float64, torch.float32)
MOST_ITERATIONS = 100
# Of a state, what the last two frames say.
FRAMES = ("z", "z_previous", "q", "q_previous", "a", "a_previous")
# Of loads, the factors of the scene's Lamé parameters.
MODULI = ("mu", "lam")


@dataclass(frozen=True, eq=False)
class BatchedState:
    """All that the next step of n instances depends on: `ReducedState` for a batch.

    Attributes:
        z, z_previous: latent coordinates of the last two frames, (n, r).
        q, q_previous: outer coordinates of the last two frames, (n, k).
        a, a_previous: where moved pins were in the last two frames, (n, l) (`space.lifting`).
        kept: the numbers of `ReducedState` of the last step, (n, ·), of which a compiled one takes over what makes it
            short: where to start and an inverse Hessian. Zeros where there was none, empty where none is compiled.
        loads: what acted in the step that led here, where the space is condensed: it moves more than the coordinates.
    """

    z: Tensor
    z_previous: Tensor
    q: Tensor
    q_previous: Tensor
    a: Tensor
    a_previous: Tensor
    kept: Tensor
    loads: BatchedLoads | None = None

    def of(self, instances: Tensor | slice) -> BatchedState:
        """The state of some instances."""
        tensors = {name: getattr(self, name)[instances] for name in (*FRAMES, "kept")}
        return BatchedState(**tensors, loads=None if self.loads is None else self.loads.of(instances))

    def detached(self) -> BatchedState:
        """The same, through which no gradient flows."""
        tensors = {name: getattr(self, name).detach() for name in (*FRAMES, "kept")}
        loads = self.loads
        if loads is not None:
            loads = BatchedLoads._make([*(each.detach() for each in loads.tensors), loads.series])
        return BatchedState(**tensors, loads=loads)

    def serial(self, instance: int) -> ReducedState:
        """One instance, for `ReducedStepper`."""
        z, z_previous, q, q_previous, a, a_previous = (
            getattr(self, name)[instance].detach().cpu().numpy().astype(np.float64) for name in FRAMES
        )
        state = ReducedState.moving(z, z_previous, q, q_previous)
        if len(a):
            state.a, state.a_previous = a, a_previous
        if self.loads is not None:
            state.loads = self.loads.serial(instance)
        return state


def is_compiled(device: torch.device, dtype: torch.dtype) -> bool:
    """Whether the compiled step, which has double precision alone, runs on a device."""
    return device.type == "cpu" and dtype == torch.float64


class BatchedStepper:
    """Steps n instances of a scene in the space u = U φ(z), each with grabs, gravity and material of its own.

    The potential, the stop rule and the acceptance of a step are those of `ReducedStepper`. On a processor in double
    precision its compiled steps are taken too, by as many threads as torch may use; elsewhere the minimiser is Newton's
    method with the exact Hessian on tensors. All agree to the tolerance. Gradients flow from the new state to the
    previous one, and to targets, stiffness, gravity and moduli: by the implicit function theorem, dz = −H⁻¹ ∂(∇E), so
    a step backwards costs one solve with the r × r Hessian, not the iterations. A condensed space, whose compliance is
    that of Young's modulus, takes the same factor in both moduli.

    Args:
        tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), N. Single precision does not reach the default; 1e-3 is a
            start, and where it is too little the step ends with `NO_DECREASE` at the best point found.
        device: "cpu", "cuda", or "cuda:1" and so on.
        piece: instances in one piece of work; None for as many as the device's memory serves best.

    Raises:
        SolverError: the space is the full one, the type is neither float32 nor float64, or the device is not there.
    """

    def __init__(
        self,
        space: Space,
        *,
        tolerance: float = 1e-8,
        max_iterations: int = MOST_ITERATIONS,
        device: str = "cpu",
        dtype: torch.dtype = torch.float64,
        piece: int | None = None,
    ) -> None:
        if space.basis is None:
            raise SolverError(f"batched stepping in the {space.name} space; it needs a reduced one, latent or linear")
        if dtype not in DTYPES:
            raise SolverError(f"batched stepping in {dtype}; allowed are torch.float64 and torch.float32")
        if torch.device(device).type == "cuda" and not torch.cuda.is_available():
            raise SolverError(f"device {device!r} asked for, but PyTorch {torch.__version__} sees none; use 'cpu'")
        self.device, self.dtype = torch.device(device), dtype
        self.model = BatchedModel.of(space, self.device, dtype)
        self._dimensions = (space.decoder.r, space.decoder.k)
        self.tolerance, self.max_iterations = tolerance, max_iterations
        room = LARGEST_TEMPORARY.get(self.device.type, LARGEST_TEMPORARY["cpu"])
        self.piece = max(piece or room // (9 * space.decoder.r * max(len(space.rule.points), 1)), 1)
        self.space, self.scene = space, space.scene
        self._lifting = Lifting.of(space.scene, ()) if space.lifting is None else space.lifting
        self._gravity = self.tensor(space.scene.gravity)
        self._compiled: CompiledSteps | None = None
        if is_compiled(self.device, dtype):
            options = ReducedOptions(tolerance=tolerance, max_iterations=max_iterations)
            self._compiled = CompiledSteps(space, self.model, options)

    def tensor(self, values: object) -> Tensor:
        """Numbers as a tensor of this stepper's type on its device."""
        return torch.as_tensor(values, dtype=self.dtype, device=self.device)

    def rest(self, n: int = 1) -> BatchedState:
        """n instances at rest."""
        z, q, a = (self.tensor(np.zeros((n, size))) for size in (*self._dimensions, self._lifting.count))
        return BatchedState(z, z, q, q, a, a, self._nothing_kept(n), self._beside([AT_REST] * n))

    def _nothing_kept(self, n: int) -> Tensor:
        count = 0 if self._compiled is None else numbers_of_a_state(*self._dimensions)
        return torch.zeros((n, count), dtype=self.dtype, device=self.device)

    def state(self, states: Sequence[ReducedState]) -> BatchedState:
        """A batch of serial states.

        Raises:
            ValueError: one is of another model.
        """
        for each in states:
            if (each.r, each.k) != self._dimensions:
                raise ValueError(f"a state has (r, k) = {(each.r, each.k)}; this stepper has {self._dimensions}")
        still = np.zeros(self._lifting.count)  # where no pins move, a serial state says nothing of them

        def batch(name: str) -> Tensor:
            return self.tensor(np.array([still if (own := getattr(s, name)) is None else own for s in states]))

        frames = {name: batch(name) for name in FRAMES}
        kept, loads = self._nothing_kept(len(states)), self._beside([each.loads for each in states])
        return BatchedState(**frames, kept=kept, loads=loads)

    def _beside(self, loads: Sequence[Loads]) -> BatchedLoads | None:
        """What a state says of its loads: nothing where they move no more than the coordinates."""
        return self.loads(loads) if self.space.is_condensed else None

    def loads(self, loads: Sequence[Loads]) -> BatchedLoads:
        """What acts on one instance for each entry, with the scene's material.

        Change it with `_replace`: `loads._replace(target=…, gravity=…)`.

        Raises:
            MotionError: they move pins that the space was not prepared for, or hold vertices beyond the mesh.
        """
        n, most = len(loads), max((len(each.grabs) for each in loads), default=0)
        U, L, rest = self.space.reduced_basis.fields, self._lifting, self.scene.mesh.vertices
        a = np.array([L.at(each.pins) for each in loads]).reshape(n, L.count)
        by_vertex = L.fields.reshape(len(rest), 3, L.count)
        known: dict[int, tuple[Array, Array, Array]] = {}
        B, centre = np.zeros((n, most, 3, U.shape[2])), np.zeros((n, most, 3))
        target, stiffness = np.zeros((n, most, 3)), np.zeros((n, most))
        for i, each in enumerate(loads):
            for j, grab in enumerate(each.grabs):
                held = grab.vertices
                if id(held) not in known:
                    check_within(held, len(rest))
                    known[id(held)] = U[held].mean(axis=0), rest[held].mean(axis=0), by_vertex[held].mean(axis=0)
                B[i, j], centre[i, j], lifted = known[id(held)]
                centre[i, j] += lifted @ a[i]
                target[i, j], stiffness[i, j] = grab.target, grab.stiffness
        ones = self.tensor(np.ones(n))
        springs = [self.tensor(values) for values in (B, centre, target, stiffness)]
        own = [self._gravity if each.gravity is None else self.tensor(each.gravity) for each in loads]
        gravity = torch.stack(own) if own else self.tensor(np.zeros((0, 3)))
        pins = self.tensor(a)
        series, nothing = None, self.tensor(np.zeros((n, len(self.model.squares))))
        if self.space.is_condensed:
            series = BatchedSeries.of(self.space, [each.grabs for each in loads], self.tensor)
        return BatchedLoads._make([*springs, gravity, ones, ones, pins, torch.zeros_like(pins), nothing, series])

    def step(self, state: BatchedState, loads: BatchedLoads) -> tuple[BatchedState, BatchedSolution]:
        """Advance every instance by one time step; the given state is unchanged.

        An instance that has no finite energy to start from stays where it is, is listed in the solution's `lost`, and
        lets no gradient through; the others do not notice. In a condensed space nothing holds it any more.

        Args:
            loads: with gravity of each instance, (n, 3), or one of all, (3,), as a tensor or as other numbers.

        Raises:
            ValueError: the state is of another model.
            SolverError: the loads are of another number of instances than the state, their gravity is of another shape,
                or those of a condensed space have other factors in μ than in λ.
        """
        n, given = len(state.z), (state.z.shape[1], state.q.shape[1])
        if given != self._dimensions:
            raise ValueError(f"the state has (r, k) = {given}; this stepper has {self._dimensions}")
        gravity = self.tensor(loads.gravity)
        if gravity.shape[-1:] != (3,) or gravity.dim() > 2:
            raise SolverError(f"gravity has the shape {tuple(gravity.shape)}; it must be (3,) or {(n, 3)}, m/s²")
        loads = loads._replace(gravity=gravity.expand(n, 3) if gravity.dim() == 1 else gravity)
        if counts := {each.shape[0] for each in loads.tensors} - {n}:
            raise SolverError(f"loads of {counts.pop()} instances, a state of {n}; each instance has a row of its own")
        results: list[_Solved] = []
        loads = loads._replace(change=loads.a - 2 * state.a + state.a_previous)
        predictor = 2 * state.q - state.q_previous
        before = _Before(state.z.detach(), state.z_previous.detach(), state.kept)
        swing = self.model.swing(loads, state.q, predictor)
        if swing is not None:
            loads = loads._replace(follows=swing.follows)
        acting, pulled = self._in_series(loads, state.q, swing)
        z = _Step.apply(self, results, before, predictor, *acting.tensors)  # type: ignore[no-untyped-call]
        _, q, kept, record = results[0]
        if q is None or z.requires_grad or swing is not None:
            q = self.model.decoder(z)
        if swing is not None and pulled is not None:
            q = self._swung(q, swing, pulled)
        stayed = (record.reason == int(Reason.INFINITE_START))[:, None]
        q = torch.where(stayed, state.q.detach(), q)
        beside = None
        if self.space.is_condensed:
            beside = loads._replace(
                target=torch.where(stayed[:, :, None], 0.0, loads.target),
                stiffness=torch.where(stayed, 0.0, loads.stiffness),
                gravity=torch.where(stayed, self._gravity, loads.gravity),
                mu=torch.where(stayed[:, 0], 1.0, loads.mu),
            )
        return BatchedState(z, state.z, q, state.q, loads.a, state.a, kept, beside), record

    def _in_series(self, loads: BatchedLoads, q: Tensor, swing: Swing | None) -> tuple[BatchedLoads, Pulled | None]:
        """The loads of a step from q, (n, k), the springs of a condensed space made, and what they were made of."""
        if loads.series is None:
            return loads, None
        if not torch.equal(loads.mu.nan_to_num(), loads.lam.nan_to_num()):
            raise SolverError("a condensed space has one factor for both moduli; mu and lam of the loads differ")
        found = loads.in_series(q, swing)
        springs = loads._replace(B=found.B, centre=found.centre, target=found.target)
        return springs._replace(stiffness=torch.ones_like(loads.stiffness)), found

    @staticmethod
    def _swung(q: Tensor, swing: Swing, pulled: Pulled) -> Tensor:
        """Where modes come to at the end of a step, q = φ(z) else, (n, k)."""
        modes = swing.swung.shape[1]
        ways = pulled.target - pulled.centre - torch.einsum("ngik,nk->ngi", pulled.B, q)
        forces = torch.einsum("nij,nj->ni", pulled.forces, ways.flatten(1))
        pull = torch.einsum("nim,ni->nm", pulled.turned, forces)
        pull = torch.where(pull.isfinite(), pull, 0.0)  # of a lost instance, whose moduli others may share
        moved = swing.follows * q[:, -modes:] + swing.swung + swing.gives * pull
        return torch.cat([q[:, :-modes], moved], dim=1)

    def displacement(self, state: BatchedState, vertices: Indices) -> Tensor:
        """u = U q + L a of some vertices, (n, v, 3), metres, and what loads move beside it; differentiable."""
        fields = self.tensor(self.space.fields[vertices])
        u = torch.einsum("vik,nk->nvi", fields, torch.cat([state.q, state.a], dim=1))
        return u if state.loads is None else u + self._residual(state.q, state.loads, vertices)

    def _residual(self, q: Tensor, loads: BatchedLoads, vertices: Indices) -> Tensor:
        """What gravity and grabs move beside the coordinates of a condensed space, (n, v, 3) metres."""
        compliance, series, softness = self.space.compliance, loads.series, 1 / loads.mu
        assert compliance is not None and series is not None
        dead, weight = (self.tensor(field[vertices]) for field in compliance.sags(local=True))
        u = softness[:, None, None] * (torch.einsum("via,na->nvi", weight, loads.gravity) + dead)
        swing = self.model.swing(loads, q, q)
        found = loads.in_series(q, swing, stepping=False)
        made = found.amounts()
        for number, held in enumerate(series.held):
            dents = self.tensor(compliance.fields(held)[vertices])  # unit forces, and where they are there their pairs
            soft = torch.cat([softness[:, None].expand(-1, 3), softness[:, None].square().expand(-1, 6)], dim=1)
            amounts = ((soft[:, None] * made) * (series.which == number)[..., None])[..., : dents.shape[2]]
            u = u + torch.einsum("vaj,ngj,ngia->nvi", dents, amounts, found.warps)
        if compliance.modes is not None and compliance.modes.turns:  # they have so much of it as they have moved
            u = u - torch.einsum("vim,nm->nvi", self.tensor(compliance.modes.fields[vertices]), found.given)
        return u

    def _pieces(self, n: int) -> list[slice]:
        """n instances in pieces that the memory serves best."""
        return [slice(first, first + self.piece) for first in range(0, max(n, 1), self.piece)]

    def solve(self, before: _Before, predictor: Tensor, loads: BatchedLoads) -> _Solved:
        """The minimisers of one step."""
        z, z_previous, kept = before
        if self._compiled is not None:
            return _Solved(*self._compiled(z, z_previous, kept, predictor, loads))
        stop = self.tolerance, self.max_iterations
        done = [
            minimise(self.model, loads.of(some), predictor[some], 2 * z[some] - z_previous[some], z[some], *stop)
            for some in self._pieces(len(z))
        ]
        names = [entry.name for entry in fields(BatchedSolution)]
        record = BatchedSolution(*(torch.cat([getattr(part, name) for _, part in done]) for name in names))
        return _Solved(torch.cat([part for part, _ in done]), None, kept, record)

    def adjoint(self, z: Tensor, predictor: Tensor, loads: BatchedLoads, gradient: Tensor) -> Tensor:
        """J H⁻¹ ∂L/∂z, (n, k): how far each instance's q gives way to the loss's pull on z; ∂L/∂z is (n, r)."""
        ways: list[Tensor] = []
        for some in self._pieces(len(z)):
            H = self.model.hessian(loads.of(some), predictor[some], z[some])
            solved, _ = torch.linalg.solve_ex(H, gradient[some, :, None])
            ways.append(torch.einsum("nrk,nr->nk", self.model.decoder.tangents(z[some]).jacobian, solved[:, :, 0]))
        return torch.cat(ways)


class _Before(NamedTuple):
    """Of the state that a step starts from what its minimiser reads."""

    z: Tensor
    z_previous: Tensor
    kept: Tensor


class _Solved(NamedTuple):
    """The minimisers of a step, (n, r), φ of them where it was made, what the next one takes over, and the record."""

    z: Tensor
    q: Tensor | None
    kept: Tensor
    record: BatchedSolution


class _Step(torch.autograd.Function):
    """z* = argmin E(z; q̂, loads) with its derivative by the implicit function theorem."""

    @staticmethod
    def forward(
        ctx: Any,
        stepper: BatchedStepper,
        results: list[_Solved],
        before: _Before,
        predictor: Tensor,
        *loads: Tensor,
    ) -> Tensor:
        results.append(stepper.solve(before, predictor, BatchedLoads._make([*loads, None])))
        solved, _, _, record = results[0]
        ctx.stepper = stepper
        ctx.save_for_backward(solved, record.reason == int(Reason.INFINITE_START), predictor, *loads)
        return solved

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        stepper: BatchedStepper = ctx.stepper
        z, lost, *saved = ctx.saved_tensors
        wanted = ctx.needs_input_grad[3:]
        if not any(wanted):
            return (None,) * (3 + len(saved))
        predictor, loads = saved[0], BatchedLoads._make([*saved[1:], None])
        y = stepper.adjoint(z, predictor, loads, gradient)
        y = torch.where(lost[:, None], 0.0, y)
        with torch.enable_grad():
            # 0 times what is not a number, as loads of a lost instance may be, is none; moduli of 0 are no solid's
            harmless = [0.0, *(float(name in MODULI) for name in BatchedLoads._fields[:-1])]
            kept = [
                torch.where(lost.reshape(-1, *[1] * (value.dim() - 1)), instead, value)
                for value, instead in zip(saved, harmless, strict=True)
            ]
            inputs = [value.detach().requires_grad_(need) for value, need in zip(kept, wanted, strict=True)]
            q = torch.where(lost[:, None], 0.0, stepper.model.decoder(z))
            work = stepper.model.virtual_work(BatchedLoads._make([*inputs[1:], None]), inputs[0], q, y)
            found = iter(torch.autograd.grad(-work, [value for value in inputs if value.requires_grad]))
        return (None, None, None, *(next(found) if need else None for need in wanted))
