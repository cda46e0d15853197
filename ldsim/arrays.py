"""The types of arrays that stand in most signatures; shape and unit are told where they are used."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# float32 or float64, or integers of any size, in code that serves several.
Numbers: TypeAlias = NDArray[Any]
