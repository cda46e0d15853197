"""Reduced deformable simulation in a learned latent space (Fulton et al., Eurographics 2019)."""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """`from ldsim import load`: the simulator and all that it needs are imported only then."""
    if name in ("load", "Simulator"):
        return getattr(importlib.import_module("ldsim.simulator"), name)
    raise AttributeError(f"module 'ldsim' has no attribute {name!r}")
