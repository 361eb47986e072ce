"""Description length of a formula."""

from gpmodel.formula.program import Node, Program

LINEAR = ("add", "subtract", "multiply", "divide")
CURVED = frozenset(("sin", "cos", "tan", "atan", "exp", "log", "tanh", "asin", "reciprocal", "logistic"))
NESTED = 2
"""Nodes that a function of a function costs besides its own, a price of reading: of 40 drawn formulas of two inputs two
became better and none worse."""


def description_size(program: Program) -> int:
    """Nodes of a program, and `NESTED` more for every curved function of a curved function."""
    curved, nested = list[bool](), 0
    for node in program.nodes:
        inside = any(curved[k] for k in node.arguments)
        nested += inside and node.operator in CURVED
        curved.append(inside or node.operator in CURVED)
    return program.complexity + NESTED * nested


def length(program: Program) -> int:
    """Operators, inputs and constants of a program written out; an input with an origin and a scale counts as one."""
    nodes, sizes, plain = program.nodes, list[int](), list[bool]()
    for node in nodes:
        plain.append(node.operator == "input" or _scales(node, nodes, plain))
        sizes.append(1 if plain[-1] else 1 + sum(sizes[k] for k in node.arguments))
    return sum(sizes[k] for k in program.outputs)


def _scales(node: Node, nodes: tuple[Node, ...], plain: list[bool]) -> bool:
    """Return whether a node shifts or scales an input by a constant; plain: whether each earlier node does no more."""
    if node.operator not in LINEAR:
        return False
    first, second = node.arguments
    by_constant = nodes[second].operator == "constant" and plain[first]
    return by_constant or (nodes[first].operator == "constant" and plain[second] and node.operator != "divide")
