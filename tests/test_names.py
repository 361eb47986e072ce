"""Test that no decision of the code depends on the spelling of a name."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "gpmodel"
SPELT = {"startswith", "endswith", "split", "rsplit", "partition", "rpartition", "removeprefix", "removesuffix"}
READ = {
    "families/by_name.py": "what a user asks for by name",
    "families/catalogue.py": "what a user asks for by name",
    "families/angle.py": "columns of a user's table that say where a joint came from",
    "families/load.py": "columns of unit loads",
    "families/inner.py": "symbols of constants in a template",
    "families/candidate.py": "sine and cosine as a user names them",
    "selection/offers.py": "one kind at several joints, also of families from outside",
}
"""Where text is read, and what it is."""


def reads_text(path: Path) -> bool:
    """Return whether a file takes text apart, by a method of texts or a regular expression."""
    calls = [node.func for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)]
    called = [call for call in calls if isinstance(call, ast.Attribute)]
    return any(call.attr in SPELT or (isinstance(call.value, ast.Name) and call.value.id == "re") for call in called)


@pytest.mark.parametrize("room", ["evidence", "families", "selection", "discovery"])
def test_only_these_files_take_text_apart(room: str) -> None:
    found = {p.relative_to(ROOT).as_posix() for p in (ROOT / room).glob("*.py") if reads_text(p)}
    assert found == {name for name in READ if name.startswith(f"{room}/")}
