"""Test that the verdict is one short sentence and agrees with the numbers."""

import dataclasses
from collections import defaultdict
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from effect_cases import measure, mechanism
from report_runs import calibrated, discovered, quickly

import gpmodel as gp
from gpmodel import wording
from gpmodel.api.arguments import load_mechanism
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Family, catalogue, explained
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects, table_names, translate
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.planning.simulate import simulate
from gpmodel.report import words
from gpmodel.report.effects import over_the_workspace, shape_record
from gpmodel.report.explain import MEASURES, explain, html, kinds_of, text
from gpmodel.report.fitted import tool_displacements
from gpmodel.report.origin import mechanism_record
from gpmodel.report.page import html as report_page
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CauseRecord, Correlation, Range
from gpmodel.report.verdict import behind, of_calibration, of_discovery, spans
from gpmodel.table.dataset import unmeasured
from gpmodel.wording import turned

JOINTS = ("J1", "J2", "J3", "J4", "J5", "J6")
SHORT = 130
"""Characters: four lines of a phone."""


def of_inputs(*inputs: str) -> Report:
    report = discovered()
    return replace(report, effects=(replace(report.effects[0], inputs=inputs),))


def test_sixty_loads_are_said_once() -> None:
    links = [f"torque_{j}_of_{k}_{a}" for j in JOINTS[1:5] for k in JOINTS for a in "xyz"]
    base = [f"moment_base_{a}_of_{k}_{b}" for a in "xy" for k in JOINTS for b in "xyz"]
    report = of_inputs(*base, *links)
    assert len(report.effects[0].inputs) > 60
    assert len(of_discovery(report)) < SHORT
    assert behind(report) == "The found effects depend on the gravity loads of the base and J2-J5."


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        (("moment_base_x", "moment_base_y", "torque_J5"), "the gravity loads of the base and J5"),
        (("moment_base_x", *(f"torque_{j}" for j in JOINTS)), "the gravity loads of the base and J1-J6"),
        (("J4", "temperature"), "the angle of J4 and temperature"),
        (("J4", "J1", "row"), "the angles of J1 and J4 and row"),
        (("lag_temperature_40",), "temperature"),
        (("play_J2_0p01",), "the motion of J2"),
    ],
)
def test_what_is_behind_it_is_said_as_a_person_would(inputs: tuple[str, ...], said: str) -> None:
    assert behind(of_inputs(*inputs)) == f"The found effects depend on {said}."


def test_a_joint_that_slides_has_a_travel() -> None:
    report = of_inputs("J4", "J1", "J2")
    sliding = replace(
        report, mechanism=mechanism_record(load_mechanism("hexapod"), {f"L{i}": f"J{i}" for i in range(1, 7)})
    )
    assert behind(sliding) == "The found effects depend on the travel of J1, J2 and J4."
    mixed = replace(report, mechanism=replace(report.mechanism, sliding=("J1",)))
    assert behind(mixed) == "The found effects depend on the angles of J2 and J4 and the travel of J1."


@pytest.mark.parametrize(("lever", "said"), [(0.2, ": 0.100 mm at 200 mm from the flange"), (3e-6, "")])
def test_an_angle_moves_nothing_where_the_tool_lies_in_the_flange(lever: float, said: str) -> None:
    assert turned(0.5, lever) == said


SEPARATE = "These poses do not separate base compliance from joint compliance, J2."
LIKELIER = "The fitted base compliance (30 %) is a less probable cause than joint compliance, J2 (70 %)."


