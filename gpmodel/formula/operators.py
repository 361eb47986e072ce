"""Define the operators of formulas: Table 5.1 of Robertson (2003) and some more, with their exact meaning.

The table in this module is the only definition of an operator. Programs, formulas in text, algebra and printing use the
table. Compiled loops compute equal functions and are tested against the table.

* Arithmetic is IEEE and unprotected: a division by zero gives an infinity. The search rejects a program whose output is
not finite. No smooth function contains a hidden branch.
* ``sqrt`` and ``log`` take the absolute value; ``modulo`` is ``a - b*floor(a/b)`` and has the sign of the divisor.
* ``not`` is the operator of C: 1 where the argument is 0, else 0.
* ``min`` and ``max`` propagate a NaN.
* ``step`` is 1 above 0, else 0; ``deadzone`` is the excess of its argument below -1 or above 1, else 0.
* ``logistic`` is 1/(1 + exp(-a)), ``hypot`` is sqrt(a*a + b*b).
* ``power`` is real: NaN for a negative base and an exponent that is not whole.
* Angles are in radians.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError, choices

TABLE_CONSTANTS: tuple[float, ...] = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Constants that a program may use: input elements 9 to 15 of Table 5.1 of Robertson (2003)."""


@dataclass(frozen=True)
class Operator:
    """An operator of formulas: op-code, name, function of one or two arguments, and its partial derivatives.

    code: op-code; ``WRITTEN`` or more for an operator that only users write and evolution does not use.
    smooth: whether the first derivative is continuous everywhere.
    derivatives: function of the arguments that returns one array per argument; exact almost everywhere if not smooth.
    """

    code: int
    name: str
    arity: int
    smooth: bool
    function: Callable[..., Array]
    derivatives: Callable[..., tuple[Array, ...]]


def _modulo(a: Array, b: Array) -> Array:
    return a - b * np.floor(a / b)


def _arcsin(a: Array) -> Array:
    return np.arcsin(a)


def _ones(a: Array) -> Array:
    return np.ones_like(a)


def _logistic(a: Array) -> Array:
    return 0.5 + 0.5 * np.tanh(0.5 * a)


def _beyond(a: Array) -> Array:
    return (np.abs(a) > 1.0).astype(float)


def _directions(a: Array, b: Array) -> tuple[Array, Array]:
    away = np.maximum(np.hypot(a, b), np.finfo(float).tiny)
    return a / away, b / away


def _between(chosen: Mask) -> tuple[Array, Array]:
    first = chosen.astype(float)
    return first, 1.0 - first


INPUT, LOAD, STORE = 0, 1, 2
"""Op-codes of instructions of evolved programs that only move data: input, load, store."""

WRITTEN = 23
"""First op-code of operators that users write and that are fitted, but not evolved."""

