"""A finding in words: its place on the chain, its size, and advice that follows from what it reads."""

import dataclasses

import numpy as np
import pytest
from report_runs import calibrated, discovered

import gpmodel as gp
from gpmodel import wording
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.families.catalogue import catalogue, explained
from gpmodel.families.family import Family
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.planning.simulate import simulate
from gpmodel.report.effects import over_the_workspace
from gpmodel.report.explain import MEASURES, explain, html, kinds_of, text
from gpmodel.report.fitted import tool_displacements
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CauseRecord, Correlation, Range
from gpmodel.table.dataset import unmeasured


def altered(**parts: object) -> Report:
    report = discovered()
    return dataclasses.replace(report, effects=(dataclasses.replace(report.effects[0], **parts),))


def test_it_says_where_how_large_and_why() -> None:
    report = discovered()
    effect = report.effects[0]
    found = explain(report, 1)
    assert found.chain == "base ─ J1 ─ J2 ─ J3 ─ [J4] ─ J5 ─ J6 ─ tool"
    assert found.where == "Turn about x of the frame just after the motion of J4."
    assert wording.length(effect.tool_rms_mm) in found.size
    assert f"turns it by {effect.tool_turn_mrad:.3g} mrad RMS" in found.size
    assert effect.explanation[1:] in found.cause
    assert str(wording.measured(effect.value, effect.stderr, effect.unit)) in found.value
    said = text(found)
    assert max(map(len, said.splitlines())) <= 80
    assert "Sweep J4 alone through the whole range" in " ".join(said.split())
    assert found.chain in html(report, 1)


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        (("row",), "Measure the first poses once more"),
        (("payload", "torque_J2"), "two payloads"),
        (("torque_J2",), "with and without payload"),
        (("approach_J3",), "from either side"),
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
    assert "named by the user" not in found.cause


def test_what_no_family_describes_is_not_called_named_by_the_user() -> None:
    assert "named by the user" not in explain(altered(explanation="", found_by="catalogue"), 1).cause
    assert "named by the user" in explain(altered(explanation="", found_by="named"), 1).cause


def test_poses_are_only_advised_where_they_tell_causes_apart() -> None:
    report = altered(causes=(CauseRecord(("close",), 0.3), CauseRecord(("other",), 0.3)))
    assert "it and other differ" in explain(report, 1, {"other"}).advice[0]
    assert "No poses of this mechanism tell it from close" in explain(report, 1, set()).advice[0]


def test_other_causes_and_a_small_share_have_their_advice() -> None:
    other = CauseRecord(("something alike",), 0.3)
    assert "it and something alike differ" in explain(altered(causes=(other,)), 1).advice[0]
    near = (Correlation("J2 Rz", 0.97),)
    weak = altered(unique_share=0.05, correlated_with=near)
    assert any("hard to tell from J2 Rz" in s for s in explain(weak, 1).advice)
    assert not any("hard to tell" in s for s in explain(altered(unique_share=0.9), 1).advice)


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
    (record,) = gp.calibrate(arm, table, effects=[effect.partition("=")[0]]).record.effects
    assert ("nothing yields against its load" in record.explanation) == against


@pytest.mark.parametrize("number", [0, 2, -1])
def test_a_number_that_is_not_there_is_refused(number: int) -> None:
    with pytest.raises(InputError, match=f"finding {number}: no such finding in the report; it has 1"):
        explain(discovered(), number)
    with pytest.raises(InputError, match="it has none"):
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
