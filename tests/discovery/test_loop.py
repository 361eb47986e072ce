"""Test that the search finds true effects, adds no false effect, and never uses held-out poses."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, numbers
from loop_cases import (
    ARM,
    CASES,
    QUICK,
    SMALL,
    against_the_oracle,
    found,
    quick,
    rms,
    robot,
)

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery import loop as a_round
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import State
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.tree import Tree
from gpmodel.families.candidate import BRED, Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.progress import Progress
from gpmodel.table.blocks import hold_out

NONE = Search(max_effects=0)
PROGRAM = Search(strategies=(Linear(), Tree()), runs=4, workers=2)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_nothing_is_added_where_nothing_is_undeclared(seed: int) -> None:
    answer = found("nothing", seed)
    assert answer.findings == ()
    assert [s.name for s in answer.steps] == ["registration", "standard"]
    assert answer.stopped == "no further effect is significant"
    assert len(answer.rounds) == 1


@pytest.mark.long
@pytest.mark.parametrize("seed", [5, 9, 20, 21, 26])
def test_noise_of_the_joints_is_no_effect_of_the_joints(seed: int) -> None:
    """Repeatability of 80 µrad in each joint, a tracker of 10 µm: the noise is largest where the lever is longest."""
    arm, data = mechanism("ur10"), bare("ur10", 120, seed)
    real = replace(data, q=data.q + np.random.default_rng(seed).normal(0.0, 80e-6, data.q.shape))
    seen = measure("ur10", (), (), seed, dataset=real, noise=1e-5)
    poses = prepare(arm, replace(seen.poses.dataset, q=data.q))
    rows = np.arange(len(poses))
    answer = discover(arm, poses, rows[rows % 4 > 0], rows[rows % 4 == 0], search=Search(runs=0, workers=1))
    assert not answer.findings


@pytest.mark.parametrize("case", [pytest.param("gear", marks=pytest.mark.long), "windup"])
def test_what_is_undeclared_is_found_and_worth_an_oracle(case: str) -> None:
    answer = found(case, 0)
    inputs = {i for f in answer.findings for e in f.candidate.effects for i in e.inputs}
    assert inputs >= CASES[case].inputs
    assert against_the_oracle(case, 0, answer) < 1.25
    assert rms(answer.steps[-1].heldout_error) < 0.5 * rms(answer.steps[1].heldout_error)


@pytest.mark.long
def test_a_named_effect_gets_its_name_and_its_size() -> None:
    answer = found("gear", 0)
    (finding,) = answer.findings
    assert finding.candidate.family == "gear_harmonic"
    assert finding.candidate.name == "gear error, 2 per turn, J4"
    truth, _, _ = robot("gear", 0)
    at = [e.name for e in answer.final.model.effects].index(finding.candidate.effects[0].name)
    assert (np.abs(answer.final.theta[at : at + 2] - truth.theta[-2:]) < 3.5 * answer.final.stderr[at : at + 2]).all()


def test_what_no_family_describes_is_an_expression_that_was_evolved() -> None:
    first = found("windup", 0).findings[0].candidate
    assert first.family == ""
    assert first.found_by in ("formula", "formula of a program", *BRED, "sequence")
    assert "torque_J3" in first.name


@pytest.mark.long
def test_shuffled_residuals_hold_nothing() -> None:
    """Residuals of the robot with a gear error, permuted."""
    truth, train, heldout = robot("gear", 0)
    arm = truth.model.mechanism
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
    smooth = observe(fit.model, truth.poses, fit.theta, fit.placement).tip[:, :3, 3]
    residual = truth.poses.dataset.position - smooth
    order = np.random.default_rng(3).permutation(len(residual))
    poses = prepare(arm, replace(truth.poses.dataset, position=smooth + residual[order]))
    assert discover(arm, poses, train, heldout, search=SMALL).findings == ()


@pytest.mark.long
def test_the_before_figure_is_registered_and_every_rung_is_on_the_same_poses() -> None:
    answer = found("gear", 0)
    truth, train, heldout = robot("gear", 0)
    alone = calibrate(ErrorModel(truth.model.mechanism, ()), truth.poses.subset(train))
    np.testing.assert_array_equal(answer.steps[0].heldout_error, errors_on(alone, truth.poses.subset(heldout)))
    assert rms(answer.steps[0].train_error) < 5e-3
    assert {len(s.heldout_error) for s in answer.steps} == {len(heldout)}
    assert {len(s.train_error) for s in answer.steps} == {len(train)}
    errors = [rms(s.train_error) for s in answer.steps]
    assert errors == sorted(errors, reverse=True)
    for step in answer.steps:
        again = errors_on(step.calibration, truth.poses.subset(heldout))
        np.testing.assert_array_equal(step.heldout_error, again)


def test_the_final_model_is_the_findings_refitted_on_all_poses() -> None:
    answer = found("gear", 0)
    added = tuple(e for f in answer.findings for e in f.candidate.effects)
    assert answer.final.model.effects == (*answer.standard_model, *added)
    assert answer.steps[-1].calibration.model == answer.final.model
    assert len(answer.final.error) == 80


@pytest.mark.long
def test_held_out_poses_choose_nothing() -> None:
    """Their measurements replaced by nonsense change no finding, no number and no fit but the final one."""
    truth, train, heldout = robot("gear", 0)
    position = truth.poses.dataset.position.copy()
    position[heldout] += np.random.default_rng(9).normal(0.0, 0.05, (len(heldout), 3))
    poses = prepare(truth.model.mechanism, replace(truth.poses.dataset, position=position))
    spoilt = discover(truth.model.mechanism, poses, train, heldout, search=QUICK)
    clean = quick()
    assert clean.findings
    assert [f.candidate for f in spoilt.findings] == [f.candidate for f in clean.findings]
    for one, other in zip(spoilt.steps, clean.steps, strict=True):
        np.testing.assert_array_equal(one.calibration.theta, other.calibration.theta)
        np.testing.assert_array_equal(one.train_error, other.train_error)
        assert rms(one.heldout_error) > 10 * rms(other.heldout_error)
    for a, b in zip(spoilt.rounds, clean.rounds, strict=True):
        assert [h.chance.p for h in a.hypotheses] == [h.chance.p for h in b.hypotheses]
        np.testing.assert_array_equal(a.exploration.null_nats, b.exploration.null_nats)


@pytest.mark.long
def test_the_number_of_workers_changes_no_number() -> None:
    two = found("gear", 0, replace(QUICK, workers=2))
    assert numbers(two) == numbers(quick())


@pytest.mark.long
def test_what_is_evolved_and_never_chosen_does_not_keep_the_search_going(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every round another wave is promising, and the selection wants none of them."""
    alone = quick().findings
    truth, train, heldout = robot("gear", 0)
    asked: list[Candidate] = []

    def another(*_: object) -> tuple[Candidate, ...]:
        name = f"sin({17 + len(asked)}*J6) on J6.moving Rz"
        effect = effect_at(name, "J6.moving", "Rz", Expression(f"sin({17 + len(asked)}*J6)"))
        asked.append(Candidate(name, (effect,), "", 15.0, "sequence"))
        assert len(asked) <= 2, "no end"
        return (asked[-1],)

    monkeypatch.setattr(a_round, "_promising", another)
    answer = discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK)
    assert [f.candidate for f in answer.findings] == [f.candidate for f in alone]
    assert [r.evolved for r in answer.rounds] == [(candidate,) for candidate in asked]
    assert answer.stopped == "no further effect is significant"


