"""Test that a seed draws one robot, that the oracle reaches the noise, and that rows are graded."""

import numpy as np
import pytest

from experiments.blind.oracle import fit, register, rms_mm
from experiments.blind.robot import world_of
from experiments.methods.plug import geometry
from experiments.random_laws import told
from experiments.random_laws.judge import alike, graded, judge, oracle, problem_of, rows_of, surface, write
from experiments.random_laws.law import GRAMMARS, SHAPES, Law, Place, places
from experiments.random_laws.robot import INNOCENT, columns_of, make
from experiments.random_laws.run import shown
from gpmodel.report.schema_search import EffectRecord


@pytest.mark.parametrize("factors", [0, 1, 2, 3, "sum"])
def test_the_same_numbers_draw_the_same_robot_and_others_another(factors):
    first, again, other = make(4, factors, 3), make(4, factors, 3), make(6, factors, 3)
    assert (str(first.law), first.place, first.amount) == (str(again.law), again.place, again.amount)
    assert np.array_equal(first.train.measured, again.train.measured)
    assert np.array_equal(first.fresh.clean, again.fresh.clean)
    assert not np.array_equal(first.fresh.clean[0], other.fresh.clean[0])


def test_every_shape_is_finite_and_varies():
    line = np.linspace(-1, 1, 201)
    rng = np.random.default_rng(1)
    for shape in SHAPES.values():
        for _ in range(20):
            values = Law(shape("u", rng), ("J1",), (0.0,), (1.0,))({"J1": line})
            assert np.isfinite(values).all()
            assert np.ptp(values) > 0.01
    for grammar in list(GRAMMARS.values())[1:]:
        for count in grammar.inputs:
            names = ("J1", "J2", "J3")[:count]
            law = Law(grammar.draw(rng, count)[1], names, (0.0,) * count, (1.0,) * count)
            assert np.isfinite(law({"J1": line, "J2": line[::-1], "J3": line**2})).all()
            assert all(letter in law.text for letter, _ in zip("uvw", names, strict=False))


def test_beyond_its_range_a_law_stays_at_the_edge():
    law = Law("sqrt(1.01 - u)", ("J1",), (1.0,), (2.0,))
    np.testing.assert_allclose(law({"J1": np.array([-9.0, -1.0, 3.0, 9.0])}) ** 2, [2.01, 2.01, 0.01, 0.01])


def test_robots_of_the_named_grammars_have_100_to_200_poses_and_as_many_inputs_as_their_laws():
    for name in ("one", "two", "weighted", "product", "sum", "waves"):
        robot = make(4, name, 1)
        assert 100 <= len(robot.train.q) <= 200
        assert len(robot.law.inputs) in GRAMMARS[name].inputs


@pytest.mark.long
def test_the_law_told_site_and_inputs_is_bred(tmp_path):
    row = told.judged(40, "waves", 0, "bred", tmp_path)
    assert row["explained"] > 0.99
    assert row["found"][0]["nodes"] == row["law_nodes"]


@pytest.mark.long
@pytest.mark.parametrize(("factors", "index"), [(1, 4), (2, 18)])
def test_a_told_oracle_is_near_the_noise_where_geometry_is_not(factors, index, tmp_path):
    row = judge(0, factors, index, geometry, tmp_path)
    assert row["oracle_mm"] < 0.7 * np.sqrt(3) * row["noise_mm"]
    assert row["geometry_mm"] > 4 * row["oracle_mm"]
    assert row["explained"] == 0.0


@pytest.mark.long
def test_the_product_reads_the_columns_that_the_laws_are_drawn_over(tmp_path):
    robot = make(0, 2, 18)
    assert any(name.startswith("torque") for name in robot.law.inputs)
    _, states = oracle(robot, write(robot, tmp_path))
    machine, fresh = robot.machine, robot.fresh
    columns = columns_of(world_of(machine.arm, fresh.q, fresh.extra, fresh.row, machine.tool))
    for name, column in columns.items():
        np.testing.assert_allclose(states[name], column, atol=0.02 * np.abs(column).max() + 1e-9)


