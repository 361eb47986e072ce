"""Test the selection of measurement poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from effect_cases import mechanism

from gpmodel.api.calibrate import calibrate
from gpmodel.api.poses import BEFORE, choose_poses
from gpmodel.api.table import dataset_of
from gpmodel.application.next_poses import Alternatives, PlanningContext
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import random_poses, ranges
from gpmodel.mechanism.source import load_mechanism
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.se3 import chain
from gpmodel.planning.design import (
    Constraints,
    Design,
    DOptimal,
    EOptimal,
    LOptimal,
    Sight,
    candidates,
    choose,
    decided_after,
    deviations,
)
from gpmodel.planning.poses import geometric_problem, least_deviation, spacing, spread_poses, variance_root
from gpmodel.report.saved import to_json
from gpmodel.report.schema_search import CandidateRecord, RoundRecord
from gpmodel.table.cells import joint_table
from gpmodel.table.dataset import unmeasured

ARMS = ["irb6400r", "ur5", "panda"]


@pytest.mark.long
@pytest.mark.parametrize("criterion", BEFORE)
@pytest.mark.parametrize("arm", ["irb6400r", "ur5"])
def test_poses_are_within_the_limits(arm: str, criterion: str) -> None:
    mechanism = load_mechanism(arm)
    q = choose_poses(mechanism, 25, criterion=criterion).q  # type: ignore[arg-type]
    assert q.shape == (25, len(mechanism.joints))
    assert len(np.unique(q, axis=0)) == 25
    for joint, values in zip(mechanism.joints, q.T, strict=True):
        assert (values >= joint.lower).all()
        assert (values <= joint.upper).all()


@pytest.mark.long
@pytest.mark.parametrize("arm", ARMS)
def test_each_goal_is_best_served_by_its_own_design(arm: str) -> None:
    mechanism = load_mechanism(arm)
    rng = np.random.default_rng(1)
    pool = candidates(mechanism, 400, rng)
    question = geometric_problem(mechanism, pool, 3e-5)
    columns, known = question.columns, question.known
    goals = (DOptimal(), EOptimal(), LOptimal(variance_root(columns)))
    designs = [choose(columns, known, 30, goal) for goal in goals]
    designs += [rng.choice(400, 30, replace=False)]
    for k, goal in enumerate(goals):
        values = [goal.value(np.einsum("pij,pik->jk", columns[d], columns[d])) for d in designs]
        assert values[k] < min(values) + 0.01, (arm, goal, values)
        assert values[k] < values[-1] - 0.2
    spread = spread_poses(mechanism, 30, rng)
    assert spacing(mechanism, spread) > 1.25 * max(spacing(mechanism, pool[d]) for d in designs)


def test_what_a_goal_says_of_a_pose_is_what_it_then_gains() -> None:
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(12, 3, 5))
    information = np.einsum("pij,pik->jk", columns, columns)
    for goal in (DOptimal(), EOptimal(), LOptimal(variance_root(columns))):
        for sign in (1.0, -1.0):
            said = goal.change(information, columns, sign)
            moved = [goal.value(information + sign * c.T @ c) for c in columns]
            np.testing.assert_allclose(said, goal.value(information) - np.array(moved), rtol=1e-8)


def test_a_deviation_is_that_of_the_fit() -> None:
    rng = np.random.default_rng(3)
    question = geometric_problem(load_mechanism("ur5"), candidates(load_mechanism("ur5"), 60, rng), 1e-4)
    order = np.arange(40)
    found = deviations((question,), order)
    rows = question.columns[:40].reshape(120, -1)
    wanted = 1e-4 * np.sqrt(np.trace(np.linalg.inv(rows.T @ rows) @ variance_root(question.columns)))
    assert np.isnan(found[:5]).all()
    assert found[-1] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("arm", ARMS)
def test_no_choice_goes_below_the_limit_and_the_best_nearly_reaches_it(arm: str) -> None:
    mechanism, rng = load_mechanism(arm), np.random.default_rng(4)
    question = geometric_problem(mechanism, candidates(mechanism, 400, rng), 3e-5)
    columns, known = question.columns, question.known
    least = least_deviation((question,), 40)
    goals = (DOptimal(), EOptimal(), question.criterion)
    reached = [deviations((question,), choose(columns, known, 40, goal))[-1] for goal in goals]
    reached += [deviations((question,), rng.choice(400, 40, replace=False))[-1] for _ in range(5)]
    assert least <= min(reached) < 1.06 * least


def test_the_limit_of_unknowns_that_are_measured_one_by_one_is_exact() -> None:
    columns = np.zeros((5, 3, 5))
    columns[np.arange(5), 0, np.arange(5)] = 1.0
    question = Design(columns, np.zeros((5, 5)), LOptimal(np.diag([1.0, 4.0, 9.0, 16.0, 25.0])))
    assert least_deviation((question,), 30) == pytest.approx(15.0 / np.sqrt(30.0), rel=0.005)


def test_two_causes_are_told_apart_after_as_many_poses_as_it_says() -> None:
    """In 19 of 20 tables of so many poses the true cause is 95 % probable, and not in those of two poses fewer."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(60, 3, 2)) * 0.9
    columns[:, :, 1] = 0.8 * columns[:, :, 0] + 0.6 * columns[:, :, 1]  # the rival first, the finding last
    question = Design(columns, 1e-9 * np.eye(2), LOptimal(np.diag([0.0, 1.0])))
    order, odds = np.arange(60), 4.0
    count = decided_after(question, order, odds)
    assert count is not None
    assert decided_after(question, order, 1.0) < count  # type: ignore[operator]
    assert decided_after(question, order[: count - 1], odds) is None

    def sure(number: int) -> float:
        """Share of tables of the finding, begun at the odds of its rival, after which it is 95 % probable."""
        rival, finding = columns[:number].reshape(-1, 2).T
        measured = finding + rng.normal(size=(4000, len(finding)))

        def left(column: np.ndarray) -> np.ndarray:
            return np.sum(measured**2, axis=1) - (measured @ column) ** 2 / (column @ column)

        return float(np.mean(0.5 * (left(rival) - left(finding)) - np.log(odds) > np.log(19.0)))

    assert sure(count) > 0.94
    assert sure(count - 2) < 0.96


