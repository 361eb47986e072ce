"""The certificate: statistics against known distributions, every given particular, and sides of A4."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_runs import calibrated, discovered

from gpmodel import wording
from gpmodel.errors import InputError
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report import certificate
from gpmodel.report.certificate import STATISTICS, errors_before_and_after, statistics
from gpmodel.report.charts_certificate import bins_of, histogram
from gpmodel.report.figures import drawn
from gpmodel.report.particulars import Particulars, read_particulars
from gpmodel.report.schema import Report

GIVEN = Particulars(machine="IRB 6400R", serial="64-10291", instrument="tracker", operator="A. N. <Other>")


def page(found: certificate.Certificate) -> str:
    return certificate.html(found, "irb6400r")


def test_statistics_are_those_of_the_errors() -> None:
    errors = np.arange(1.0, 101.0)
    found = {name: of(errors) for name, of in STATISTICS}
    spread = 50.5 + 3 * errors.std(ddof=1)
    assert list(found.values()) == pytest.approx([50.5, spread, 95.05, 100.0, np.sqrt(np.mean(errors**2))])
    assert [row[0] for row in statistics(np.column_stack([errors, errors]))] == list(found)


@pytest.mark.long
def test_before_is_registration_and_after_the_last_step_on_held_out_poses() -> None:
    for report in (discovered(), calibrated(), calibrated(0.0)):
        found = errors_before_and_after(report)
        assert found is not None
        assert len(found) == (report.data.heldout or report.data.train)
        for one, rung in zip(found.T, (report.ladder[0], report.ladder[-1]), strict=True):
            assert root_mean_square(one) == pytest.approx(rung.errors.rms_mm, rel=1e-5)
            assert one.max() == pytest.approx(rung.errors.max_mm, rel=1e-5)


def test_what_is_not_confirmed_is_not_certified() -> None:
    refused = dataclasses.replace(discovered(), confirmation=Confirmation(0.2, 0.4, 0.1, 27, False))
    assert certificate.certificate(discovered(), GIVEN).effects
    assert certificate.certificate(refused, GIVEN).effects == ()
    pair = errors_before_and_after(refused)
    standard = refused.step("standard")
    assert pair is not None
    assert standard is not None
    assert root_mean_square(pair[:, 1]) == pytest.approx(standard.heldout.rms_mm, abs=1e-5)


def test_letters_that_no_font_has_are_drawn_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    drawn([histogram(np.ones((3, 2)), None, ("机器人三号 🤖", True))])
    assert not caplog.records


@pytest.mark.parametrize("report", [discovered, calibrated], ids=["discovered", "calibrated"])
def test_the_page_has_the_particulars_the_accuracy_the_parameters_and_the_record(report: type[Report]) -> None:
    made = report()
    certified = certificate.certificate(made, GIVEN)
    assert {unit for *_, unit in (*certified.parameters, *certified.placement)} == {"mm", "mrad"}
    text = page(certified)
    words = " ".join(re.sub(r"<[^>]+>", " ", text).split())
    found = errors_before_and_after(made)
    assert found is not None
    effect = made.effects[0]
    for said in (
        "IRB 6400R", "64-10291", "tracker", "A. N. &lt;Other&gt;", made.data.sha256, made.command,
        f"RMS {' '.join(wording.millimetres(root_mean_square(of)) for of in found.T)}",
        "held out: the calibration that predicts them was made without them", effect.name,
        wording.measured(effect.value, effect.stderr, effect.unit).value, "not stated: no pose was measured",
        wording.measured(made.placement[0].value, made.placement[0].stderr, "m", in_list=True).value, "tool x", "J1",
        "workspace covered", "standard uncertainty (k = 1)", "is the 95 % interval (k = ",
    ):  # fmt: skip
        assert said in words
    assert "@page { size: A4" in text
    assert "https://" not in text


def test_poses_held_out_in_turn_are_not_called_unseen() -> None:
    """The model that is certified is fitted to them: only the calibrations that predict them have not seen them."""
    made = calibrated()
    turned = dataclasses.replace(made, data=dataclasses.replace(made.data, folds=5))
    said = certificate.certificate(turned, Particulars()).poses
    assert "each predicted by a calibration made without it (5-fold)" in said
    assert "saw" not in said


def test_the_accuracy_is_said_under_the_title() -> None:
    made = certificate.certificate(calibrated(), Particulars())
    rms = wording.millimetres(calibrated().ladder[-1].heldout.rms_mm)
    assert made.answer.startswith(f"{rms} mm RMS predicted, ")
    text = page(made)
    assert text.index("Calibration certificate") < text.index(made.answer) < text.index("Scope")


def test_poses_the_model_was_fitted_to_are_called_that() -> None:
    assert "the poses the model was fitted to" in page(certificate.certificate(calibrated(0.0), Particulars()))


@pytest.mark.parametrize(("beyond", "said"), [(0.999, "fail: 1 of "), (1.001, "pass: none of "), (None, "")])
def test_a_tolerance_is_passed_or_failed_by_what_is_predicted(beyond: float | None, said: str) -> None:
    pair = errors_before_and_after(discovered())
    assert pair is not None
    limit = None if beyond is None else beyond * float(pair[:, 1].max())
    found = certificate.certificate(discovered(), GIVEN, limit)
    line = dict(found.scope)["tolerance"]
    assert line.startswith(said)
    assert bool(line) == (limit is not None)
    assert "after, predicted, mm" in page(found)
    assert dict(found.particulars)["controller"] == ""
    assert len(found.errors) == len(pair)


def test_particulars_are_read_from_toml(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text('machine = "R1"\nserial = 4711\ndate = 2026-11-20\ntemperature = "21 °C"\n', encoding="utf-8")
    found = read_particulars(path)
    assert found == Particulars(machine="R1", serial="4711", date="2026-11-20", temperature="21 °C")
    assert found.lines()[:2] == (("machine", "R1"), ("serial", "4711"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("machine = ", "is no TOML"),
        ('colour = "red"', "key 'colour' is unknown; available: controller, payload, operator and"),
        ("operator = [1]", "operator = [1]; expected text"),
        ("operator = true", "expected text"),
    ],
)
def test_bad_particulars_are_refused_in_one_line(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(said)):
        read_particulars(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_particulars(tmp_path / "nowhere.toml")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=60).map(lambda text: f"machine = {text}"))
def test_any_text_is_particulars_or_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8", errors="replace")
    said = ""
    try:
        assert isinstance(read_particulars(path), Particulars)
    except InputError as error:
        said = str(error)
    assert "\n" not in said


@pytest.mark.parametrize(("before", "tolerance"), [(0.2, None), (1.9, None), (1.9, 3.0), (1e-3, None)])
def test_the_bars_of_the_errors_after_calibration_show_their_shape(before: float, tolerance: float | None) -> None:
    """Of errors after calibration of 0.02 to 0.13 mm no bar holds more than half."""
    errors = np.column_stack([np.linspace(0.1, 1.0, 60) * before, np.linspace(0.02, 0.13, 60)])
    bins = bins_of(errors, tolerance)
    assert bins[-1] >= max(errors.max(), tolerance or 0.0)
    assert np.histogram(errors[:, 1], bins)[0].max() <= 30
    assert len(bins) < 100
