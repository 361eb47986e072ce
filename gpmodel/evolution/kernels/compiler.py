"""Compilation of the inner loops: on first use, once a machine, without the interpreter's lock."""

from collections.abc import Callable
from typing import ParamSpec, Protocol, TypeVar

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Compiler(Protocol):
    """Compiles a function to one of the same arguments and result."""

    def __call__(self, function: Callable[Arguments, Result], /) -> Callable[Arguments, Result]: ...


compiled: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
reduction: Compiler = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nnan", "nsz"})
"""For sums and maxima over rows without a NaN, in the order the processor likes."""

inlined: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, inline="always")
"""For what is called once a program or a number: passing arrays costs as much as a short program takes."""

of_a_number: Compiler = njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
"""For functions of numbers: compiled once, and inlined by the optimiser. `inlined` would compile each use anew."""
