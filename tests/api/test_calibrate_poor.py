"""A calibration with an impossible result says so in its verdict, with the file and the likely fault."""

from pathlib import Path

import pytest

import gpmodel as gp


def touched(instrument: str, column: str, value: str, folder: Path) -> Path:
    """A table of touches with one column wrong."""
    frame = gp.simulate("ur5", poses=90, instrument=instrument, geometry_sigma="0.3 mm", seed=1).to_dataframe()
    frame[column] = value
    frame.to_csv(folder / "touched.csv", index=False)
    return folder / "touched.csv"


@pytest.mark.long
def test_wrong_labels_are_named_in_the_verdict(tmp_path: Path) -> None:
    verdict = gp.calibrate("ur5", touched("spheres", "on_sphere", "A", tmp_path)).verdict
    assert "touched.csv: the fit leaves" in verdict
    assert "mm RMS; calibrated machines leave less than 2 mm: a wrong label or length (on_sphere)" in verdict


def test_a_bar_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(gp.InputError, match=r"touched\.csv, column 'pair': does not fit ur5"):
        gp.calibrate("ur5", touched("bar", "length [mm]", "3000", tmp_path))


def test_a_fit_that_is_as_of_a_machine_says_nothing_of_it(tmp_path: Path) -> None:
    made = gp.simulate("ur5", poses=40, geometry_sigma="0.3 mm", seed=1)
    assert "the fit leaves" not in gp.calibrate("ur5", made.table).verdict


def test_a_label_touched_along_one_circle_is_said_with_its_file(tmp_path: Path) -> None:
    frame = gp.simulate("ur5", poses=90, instrument="spheres", seed=1).to_dataframe()
    frame.loc[frame.on_sphere == "B", frame.columns[:6]] = (
        frame.loc[frame.on_sphere == "B", frame.columns[:6]].iloc[:1].to_numpy()
    )
    frame.to_csv(tmp_path / "touched.csv", index=False)
    with pytest.raises(gp.InputError, match=r"touched\.csv: on_sphere B"):
        gp.calibrate("ur5", tmp_path / "touched.csv")
