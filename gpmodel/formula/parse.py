"""Text to program, by Python's own expression grammar."""

import ast

from gpmodel.errors import InputError
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.program import Builder, Program

_BINARY: dict[type, str] = {
    ast.Add: "add",
    ast.Sub: "subtract",
    ast.Mult: "multiply",
    ast.Div: "divide",
    ast.Mod: "modulo",
}


def parse(text: str) -> Program:
    """``v1 = sin(J1); v1*v1 + 2*'oil temperature', v1`` to a program.

    Functions are the operators' names; ``x**n`` with a whole n is written out. A quoted text is an input
    whose name is no identifier. Raises InputError with the part that could not be read.
    """
    try:
        statements = ast.parse(text.strip()).body
    except SyntaxError as error:
        raise InputError(f"program {text!r}: {error.msg} near column {error.offset}") from None
    if not statements or not isinstance(statements[-1], ast.Expr):
        raise InputError(f"program {text!r}: expected an expression at the end")
    reader = _Reader(text)
    for statement in statements[:-1]:
        if not (isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)):
            raise InputError(f"program {text!r}: expected 'name = expression' before the last ';'")
        reader.names[statement.targets[0].id] = reader.read(statement.value)
    last = statements[-1].value
    outputs = last.elts if isinstance(last, ast.Tuple) else [last]
    return reader.builder.program([reader.read(output) for output in outputs])


class _Reader:
    def __init__(self, text: str) -> None:
        self.text = text
        self.builder = Builder()
        self.names: dict[str, int] = {}

    def read(self, node: ast.expr) -> int:
        builder = self.builder
        match node:
            case ast.Constant(value=str() as name):
                return builder.input(name)
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return builder.constant(float(value))
            case ast.Name(id=name):
                return self.names[name] if name in self.names else builder.input(name)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return builder.constant(-float(value))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return builder.apply("multiply", builder.constant(-1.0), self.read(operand))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return builder.apply("not", self.read(operand))
            case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int() as power)) if 0 < power < 65:
                return raise_to(builder, self.read(base), power)
            case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
                return builder.apply(_BINARY[type(operation)], self.read(left), self.read(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in BY_NAME:
                return builder.apply(name, *(self.read(argument) for argument in arguments))
        raise InputError(
            f"program {self.text!r}: cannot read {ast.unparse(node)!r}; operators are {', '.join(BY_NAME)}"
        )


def raise_to(builder: Builder, base: int, power: int) -> int:
    """``base**power`` for a whole power of at least one, by squaring."""
    if power == 1:
        return base
    half = raise_to(builder, base, power // 2)
    squared = builder.apply("square", half)
    return builder.apply("multiply", squared, base) if power % 2 else squared
