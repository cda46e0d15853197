"""The paper's minimiser, its authors', and Newton's method, for runs beside those of `ldsim simulate`."""

from __future__ import annotations

from ldsim.dynamics.reduced.options import ReducedOptions

# As the text has it: L-BFGS of eight pairs, Eq. 15 made in every step, started at the last state, Wolfe's conditions.
PAPER = ReducedOptions(
    tolerance=1e-8, method="lbfgs", current=False, inertia=False, every_step=True, extrapolate=False, wolfe=True
)
# As the authors' code has it: with the inertia in the preconditioner.
INERTIA = PAPER.replace(inertia=True)
NEWTON = PAPER.replace(method="newton", current=True)
