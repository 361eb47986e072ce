"""Programs in the languages of others: LaTeX and NumPy source."""

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
