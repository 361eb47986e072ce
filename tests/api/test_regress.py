"""`gp.regress`: laws of any table, from a frame or an array, and one line for what is none."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gpmodel as gp

RNG = np.random.default_rng(2)
FRAME = pd.DataFrame({"load": RNG.uniform(1, 3, 60), "oil temp": RNG.uniform(1, 3, 60), "idle": RNG.uniform(1, 3, 60)})
LAW = 3.0 * FRAME["load"] * np.exp(-FRAME["oil temp"])


@pytest.mark.long
def test_a_law_is_found_exactly_and_holds_on_rows_it_never_saw() -> None:
    found = gp.regress(FRAME, LAW, seconds=60, seed=1)
    assert set(found.best.program.inputs) == {"load", "oil temp"}
    new = pd.DataFrame(RNG.uniform(1, 3, (20, 3)), columns=list(FRAME))
    np.testing.assert_allclose(found.predict(new), 3.0 * new["load"] * np.exp(-new["oil temp"]), rtol=1e-9)
    np.testing.assert_allclose(
        found.expression.program.evaluate({n: new[n].to_numpy() for n in new})[0], found.predict(new), rtol=1e-9
    )
    again = gp.regress(FRAME.to_numpy(), LAW.to_numpy(), names=list(FRAME), seconds=60, seed=1)
    assert [str(law.program) for law in again.laws] == [str(law.program) for law in found.laws]


@pytest.mark.long
def test_the_front_goes_from_short_to_close_and_marks_the_law_of_least_description_length(tmp_path: Path) -> None:
    noisy = LAW + np.random.default_rng(0).normal(0, 0.02, len(LAW))
    found = gp.regress(FRAME, noisy, seconds=1.5)
    frame = found.to_dataframe()
    assert len(frame) > 1
    assert frame["length"].is_monotonic_increasing
    assert frame["r_squared"].is_monotonic_increasing
    assert frame["nats"][frame["best"]].tolist() == [frame["nats"].min()]
    residual = noisy - found.predict(FRAME, int(frame.index[-1]))
    assert frame["rms"].iloc[-1] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-6)
    assert len(found.summary().splitlines()) == len(frame) + 1
    found.save(tmp_path / "laws.json")
    assert [row["law"] for row in json.loads((tmp_path / "laws.json").read_text())["laws"]] == frame["law"].tolist()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"y": LAW[:-1]}, "y: shape (59,), expected one number for each of the 60 rows"),
        ({"y": LAW * 0}, "response"),
        ({"y": LAW.where(LAW.index != 7)}, "y: not finite in row 7"),
        ({"X": FRAME.assign(name="a")}, "X: column 'name' holds no numbers"),
        ({"X": FRAME.to_numpy(), "names": ["a"]}, "X: 3 columns, expected 1: a"),
        ({"X": FRAME.reindex([0, 1, 2, 99, *range(4, 60)])}, "column 'load' is not finite in row 3"),
        ({"X": FRAME[:3], "y": LAW[:3]}, "X: 3 rows, expected 5 or more"),
        ({"X": [["a"]]}, "X: [['a']], expected numbers"),
        ({"seconds": -1}, "seconds: -1"),
        ({"names": ["load", "speed"]}, "X: no column 'speed', there are load, oil temp, idle"),
    ],
)
def test_bad_input_is_one_line(change: dict[str, object], said: str) -> None:
    with pytest.raises(gp.InputError) as error:
        gp.regress(**{"X": FRAME, "y": LAW, "seconds": 0.1, **change})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_row_of_other_columns_and_a_law_that_is_not_there_are_refused() -> None:
    found = gp.regress(FRAME, LAW, seconds=0.5)
    with pytest.raises(gp.InputError, match="no column 'load'"):
        found.predict(FRAME[["idle"]])
    with pytest.raises(gp.InputError, match="law: 99, expected 0 to"):
        found.predict(FRAME, 99)
