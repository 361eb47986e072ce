"""Convert formulas (programs) to sympy expressions, simplify the expressions, and convert them back."""

from collections.abc import Callable, Mapping, Sequence
from math import prod

import sympy
from sympy.core.function import Application
from sympy.functions.elementary.hyperbolic import HyperbolicFunction
from sympy.functions.elementary.trigonometric import TrigonometricFunction

from gpmodel.formula.expression import raise_to
from gpmodel.formula.operators import BY_NAME, WRITTEN
from gpmodel.formula.program import Builder, Node, Program

_LARGEST_POWER = 64
Pieces = Mapping[sympy.Symbol, sympy.Expr]
LARGEST_PIECE = 30
"""Largest number of operators and leaves of one sympy expression; simplifying a longer expression takes minutes."""

logical_not = sympy.Function("not_")
"""Function that is 1 if the argument is 0, else 0. sympy does not simplify this function."""

deadzone, logistic, hypot = map(sympy.Function, ("deadzone", "logistic", "hypot"))
"""Functions that sympy does not simplify: excess of the argument beyond -1 to 1; 1/(1 + exp(-a)); sqrt(a*a + b*b)."""

_SYMPY: dict[str, Callable[..., sympy.Expr]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "modulo": sympy.Mod,
    "min": sympy.Min,
    "max": sympy.Max,
    "abs": sympy.Abs,
    "square": lambda a: a**2,
    "sqrt": lambda a: sympy.sqrt(sympy.Abs(a)),
    "not": logical_not,
    "sin": sympy.sin,
    "cos": sympy.cos,
    "tan": sympy.tan,
    "atan": sympy.atan,
    "exp": sympy.exp,
    "log": lambda a: sympy.log(sympy.Abs(a)),
    "tanh": sympy.tanh,
    "asin": sympy.asin,
    "reciprocal": lambda a: 1 / a,
    "sign": sympy.sign,
    "step": lambda a: sympy.Heaviside(a, 0),
    "deadzone": deadzone,
    "logistic": logistic,
    "hypot": hypot,
    "power": lambda a, b: a**b,
}


def to_sympy(program: Program) -> list[sympy.Expr]:
    """Return one sympy expression for each output of a program. Inputs become real symbols of equal names."""
    return in_pieces(program, None)[1]


def in_pieces(program: Program, largest: int | None) -> tuple[dict[sympy.Symbol, sympy.Expr], list[sympy.Expr]]:
    """Convert a program to sympy in pieces: symbols defined by large subexpressions, and outputs in terms of symbols.

    No expression has more than about `largest` operators and leaves. The written-out form of a program with shared
    parts may be exponentially longer, and its algebra would not end. largest: that number; None for no limit.
    """
    values: list[sympy.Expr] = []
    sizes: list[int] = []
    pieces: dict[sympy.Symbol, sympy.Expr] = {}
    taken = set(program.inputs)
    for node in program.nodes:
        if largest is not None and 1 + sum(sizes[k] for k in node.arguments) > largest:
            for k in node.arguments:
                if sizes[k] > 1:
                    name = next(f"v{n}" for n in range(len(pieces) + 1, 10**9) if f"v{n}" not in taken)
                    taken.add(name)
                    symbol = sympy.Symbol(name, real=True)
                    pieces[symbol], values[k], sizes[k] = values[k], symbol, 1
        values.append(_value(node, values))
        sizes.append(1 if values[-1].is_Atom else 1 + sum(sizes[k] for k in node.arguments))
    return pieces, [values[k] for k in program.outputs]


def _value(node: Node, values: list[sympy.Expr]) -> sympy.Expr:
    if node.operator == "input":
        return sympy.Symbol(str(node.value), real=True)
    if node.operator == "constant":
        number = float(node.value or 0.0)
        return sympy.Integer(int(number)) if number == int(number) else sympy.Float(number)
    return _SYMPY[node.operator](*(values[k] for k in node.arguments))


def from_sympy(expressions: Sequence[sympy.Expr], pieces: Pieces | None = None) -> Program:
    """Convert sympy expressions to a program. `pieces` defines some symbols of the expressions.

    Raises ValueError for a function that no operator computes.
    """
    builder = Builder()
    built: dict[sympy.Symbol, int] = {}
    for symbol, expression in (pieces or {}).items():
        built[symbol] = _build(builder, expression, built)
    return builder.program([_build(builder, expression, built) for expression in expressions])


_FROM_SYMPY: dict[type[sympy.Basic], str] = {
    sympy.Mod: "modulo",
    sympy.Abs: "abs",
    logical_not: "not",
    sympy.sign: "sign",
    sympy.Heaviside: "step",
    deadzone: "deadzone",
    logistic: "logistic",
    hypot: "hypot",
    **{getattr(sympy, name): name for name in ("sin", "cos", "tan", "atan", "exp", "log", "tanh", "asin")},
}


