"""Names of files that would end a string of source or steer a terminal: refused at once, printed harmlessly."""

from pathlib import Path

import pytest
from cli_cases import one_line, run, table, write

UNKEPT = "could not be kept in a model file: file: Expected text without quotes"
STEERS = "holds control characters; expected a path"


@pytest.mark.parametrize("command", ["calibrate", "discover"])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ('a"b.csv', UNKEPT), ("a\x1b[31m.csv", STEERS), ("a\\b.csv", UNKEPT), ("\udcff.csv", STEERS),
    ],
)  # fmt: skip
def test_a_name_that_no_model_may_hold_is_refused_at_once_and_printed_harmlessly(
    name: str, said: str, command: str, tmp_path: Path
) -> None:
    path = write(table(), tmp_path / name)
    line = one_line(run(command, path, "--mechanism", "irb6400r", "--out", tmp_path / "out", "--quiet"), 2)
    assert said in line
    assert line.isprintable()
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_not_there_is_printed_harmlessly() -> None:
    line = one_line(run("calibrate", "a\x1b[31m.csv", "--mechanism", "irb6400r"), 2)
    assert "x1b[31m.csv' holds control characters" in line
