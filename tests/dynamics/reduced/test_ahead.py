"""What is compiled ahead is what every space steps with."""

from __future__ import annotations

import pytest

from ldsim.dynamics.reduced.advance import advance
from ldsim.dynamics.reduced.ahead import compile_step
from ldsim.dynamics.reduced.stepper import ReducedStepper
from tests.dynamics.reduced.solids import HEX, TET, curved, pull, stepper
from tests.helpers import smooth_basis
from tests.runtime.problems import condensed


def steppers() -> dict[str, ReducedStepper]:
    return {
        "linear": stepper(HEX, smooth_basis(HEX, 6), curved(6, 6)),
        "latent, quasi-static, Newton": stepper(
            TET, smooth_basis(TET, 6), curved(6, 4), quasistatic=True, method="newton"
        ),
        "condensed": ReducedStepper(condensed()),
    }


@pytest.mark.parametrize("kind", ["linear", "latent, quasi-static, Newton", "condensed"])
def test_no_space_and_no_load_has_the_step_compiled_again(kind: str) -> None:
    compile_step()
    some = steppers()[kind]
    state, _ = some.step(some.rest(), pull(some.scene))
    some.step(state, pull(some.scene, 0.1))
    assert len(advance.signatures) == 1
