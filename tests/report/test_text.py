"""Test that the printed summary has the numbers of the report, in 80 columns, held-out errors first."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure
from loop_cases import found
from report_runs import REPORTS, calibrated, discovered, evolved

from gpmodel import wording
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report.fitted import unabsorbed_rms
from gpmodel.report.from_discovery import from_discovery
from gpmodel.report.origin import Origin
from gpmodel.report.page import html
from gpmodel.report.schema import ErrorsMm, Report, StepRecord
from gpmodel.report.schema_search import CandidateRecord, CauseRecord, RoundRecord, TestRecord
from gpmodel.report.text import summary
from gpmodel.report.words import causes, noise_floor, story


@pytest.mark.parametrize("case", REPORTS)
def test_it_fits_80_columns_and_says_verdict_ladder_and_noise_floor(case: str) -> None:
    report = REPORTS[case]()
    text = summary(report)
    assert max(map(len, text.splitlines())) <= 80
    plain = " ".join(text.split())
    assert " ".join(report.verdict.split()) in plain
    assert " ".join(noise_floor(report).split()) in plain
    for rung in report.ladder:
        assert wording.millimetres(rung.errors.rms_mm) in text
    assert text.index("[[Verdict]]") < text.index("[[3-D error, mm]]") < text.index("[[Noise floor]]")


@pytest.mark.parametrize(
    ("after", "significant", "listed"),
    [(0.287, True, False), (0.2435, True, False), (0.2, False, False), (0.2, True, True)],
)
def test_a_rejected_candidate_is_listed_where_it_lowers_the_error(
    after: float, significant: bool, listed: bool
) -> None:
    tests = (TestRecord("chance", 0.0, 0.01, significant), TestRecord("nats", 352.0, 5.0, True),
             TestRecord("rows", 1.0, 5.0, False))  # fmt: skip
    play = CandidateRecord("play <J3>", nats=352.0, cv_rms_mm=after, cv_before_mm=0.244, tests=tests, why="it drifts")
    found = discovered()
    report = dataclasses.replace(
        found, rounds=(RoundRecord(1, (play, dataclasses.replace(play, name=found.effects[0].name))),)
    )
    assert [c.name for c in report.rejected] == [play.name] * listed
    for said in (summary(report), html(report, {})):
        text = " ".join(said.split())
        parts = (
            "These candidates are not in the model",
            "0.244 → 0.200 mm",
            "ejected: it drifts",
            "--rejected 1",
            "One rejected candidate needs further poses",
        )
        assert [part in text for part in parts] == [listed] * len(parts)
    assert "play <J3>" not in html(report, {})


def test_held_out_errors_stand_before_those_of_training() -> None:
    report = discovered()
    rung = report.ladder[1]
    line = next(line for line in summary(report).splitlines() if line.lstrip().startswith("standard model"))
    sides = [[wording.millimetres(v) for v in dataclasses.astuple(e)] for e in (rung.heldout, rung.train)]
    assert line.split()[2:] == [*sides[0], *sides[1], str(rung.rank)]


@pytest.mark.parametrize("size", [0.00123, 1.234, 54321.0])
def test_errors_of_any_size_stand_apart_in_80_columns(size: float) -> None:
    """A ball joint leaves micrometres and a wrong column metres: `0.001630.00219` is neither."""
    errors = ErrorsMm(size, 1.3 * size, 2.0 * size)
    report = Report(ladder=(StepRecord("standard", errors, errors, rank=27),), verdict="Said.")
    text = summary(report)
    cells = [wording.millimetres(v) for v in dataclasses.astuple(errors)]
    assert max(map(len, text.splitlines())) <= 80
    assert text.split("unknowns")[1].split("[[")[0].split() == ["standard", "model", *cells, *cells, "27"]


def test_without_held_out_poses_nothing_is_called_held_out() -> None:
    assert "held out" not in summary(calibrated(0.0))


def test_a_finding_has_its_size_deviation_share_and_chance() -> None:
    report = discovered()
    (effect,) = report.effects
    text = " ".join(summary(report).split())
    value = wording.measured(effect.value, effect.stderr, effect.unit)
    assert f"{effect.name}: {value}" in text
    assert f"unique share {wording.percent(effect.unique_share)}" in text
    assert f"at {effect.slot} {effect.axis}" in text


def test_the_credible_set_is_said_cause_by_cause() -> None:
    (effect,) = discovered().effects
    own = CauseRecord((effect.name, "its double"), 0.6, own=True)
    said = causes(dataclasses.replace(effect, causes=(own, CauseRecord(("other",), 0.3)), without_name=0.08))
    assert said.index(f"{effect.name} or its double (60 %)") < said.index("other (30 %)") < said.index("none of these")
    alone = dataclasses.replace(effect, causes=(CauseRecord((effect.name,), 0.97, own=True),), without_name=0.0)
    assert "no other cause" in causes(alone)
    assert causes(dataclasses.replace(effect, causes=None)) == ""


def test_causes_stand_before_a_value_that_holds_for_one_of_them() -> None:
    report = discovered()
    (effect,) = report.effects
    set_of_two = (CauseRecord((effect.name,), 0.5, own=True), CauseRecord(("a stranger",), 0.5))
    doubted = dataclasses.replace(effect, causes=set_of_two)
    assert doubted.stderr_over_causes == pytest.approx(
        np.hypot(effect.value or 0.0, effect.stderr or 0.0) / np.sqrt(2.0)
    )
    kept = (set_of_two[0], dataclasses.replace(set_of_two[1], amount=0.9))
    assert dataclasses.replace(effect, causes=kept).stderr_over_causes == pytest.approx(
        np.hypot(0.1 * (effect.value or 0.0) / np.sqrt(2.0), effect.stderr or 0.0)
    )
    text = " ".join(summary(dataclasses.replace(report, effects=(doubted,))).split())
    value = str(wording.measured(effect.value, effect.stderr, effect.unit))
    assert text.index("a stranger") < text.index(value)
    assert "if this is the cause (50 % likely; allowing for the other causes, ± " in text[text.index(value) :]


@pytest.mark.long
def test_a_finding_may_have_fewer_effects_in_the_fit_to_all_poses() -> None:
    """A hysteresis of three radii is an example: it is one of two if all poses have them."""
    whole = found("gear", 0)
    (candidate, *others) = whole.fitted.candidates
    fewer = dataclasses.replace(candidate, effects=candidate.effects[:1])
    assert len(candidate.effects) > 1
    left = dataclasses.replace(whole, fitted=dataclasses.replace(whole.fitted, candidates=(fewer, *others)))
    assert from_discovery(left, Origin("gpmodel discover", 0)).effects[0].kind == "single"


def test_what_an_effect_moves_comes_with_what_nothing_else_takes_up() -> None:
    """A constant along a joint that the geometry has as well moves the tool, and nothing of it is its own."""
    report = calibrated()
    (effect, *_) = report.effects
    assert effect.alone_rms_mm is not None
    assert effect.tool_rms_mm is not None
    assert 0.0 < effect.alone_rms_mm <= effect.tool_rms_mm
    assert "of which no other parameter absorbs" in " ".join(summary(report).split())
    truth = measure("ur5", (), (), 1, count=40)
    fit = calibrate(truth.model, truth.poses)
    first = next(e for e, kept in zip(truth.model.effects, fit.free, strict=True) if kept)
    twin = dataclasses.replace(first, name="twin")
    model = dataclasses.replace(truth.model, effects=(*truth.model.effects, twin))
    kept = np.append(fit.free, True)
    both = dataclasses.replace(fit, model=model, theta=np.append(fit.theta, 1e-3), free=kept)
    (alone,) = unabsorbed_rms(both, truth.poses, [[twin]])
    assert alone == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("passed", [True, False])
def test_it_says_whether_held_out_poses_confirm_the_findings(passed: bool) -> None:
    report = dataclasses.replace(discovered(), confirmation=Confirmation(1.3, 0.12, 0.1, 20, passed))
    text = summary(report)
    assert ("NOT CONFIRMED" in text) is not passed
    assert "1.3 standard errors over 20 independent poses" in " ".join(text.split())


def test_nothing_found_is_said() -> None:
    assert "none: no further effect is significant" in summary(discovered("nothing"))


def test_inputs_beyond_chance_are_named_for_evolved_programs() -> None:
    report = evolved()
    assert ", ".join(report.histograms[0].significant) in summary(report)


def told(*significant: tuple[str, ...], inputs: tuple[str, ...] = ("moment_base_x",), found: bool = True) -> list[str]:
    report: Report = discovered()
    effects = (replace(report.effects[0], name="base compliance", inputs=inputs, round=1),) if found else ()
    histograms = tuple(
        Histogram(names, {}, {}, {}, {}, {}, (0.0,) * len(names), (0.0,) * len(names), 0.05) for names in significant
    )
    return list(story(replace(report, effects=effects, histograms=histograms)))


def test_what_agrees_needs_no_word() -> None:
    assert told(("moment_base_x",), ()) == []
    assert told((), ()) == []


def test_a_lead_that_led_elsewhere_is_explained() -> None:
    (said,) = told(("torque_J2",), ())
    assert said == (
        "The programs used torque_J2 as a proxy; base compliance explains the same error better; "
        "given base compliance, no program refers to this input."
    )
    (still,) = told(("torque_J2",), ("torque_J2",))[:1]
    assert "no program refers" not in still


def test_a_lead_without_a_finding_is_called_one() -> None:
    assert told(("temperature",), found=False) == [
        "temperature is significant, but no effect that depends on this input passed the tests."
    ]
