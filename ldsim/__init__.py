"""Reduced deformable simulation in a learned latent space (Fulton et al., Eurographics 2019).

The front door is `from ldsim import load, view, Simulator, BatchedSimulator, Run, simulate`; each
stage is a function of its module in `ldsim.pipeline`, as `from ldsim.pipeline.train import train`.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

# Imported when they are first asked for, so that `import ldsim` is instant; `__init__.pyi` tells type checkers.
HOMES = {
    "BatchedSimulator": "ldsim.runtime.batch",
    "Run": "ldsim.run",
    "Simulator": "ldsim.simulator",
    "load": "ldsim.simulator",
    "simulate": "ldsim.dynamics.simulate",
    "view": "ldsim.export.notebook",
}


def __getattr__(name: str) -> Any:
    if name in HOMES:
        return getattr(importlib.import_module(HOMES[name]), name)
    raise AttributeError(f"module 'ldsim' has no attribute {name!r}; it has {', '.join(HOMES)}")


def __dir__() -> list[str]:
    """What a shell or a notebook completes."""
    return ["__version__", *HOMES]
