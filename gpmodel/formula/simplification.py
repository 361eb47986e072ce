"""Shorter programs of the same values, by computer algebra."""

from math import prod

import sympy
from sympy.core.function import Application
from sympy.functions.elementary.hyperbolic import HyperbolicFunction
from sympy.functions.elementary.trigonometric import TrigonometricFunction

from gpmodel.formula.algebra import LARGEST_PIECE, from_sympy, in_pieces
from gpmodel.formula.operators import BY_NAME, WRITTEN
from gpmodel.formula.program import Program

_ONE_OPERATOR = 2

MOST_TERMS = 64
"""Largest number of terms of an expanded expression, a sine or cosine counted as two.

Algebra on more takes seconds and hardly shortens any.
"""


def simplify(program: Program) -> Program:
    """The program with numbers and neutral elements worked out, then what algebra makes of it where that is shorter.

    One with an operator that is only written, never evolved, stays as it is.
    """
    if _is_written(program):
        return program
    best = program
    for largest, change in ((_ONE_OPERATOR, _unchanged), (LARGEST_PIECE, _unchanged), (LARGEST_PIECE, _by_levels)):
        try:
            pieces, outputs = in_pieces(best, largest)
            changed = {symbol: change(expression) for symbol, expression in pieces.items()}
            candidate = from_sympy([change(expression) for expression in outputs], changed)
        except (ValueError, TypeError, RecursionError):
            continue
        best = best if _is_written(candidate) else min(best, candidate, key=_operators_then_size)
    return best


def _is_written(program: Program) -> bool:
    """Return whether any of its operators is used in texts only and never evolved."""
    return any(BY_NAME[name].code >= WRITTEN for name in program.operator_counts)


def _operators_then_size(program: Program) -> tuple[int, int]:
    return sum(program.operator_counts.values()), program.complexity


def _unchanged(expression: sympy.Expr) -> sympy.Expr:
    return expression


def _by_levels(expression: sympy.Expr) -> sympy.Expr:
    """Simplify an expression level by level: functions of an angle nested within a function are simplified first.

    Identities of angles are sought in the whole of what they are given, also within the arguments of what is one
    number to them. One that multiplied out had more than MOST_TERMS stays as it is.
    """
    inside: dict[sympy.Expr, sympy.Symbol] = {}

    def named(argument: sympy.Expr) -> sympy.Expr:
        if not argument.has(TrigonometricFunction, HyperbolicFunction):
            return argument
        return inside.setdefault(_by_levels(argument), sympy.Dummy(real=True))

    def level(part: sympy.Expr) -> sympy.Expr:
        if part.is_Atom:
            return part
        return part.func(*map(named if isinstance(part, Application) else level, part.args))

    outer = level(expression)
    changed = sympy.simplify(outer) if _terms(outer) <= MOST_TERMS else outer
    return changed.xreplace({symbol: argument for argument, symbol in inside.items()})


def _terms(expression: sympy.Expr) -> int:
    """Count the terms of an expression after expansion."""
    if expression.is_Add:
        return sum(map(_terms, expression.args))
    if expression.is_Mul:
        return prod(map(_terms, expression.args))
    if expression.is_Pow:
        power = min(abs(int(expression.exp)), MOST_TERMS) if expression.exp.is_Integer else 1
        return int(_terms(expression.base) ** power)
    return 2 if isinstance(expression, TrigonometricFunction | HyperbolicFunction) else 1
