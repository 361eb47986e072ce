"""Test the certificate: statistics against known distributions, entries, A4 pages."""

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_runs import calibrated, discovered

import gpmodel as gp
from gpmodel import wording
from gpmodel.api.results import write_numbers
from gpmodel.errors import InputError
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report import certificate
from gpmodel.report.certificate import (
    STATISTICS,
    bins_of,
    errors_before_and_after,
    histogram,
    statistics,
)
from gpmodel.report.compare import SIGNIFICANCE, cells, compare, html, text, verdict
from gpmodel.report.figures import drawn
from gpmodel.report.origin import Particulars, read_particulars
from gpmodel.report.schema import DataRecord, MechanismRecord, ParameterRecord, Report
from gpmodel.report.schema_search import EffectRecord

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
        "held out: not used by the calibration that predicts them", effect.name,
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
    assert "each predicted by a calibration without this pose (5-fold)" in said
    assert "saw" not in said


def test_the_accuracy_is_said_under_the_title() -> None:
    made = certificate.certificate(calibrated(), Particulars())
    rms = wording.millimetres(calibrated().ladder[-1].heldout.rms_mm)
    assert made.answer.startswith(f"{rms} mm RMS predicted, ")
    text = page(made)
    assert text.index("Calibration certificate") < text.index(made.answer) < text.index("Scope")


def test_poses_the_model_was_fitted_to_are_called_that() -> None:
    assert "poses to which the model was fitted" in page(certificate.certificate(calibrated(0.0), Particulars()))


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


@pytest.mark.long
def test_a_certificate_of_another_model_does_not_stay_in_the_folder(tmp_path: Path) -> None:
    tables = [gp.simulate("irb6400r", poses=30, noise="0.02mm", geometry_sigma="0.3mm", seed=k).table for k in (4, 5)]
    first, other = (gp.calibrate("irb6400r", table) for table in tables)
    made = {"certificate.html", "verify.html", "verify.json", "verify.csv"}

    def derived() -> set[str]:
        return {path.name for path in tmp_path.iterdir()} & made

    write_numbers(first.record, first.model, tmp_path)
    later = gp.verify(first.model, gp.simulate("irb6400r", poses=15, noise="0.02mm", seed=6).table)
    gp.certificate(first).report(tmp_path)
    later.report(tmp_path)
    assert derived() == made - {"certificate.html"}
    gp.certificate(tmp_path).report(tmp_path)
    write_numbers(first.record, first.model, tmp_path)
    assert derived() == made
    write_numbers(other.record, other.model, tmp_path)
    assert derived() == set()


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


def remeasured(seed: int, shift: float = 0.0) -> Report:
    """Measure the machine again: every number is drawn anew within its σ, the first parameter moved by `shift` σ."""
    report, rng = discovered(), np.random.default_rng(seed)
    drawn, effects, placed = (
        [dataclasses.replace(p, value=p.value + p.stderr * rng.normal()) if p.stderr else p for p in numbers]
        for numbers in (report.parameters, report.effects, report.placement)
    )
    at = next(i for i, p in enumerate(drawn) if p.kept)
    drawn[at] = dataclasses.replace(drawn[at], value=drawn[at].value + shift * drawn[at].stderr)
    rows = of_rows(report, range(seed * 1000, seed * 1000 + 90))
    numbers = {"parameters": tuple(drawn), "effects": tuple(effects), "placement": tuple(placed)}
    return dataclasses.replace(report, data=rows, **numbers)


def of_rows(report: Report, rows: Iterable[int]) -> DataRecord:
    """The data of a report as if of these rows of one long table."""
    marks = tuple(f"{row:08x}" for row in rows)
    return dataclasses.replace(report.data, marks=marks, poses=len(marks), sha256=f"{hash(marks)}")


def test_a_report_does_not_differ_from_itself() -> None:
    found = compare(discovered(), discovered())
    assert {c.chance for c in (*found.parameters, *found.effects, *found.placement)} == {1.0}
    assert {c.name for c in found.placement} >= {"tool x", "registration rz"}
    assert (found.only_before, found.only_after, found.incomparable) == ((), (), ())
    assert verdict(found) == "Both models were fitted to the same rows and are equal."


def test_two_models_of_the_same_rows_are_no_change_of_the_machine() -> None:
    """Geometry may absorb an effect that one model lacks by many standard errors."""
    report = discovered()
    kept = next(p for p in report.parameters if p.kept and p.stderr)
    moved = dataclasses.replace(kept, value=kept.value + 50 * kept.stderr)
    other = dataclasses.replace(report, parameters=tuple(moved if p is kept else p for p in report.parameters))
    found = compare(report, other)
    assert verdict(found).startswith("Both models were fitted to the same rows: ")
    assert not any(c.significant or c.stderr for c in (*found.parameters, *found.effects, *found.placement))
    assert kept.name in {c.name for c in found.parameters}
    assert "±" not in text(found)
    assert not any("±" in cell for c in found.parameters for cell in cells(c))
    assert "the same rows" in html(found)


def test_a_table_that_grew_is_compared_by_what_was_added() -> None:
    """For n rows and those n with m more, the σ of the difference is that of the information of the m."""
    report = discovered()
    kept = next(p for p in report.parameters if p.kept and p.stderr)
    few = dataclasses.replace(report, data=of_rows(report, range(60)))
    finer = dataclasses.replace(kept, stderr=kept.stderr * np.sqrt(60 / 90))
    many = dataclasses.replace(
        report, data=of_rows(report, range(90)), parameters=tuple(finer if p is kept else p for p in report.parameters)
    )
    change = next(c for c in compare(few, many).parameters if c.name == kept.name)
    assert change.stderr == pytest.approx(kept.stderr * np.sqrt(1 - 60 / 90))
    assert "60 rows are in both tables" in verdict(compare(few, many))
    apart = dataclasses.replace(few, data=of_rows(report, range(200, 260)))
    change = next(c for c in compare(apart, many).parameters if c.name == kept.name)
    assert change.stderr == pytest.approx(np.hypot(kept.stderr, finer.stderr))