def test_innocent_robots_have_nothing_and_every_kind_comes():
    robots = [make(0, 0, index) for index in range(len(INNOCENT))]
    assert [robot.kind for robot in robots] == list(INNOCENT)
    assert all(robot.law is None and not robot.machine.shapes for robot in robots)


def test_a_law_before_a_joint_moves_is_one_after_it_about_the_joint_axis_only():
    robot = make(0, 1, 2)
    arm, tool, q = robot.machine.arm, robot.machine.tool, robot.fresh.q
    before, after = (
        [Place(f"J3.{side}", a).column(arm, tool, q) for a in ("Rz", "Rx")] for side in ("fixed", "moving")
    )
    np.testing.assert_allclose(before[0], after[0], atol=1e-12)
    assert alike(before[1], after[1]) < 0.95
    assert len(places(arm)) == 6 * (2 * len(arm.rows) + 1) + 3


def finding(place, inputs, basis="J2"):
    slot, axis = place.split()
    return EffectRecord("found", slot, axis, basis, inputs=inputs)


@pytest.mark.long
def test_findings_are_graded_by_inputs_and_place(tmp_path):
    robot = make(0, 1, 2)
    _, states = oracle(robot, write(robot, tmp_path))
    assert (robot.law.inputs, str(robot.place)) == (("J2",), "Place(slot='J4.fixed', axis='Rz')")
    right = graded((finding("J4.moving Rz", ("J2",), "sin(J2)"),), robot, states)
    assert (right["inputs_right"], right["inputs_needless"], right["place_right"], right["false"]) == (True, 0, True, 0)
    assert right["found"][0]["nodes"] == 2
    wrong = graded((finding("J2.moving Rz", ("J5",)),), robot, states)
    assert (wrong["inputs_right"], wrong["inputs_needless"], wrong["place_right"], wrong["false"]) == (
        False,
        1,
        False,
        1,
    )
    assert graded((), robot, states)["inputs_right"] is False


@pytest.mark.long
def test_on_an_innocent_robot_all_is_false_but_what_follows_a_tracker_that_walks(tmp_path):
    for index, false in ((0, 2), (list(INNOCENT).index("walking tracker"), 1)):
        robot = make(0, 0, index)
        _, states = oracle(robot, write(robot, tmp_path / str(index)))
        row = graded((finding("base Tx", ("row",)), finding("J2.moving Rz", ("J2",))), robot, states)
        assert row["false"] == false
        assert "inputs_right" not in row


def test_a_robot_for_a_last_look_is_kept_without_what_tells_which_it_is():
    one = {"seed": 1, "law": "u", "inputs": [], "place": "", "arm": "", "kind": "", "ratio": 2.0}
    assert shown(one, False) == {"seed": 1, "ratio": 2.0}
    assert shown(one, True) == one
    assert shown({**one, "seed": 2}, False) == {**one, "seed": 2}


@pytest.mark.long
def test_a_surface_told_inputs_and_place_is_near_the_oracle_of_a_smooth_law(tmp_path):
    robot = make(0, 1, 4)
    told, _ = oracle(robot, write(robot, tmp_path))
    assert rms_mm(surface(robot) - robot.fresh.clean) < 1.3 * rms_mm(told - robot.fresh.clean)


def test_the_gradient_of_the_marginal_likelihood_is_that_of_its_differences():
    robot = make(0, 2, 18)
    train = robot.train
    model = fit(robot.machine.arm, train.q, train.measured, [], register(robot.machine.arm, train.q, train.measured))
    left = (train.measured - model.predict(train.q, [])).ravel()
    problem = problem_of(rows_of(robot, model, train), left)
    at = np.array([np.log(3e-5), np.log(1e-3), -0.5, 0.2])
    for step, slope in zip(1e-5 * np.eye(4), problem.cost(at)[1], strict=True):
        assert (problem.cost(at + step)[0] - problem.cost(at - step)[0]) / 2e-5 == pytest.approx(slope, rel=1e-4)