@pytest.mark.long
def test_the_tool_stays_in_its_box_and_in_sight() -> None:
    mechanism, point = load_mechanism("ur5"), np.array([0.05, 0.0, 0.1])
    box = np.array([[-0.5, -0.8, 0.1], [0.6, 0.8, 0.9]])
    sight = Sight(np.array([3.0, 0.5, 1.0]), np.array([0.0, 0.0, 1.0]), np.radians(40))
    q = spread_poses(mechanism, 20, np.random.default_rng(0), Constraints(box, point, sight))
    frames = chain(mechanism.transforms(q))[-1]
    tips = frames[:, :3, 3] + frames[:, :3, :3] @ point
    assert (tips >= box[0]).all()
    assert (tips <= box[1]).all()
    beam = sight.instrument - tips
    facing = np.sum(frames[:, :3, 2] * beam, axis=1) / np.linalg.norm(beam, axis=1)
    assert (facing >= np.cos(sight.cone)).all()
    with pytest.raises(InputError, match="outside the box"):
        spread_poses(mechanism, 30, np.random.default_rng(0), Constraints(box + 5.0))


def test_an_arm_that_folds_into_itself_is_left_out_and_one_in_the_beam_too() -> None:
    mechanism = load_mechanism("ur5")
    folded, straight = np.radians([[0, -90, 170, 0, 90, 0]]), np.radians([[0, -90, 0, 0, 90, 0]])
    reach = Constraints()
    assert reach.failures(mechanism, folded)["in collision with itself"].all()
    assert not any(bad.any() for bad in reach.failures(mechanism, straight).values())
    assert not any(bad.any() for bad in Constraints(collisions=False).failures(mechanism, folded).values())
    tip = chain(mechanism.transforms(straight))[-1][0, :3, 3]
    up = np.array([0.0, 0.0, 1.0])
    places = [tip + np.array(way) for way in ([3.0, 0.0, 1.0], [0.0, 3.0, 0.0], [0.0, 0.0, -3.0])]
    reaches = [Constraints(sight=Sight(place, up, np.pi)) for place in places]
    hidden = [bool(r.failures(mechanism, straight)["hidden from the instrument"][0]) for r in reaches]
    assert hidden == [False, False, True]


