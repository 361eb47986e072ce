"""Types of arrays and of bounded numbers used throughout the package."""

from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

NotNegative = Annotated[float, Meta(ge=0)]
Count = Annotated[int, Meta(ge=0)]
ROUNDING = 1e-9
"""Upper bound of rounding errors in double precision, in m, rad or N·m, for machines of metres."""
LARGEST = 1e100
"""Largest accepted number; the square of a larger number could overflow double precision."""
Share = Annotated[float, Meta(ge=0, le=1 + ROUNDING)]
