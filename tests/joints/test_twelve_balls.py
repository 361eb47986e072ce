"""Test machines of twelve ball joints: loop closure, effects of every ball, a joint's result as prior."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gpmodel as gp
from experiments.spherical_joint.rig import Rig
from experiments.twelve_balls import simulator
from experiments.twelve_balls.run import measured, one_machine
from experiments.twelve_balls.simulator import BALLS, Fault, Rotation, table, tau_readings
from gpmodel.api.calibrate import measured_joints
from gpmodel.application.further import further_poses
from gpmodel.application.model_file import saved_model
from gpmodel.calibration.alternatives import POOL, _anywhere
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.errors import InputError
from gpmodel.families import catalogue
from gpmodel.families.session import arm_growth
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import balls_of
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import unmeasured
from gpmodel.testing import check_mechanism
from joints import spherical_joint
from joints.hexapod import hexapod, tau
from joints.settings import DATA

PUSHED = {"turned": "pushed", '["0 mm", "0 mm"]': '["-20 mm", "20 mm"]'}


def described(folder: Path, changes: dict[str, str]) -> Path:
    text = (DATA / "tau.toml").read_text(encoding="utf-8")
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    (folder / "other.toml").write_text(text, encoding="utf-8")
    return folder / "other.toml"


@pytest.mark.long
@pytest.mark.parametrize("changes", [{}, PUSHED], ids=["turned", "pushed"])
def test_a_tau_robot_holds_to_the_contract_of_mechanisms_loops_included(tmp_path: Path, changes: dict) -> None:
    check_mechanism(tau(described(tmp_path, changes)), poses=6)


@pytest.mark.parametrize("which", ["hexapod", "turned", "pushed"])
def test_growth_of_all_lengths_scales_the_machine(which: str, tmp_path: Path) -> None:
    """A measured length of a leg is a whole length: it grows once. The point on the platform is fitted, not grown."""
    arm = hexapod() if which == "hexapod" else tau(described(tmp_path, PUSHED if which == "pushed" else {}))
    q = random_poses(arm, 20, np.random.default_rng(0))
    poses = prepare(arm, unmeasured([joint.name for joint in arm.joints], q))
    (effect,) = arm_growth("growth", arm, Expression("1"), "1", "thermal_growth")
    before, after = (ErrorModel(arm, one).frames(poses, np.full(len(one), 1e-5))[-1] for one in ((), (effect,)))
    platform = before[:, :3, 3] - before[:, :3, :3] @ arm.tool
    np.testing.assert_allclose((after - before)[:, :3, 3], 1e-5 * platform, atol=1e-9)


def test_its_coordinates_close_to_the_poses_that_scipy_finds() -> None:
    """The truth's errors are drawn large enough to be seen; without them both are one machine."""
    arm, rng = tau(), np.random.default_rng(0)
    none = type("still", (), {"normal": lambda _, *a, **k: np.zeros(k["size"]), "uniform": rng.uniform})()
    q, place, turn = tau_readings(DATA / "tau.toml", Fault(-1, 0, 0.0), 8, none)
    tool = arm.assembled(q, {})[-1]
    np.testing.assert_allclose(tool[:, :3, 3], place + turn.apply(arm.tool), atol=1e-9)
    np.testing.assert_allclose((Rotation.from_matrix(tool[:, :3, :3]).inv() * turn).magnitude(), 0.0, atol=1e-9)


def test_links_keep_their_lengths_and_weights_balance(tmp_path: Path) -> None:
    """The torques are the slopes of the potential energy of platform and payload."""
    arm = tau(described(tmp_path, {'mass = "0 kg"': 'mass = "3 kg"'}))
    q, payload = random_poses(arm, 5, np.random.default_rng(1)), np.full(5, 2.0)

    def energy(q: np.ndarray) -> np.ndarray:
        tool = arm.assembled(q, {})[-1]
        origin = tool[:, :3, 3] - tool[:, :3, :3] @ np.array(arm.tool)
        return -(2.0 * tool[:, :3, 3] + 3.0 * origin) @ np.array(arm.gravity)

    loads = arm.loads(q, payload)
    for k, step in enumerate(1e-6 * np.eye(3)):
        slope = (energy(q + step) - energy(q - step)) / 2e-6
        np.testing.assert_allclose(loads[f"torque_A{k + 1}"], -slope, atol=1e-6)
    np.testing.assert_allclose(loads["force_base_z"], -5.0 * 9.80665, rtol=1e-3)


