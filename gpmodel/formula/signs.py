"""A program as one writes it by hand: no sum of a negative number, no difference of one."""

from gpmodel.formula.program import Builder, Node, Program

_OTHER = {"add": "subtract", "subtract": "add"}


def with_plain_signs(program: Program) -> Program:
    """The same program, of the same size and values, with x - (-c) as x + c, -c + x as x - c, and c·y alike for c."""
    return program.rebuilt(_plain)


def _plain(builder: Builder, node: Node, copies: list[int]) -> int:
    """A sum or difference with its second argument positive where that is a number or begins with one."""
    if node.operator not in _OTHER:
        return builder.add(node, copies)
    first, second = (copies[k] for k in node.arguments)
    if node.operator == "add" and _turned(builder, second) is None:
        first, second = (second, first) if _turned(builder, first) is not None else (first, second)
    turned = _turned(builder, second)
    return (
        builder.apply(node.operator, first, second)
        if turned is None
        else builder.apply(_OTHER[node.operator], first, turned)
    )


def _turned(builder: Builder, index: int) -> int | None:
    """The node of the other sign of a negative number, or of a product that begins with one; None of others."""
    node = builder.nodes[index]
    if node.operator == "multiply":
        factor = _turned(builder, node.arguments[0]) if _is_number(builder, node.arguments[0]) else None
        return None if factor is None else builder.apply("multiply", factor, node.arguments[1])
    value = float(node.value or 0.0) if _is_number(builder, index) else 0.0
    return builder.constant(-value) if value < 0 else None


def _is_number(builder: Builder, index: int) -> bool:
    return builder.nodes[index].operator == "constant"