@pytest.mark.parametrize(("probability", "said"), [(0.3, LIKELIER), (0.6, SEPARATE), (0.95, None), (None, None)])
def test_a_cause_that_these_poses_do_not_tell_apart_is_in_the_sentence(
    probability: float | None, said: str | None
) -> None:
    report = discovered()
    causes = None
    if probability is not None:
        causes = (
            CauseRecord(("base compliance",), probability, own=True),
            CauseRecord(("joint compliance, J2",), 1.0 - probability),
        )
    effect = replace(report.effects[0], name="base compliance", causes=causes)
    behind_it = behind(replace(report, effects=(effect,)))
    assert [sentence for sentence in (SEPARATE, LIKELIER) if sentence in behind_it] == [said] * (said is not None)
    title = f"joint compliance, J2 (70 % likely), fitted as {effect.name}" if said == LIKELIER else effect.name
    assert words.title(effect) == title


def test_joints_in_a_row_are_a_span() -> None:
    assert spans(("J6", "J1", "J2", "J3"), JOINTS) == "J1-J3 and J6"
    assert spans(("J2", "J1"), JOINTS) == "J1 and J2"


def test_what_is_not_confirmed_is_not_called_missing() -> None:
    report = replace(discovered(), confirmation=Confirmation(0.3, 0.4, 0.1, 20, False))
    said = of_discovery(report)
    assert said.startswith("One effect was found but not confirmed on held-out poses: the standard model is kept, ")
    assert "missing" not in said


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.5, ", noise floor "), (0.98, ", at the noise floor."), (20.0, ", 20 times less than the stated noise of ")],
)
def test_the_noise_floor_is_where_the_error_is_not_just_mentioned(share: float, said: str) -> None:
    report = quickly()
    rms = report.ladder[-1].errors.rms_mm
    assert rms is not None
    assert said in of_discovery(replace(report, noise_floor_mm=share * rms))


@pytest.mark.parametrize(("ratio", "said"), [(1.4, False), (4.5, True)])
def test_a_held_out_error_far_above_that_of_training_is_said(ratio: float, said: bool) -> None:
    report = discovered()
    last = report.ladder[-1]
    assert last.train.rms_mm is not None
    held = replace(last.heldout, rms_mm=ratio * last.train.rms_mm)
    there = replace(report, ladder=(*report.ladder[:-1], replace(last, heldout=held)))
    assert ("is 4.5 times the training error" in of_discovery(there)) == said


def test_a_calibration_says_what_it_gained() -> None:
    report = calibrated()
    first, last = (report.ladder[k].heldout.rms_mm for k in (1, -1))
    change = f"standard model {first:.3f} → {last:.3f} mm on held-out poses."
    assert of_calibration(report) == f"Calibrated with the standard model and {report.effects[0].name}: {change}"


def test_before_is_the_step_below_what_was_added_and_has_its_name() -> None:
    """One definition in every title: without an effect the standard model is what was added."""
    report = calibrated()
    plain = replace(report, ladder=report.ladder[:2], effects=())
    first, last = (rung.heldout.rms_mm for rung in plain.ladder)
    change = f"registration only {first:.3f} → {last:.3f} mm on held-out poses."
    assert of_calibration(plain) == f"Calibrated with the standard model: {change}"
    bare = replace(plain, ladder=plain.ladder[:1])
    assert of_calibration(bare).endswith(f": {first:.3f} mm RMS on held-out poses.")


def test_unit_loads_have_the_tables_names_of_joints() -> None:
    names = table_names(("joint_1", "joint_2"), ("J1", "J2"))
    assert translate("torque_joint_1_of_joint_2_x", names) == "torque_J1_of_J2_x"
    assert translate("moment_base_y_of_joint_1_z + torque_joint_2_of_joint_2", names) == (
        "moment_base_y_of_J1_z + torque_J2_of_J2"
    )


def altered(**parts: object) -> Report:
    report = discovered()
    return dataclasses.replace(report, effects=(dataclasses.replace(report.effects[0], **parts),))


