"""Define the result of an engine, and count processor seconds on a shared machine."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.formula.program import Program

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """Result of an engine: predictions at new points; the program and its coefficients, the last the intercept."""

    predict: Callable[[dict[str, Array]], Array]
    program: Program | None = None
    coefficients: tuple[float, ...] = ()


Engine = Callable[[dict[str, Array], Array, float, int], Found]


def slowdown() -> float:
    """Wall seconds a second of one core's work takes now."""
    begin, used = time.perf_counter(), time.thread_time()
    while time.thread_time() - used < 0.2:
        pass
    return max(1.0, (time.perf_counter() - begin) / 0.2)