@pytest.mark.parametrize("machine", [hexapod, tau])
def test_every_ball_offers_the_joints_effects_over_its_own_angles_from_where_it_stands_at_home(machine) -> None:
    arm = machine()
    assert [ball.name for ball in balls_of(arm)] == list(BALLS)
    at_home = arm.turned(arm.home)
    np.testing.assert_allclose(list(at_home.values()), 0.0, atol=1e-12)
    made = simulate(
        arm, random_poses(arm, 12, np.random.default_rng(2)), (), np.random.default_rng(2), payload=np.full(12, 40.0)
    )
    poses = prepare(arm, made.dataset)
    offered = catalogue.candidates(arm, poses.states)
    for family, angles in [("ball_lobes", True), ("axis_run_out", True), ("axis_motion", True), ("support_sag", False),
                           ("preload", False)]:  # fmt: skip
        of_family = [c for c in offered if c.family == family]
        for ball in balls_of(arm):
            of_ball = [c for c in of_family if (set(c.inputs) <= set(ball.angles) if angles else ball.name in c.name)]
            assert of_ball, (family, ball.name)
    lobes = next(c for c in offered if c.family == "ball_lobes")
    assert poses.states.unit(lobes.inputs[0]) == "rad"


@pytest.mark.long
def test_the_bad_ball_of_a_hexapod_is_named_and_nothing_of_a_good_one() -> None:
    found = one_machine("hexapod", 3, True)
    assert found["right"]
    assert found["lobes"]
    assert one_machine("hexapod", 3, False)["named"] == []