def test_it_says_where_how_large_and_why() -> None:
    report = discovered()
    effect = report.effects[0]
    found = explain(report, 1)
    assert found.chain == "base ─ J1 ─ J2 ─ J3 ─ [J4] ─ J5 ─ J6 ─ tool"
    assert found.where == "Rotation about x of the frame just after the motion of J4."
    assert wording.length(effect.tool_rms_mm) in found.size
    assert f"rotation of the tool {effect.tool_turn_mrad:.3g} mrad RMS" in found.size
    assert effect.explanation[1:] in found.cause
    assert str(wording.measured(effect.value, effect.stderr, effect.unit)) in found.value
    said = text(found)
    assert max(map(len, said.splitlines())) <= 80
    assert "Move J4 alone through the whole range" in " ".join(said.split())
    assert found.chain in html(report, 1)


def test_a_finding_says_what_to_check_and_repair_by_hand() -> None:
    report = discovered()
    advice = report.effects[0].repair
    assert advice is not None
    said, page = " ".join(text(explain(report, 1)).split()), unescape(report_page(report, defaultdict(str)))
    explained_page = unescape(html(report, 1))
    for sentence in (advice.sign, advice.check, advice.clause, advice.compensation):
        assert sentence in said
        assert sentence in explained_page
        assert sentence in page
    assert altered(catalogue=None).effects[0].repair is None
    assert explain(altered(catalogue=None), 1).repair == ()


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        (("row",), "Measure the first poses again"),
        (("payload", "torque_J2"), "two or more payloads"),
        (("torque_J2",), "with and without payload"),
        (("approach_J3",), "from both directions"),
    ],
)
def test_the_advice_follows_from_what_it_reads(inputs: tuple[str, ...], said: str) -> None:
    assert any(said in sentence for sentence in explain(altered(inputs=inputs), 1).advice)


@pytest.mark.parametrize(
    ("name", "unit", "kinds"),
    [
        ("lag_temperature_40", "degC", ("delay", "temperature")),
        ("stop_J2_0p03", "deg", ("approach",)),
        ("stop_torque_J2_40", "Nm", ("approach", "load")),
        ("last_move_J2", "1", ("approach",)),
        ("timer", "min", ("clock",)),
        ("timer", "1", ()),
        ("lagoon", "degC", ("temperature",)),
        ("feed", "mm/s", ("speed",)),
        ("rowing_machine", "1", ()),
    ],
)
def test_a_column_is_known_by_its_kind_not_by_how_its_name_begins(name: str, unit: str, kinds: tuple[str, ...]) -> None:
    assert kinds_of(name, unit, {"J1", "J2"}) == kinds
    said = explain(altered(inputs=(name,), ranges=(Range(name, 0.0, 1.0, unit),)), 1).advice
    wanted = {f"{MEASURES[k][:1].upper()}{MEASURES[k][1:]}." for k in kinds}
    assert wanted == {s for s in said if any(s[1:].startswith(m[1:]) for m in MEASURES.values())}


@pytest.mark.parametrize("family", catalogue, ids=lambda family: family.name)
def test_every_family_is_explained(family: Family) -> None:
    found = explain(altered(catalogue=family.name, explanation=explained(family.name), found_by="catalogue"), 1)
    assert family.explanation[1:] in found.cause
    assert family.source in found.cause
    assert "the user named" not in found.cause


def test_what_no_family_describes_is_not_called_named_by_the_user() -> None:
    assert "the user named" not in explain(altered(explanation="", found_by="catalogue"), 1).cause
    assert "the user named" in explain(altered(explanation="", found_by="named"), 1).cause


def test_poses_are_only_advised_where_they_tell_causes_apart() -> None:
    report = altered(causes=(CauseRecord(("close",), 0.3), CauseRecord(("other",), 0.3)))
    assert "separate this effect from other" in explain(report, 1, {"other"}).advice[0]
    assert "No poses of this mechanism separate this effect from close" in explain(report, 1, set()).advice[0]


def test_other_causes_and_a_small_share_have_their_advice() -> None:
    other = CauseRecord(("something alike",), 0.3)
    assert "separate this effect from something alike" in explain(altered(causes=(other,)), 1).advice[0]
    near = (Correlation("J2 Rz", 0.97),)
    weak = altered(unique_share=0.05, correlated_with=near)
    assert any("nearly equivalent to J2 Rz" in s for s in explain(weak, 1).advice)
    assert not any("nearly equivalent" in s for s in explain(altered(unique_share=0.9), 1).advice)


