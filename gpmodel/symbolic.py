"""Programs and computer algebra: simplified forms, LaTeX, and NumPy source."""

from collections.abc import Callable
from typing import Any

import sympy

from gpmodel.operators import BY_NAME
from gpmodel.parsing import raise_to
from gpmodel.program import Builder, Program

_LARGEST_POWER = 64

logical_not = sympy.Function("not_")
"""1 where its argument is 0, else 0: left alone by the algebra."""

_SYMPY: dict[str, Callable[..., Any]] = {
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
}


def to_sympy(program: Program) -> list[sympy.Expr]:
    """One sympy expression an output; inputs are real symbols of the same names."""
    values: list[Any] = []
    for node in program.nodes:
        if node.operator == "input":
            values.append(sympy.Symbol(str(node.value), real=True))
        elif node.operator == "constant":
            number = float(node.value or 0.0)
            values.append(sympy.Integer(int(number)) if number == int(number) else sympy.Float(number))
        else:
            values.append(_SYMPY[node.operator](*(values[k] for k in node.arguments)))
    return [values[k] for k in program.outputs]


def from_sympy(expressions: list[Any]) -> Program:
    """The program of sympy expressions made of our operators.

    Raises ValueError for a function that no operator computes.
    """
    builder = Builder()
    return builder.program([_build(builder, expression) for expression in expressions])


def simplify(program: Program) -> Program:
    """The shorter of the program and its algebraic simplification."""
    try:
        simpler = from_sympy([sympy.simplify(expression) for expression in to_sympy(program)])
    except (ValueError, TypeError, RecursionError):
        return program
    return simpler if simpler.complexity < program.complexity else program


def latex(program: Program) -> str:
    """LaTeX of the outputs, separated by commas."""
    written = {
        sympy.Symbol(name, real=True): "\\mathrm{" + name.replace(" ", "\\ ").replace("_", "\\_") + "}"
        for name in program.inputs
        if not name.isalnum()
    }
    return ", ".join(sympy.latex(expression, symbol_names=written) for expression in to_sympy(program))


def numpy_source(program: Program, name: str = "basis") -> str:
    """Source of ``def name(inputs)``: from a mapping of input names to arrays to an array (outputs, N)."""
    lines = [
        "import numpy as np",
        "",
        "",
        f"def {name}(inputs):",
        "    length = max((np.size(column) for column in inputs.values()), default=1)",
    ]
    for index, node in enumerate(program.nodes):
        arguments = [f"v{k}" for k in node.arguments]
        if node.operator == "input":
            text = f"np.asarray(inputs[{str(node.value)!r}], dtype=float)"
        elif node.operator == "constant":
            text = f"np.full(length, {float(node.value or 0.0)!r})"
        else:
            text = _NUMPY[node.operator].format(*arguments)
        lines.append(f"    v{index} = {text}")
    lines.append(f"    return np.stack([{', '.join(f'v{k}' for k in program.outputs)}])")
    return "\n".join(lines) + "\n"


_NUMPY: dict[str, str] = {
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "modulo": "{0} - {1} * np.floor({0} / {1})",
    "min": "np.minimum({0}, {1})",
    "max": "np.maximum({0}, {1})",
    "abs": "np.abs({0})",
    "square": "np.square({0})",
    "sqrt": "np.sqrt(np.abs({0}))",
    "not": "({0} == 0.0).astype(float)",
    "sin": "np.sin({0})",
    "cos": "np.cos({0})",
    "tan": "np.tan({0})",
    "atan": "np.arctan({0})",
    "exp": "np.exp({0})",
    "log": "np.log(np.abs({0}))",
    "tanh": "np.tanh({0})",
    "asin": "np.arcsin({0})",
    "reciprocal": "1.0 / {0}",
}

_FROM_SYMPY: dict[Any, str] = {
    sympy.Mod: "modulo",
    sympy.Abs: "abs",
    logical_not: "not",
    **{
        getattr(sympy, name): name
        for name in ("sin", "cos", "tan", "atan", "exp", "log", "tanh", "asin")
        if name in BY_NAME
    },
}


def _build(builder: Builder, expression: Any) -> int:
    if expression.is_Symbol:
        return builder.input(expression.name)
    if expression.is_number:
        value = complex(expression)
        if value.imag:
            raise ValueError(f"{expression} is not real")
        return builder.constant(value.real)
    if expression.is_Add or expression.is_Mul:
        return _chain(builder, expression)
    arguments = expression.args
    if expression.is_Pow:
        return _power(builder, *arguments)
    if isinstance(expression, sympy.Min | sympy.Max):
        name = "min" if isinstance(expression, sympy.Min) else "max"
        built = [_build(builder, argument) for argument in arguments]
        total = built[0]
        for item in built[1:]:
            total = builder.apply(name, total, item)
        return total
    if expression.func == sympy.log:
        return builder.apply("log", _build(builder, _magnitude(arguments[0])))
    if expression.func not in _FROM_SYMPY:
        raise ValueError(f"no operator computes {expression.func}")
    return builder.apply(_FROM_SYMPY[expression.func], *(_build(builder, argument) for argument in arguments))


def _chain(builder: Builder, expression: Any) -> int:
    """A sum with its negative terms subtracted, or a product with its inverse factors divided by."""
    join, invert = ("add", "subtract") if expression.is_Add else ("multiply", "divide")
    plain, inverse = [], []
    for argument in expression.args:
        if expression.is_Add and argument.could_extract_minus_sign():
            inverse.append(-argument)
        elif expression.is_Mul and argument.is_Pow and argument.exp.is_number and argument.exp < 0:
            inverse.append(1 / argument)
        else:
            plain.append(argument)
    built = [_build(builder, argument) for argument in plain]
    total = built[0] if built else builder.constant(0.0 if expression.is_Add else 1.0)
    for item in built[1:]:
        total = builder.apply(join, total, item)
    for argument in inverse:
        total = builder.apply(invert, total, _build(builder, argument))
    return total


def _magnitude(expression: Any) -> Any:
    """Without an outer absolute value, which ``sqrt`` and ``log`` take anyway."""
    return expression.args[0] if isinstance(expression, sympy.Abs) else expression


def _power(builder: Builder, base: Any, exponent: Any) -> int:
    if base == sympy.E:
        return builder.apply("exp", _build(builder, exponent))
    if exponent.is_number and exponent < 0:
        return builder.apply("divide", builder.constant(1.0), _build(builder, base ** (-exponent)))
    if exponent.is_Integer and exponent <= _LARGEST_POWER:
        return raise_to(builder, _build(builder, base), int(exponent))
    if exponent.is_Rational and exponent.q == 2 and exponent.p <= _LARGEST_POWER:
        root = builder.apply("sqrt", _build(builder, _magnitude(base)))
        return raise_to(builder, root, int(exponent.p))
    raise ValueError(f"no operator computes the power {exponent}")
