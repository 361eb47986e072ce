"""Some readings are bad: they are named and left out of every error, or the table is refused where they are many."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, run, table, write

import gpmodel as gp

GOOD = table(90)
POINTS = ["x [mm]", "y [mm]", "z [mm]"]


def placed(rows: list[int], points: np.ndarray) -> pd.DataFrame:
    """The good table with other points in some rows."""
    out = GOOD.astype(dict.fromkeys(POINTS, float))
    out.loc[rows, POINTS] = points
    return out


def shuffled() -> pd.DataFrame:
    rows = list(range(5, 85, 8))
    return placed(rows, numbers(GOOD, POINTS)[np.roll(rows, 1)])


FEW: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "one digit": (lambda: placed([17], numbers(GOOD, POINTS)[17] + [20.0, 0.0, 0.0]),
                  "1 of 90 readings left out (row 18)"),
    "a lost beam": (lambda: placed([30, 31], np.zeros((2, 3))), "2 of 90 readings left out (rows 31, 32)"),
    "-999.9": (lambda: placed([60], np.full((1, 3), -999.9)), "1 of 90 readings left out (row 61)"),
    "ten rows shuffled": (shuffled, "10 of 90 readings left out (rows 6, 14, 22"),
}  # fmt: skip


@pytest.mark.parametrize("case", FEW)
def test_a_few_bad_readings_are_named_and_the_table_stays_fit(case: str) -> None:
    make, said = FEW[case]
    judged = gp.check("irb6400r", make())
    assert not judged.unfit, judged.summary()
    assert said in " ".join(judged.summary().split())


@pytest.mark.parametrize("case", ["one digit", pytest.param("ten rows shuffled", marks=pytest.mark.long)])
def test_a_few_bad_readings_are_left_out_of_every_error(case: str) -> None:
    make, said = FEW[case]
    result = gp.calibrate("irb6400r", make())
    assert said in result.verdict
    ladder = result.record.ladder
    for errors in (ladder[-1].train, ladder[-1].heldout):
        assert (errors.max_mm or np.inf) < 0.3


@pytest.mark.parametrize("share", [0.45, *(pytest.param(s, marks=pytest.mark.long) for s in (0.3, 0.6))])
def test_readings_of_which_many_are_bad_are_refused(share: float, tmp_path: Path) -> None:
    rng = np.random.default_rng(int(100 * share))
    rows = rng.choice(90, int(share * 90), replace=False).tolist()
    off = rng.normal(0.0, 100.0, (len(rows), 3))
    path = write(placed(rows, numbers(GOOD, POINTS)[rows] + off), tmp_path / "bad.csv")
    for command in ("check", "calibrate"):
        said = one_line(run(command, path, "--mechanism", "irb6400r"), 2)
        assert "of 90 readings are up to" in said


def test_check_ends_with_2_where_a_table_is_not_fit_to_calibrate_with(tmp_path: Path) -> None:
    noisy = GOOD.assign(**{"x [mm]": numbers(GOOD, "x [mm]") + np.random.default_rng(0).normal(0, 9, 90)})
    result = run("check", write(noisy, tmp_path / "t.csv"), "--mechanism", "irb6400r")
    assert result.exit_code == 2
    assert "not fit to calibrate with" in result.stdout
