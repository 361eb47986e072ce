"""The page of tables and options has a row for everything that is read."""

import re
from pathlib import Path

import click
import pytest

from gpmodel.cli.main import main
from gpmodel.model.described import KINDS, SOLVED
from gpmodel.table.dataset import LABELS, READINGS

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
CELLS = [line.strip("| ").split(" | ")[0] for line in PAGE.splitlines() if line.startswith("| ")]
FIRST = {word for cell in CELLS for part in re.findall(r"`([^`]+)`", cell) for word in part.split()}
"""The words in code in the first cells of all rows."""
POINT = ("x", "y", "z", "rx", "ry", "rz", "payload", "distance_*")


@pytest.mark.parametrize("column", [*LABELS, *READINGS, *POINT])
def test_every_column_of_a_table_has_a_row(column: str) -> None:
    assert column in FIRST


def test_every_option_of_every_command_has_a_row() -> None:
    root = click.Context(main)
    commands = {name: main.get_command(root, name) for name in main.list_commands(root)}
    options = {
        (name, flag)
        for name, command in commands.items()
        for option in (command.params if command else ())
        if isinstance(option, click.Option)
        for flag in option.opts
    }
    assert len(options) > 100
    assert {(name, flag) for name, flag in options if flag not in FIRST} == set()
    assert {name for name in commands if f"`gpmodel {name}" not in PAGE} == set()


def test_what_files_describe_is_said_with_its_words() -> None:
    assert {f"--{kind}" for kind in KINDS} <= FIRST
    assert [word for word in SOLVED if f'"{word}"' not in PAGE] == []
