"""Test the hexapod: closed loops, their derivatives, identifiable constants, bad files."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from instances import some

import gpmodel as gp
from experiments.hexapod.simulator import BASE, GEOMETRY, POINT_NOISE, Machine, Rotation, readings, ring, table
from gpmodel.api.check import effects as families_on
from gpmodel.application.compensate import not_reached
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.start import start_placements
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import ClosedLoops, closed
from gpmodel.model.error_model import ErrorModel, Placement, closing, observe, prepare
from gpmodel.model.sites import geometric_effects, standard_effects
from gpmodel.planning.design import candidates
from gpmodel.planning.simulate import simulate
from gpmodel.report.fitted import tool_displacements
from gpmodel.table.dataset import unmeasured
from gpmodel.testing import check_mechanism
from joints import load_mechanism, spherical_joint
from joints.hexapod import Hexapod, hexapod

HEAVY = """
kind = "hexapod"
[base]
radius = "500 mm"
pair = "40 deg"
[platform]
radius = "12 in"
pair = "15 deg"
mass = "30 kg"
[leg]
shortest = "0.7 m"
longest = "0.8 m"
[tool]
centre = ["20 mm", "-30 mm", "100 mm"]
"""


def machine(folder: Path, text: str = HEAVY) -> Hexapod:
    (folder / "press.toml").write_text(text)
    return hexapod(folder / "press.toml")


@pytest.mark.long
@pytest.mark.parametrize("which", ["built-in", "heavy"])
def test_it_holds_to_the_contract_of_mechanisms_loops_included(which: str, tmp_path: Path) -> None:
    check_mechanism(hexapod() if which == "built-in" else machine(tmp_path), poses=6)


def test_every_leg_is_as_long_as_it_reads_over_the_whole_stroke(tmp_path: Path) -> None:
    for arm in (hexapod(), machine(tmp_path)):
        q = random_poses(arm, 500, np.random.default_rng(0))
        frames = arm.assembled(q, {})
        lengths = np.linalg.norm(frames[3:-1:3, :, :3, 3] - frames[1:-1:3, :, :3, 3], axis=2).T
        np.testing.assert_allclose(lengths, q, atol=1e-12)
        np.testing.assert_allclose(arm.weakest(q) > 0.1, True)
    assert machine(tmp_path).name == "press"


def test_readings_chosen_from_poses_close_to_the_same_poses() -> None:
    """The other way round, by code that shares nothing: poses give lengths there, lengths give poses here."""
    text, _ = table(3)
    frame = pd.read_csv(io.StringIO(text))
    arm = hexapod()
    np.testing.assert_allclose(ring(BASE, (-np.radians(10), np.radians(10))), arm.base, atol=1e-15)
    perfect = Machine(arm.base, arm.platform, np.zeros(6), 0, 0.0, 0.0)
    poses = arm.assembled(1e-3 * frame.iloc[:, :6].to_numpy(), {})[-1]
    place = poses[:, :3, 3] - poses[:, :3, :3] @ np.array(arm.tool)
    again = readings(perfect, place, Rotation.from_matrix(poses[:, :3, :3]))
    np.testing.assert_allclose(again, 1e-3 * frame.iloc[:, :6], atol=1e-12)


def in_pinocchio(arm: Hexapod, q: Array) -> tuple[Array, Array]:
    """Solve the machine by Pinocchio's constraint models, closed as found here: gaps (6, 3) m, tool speed (3, 6).

    A free platform and six legs of ball joint and slide, each tied to its ball of the platform by a point constraint.
    """
    frames = arm.assembled(q[None], {})[:, 0]
    tool = frames[-1]
    place = pin.SE3(tool[:3, :3], tool[:3, 3] - tool[:3, :3] @ np.array(arm.tool))
    model = pin.Model()
    platform = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    values, ties = [pin.SE3ToXYZQUAT(place)], []
    for k, (base, ball, length) in enumerate(zip(arm.base, arm.platform, q, strict=True)):
        foot = model.addJoint(0, pin.JointModelSpherical(), pin.SE3(np.eye(3), base), f"foot {k}")
        slide = model.addJoint(foot, pin.JointModelPZ(), pin.SE3.Identity(), f"slide {k}")
        along = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), place.act(ball) - base)
        values += [along.coeffs(), np.array([length])]
        at = pin.SE3(np.eye(3), ball)
        ties.append(
            pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, slide, pin.SE3.Identity(), platform, at)
        )
    data, tied = model.createData(), [tie.createData() for tie in ties]
    pin.computeJointJacobians(model, data, np.concatenate(values))
    for tie, of_tie in zip(ties, tied, strict=True):
        tie.calc(model, data, of_tie)
    rows = pin.getConstraintsJacobian(model, data, ties, tied)
    slides = [model.joints[tie.joint1_id].idx_v for tie in ties]
    free = np.setdiff1d(np.arange(model.nv), slides)
    moved = -np.linalg.lstsq(rows[:, free], rows[:, slides], rcond=None)[0][:6]
    speed = moved[:3] - np.cross(np.array(arm.tool), moved[3:], axisb=0).T
    return np.array([of_tie.c1Mc2.translation for of_tie in tied]), tool[:3, :3] @ speed


def test_pinocchios_constraint_models_close_the_same_loops_and_move_the_tool_alike(tmp_path: Path) -> None:
    for arm in (hexapod(), machine(tmp_path)):
        for q in random_poses(arm, 5, np.random.default_rng(6)):
            gaps, speeds = in_pinocchio(arm, q)
            np.testing.assert_allclose(gaps, 0.0, atol=1e-12)
            steps = 1e-6 * np.eye(6)
            ours = (arm.assembled(q + steps, {}) - arm.assembled(q - steps, {}))[-1, :, :3, 3].T / 2e-6
            np.testing.assert_allclose(speeds, ours, atol=1e-8)


@pytest.mark.parametrize(("size", "tolerance"), some([(3e-4, 1e-7), (3e-3, 1e-7), (3e-2, 1e-6)], (3e-2, 1e-6)))
def test_columns_are_central_differences_of_the_closed_machine_at_finite_errors(size: float, tolerance: float) -> None:
    arm, rng = hexapod(), np.random.default_rng(4)
    effects = geometric_effects(arm)
    data = simulate(arm, random_poses(arm, 16, rng), (), rng).dataset
    model, theta = ErrorModel(arm, effects), size * rng.normal(size=len(effects))
    poses = prepare(arm, data.subset(closing(model, data, theta)[:8]))
    placed = Placement({"": np.eye(4)}, {"": np.eye(4)}, {})

    def tips(at: Array) -> Array:
        return observe(model, poses, at, placed).tip[:, :3, 3]

    problem = linearise(model, poses, theta, placed, Weighting({}, np.ones(8, dtype=bool)))
    columns = problem.columns[:, problem.placement :].reshape(8, 3, -1)
    for k, step in enumerate(1e-6 * np.eye(len(effects))):
        numeric = (tips(theta + step) - tips(theta - step)) / 2e-6
        np.testing.assert_allclose(columns[:, :, k], numeric, atol=tolerance)


def test_forty_two_constants_less_the_places_of_base_and_platform_can_be_told_apart() -> None:
    arm = hexapod()
    effects = geometric_effects(arm)
    assert len(effects) == 42
    poses = prepare(arm, gp.read_table(pd.read_csv(io.StringIO(table(0, False)[0]), dtype=str), arm))
    model, everyone = ErrorModel(arm, effects), np.ones(len(poses), dtype=bool)
    problem = linearise(model, poses, np.zeros(42), next(start_placements(poses)), Weighting({}, everyone))
    scaled = problem.columns / np.linalg.norm(problem.columns, axis=0)
    assert problem.placement == 12
    assert np.linalg.matrix_rank(scaled, tol=1e-6) == 42


@pytest.mark.long
def test_calibrated_on_an_outside_truth_it_predicts_to_the_noise() -> None:
    arm = gp.load_mechanism("hexapod")
    frame = pd.read_csv(io.StringIO(table(1, planted=False)[0]), dtype=str)
    result = gp.calibrate(arm, frame, holdout=0.3)
    before, after = result.record.ladder[0].heldout, result.record.ladder[-1].heldout
    assert before.rms_mm > 0.1 * 1e3 * GEOMETRY
    assert after.rms_mm < 1.4 * np.sqrt(3) * 1e3 * POINT_NOISE


def test_what_has_loops_says_so_and_what_has_none_does_not() -> None:
    assert isinstance(hexapod(), ClosedLoops)
    assert closed(gp.load_mechanism("hexapod")) is not None
    assert closed(spherical_joint()) is closed(gp.load_mechanism("ur5")) is None
    chosen = [e.name for e in standard_effects(gp.load_mechanism("hexapod"), ("J2.fixed T*", "L3 Tz"))]
    assert chosen == ["L3 Tz", "L2.fixed Tx", "L2.fixed Ty", "L2.fixed Tz"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[base]\nradius = "0 mm"', "base.radius"),
        ('[leg]\nshortest = "700 mm"', "expected above shortest"),
        ('[leg]\nshortest = "50 mm"\nlongest = "60 mm"', "do not meet"),
        ('[base]\npair = "60 deg"\n[platform]\npair = "60 deg"', "the legs do not fix the platform"),
        ('[platform]\nradius = "200"', "unit"),
        ("[platform]\nsize = 3", "unknown key"),
    ],
)
def test_a_bad_description_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(f'kind = "hexapod"\n{text}\n')
    with pytest.raises(InputError, match=message) as caught:
        load_mechanism(str(path))
    assert "\n" not in str(caught.value)
    assert "bad.toml" in str(caught.value)


def test_lengths_that_meet_in_no_platform_are_refused_by_pose() -> None:
    q = np.full((3, 6), 0.55)
    q[1] = (0.1, 0.9, 0.1, 0.9, 0.1, 0.9)
    with pytest.raises(InputError, match=r"pose 2: legs of 100.0, 900.0.* do not meet in one platform"):
        hexapod().transforms(q)


def test_a_table_without_its_lengths_is_told_their_names_and_unit() -> None:
    frame = pd.DataFrame({"x [mm]": ["1"], "y [mm]": ["2"], "z [mm]": ["3"]})
    with pytest.raises(InputError, match=r"'J1' is missing.*L1, L2.* with \[mm\] or \[m\]"):
        gp.read_table(frame, "hexapod")


def test_effects_that_only_a_payload_brings_say_so() -> None:
    offered = families_on(hexapod()).set_index("family")
    assert offered.loc["joint_compliance", "payload"]
    assert not offered.loc["ball_lobes", "payload"]
    assert offered.loc["ball_lobes", "instances"] == 288


@pytest.mark.long
def test_what_an_effect_moves_is_told_where_the_loops_close_with_it_and_without_it() -> None:
    arm = gp.load_mechanism(Path(__file__).parents[2] / "experiments" / "twelve_balls" / "hexapod.toml")
    effects = standard_effects(arm, ("L1 Tz", "L2 Tz"))
    model, theta, alone = ErrorModel(arm, effects), np.array([0.05, 0.05]), np.array([0.05, 0.0])
    drawn = unmeasured([joint.name for joint in arm.joints], random_poses(arm, 600, np.random.default_rng(0)))
    whole, less = (set(closing(model, drawn, value)) for value in (theta, alone))
    assert whole - less
    assert whole & less
    data = drawn.subset(np.array(sorted(whole)))
    saved = replace(gp.simulate(arm, poses=12).truth.saved, model=model, theta=theta)
    moves = tool_displacements(saved, prepare(arm, data), [effects[1:]])[1][0][:, :3]
    moved = np.linalg.norm(moves, axis=1)
    assert len(moved) == len(whole & less)
    assert 10e-3 < moved.mean() < 150e-3


@pytest.mark.long
def test_poses_that_are_proposed_close_and_steps_to_open_loops_are_not_taken() -> None:
    arm = gp.load_mechanism(Path(__file__).parents[2] / "experiments" / "twelve_balls" / "hexapod.toml")
    loops = closed(arm)
    assert loops is not None
    assert loops.closes(candidates(arm, 300, np.random.default_rng(1))).all()
    made = gp.simulate(arm, poses=12, geometry_sigma="1 mm", seed=3)
    found = made.truth.compensate(pd.DataFrame(made.table.q * 1e3, columns=[f"{j.name} [mm]" for j in arm.joints]))
    assert set(found["status"]) <= {"ok", "large move", "joint limit", "near singular"}


TARGET = ["x [mm]", "y [mm]", "z [mm]", "rx [rad]", "ry [rad]", "rz [rad]"]


@pytest.mark.long
@pytest.mark.parametrize("columns", [TARGET, TARGET[:3]])
def test_a_target_out_of_reach_has_no_numbers_and_the_other_rows_keep_theirs(columns: list[str]) -> None:
    arm = gp.load_mechanism(Path(__file__).parents[2] / "experiments" / "twelve_balls" / "hexapod.toml")
    truth = gp.simulate(arm, poses=12, geometry_sigma="1 mm", seed=3).truth
    rows = [[0, 0, 500, 0, 0, 0], [5000, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]
    targets = pd.DataFrame(rows, columns=TARGET)[columns]
    found = truth.compensate(targets)
    assert found["status"].tolist() == ["ok", "not reached", "not reached"]
    numbers = [c for c in found.columns if c.startswith("corrected_")] + ["correction [mm]", "residual [mm]"]
    assert found[numbers].notna().to_numpy().tolist() == [[True] * 8, [False] * 8, [False] * 8]
    assert not_reached(arm, found).startswith("row 2: x [mm] 5000, y [mm] 0, z [mm] 0 is out of reach of wide hexapod")
    for row in (1, 2):
        with pytest.raises(InputError, match=r"row 1.* out of reach of wide hexapod"):
            truth.compensate(targets.iloc[[row]])


def test_open_loops_and_degrees_given_as_radians_are_named_by_row() -> None:
    truth = gp.simulate("hexapod", poses=12, seed=3).truth
    legs = pd.DataFrame(0.55, index=range(2), columns=[f"L{i} [m]" for i in range(1, 7)])
    legs.iloc[1] = (0.1, 0.9, 0.1, 0.9, 0.1, 0.9)
    for ask in (truth.predict, truth.compensate):
        with pytest.raises(InputError, match=r", row 2: legs of 100.0, 900.0"):
            ask(legs)
    with pytest.raises(InputError, match=r"row 1: rx, ry, rz turn by 5157 deg; expected at most 360"):
        truth.compensate(pd.DataFrame([[0, 0, 500, 90, 0, 0]], columns=TARGET))


def test_a_pose_that_stalls_is_given_up_and_the_others_go_on() -> None:
    arm, near = hexapod(), np.full((1, 6), 0.55)
    apart = np.array([[0.1, 0.9, 0.1, 0.9, 0.1, 0.9]])
    assert arm.closes(np.concatenate([apart, near, apart])).tolist() == [False, True, False]