def _build(builder: Builder, expression: sympy.Expr, built: Mapping[sympy.Symbol, int]) -> int:
    if expression.is_Symbol:
        return built[expression] if expression in built else builder.input(expression.name)
    if expression.is_number:
        value = complex(expression)
        if value.imag:
            raise ValueError(f"{expression} is not real")
        return builder.constant(value.real)
    if expression.is_Add or expression.is_Mul:
        return _chain(builder, expression, built)
    arguments = expression.args
    if expression.is_Pow:
        return _power(builder, arguments[0], arguments[1], built)
    if isinstance(expression, sympy.Min | sympy.Max):
        name = "min" if isinstance(expression, sympy.Min) else "max"
        parts = [_build(builder, argument, built) for argument in arguments]
        total = parts[0]
        for item in parts[1:]:
            total = builder.apply(name, total, item)
        return total
    if expression.func == sympy.log:
        return builder.apply("log", _build(builder, _magnitude(arguments[0]), built))
    if expression.func not in _FROM_SYMPY:
        raise ValueError(f"no operator computes {expression.func}")
    name = _FROM_SYMPY[expression.func]
    return builder.apply(name, *(_build(builder, a, built) for a in arguments[: BY_NAME[name].arity]))


def _chain(builder: Builder, expression: sympy.Expr, built: Mapping[sympy.Symbol, int]) -> int:
    """Build the program of a sum, with negative terms subtracted, or of a product, with inverse factors as divisors."""
    join, invert = ("add", "subtract") if expression.is_Add else ("multiply", "divide")
    neutral = 0.0 if expression.is_Add else 1.0
    plain, inverse = [], []
    for argument in expression.args:
        if expression.is_Add and argument.could_extract_minus_sign():
            inverse.append(-argument)
        elif expression.is_Mul and argument.is_Pow and argument.exp.is_number and argument.exp < 0:
            inverse.append(1 / argument)
        elif not argument.is_number or argument != neutral:
            plain.append(argument)
    parts = [_build(builder, argument, built) for argument in plain]
    total = parts[0] if parts else builder.constant(neutral)
    for item in parts[1:]:
        total = builder.apply(join, total, item)
    for argument in inverse:
        total = builder.apply(invert, total, _build(builder, argument, built))
    return total


def _magnitude(expression: sympy.Expr) -> sympy.Expr:
    """Remove an outer absolute value: ``sqrt`` and ``log`` take the absolute value of their argument."""
    return expression.args[0] if isinstance(expression, sympy.Abs) else expression


def _power(builder: Builder, base: sympy.Expr, exponent: sympy.Expr, built: Mapping[sympy.Symbol, int]) -> int:
    if base == sympy.E:
        return builder.apply("exp", _build(builder, exponent, built))
    if exponent.is_number and exponent < 0:
        return builder.apply("divide", builder.constant(1.0), _build(builder, base ** (-exponent), built))
    if exponent.is_Integer and exponent <= _LARGEST_POWER:
        return raise_to(builder, _build(builder, base, built), int(exponent))
    if exponent.is_Rational and exponent.q == 2 and exponent.p <= _LARGEST_POWER:
        root = builder.apply("sqrt", _build(builder, _magnitude(base), built))
        return raise_to(builder, root, int(exponent.p))
    return builder.apply("power", _build(builder, base, built), _build(builder, exponent, built))


_ONE_OPERATOR = 2

MOST_TERMS = 64
"""Largest number of terms of an expanded expression that is simplified; a sine or cosine counts as two. Algebra on a
longer expression takes seconds and hardly shortens the expression."""


def simplify(program: Program) -> Program:
    """Return the shortest equivalent program that constant folding and algebra find.

    A program with an operator that evolution does not use is returned unchanged.
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
        if not _is_written(candidate):
            best = min(best, candidate, key=lambda one: (sum(one.operator_counts.values()), one.complexity))
    return best


def _is_written(program: Program) -> bool:
    """Return whether a program has an operator that only users write and evolution does not use."""
    return any(BY_NAME[name].code >= WRITTEN for name in program.operator_counts)


def _unchanged(expression: sympy.Expr) -> sympy.Expr:
    return expression


def _by_levels(expression: sympy.Expr) -> sympy.Expr:
    """Simplify an expression from the inside to the outside: the arguments of functions first.

    The search of sympy for trigonometric identities inside the arguments of functions takes long. Each argument of a
    function is therefore simplified alone and replaced by a symbol. An expression or argument with more than MOST_TERMS
    terms after expansion stays unchanged.
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
