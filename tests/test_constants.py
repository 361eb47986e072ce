"""Test that every named numeric constant has a source in the table of constants."""

import ast
import csv
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "reference" / "constants.csv"
KINDS = {"standard", "derived", "measured", "definition", "rounding", "size", "steps", "display", "chosen"}
MOST_CHOSEN = 179
"""Constants chosen by hand: a change may lower their number."""
INSIDE = {ast.Tuple: "elts", ast.List: "elts", ast.Dict: "values", ast.Call: "args"}
SETTINGS = {"Criteria", "Search", "Linear", "Tree", "Tournament", "Truncation",
            "Budget", "CartesianProblem", "SlotProblem"}  # fmt: skip
"""Classes whose numbers are constants of the method."""


def is_number(node: ast.expr) -> bool:
    """Return whether a value consists of literal numbers."""
    match node:
        case ast.Constant():
            return type(node.value) in (int, float)
        case ast.BinOp():
            return is_number(node.left) or is_number(node.right)
        case ast.UnaryOp():
            return is_number(node.operand)
        case ast.Call() if any(is_number(k.value) for k in node.keywords):
            return True
    parts = getattr(node, INSIDE[type(node)]) if type(node) in INSIDE else ()
    return any(part is not None and is_number(part) for part in parts)


def constants(path: Path) -> Iterator[tuple[str, bool]]:
    """Every constant of a file, and whether its docstring follows it or its neighbours."""
    waiting: list[str] = []
    for node in [*ast.parse(path.read_text(encoding="utf-8")).body, ast.Pass()]:
        if isinstance(node, ast.ClassDef) and node.name in SETTINGS:
            numbers = [n for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.value, ast.Constant)]
            for n in numbers:
                if is_number(n.value) and n.value.value not in (0, 1):
                    yield f"{node.name}.{ast.unparse(n.target)}", bool(ast.get_docstring(node))
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            names = [ast.unparse(t) for t in (target.elts if isinstance(target, ast.Tuple) else [target])]
            waiting += [name for name in names if name.isupper() and is_number(node.value)]
            continue
        told = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        yield from ((name, told) for name in waiting)
        waiting = []


def test_every_constant_has_a_source_and_no_row_is_left_over() -> None:
    with TABLE.open(encoding="utf-8") as file:
        table = {(row["file"], row["name"]): row for row in csv.DictReader(file)}
    found = {
        (path.relative_to(ROOT).as_posix(), name): told
        for package in ("gpmodel", "robots", "joints")
        for path in sorted((ROOT / package).rglob("*.py"))
        for name, told in constants(path)
    }
    assert found.keys() - table.keys() == set()
    assert table.keys() - found.keys() == set()
    assert {row["kind"] for row in table.values()} == KINDS
    argued = {"standard", "derived", "measured"}
    assert [k for k, row in table.items() if row["kind"] in argued and not (row["source"] or found[k])] == []
    assert sum(row["kind"] == "chosen" for row in table.values()) <= MOST_CHOSEN


def test_experiments_that_are_named_as_sources_exist() -> None:
    with TABLE.open(encoding="utf-8") as file:
        sources = [row["source"] for row in csv.DictReader(file)]
    named = {word.strip(",;") for source in sources for word in source.split() if word.startswith("experiments/")}
    assert named
    assert [name for name in named if not (ROOT / name).is_dir()] == []
