"""The verdict: one short sentence, true to the numbers, whatever the names behind it."""

from dataclasses import replace

import pytest
from report_runs import calibrated, discovered, quickly

from gpmodel.api.mechanism import load_mechanism
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.model.naming import table_names, translate
from gpmodel.report.origin import mechanism_record
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CauseRecord
from gpmodel.report.verdict import behind, of_calibration, of_discovery, spans
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
    assert behind(report) == "What was found follows the gravity loads of the base and J2-J5."


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
    assert behind(of_inputs(*inputs)) == f"What was found follows {said}."


def test_a_joint_that_slides_has_a_travel() -> None:
    report = of_inputs("J4", "J1", "J2")
    sliding = replace(
        report, mechanism=mechanism_record(load_mechanism("hexapod"), {f"L{i}": f"J{i}" for i in range(1, 7)})
    )
    assert behind(sliding) == "What was found follows the travel of J1, J2 and J4."
    mixed = replace(report, mechanism=replace(report.mechanism, sliding=("J1",)))
    assert behind(mixed) == "What was found follows the angles of J2 and J4 and the travel of J1."


@pytest.mark.parametrize(("lever", "said"), [(0.2, ": 0.100 mm at 200 mm from the flange"), (3e-6, "")])
def test_an_angle_moves_nothing_where_the_tool_lies_in_the_flange(lever: float, said: str) -> None:
    assert turned(0.5, lever) == said


@pytest.mark.parametrize(("probability", "said"), [(0.3, True), (0.95, False), (None, False)])
def test_a_cause_that_these_poses_do_not_tell_apart_is_in_the_sentence(probability: float | None, said: bool) -> None:
    report = discovered()
    causes = None
    if probability is not None:
        causes = (
            CauseRecord(("base compliance",), probability, own=True),
            CauseRecord(("joint compliance, J2",), 1.0 - probability),
        )
    effect = replace(report.effects[0], name="base compliance", causes=causes)
    sentence = "These poses do not tell base compliance from joint compliance, J2."
    assert (sentence in behind(replace(report, effects=(effect,)))) == said


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