def test_a_rotation_vector_past_half_a_turn_is_the_same_orientation() -> None:
    names = [f"registration r{a}" for a in "xyz"]
    first, second = np.array([3.13, 0.1, 0.0]), np.array([-3.14, -0.1, 0.0])
    second *= (2 * np.pi - np.linalg.norm(first) - 1e-5) / np.linalg.norm(second)

    def placed(vector: np.ndarray, rows: range) -> Report:
        numbers = [ParameterRecord(n, float(v), 1e-4, "rad") for n, v in zip(names, vector, strict=True)]
        return dataclasses.replace(discovered(), placement=tuple(numbers), data=of_rows(discovered(), rows))

    found = compare(placed(first, range(50)), placed(second, range(100, 150)))
    assert max(abs(c.difference) for c in found.placement) < 5e-4


def test_noise_alone_is_seldom_called_a_change_and_a_shift_is_found() -> None:
    pairs = [compare(remeasured(2 * s), remeasured(2 * s + 1)) for s in range(200)]
    wrong = sum(any(c.significant for c in (*p.parameters, *p.effects, *p.placement)) for p in pairs)
    assert wrong <= 200 * 3 * SIGNIFICANCE
    moved = compare(remeasured(1), remeasured(2, shift=12.0))
    changed = [c.name for c in moved.parameters if c.significant]
    assert changed == [next(p.name for p in discovered().parameters if p.kept)]
    assert moved.parameters[0].name == changed[0]
    assert changed[0] in verdict(moved)


def test_a_change_is_less_sure_where_few_measurements_are_left_over() -> None:
    """A change that is significant at known σ is not with three degrees of freedom in either."""
    for freedom, found in ((None, True), (3.0, False)):
        pair = (dataclasses.replace(remeasured(k, s), freedom=freedom) for k, s in ((1, 0.0), (2, 7.0)))
        assert any(c.significant for c in compare(*pair).parameters) == found


def test_effects_that_came_and_went_are_named() -> None:
    report = discovered()
    new = dataclasses.replace(report, effects=(EffectRecord("something new", value=1.0, stderr=0.1),))
    found = compare(report, new)
    assert [e.name for e in found.only_after] == ["something new"]
    assert [e.name for e in found.only_before] == [report.effects[0].name]
    assert "new: something new" in verdict(found)


def test_parameters_that_only_one_could_fit_are_not_compared() -> None:
    report = discovered()
    kept = next(p for p in report.parameters if p.kept)
    without = [dataclasses.replace(p, kept=False, stderr=None) if p is kept else p for p in report.parameters]
    other = dataclasses.replace(report, parameters=tuple(without), data=of_rows(report, range(90)))
    found = compare(report, other)
    assert found.incomparable == (kept.name,)
    assert kept.name not in {c.name for c in found.parameters}
    assert "fitted in one model only" in text(found)
    assert verdict(found).startswith(f"No change beyond chance in {len(found.effects)} quantity;")


def test_text_and_page_show_every_change_in_80_columns() -> None:
    found = compare(remeasured(1), remeasured(2, shift=12.0))
    said = text(found)
    assert max(map(len, said.splitlines())) <= 80
    assert sum(line.endswith("*") for line in said.splitlines()) == 1
    page = html(found)
    assert all(
        c.name[:11] in said and c.name.split()[-1] in said and c.name in page
        for c in (*found.parameters, *found.effects)
    )


def test_another_machine_is_refused() -> None:
    report = discovered()
    joints = report.mechanism.joints
    for another in (MechanismRecord(report.mechanism.name, joints, (1.0, 2.0, 3.0)), MechanismRecord("ur5", joints)):
        with pytest.raises(InputError, match="expected two calibrations of one machine"):
            compare(report, dataclasses.replace(report, mechanism=another))


def test_a_machine_is_known_by_its_geometry_and_its_joints_by_their_order() -> None:
    """Another file name and other joint names make nothing missing or new."""
    report = discovered()
    joints = tuple(name.replace("J", "joint_") for name in report.mechanism.joints)
    renamed = dataclasses.replace(
        report,
        mechanism=dataclasses.replace(report.mechanism, name="robot", joints=joints),
        parameters=tuple(dataclasses.replace(p, name=p.name.replace("J", "joint_")) for p in report.parameters),
        effects=tuple(dataclasses.replace(e, name=e.name.replace("J", "joint_")) for e in report.effects),
    )
    found = compare(report, renamed)
    assert {c.name for c in found.effects} == {e.name for e in renamed.effects}
    assert verdict(found) == "Both models were fitted to the same rows and are equal."


def test_the_page_shows_the_changes_and_no_chance_that_is_one() -> None:
    found = compare(remeasured(1), remeasured(2, shift=9.0), ("first: a.csv", "second: a.csv"))
    page = html(found)
    assert any(c.chance == 1.0 for c in found.parameters)
    assert "<td>1</td>" not in page
    assert page.count('<svg class="chart"') == 1
    assert page.index("first: a.csv") < page.index("second: a.csv")
    assert "second: a.csv" in text(found)


def test_without_deviations_there_is_neither_chart_nor_chance() -> None:
    page = html(compare(discovered(), discovered()))
    assert "<svg" not in page
    assert ">chance<" not in page
