"""Compilation of genetic programming's inner loops: on first use, once per machine, without the global lock."""

from collections.abc import Callable
from typing import ParamSpec, Protocol, TypeVar

from numba import njit

from gpmodel.arrays import Array

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Compiler(Protocol):
    """Type of a compiler, which changes neither arguments nor result of a function."""

    def __call__(self, function: Callable[Arguments, Result], /) -> Callable[Arguments, Result]: ...


compiled: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
reduction: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nnan", "nsz"})
"""Compiler of sums and maxima over rows of numbers without a NaN; the order of summation is free."""

inlined: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, inline="always")
"""Compiler that inlines functions called once per program or number, where passing arrays takes long."""

of_a_number: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
"""Compiler of functions of numbers, compiled once and inlined by the optimiser."""


@reduction
def largest_magnitude(row: Array) -> float:
    """Return the largest absolute value of a row without a NaN."""
    value = 0.0
    for j in range(len(row)):
        value = abs(row[j]) if abs(row[j]) > value else value
    return value