def faulty(kind: str, fault: Fault, count: int) -> str:
    """A table of a machine with that fault."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulator, "drawn", lambda *_: (fault, np.random.default_rng(5)))
        return table(kind, 0, True, count)[0]


def joint_of(lobes: float, kind: str = "lobes", measured_angles: bool = False) -> gp.Model:
    """A joint of three lobes over its pitch, measured alone on its rig, told of them."""
    joint, rng = spherical_joint().with_angles(measured=measured_angles), np.random.default_rng(3)
    rig = Rig(joint, reach=(1.2, 1.2, 2.0), angle_noise=np.radians(0.5))
    q = rig.poses(80, rng)
    lever = np.array(joint.tooling_ball) / np.linalg.norm(joint.tooling_ball)
    shape = lobes * np.cos(3 * q[:, 1])
    poses = prepare(joint, rig.measure(q, rng, None, lambda q, _: {25 + k: v * shape for k, v in enumerate(lever)}))
    name = "out-of-round ball, 3 lobes over J2, lift along the lever"
    told = [c.effects for c in catalogue.candidates(joint, poses.states) if c.name == name and kind == "lobes"]
    fit = calibrate(ErrorModel(joint, (*geometric_effects(joint), *(e for own in told for e in own))), poses)
    return gp.Model(saved_model(fit, poses))


@pytest.mark.long
def test_a_joints_result_is_the_prior_of_that_ball_of_a_machine(tmp_path: Path) -> None:
    """With it, a fit to 20 poses predicts further ones to the noise; a fit with the lobes alone does not."""
    joint_of(12e-6).save(tmp_path / "model.json")
    truth = Fault(2 * 4, 1, 0.0)
    machine, everything = measured("hexapod", faulty("hexapod", truth, 220))
    seen, fresh = everything.subset(np.arange(20)), everything.subset(np.arange(20, 220))
    ((_, handed),) = measured_joints([f"{BALLS[truth.ball]}={tmp_path}"], machine)
    assert {i for e in handed for i in e.inputs} == {truth.angle}
    means = {str(e.terms[0].basis)[:3]: e.mean for e in handed}
    assert means["cos"] == pytest.approx(12e-6, abs=3e-6)
    assert all(0.0 < e.prior < 3e-6 for e in handed)
    free = tuple(replace(e, prior=np.inf, mean=0.0) for e in handed)
    geometry = geometric_effects(machine)
    known, alone = (calibrate(ErrorModel(machine, (*geometry, *own)), seen) for own in (handed, free))
    rms = [float(np.sqrt(np.mean(errors_on(fit, fresh) ** 2))) for fit in (known, alone)]
    assert rms[0] < rms[1]
    assert abs(known.theta[-1] - means["cos"]) < 3 * handed[-1].prior


def refused(joint: str, result: gp.Model, folder: Path, machine: str = "hexapod") -> str:
    result.save(folder / "model.json")
    with pytest.raises(InputError) as caught:
        measured_joints([f"{joint}={folder}"], gp.load_mechanism(machine))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.long
def test_a_result_of_another_joint_or_for_no_ball_is_refused_in_one_line(tmp_path: Path) -> None:
    plain = joint_of(0.0, kind="nothing")
    assert "expected a shift that depends on the tilt of the ball" in refused("L3.fixed", plain, tmp_path)
    assert "'L7.fixed' is no ball of hexapod; expected L" in refused("L7.fixed", plain, tmp_path)
    assert "'L1.fixed' is no ball of irb6400r; expected none" in refused("L1.fixed", plain, tmp_path, "irb6400r")
    text, _ = table("hexapod", 0, False, 30)
    machine, poses = measured("hexapod", text)
    own = gp.Model(saved_model(calibrate(ErrorModel(machine, geometric_effects(machine)), poses), poses))
    assert "a result of wide hexapod, expected a result of a single ball joint" in refused("L1.fixed", own, tmp_path)
    with pytest.raises(InputError, match=r"'L3\.fixed', expected BALL=RESULT"):
        measured_joints(["L3.fixed"], gp.load_mechanism("hexapod"))


def test_bad_descriptions_and_poses_are_refused_in_one_line(tmp_path: Path) -> None:
    for changes, said in [
        ({'stands = "75 deg"': 'stands = "75 mm"'}, "stands"),
        ({'turn = ["-29 deg", "29 deg"]': 'turn = ["5 deg", "29 deg"]'}, "zero between the two"),
        ({'drive = "turned"': 'drive = "slid"'}, "expected turned or pushed"),
        ({'axis = "z"': 'axis = "w"'}, "expected x, y or z"),
        ({'[[link]]\nbase = ["350 mm", "0 mm", "0 mm"]\nplatform = ["0 mm", "-50 mm", "-90 mm"]': ""}, "expected 6"),
    ]:
        with pytest.raises(InputError, match=said):
            tau(described(tmp_path, changes))
    with pytest.raises(InputError, match=r"pose 2: legs of .* do not meet in one platform"):
        tau().transforms(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]))
    frame = pd.read_csv(io.StringIO(table("tau", 0, False, 5)[0]), dtype=str)
    with pytest.raises(InputError, match="A3"):
        gp.calibrate("tau", frame.drop(columns="A3 [rad]"))


WIDE = str(simulator.MACHINES["hexapod"][0])


@pytest.mark.long
def test_random_poses_of_a_fitted_machine_are_those_at_which_its_loops_close() -> None:
    errors = [f"L{i}.moving:Tz:1={'-' if i % 2 else ''}5 mm" for i in range(1, 7)]
    made = gp.simulate(WIDE, errors, poses=40)
    model = made.truth.saved.model
    poses = prepare(model.mechanism, made.table)
    fit = calibrate(model, poses, condition_limit=1e4, robust=False)
    drawn = _anywhere(fit, poses)
    assert POOL / 2 < len(drawn) < POOL
    assert np.isfinite(drawn.dataset.position).all()
    assert further_poses(fit, poses) is not None


@pytest.mark.long
@pytest.mark.parametrize("errors", [{"geometry_sigma": "3 mm"}, {"effects": ["L1.moving:Tz:1=20 mm"]}])
def test_simulated_poses_whose_loops_stay_open_are_drawn_again(errors: dict) -> None:
    made = gp.simulate(WIDE, poses=60, **errors)
    assert np.isfinite(made.table.position).all()
    assert len(made.table) == 60
    given = pd.DataFrame({f"L{i} [mm]": ["500", "530" if i % 2 else "470"] for i in range(1, 7)})
    with pytest.raises(InputError, match=r"^poses: the loops do not close with these errors at 2 of 2 .*at pose 1"):
        gp.simulate(WIDE, ["L1.moving:Tz:1=100 mm"], poses=given)
