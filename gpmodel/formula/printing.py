"""Write formulas (programs) as LaTeX, NumPy or C99 source."""

import re
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

import sympy

from gpmodel.characters import harmless
from gpmodel.formula.algebra import LARGEST_PIECE, from_sympy, hypot, in_pieces, logical_not
from gpmodel.formula.expression import DIGITS
from gpmodel.formula.program import Program

_ONE_LETTER = re.compile(r"[A-Za-z]\d*$")
"""Pattern of names that LaTeX sets in italics. Each letter of a longer name in italics would look like a factor."""
_STEP, _NOT = sympy.Function("step"), sympy.Function("not")


def latex(program: Program) -> str:
    """Write the outputs of a program in LaTeX, separated by commas; definitions of parts precede a long output.

    Numbers in the LaTeX text are rounded to DIGITS significant digits.
    """
    parts, outputs = latex_lines(program)
    return ";\\; ".join([*(f"{name} = {text}" for name, text in parts), ", ".join(outputs)])


def latex_lines(
    program: Program, names: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[tuple[str, str]], list[str]]:
    """Write names and LaTeX definitions of a program's parts, and one text for each output. names: new input names."""
    written = {sympy.Symbol(name, real=True): _symbol(names.get(name, name)) for name in program.inputs}
    pieces, outputs = _rounded(program)

    def line(expression: sympy.Basic) -> str:
        named = expression.replace(sympy.Heaviside, lambda a, *_: _STEP(a)).replace(logical_not, _NOT)
        named = named.replace(hypot, lambda a, b: sympy.sqrt(a**2 + b**2))
        return str(sympy.latex(named, symbol_names=written))

    return [(line(symbol), line(expression)) for symbol, expression in pieces.items()], list(map(line, outputs))


def _symbol(name: str) -> str:
    if _ONE_LETTER.match(name):
        return str(sympy.latex(sympy.Symbol(name)))
    return "\\mathrm{" + in_latex(name) + "}"


def in_latex(name: str) -> str:
    """Escape a name for LaTeX, so that the name is no command and no comment."""
    return harmless(name).replace("%", "\\%").replace(" ", "\\ ").replace("_", "\\_")


def as_in_latex(program: Program) -> Program:
    """Return the program with its numbers rounded to DIGITS significant digits, as its LaTeX text shows them."""
    pieces, outputs = _rounded(program)
    return from_sympy(outputs, pieces)


@lru_cache(maxsize=1)
def _rounded(program: Program) -> tuple[dict[sympy.Symbol, sympy.Expr], list[sympy.Expr]]:
    """Return parts and outputs of a program with numbers rounded to DIGITS significant digits.

    The last rounded program is cached for `as_in_latex`, which follows `latex`.
    """

    def rounded(expression: sympy.Expr) -> sympy.Expr:
        return expression.xreplace({n: sympy.Float(f"{float(n):.{DIGITS}g}") for n in expression.atoms(sympy.Float)})

    pieces, outputs = in_pieces(program, LARGEST_PIECE)
    return {symbol: rounded(expression) for symbol, expression in pieces.items()}, list(map(rounded, outputs))


def inline(program: Program, language: Literal["numpy", "c99"], columns: Mapping[str, str]) -> str:
    """Write the first output of a program as one expression. C99 source needs <math.h>.

    columns: name or source text of each input in the language.
    """
    written: list[str] = []
    for node in program.nodes:
        if node.operator == "input":
            text = columns[str(node.value)]
        elif node.operator == "constant":
            text = f"({float(node.value or 0.0)!r})"
        else:
            arguments = [written[k] for k in node.arguments]
            text = f"({(_NUMPY if language == 'numpy' else _C99)[node.operator].format(*arguments)})"
        written.append(text)
    return written[program.outputs[0]]


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
    "sign": "np.sign({0})",
    "step": "({0} > 0.0).astype(float)",
    "logistic": "0.5 + 0.5 * np.tanh(0.5 * {0})",
    "deadzone": "{0} - np.clip({0}, -1.0, 1.0)",
    "hypot": "np.hypot({0}, {1})",
    "power": "np.float_power({0}, {1})",
}

_C99: dict[str, str] = _NUMPY | {
    "modulo": "{0} - {1} * floor({0} / {1})",
    "min": "fmin({0}, {1})",
    "max": "fmax({0}, {1})",
    "abs": "fabs({0})",
    "square": "{0} * {0}",
    "sqrt": "sqrt(fabs({0}))",
    "not": "{0} == 0.0 ? 1.0 : 0.0",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "tan": "tan({0})",
    "atan": "atan({0})",
    "exp": "exp({0})",
    "log": "log(fabs({0}))",
    "tanh": "tanh({0})",
    "asin": "asin({0})",
    "sign": "(double)(({0} > 0.0) - ({0} < 0.0))",
    "step": "{0} > 0.0 ? 1.0 : 0.0",
    "logistic": "0.5 + 0.5 * tanh(0.5 * {0})",
    "deadzone": "{0} - fmin(fmax({0}, -1.0), 1.0)",
    "hypot": "hypot({0}, {1})",
    "power": "pow({0}, {1})",
}