def test_an_effect_that_was_named_is_explained_too() -> None:
    found = explain(calibrated(), 1)
    assert "foundation tilts" in found.cause
    assert found.chain.startswith("[base]")


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "against"),
    [("base_compliance=-4e-8", True), ("base_compliance=4e-8", False), ("joint_compliance J2=-2e-7", True),
     ("gear_harmonic J4=-2e-4", False)],
)  # fmt: skip
def test_a_compliance_of_the_wrong_sign_is_said_to_be_none(effect: str, against: bool) -> None:
    arm = gp.load_mechanism("irb6400r", payload="60 kg")
    table = gp.simulate(arm, poses=60, effects=[effect], noise="0.03 mm", seed=1).table
    found = gp.calibrate(arm, table, effects=[effect.partition("=")[0]])
    (record,) = found.record.effects
    assert ("which is physically impossible" in record.against) == against
    assert ("physically impossible" in found.summary()) == against


@pytest.mark.parametrize("number", [0, 2, -1])
def test_a_number_that_is_not_there_is_refused(number: int) -> None:
    with pytest.raises(InputError, match=f"finding {number}: not in the report; expected 1 to 1"):
        explain(discovered(), number)
    with pytest.raises(InputError, match="expected a report with findings"):
        explain(discovered("nothing"), 1)


def test_the_size_over_the_workspace_is_that_of_the_true_effect_where_nobody_measured() -> None:
    arm, rng = MechanismChoice("irb6400r").load(), np.random.default_rng(0)
    made = simulate(arm, 0.5 * random_poses(arm, 60, rng), ("joint_compliance J2=2e-7",), rng, noise=1e-5)
    poses = prepare(arm, made.dataset)
    asked = made.model.effects[-1:]
    fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), *asked)), poses)
    anywhere = prepare(arm, unmeasured(made.dataset.joints, random_poses(arm, 3000, rng)))
    thetas = (made.theta, np.append(made.theta[:-1], 0.0))
    tips = [observe(made.model, anywhere, theta, made.placement).tip[:, :3, 3] for theta in thetas]
    truth = 1e3 * np.linalg.norm(tips[0] - tips[1], axis=1)
    found = over_the_workspace(fit, poses, [asked])[0]
    assert found is not None
    both = found[1], tool_displacements(fit, poses, [asked])[1][0]
    moved, near = (1e3 * np.linalg.norm(m[:, :3], axis=1) for m in both)
    assert root_mean_square(moved) == pytest.approx(root_mean_square(truth), rel=0.1)
    assert 0.8 * truth.max() < moved.max() < 1.1 * truth.max()
    assert root_mean_square(moved) > 1.2 * root_mean_square(near)


def test_where_rotations_were_measured_they_say_what_the_last_joint_does() -> None:
    """Its lever is that of the tool, which may be short: without them the points alone have to say it."""
    effect = drive_effect("true", mechanism("irb6400r").joints[5], Expression("sin(J6)"))
    truth = measure("irb6400r", [effect], [1e-3], 4, see=("position", "rotation"))
    fit = calibrate(truth.model, truth.poses)
    points = replace(truth.poses.dataset, rotation=np.full((len(truth.poses), 3), np.nan))
    candidate, heldout = Candidate("true", (effect,), "", 4.0), np.zeros(len(truth.poses), dtype=bool)
    scatter = []
    for dataset in (truth.poses.dataset, points):
        shape = shape_record(fit, replace(truth.poses, dataset=dataset), candidate, heldout, {})
        assert shape is not None
        scatter.append(np.std(np.subtract(shape.partial, np.interp(shape.x, shape.curve_x, shape.curve_y))))
    assert scatter[0] < 0.5 * scatter[1]