@pytest.mark.long
def test_limits_of_effects_and_time_are_kept_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, train, heldout = robot("gear", 0)
    arm = truth.model.mechanism
    stopped = discover(arm, truth.poses, train, heldout, search=NONE)
    assert stopped.stopped == "stopped at 0 effects"
    assert stopped.rounds == ()
    monkeypatch.setattr(State, "late", property(lambda state: bool(state.rounds)))
    late = discover(arm, truth.poses, train, heldout, search=replace(QUICK, stop_after=1e9))
    assert "there may be more to find" in late.stopped
    assert len(late.findings) == 1


@pytest.mark.long
def test_rows_that_copy_others_count_once() -> None:
    truth, train, heldout = robot("nothing", 0, 40)
    poses = truth.poses.subset(np.concatenate([np.arange(40), train[:10]]))
    said: list[Progress] = []
    twice = discover(
        truth.model.mechanism, poses, np.concatenate([train, np.arange(40, 50)]), heldout,
        search=Search(runs=0, workers=1), progress=said.append,
    )  # fmt: skip
    once = discover(truth.model.mechanism, truth.poses, train, heldout, search=Search(runs=0, workers=1))
    assert said[0].text == "10 rows are exact copies of the measurement of another row: left out"
    assert twice.final.theta.tolist() == once.final.theta.tolist()


@pytest.mark.long
def test_a_known_effect_is_in_the_standard_model_and_not_found_again() -> None:
    truth, train, heldout = robot("gear", 0)
    known = Candidate("gear error, 2 per turn, J4", CASES["gear"].effects, "gear_harmonic", 4.0)
    answer = discover(
        truth.model.mechanism, truth.poses, train, heldout, search=replace(SMALL, strategies=(Linear(),)),
        known=(known,),
    )  # fmt: skip
    assert answer.findings == ()
    assert set(known.effects) <= set(answer.final.model.effects)
    assert rms(answer.steps[1].heldout_error) < 1e-4


def test_the_standard_model_is_a_choice_and_the_condition_limit_too() -> None:
    truth, train, heldout = robot("nothing", 0)
    arm = truth.model.mechanism
    few = geometric_effects(arm)[:12]
    answer = discover(arm, truth.poses, train, heldout, search=NONE, standard=few, condition_limit=50.0)
    assert answer.final.model.effects == few
    assert {s.calibration.condition_limit for s in answer.steps} == {50.0}


@pytest.mark.parametrize(("settings", "field"), [(Search(), "runs"), (Criteria(), "significance")])
def test_settings_are_never_edited(settings: Search | Criteria, field: str) -> None:
    with pytest.raises(FrozenInstanceError):
        setattr(settings, field, 3)
    assert settings == type(settings)()


@pytest.mark.long
def test_several_setups_and_tools_go_through_the_loop() -> None:
    truth = measure(ARM, CASES["gear"].effects, (1e-3, 1e-3), 4, setups=2, tools=2)
    train, heldout = hold_out(truth.poses.dataset, 0.3, np.random.default_rng(0))
    answer = discover(truth.model.mechanism, truth.poses, train, heldout, search=NONE)
    assert set(answer.final.placement.registration) == {"s0", "s1"}
    assert set(answer.final.placement.tool) == {"t0", "t1"}
    assert rms(answer.steps[0].heldout_error) < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 10))
def test_nothing_is_added_with_the_search_of_the_program(seed: int) -> None:
    assert found("nothing", seed, PROGRAM).findings == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "seed"),
    [
        ("gear", 2),
        ("gear", 3),
        ("gear", 4),
        ("windup", 2),
        ("windup", 3),
        ("windup", 4),
    ],
)
def test_effects_are_found_with_the_search_of_the_program(case: str, seed: int) -> None:
    answer = found(case, seed, PROGRAM)
    inputs = {i for f in answer.findings for e in f.candidate.effects for i in e.inputs}
    assert inputs >= CASES[case].inputs
    assert against_the_oracle(case, seed, answer) < 1.25
