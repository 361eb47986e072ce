"""Programs in the languages of others: LaTeX, NumPy and C99 source."""

from collections.abc import Mapping
from typing import Literal

import sympy

from gpmodel.formula.algebra import LARGEST_PIECE, in_pieces
from gpmodel.formula.program import Program


def latex(program: Program) -> str:
    """LaTeX of the outputs, separated by commas; after the definitions of their parts where they are long.

    Numbers are rounded to six digits.
    """
    written = {
        sympy.Symbol(name, real=True): "\\mathrm{" + name.replace(" ", "\\ ").replace("_", "\\_") + "}"
        for name in program.inputs
        if not name.isalnum()
    }

    def line(expression: sympy.Basic) -> str:
        rounded = {number: sympy.Float(number, 6) for number in expression.atoms(sympy.Float)}
        return str(sympy.latex(expression.xreplace(rounded), symbol_names=written))

    pieces, outputs = in_pieces(program, LARGEST_PIECE)
    parts = [f"{line(symbol)} = {line(expression)}" for symbol, expression in pieces.items()]
    return ";\\; ".join([*parts, ", ".join(map(line, outputs))])


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


def inline(program: Program, language: Literal["numpy", "c99"], columns: Mapping[str, str]) -> str:
    """The first output as one expression. columns: what each input is called there. C needs <math.h>."""
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
    "power": "pow({0}, {1})",
}
