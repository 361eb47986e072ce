"""Positions that a controller computed are no measurement, and rounding is no error of a machine."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from cli_cases import table

import gpmodel as gp
from gpmodel.api.results import write_numbers

SOUND = table(60, name="ur5")


def rounded(decimals: int, of: str) -> object:
    frame = SOUND.astype(float)
    columns = [c for c in frame if f"[{of}]" in c]
    return frame.assign(**{c: frame[c].round(decimals) for c in columns})


def of_the_controller(decimals: int) -> object:
    own = table(60, name="ur5", noise=0.0, geometry_sigma=0.0).astype(float)
    return own.assign(**{f"{a} [mm]": own[f"{a} [mm]"].round(decimals) for a in "xyz"})


@pytest.mark.parametrize("decimals", [1, 3])
def test_positions_of_the_nominal_arm_are_called_computed(decimals: int) -> None:
    judged = gp.check("ur5", of_the_controller(decimals))
    assert ("these positions are computed, not measured" in " ".join(judged.summary().split())) == (decimals == 3)
    assert judged.valid == (decimals != 3)


@pytest.mark.parametrize("fit", [gp.calibrate, gp.discover])
def test_nothing_is_fitted_to_computed_positions(fit: Callable[..., object]) -> None:
    with pytest.raises(gp.InputError, match="these positions are computed, not measured"):
        fit("ur5", of_the_controller(3))


@pytest.mark.parametrize(("decimals", "of"), [(1, "deg"), (0, "mm")])
def test_a_residual_that_rounding_explains_is_said_to_be_rounding(decimals: int, of: str) -> None:
    said = " ".join(gp.check("ur5", rounded(decimals, of)).summary().split())
    assert "rounding explains what is left" in said
    assert "rounding" not in gp.check("ur5", SOUND).summary()


def test_no_accuracy_is_certified_by_computed_positions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as before:
        before.setattr("gpmodel.checks.judge.computed", lambda *_: iter(()))
        fit = gp.calibrate("ur5", of_the_controller(3), holdout=0)
        write_numbers(fit.record, fit.model, tmp_path)
    for result in (fit, tmp_path):
        with pytest.raises(gp.InputError, match=r"are computed, not measured.*no accuracy can be certified by them"):
            gp.certificate(result)


def test_no_accuracy_is_certified_by_predictions_of_the_model() -> None:
    verified = gp.calibrate("ur5", SOUND, holdout=0).model.verify(table(40, 5, name="ur5"))
    predicted = replace(verified, record=replace(verified.record, chi_square=1e-9))
    with pytest.raises(gp.InputError, match="nearer to the model than its noise allows"):
        gp.certificate(predicted)
