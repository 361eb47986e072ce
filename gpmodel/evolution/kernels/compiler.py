"""Compilation of the inner loops: on first use, once per machine, without Python's global lock."""

from collections.abc import Callable
from typing import ParamSpec, Protocol, TypeVar

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Compiler(Protocol):
    """A compiler of a function that changes neither its arguments nor its result."""

    def __call__(self, function: Callable[Arguments, Result], /) -> Callable[Arguments, Result]: ...


compiled: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
reduction: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nnan", "nsz"})
"""Compiler of sums and maxima over rows of numbers without a NaN; the order of summation is free."""

inlined: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, inline="always")
"""Compiler of functions called once per program or number, where passing arrays takes as long as a short program."""

of_a_number: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
"""Compiler of functions of numbers, once, for the optimiser to inline. `inlined` would compile each use again."""