def test_too_few_poses_to_determine_the_errors() -> None:
    with pytest.raises(InputError, match="expected more poses"):
        choose_poses("irb6400r", 9, criterion="d-optimal")


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_the_next_poses_shrink_what_they_are_for_more_than_random_ones(tmp_path: Path) -> None:
    mechanism, made = robot(40, 5, "irb6400r", effects=("joint_compliance J5=3e-7", "gear_harmonic J4=30 arcsec"))
    fit = calibrate(mechanism, made.dataset, ["joint_compliance J5", "gear_harmonic J4"])
    for criterion in ("effect", "i-optimal"):
        found = choose_poses(count=10, after=fit.model, criterion=criterion)  # type: ignore[arg-type]
        value, random = (found.curve.iloc[-1, k] for k in (1, 2))
        assert value < random < found.curve.iloc[0, 1]
    fit.report(tmp_path / "fit")
    done = run("poses", "--after", tmp_path / "fit", "-n", 6, "--out", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "worst known effect" in done.stdout
    assert len(dataset_of(tmp_path / "poses.csv", mechanism, need_measurement=False).q) == 6
    assert len(pd.read_csv(tmp_path / "poses.curve.csv")) == 7
    assert "rivals" in one_line(run("poses", "--after", tmp_path / "fit", "--criterion", "rivals", "--quiet"), 2)
    assert "mechanism" in one_line(run("poses"), 2)
    tried = (CandidateRecord(name=name, nats=9.0, cv_rms_mm=0.1, cv_before_mm=0.2) for name in
             ("joint compliance, J3", "what nobody named"))  # fmt: skip
    record = replace(fit.record, rounds=(RoundRecord(1, tuple(tried)),))
    (tmp_path / "fit" / "report.json").write_text(to_json(record))
    asked = choose_poses(count=6, after=tmp_path / "fit", rejected=1)
    value, random = (asked.curve.iloc[-1, k] for k in (1, 2))
    assert value < random < asked.curve.iloc[0, 1]
    assert asked.said == "rejected candidate: joint compliance, J3"
    for number, said in ((2, "is not in the catalogue"), (3, "expected 1 to 2")):
        line = one_line(run("poses", "--after", tmp_path / "fit", "--rejected", number, "--quiet"), 2)
        assert line.startswith("gpmodel: --rejected: ")
        assert said in line


def test_the_promised_precision_of_a_shift_is_reached_by_rows_after_the_session() -> None:
    name = "tool slipped after row 13, Tx"
    arm, made = robot(20, 5, "irb6400r", effects=(f"{name}=0.3 mm",), noise=2e-5)
    fit = calibrate(arm, made.dataset, [name], standard=["none"], holdout=0.0)
    found = choose_poses(count=20, after=fit.model, criterion="effect")
    data = unmeasured([j.name for j in arm.joints], np.vstack([made.dataset.q, found.q]))
    tip = observe(made.model, prepare(arm, data), made.theta, made.placement).tip[:, :3, 3]
    noise = np.random.default_rng(1).normal(0.0, 2e-5, tip.shape)
    again = calibrate(arm, replace(data, position=tip + noise), [name], standard=["none"], holdout=0.0)
    reached = again.model.saved.stderr[-1] / abs(fit.model.saved.theta[-1]) / again.model.saved.sigma
    assert reached * fit.model.saved.sigma * 100 == pytest.approx(found.curve.iloc[-1, 1], rel=0.05)


def test_a_small_box_needs_no_more_candidates_than_poses() -> None:
    arm = load_mechanism("irb6400r")
    near = choose_poses(arm, 5, box="1200:1500,-200:200,800:1200mm")
    assert near.q.shape == (5, 6)
    with pytest.raises(InputError, match="expected a wider box"):
        choose_poses(arm, 5, box="9000:9100,0:100,0:100mm")


def test_joints_without_limits_keep_to_the_measured_range() -> None:
    arm, rng = mechanism("gantry"), np.random.default_rng(0)
    travel = np.array([[0.2, -0.3, 1.0], [0.9, 0.1, 1.5]])
    q = random_poses(arm, 200, rng, travel)
    assert not np.isfinite([j.upper for j in arm.joints]).any()
    assert (travel[0] <= q).all()
    assert (q <= travel[1]).all()
    assert (candidates(arm, 50, rng, Constraints(measured=travel)) >= travel[0]).all()
    limited = mechanism("irb6400r")
    np.testing.assert_array_equal(ranges(limited, np.zeros((2, 6))), ranges(limited))


def test_poses_for_a_task_know_its_points_better_than_poses_for_the_workspace(tmp_path: Path) -> None:
    arm, made = robot(25, 5, "irb6400r", noise=2e-5)
    fit, task = calibrate(arm, made.dataset, holdout=0.0), tmp_path / "task.csv"
    middle, rng = 0.5 * made.dataset.q[3], np.random.default_rng(1)
    joint_table(arm, middle + rng.uniform(-0.3, 0.3, (12, 6))).to_csv(task, index=False)

    def known(**asked: object) -> float:
        q = np.vstack([made.dataset.q, choose_poses(count=6, after=fit.model, **asked).q])  # type: ignore[arg-type]
        data = unmeasured([j.name for j in arm.joints], q)
        tip = observe(made.model, prepare(arm, data), made.theta, made.placement).tip[:, :3, 3]
        again = calibrate(arm, replace(data, position=tip + rng.normal(0.0, 2e-5, tip.shape)), holdout=0.0)
        return float(np.mean(again.model.predict(task)["sigma [mm]"] / again.model.saved.sigma))

    assert known(task=task) < 0.97 * known(criterion="i-optimal")


def test_a_task_that_cannot_be_reached_or_belongs_to_nothing_is_refused_in_one_line(tmp_path: Path) -> None:
    arm, made = robot(25, 5, "irb6400r", noise=2e-5)
    calibrate(arm, made.dataset, holdout=0.0).model.save(tmp_path / "model.json")
    task, ask = tmp_path / "task.csv", ("poses", "--after", tmp_path / "model.json", "-n", 3, "--quiet", "--task")
    task.write_text("x [mm],y [mm],z [mm]\n1200,0,900\n99000,0,900\n", encoding="utf-8")
    assert "row 2: the target is out of reach; expected poses that" in one_line(run(*ask, task), 2)
    task.write_text("J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg]\n0,0,0,0,170,0\n", encoding="utf-8")
    assert "row 1: the target is beyond a joint limit; expected poses that" in one_line(run(*ask, task), 2)
    assert "not both" in one_line(run(*ask, task, "--criterion", "effect"), 2)
    assert "needs a result" in one_line(run("poses", "--mechanism", "irb6400r", "--task", task), 2)
    task.write_text("x [mm],y [mm],z [mm]\n1200,0,900\n1300,100,900\n", encoding="utf-8")
    found = choose_poses(count=3, after=tmp_path / "model.json", task=task)
    assert found.said == "task: 2 targets of task.csv"
    assert found.curve.iloc[-1, 1] < found.curve.iloc[0, 1]


@pytest.mark.long
def test_command_writes_a_table_that_is_read_again(tmp_path: Path) -> None:
    assert run("poses", "--mechanism", "ur5", "-n", 12, "--out", tmp_path).exit_code == 0
    data = dataset_of(tmp_path / "poses.csv", load_mechanism("ur5"), need_measurement=False)
    assert data.q.shape == (12, 6)
    printed = run("poses", "--mechanism", "ur5", "-n", 12).stdout
    assert printed == (tmp_path / "poses.csv").read_text()
    assert "--criterion" in one_line(run("poses", "--mechanism", "ur5", "--criterion", "beauty"), 2)


def test_no_more_poses_are_chosen_than_anybody_measures() -> None:
    with pytest.raises(InputError, match="1000000, expected a whole number from 1 to 10000"):
        choose_poses("irb6400r", 1_000_000)
    with pytest.raises(InputError, match="1e300 mm, expected at most 1 m, the unit may be wrong"):
        choose_poses("irb6400r", 20, noise="1e300 mm")


@pytest.mark.first(1)
@pytest.mark.parametrize("input_name", ["last_move_J2", "stop_J3_", "lag_temperature_"])
def test_causes_that_read_earlier_rows_are_rivals_at_new_poses(input_name: str) -> None:
    """New poses have no order: their earlier moves and temperatures are those of measured rows."""
    arm, made = robot(30, 5, "irb6400r", effects=("joint_compliance J2=3e-7",))
    warm = {"temperature": np.linspace(20.0, 30.0, 30)}
    data = replace(made.dataset, in_order=True, extras=warm, extra_units={"temperature": "degC"})
    saved = calibrate(arm, data, ["joint_compliance J2"], standard=["none"], holdout=0.0).model.saved
    outlook = PlanningContext.from_joint_values(
        saved, random_poses(arm, 10, np.random.default_rng(1)), np.random.default_rng(2)
    )
    finding = Alternatives("compliance", np.array([0]))
    rivals = [
        own for own in outlook.candidates.values() if any(n.startswith(input_name) for e in own for n in e.inputs)
    ]
    assert rivals
    for rival in rivals:
        question = outlook.separation(finding, rival)
        assert np.isfinite(question.columns).all()
        assert np.ptp(question.columns[:, :, -1 - len(rival)]) > 0.0