ARITHMETIC: tuple[Operator, ...] = (
    Operator(3, "add", 2, True, np.add, lambda a, b: (_ones(a), _ones(b))),
    Operator(4, "subtract", 2, True, np.subtract, lambda a, b: (_ones(a), -_ones(b))),
    Operator(5, "multiply", 2, True, np.multiply, lambda a, b: (b, a)),
    Operator(6, "divide", 2, False, np.divide, lambda a, b: (1.0 / b, -a / (b * b))),
    Operator(7, "modulo", 2, False, _modulo, lambda a, b: (_ones(a), -np.floor(a / b))),
    Operator(8, "min", 2, False, np.minimum, lambda a, b: _between(a < b)),
    Operator(9, "max", 2, False, np.maximum, lambda a, b: _between(a > b)),
    Operator(10, "abs", 1, False, np.abs, lambda a: (np.sign(a),)),
    Operator(11, "square", 1, True, np.square, lambda a: (2.0 * a,)),
    Operator(12, "sqrt", 1, False, lambda a: np.sqrt(np.abs(a)), lambda a: (0.5 * np.sign(a) / np.sqrt(np.abs(a)),)),
    Operator(13, "not", 1, False, lambda a: (a == 0.0).astype(float), lambda a: (np.zeros_like(a),)),
    Operator(14, "sin", 1, True, np.sin, lambda a: (np.cos(a),)),
    Operator(15, "cos", 1, True, np.cos, lambda a: (-np.sin(a),)),
    Operator(16, "tan", 1, False, np.tan, lambda a: (1.0 + np.square(np.tan(a)),)),
    Operator(17, "atan", 1, True, np.arctan, lambda a: (1.0 / (1.0 + a * a),)),
    Operator(18, "exp", 1, True, np.exp, lambda a: (np.exp(a),)),
    Operator(19, "log", 1, False, lambda a: np.log(np.abs(a)), lambda a: (1.0 / a,)),
    Operator(20, "tanh", 1, True, np.tanh, lambda a: (1.0 - np.square(np.tanh(a)),)),
    Operator(21, "asin", 1, False, _arcsin, lambda a: (1.0 / np.sqrt(1.0 - a * a),)),
    Operator(22, "reciprocal", 1, False, lambda a: 1.0 / a, lambda a: (-1.0 / (a * a),)),
)
"""All operators that can be evolved. Codes 3 to 17 are the codes of Table 5.1 of Robertson (2003)."""

LANGUAGE: tuple[Operator, ...] = (
    *ARITHMETIC,
    Operator(WRITTEN, "sign", 1, False, np.sign, lambda a: (np.zeros_like(a),)),
    Operator(24, "step", 1, False, lambda a: (a > 0.0).astype(float), lambda a: (np.zeros_like(a),)),
    Operator(25, "logistic", 1, True, _logistic, lambda a: (_logistic(a) * _logistic(-a),)),
    Operator(26, "deadzone", 1, False, lambda a: a - np.clip(a, -1.0, 1.0), lambda a: (_beyond(a),)),
    Operator(27, "hypot", 2, False, np.hypot, _directions),
    Operator(
        28, "power", 2, False, np.float_power,
        lambda a, b: (b * np.float_power(a, b - 1.0), np.float_power(a, b) * np.log(a)),
    ),
)  # fmt: skip
"""All operators that a user can write in a formula."""

BY_NAME: dict[str, Operator] = {operator.name: operator for operator in LANGUAGE}
BY_CODE: dict[int, Operator] = {operator.code: operator for operator in ARITHMETIC}

SETS: dict[str, tuple[str, ...]] = {
    "thesis": tuple(operator.name for operator in ARITHMETIC if operator.code <= 17),
    "smooth": tuple(operator.name for operator in ARITHMETIC if operator.smooth and operator.code <= 17),
    "slot": ("add", "subtract", "multiply", "divide", "min", "max", "abs", "square", "sin", "cos", "exp", "tanh"),
    "physics": ("reciprocal", "add", "subtract", "multiply", "divide", "square", "sqrt", "sin", "cos", "exp", "log"),
}
"""Operator sets: ``thesis`` (Table 5.1 of Robertson 2003), ``smooth`` (continuous first derivative, its section 5.2.3),
``slot`` (shapes of mechanism errors: harmonics, springs, dead zones, bumps, saturation), ``physics`` (laws)."""


def operator_set(names: str | Iterable[str]) -> tuple[Operator, ...]:
    """Return the operators of a named set, or of a list of operator names, in op-code order.

    Raises InputError for an unknown name.
    """
    if isinstance(names, str):
        names = SETS[names] if names in SETS else [name.strip() for name in names.split(",")]
    chosen = set(names)
    offered = [operator.name for operator in ARITHMETIC]
    unknown = sorted(chosen.difference(offered))
    if unknown:
        raise InputError(
            f"unknown {', '.join(map(repr, unknown))}; expected one of the sets {', '.join(SETS)}, or operators of "
            f"{choices(unknown[0], offered)}",
            "operators",
        )
    if not chosen:
        raise InputError("no operators, expected at least one", "operators")
    return tuple(operator for operator in ARITHMETIC if operator.name in chosen)
