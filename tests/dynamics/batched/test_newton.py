"""The line search of a batch against the compiled one, line by line."""

from __future__ import annotations

import numpy as np
import torch

from ldsim.dynamics.batched.newton import _Line, accepts, next_length
from ldsim.optimise import line_search


def test_a_batch_accepts_and_shortens_steps_by_the_compiled_rule() -> None:
    rng = np.random.default_rng(0)
    count = 400
    f0, slope0, length = rng.normal(size=count), -rng.uniform(0.01, 3, count), rng.uniform(0.01, 2, count)
    f, slope = f0 + rng.normal(size=count) * 0.3, 3 * rng.normal(size=count)
    f[::4] = f0[::4] * (1 + 1e-12 * rng.normal(size=count)[::4])
    f[::7] = np.inf
    values = [torch.tensor(array) for array in (f0, slope0, length, f, slope)]
    nothing = torch.zeros((count, 1), dtype=torch.float64)
    line = _Line(nothing, nothing, values[0], values[1])
    accepted, following = accepts(line, *values[2:]), next_length(line, *values[2:])
    one_by_one = list(zip(f0, slope0, length, f, slope, strict=True))
    expected = [line_search.accepts(*case) for case in one_by_one]
    assert 40 < sum(expected) < count - 40
    assert accepted.tolist() == expected
    np.testing.assert_allclose(following, [line_search.next_step(*case) for case in one_by_one], rtol=1e-14)
