"""Test the verdicts of `check`: weak columns, scale factors, exchanged columns, rounded digits."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import robot, table
from instances import some
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.api.check import check
from gpmodel.api.results import write_numbers
from gpmodel.checks.judge import Remark, check_dataset
from gpmodel.checks.mixed_up import mixed_up, rotations_flaw
from gpmodel.checks.scales import Factor
from gpmodel.checks.weak_columns import misread_column
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.se3 import shift
from gpmodel.planning.simulate import Simulation
from gpmodel.table.dataset import Dataset


def longer(made: Simulation) -> Dataset:
    arm = made.model.mechanism
    model = ErrorModel(arm, (*made.model.effects, effect_at("longer", "J2.moving", "Tz")))
    tip = observe(model, prepare(arm, made.dataset), np.append(made.theta, 0.0496), made.placement).tip
    return replace(made.dataset, position=tip[:, :3, 3])


def noisy(made: Simulation) -> Dataset:
    off = np.random.default_rng(0).normal(0.0, 0.05, 60)[:, None] * np.array([1.0, 0.0, 0.0])
    return replace(made.dataset, position=made.dataset.position + off)


VERDICTS: dict[str, tuple[Callable[[Simulation], Dataset], tuple[str, ...]]] = {
    "sound": (lambda made: made.dataset, ()),
    "another arm": (longer, ("the description of irb6400r does not match the measurements",)),
    "50 mm of noise in x": (noisy, ("the residual of the standard model is too large",)),
    "none to hold out": (lambda made: made.dataset.subset(np.arange(12)), ("too few poses",)),
}


@pytest.mark.long
@pytest.mark.parametrize("case", VERDICTS)
def test_the_verdict_says_why_a_table_is_not_fit_to_calibrate_with(case: str) -> None:
    make, why = VERDICTS[case]
    arm, made = robot(60)
    judged = check(arm, make(made))
    assert judged.unfit == why
    assert any("compliance of joints" in remark.text for remark in judged.findings) is (make is noisy)
    verdict = judged.summary().splitlines()[-1]
    assert verdict.startswith(f"not fit to calibrate with: {why[0]}; " if why else "fit to calibrate with")


def test_a_soft_robot_is_fit_to_calibrate_with() -> None:
    arm, made = robot(60, effects=("base_compliance=2e-6",))
    judged = check(arm, made.dataset)
    assert judged.unfit == ()
    assert any("With compliances and smooth errors of the joints" in remark.text for remark in judged.findings)


def test_a_bad_robot_is_described_as_it_was_measured_though_parallel_joints_share_its_errors() -> None:
    arm, made = robot(60, 1, "ur3", geometry_sigma=1e-3)
    assert not check(arm, made.dataset).unfit


def measured(offset: float, seed: int = 1, rotations: bool = False) -> tuple[Mechanism, Dataset]:
    """A ur10 whose reflector stands `offset` m off the axis of its last joint."""
    mechanism, made = robot(60, seed, "ur10")
    flange = np.array([offset, 0.0, 0.05])
    placement = replace(made.placement, tool={"": shift(flange)})
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, placement).tip
    noise = np.random.default_rng(seed).normal(0.0, 3e-5, (60, 3))
    data = replace(made.dataset, position=tip[:, :3, 3] + noise)
    return mechanism, replace(data, rotation=Rotation.from_matrix(tip[:, :3, :3]).as_rotvec()) if rotations else data


def column(data: Dataset, change: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    q = data.q.copy()
    q[:, 5] = change(q[:, 5])
    return replace(data, q=q)


WRONG: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "flipped": (np.negative, "probably has the opposite sign"),
    "degrees as radians": (np.degrees, "looks like [deg], given as radians"),
}


@pytest.mark.parametrize("offset", [1.5e-3, pytest.param(3e-4, marks=pytest.mark.long)])
@pytest.mark.parametrize("case", WRONG)
def test_a_wrist_that_is_read_wrongly_is_named_though_it_leaves_a_millimetre(case: str, offset: float) -> None:
    mechanism, data = measured(offset)
    change, said = WRONG[case]
    text = misread_column(mechanism, column(data, change), geometric_effects(mechanism))
    assert text is not None
    assert f"column '{mechanism.joints[5].name}'" in text
    assert said in text


@pytest.mark.parametrize("change", some(["shuffled", "one row late"], "one row late"))
@pytest.mark.parametrize("offset", [1.5e-3, pytest.param(3e-4, marks=pytest.mark.long)])
def test_a_wrist_of_other_poses_is_named(change: str, offset: float) -> None:
    mechanism, data = measured(offset)
    rng = np.random.default_rng(2)
    text = misread_column(
        mechanism,
        column(data, rng.permutation if change == "shuffled" else lambda q: np.roll(q, 1)),
        geometric_effects(mechanism),
    )
    assert f"column '{mechanism.joints[5].name}' does not match these positions" in (text or "")


@pytest.mark.parametrize("offset", some([0.0, 3e-4, 1.5e-3], 1.5e-3))
def test_a_wrist_that_is_read_rightly_is_not(offset: float) -> None:
    mechanism, data = measured(offset)
    assert misread_column(mechanism, data, geometric_effects(mechanism)) is None


def written(data: Dataset, convention: str) -> Dataset:
    turn = Rotation.from_rotvec(np.array(data.rotation))
    if convention == "wxyz read as xyzw":
        quaternion = turn.as_quat()
        values = Rotation.from_quat(quaternion[:, [3, 0, 1, 2]]).as_rotvec()
    elif convention == "inverse":
        values = turn.inv().as_rotvec()
    elif convention == "radians read as degrees":
        values = np.radians(turn.as_rotvec())
    elif convention == "shuffled":
        values = np.random.default_rng(0).permutation(data.rotation)
    elif convention == "left-handed":
        values = turn.as_rotvec() * [-1.0, 1.0, -1.0]
    else:
        values = turn.as_euler(convention)
    return replace(data, rotation=values)


@pytest.mark.parametrize(
    ("convention", "said"),
    [
        ("wxyz read as xyzw", "as quaternion wxyz, by"),
        ("xyz", "as fixed XYZ of rx, ry, rz, by"),
        ("ZYX", "as intrinsic ZYX of rx, ry, rz, by"),
        ("zyz", "as fixed ZYZ of rx, ry, rz, by"),
        ("inverse", "read as the inverse, by"),
        ("radians read as degrees", "read as rotation vector in radians, by"),
        ("left-handed", "read as left-handed, y mirrored, by"),
        ("shuffled", "in every other convention by at least"),
    ],
)
def test_rotations_in_another_convention_are_refused_with_the_one_that_fits(convention: str, said: str) -> None:
    mechanism, data = measured(0.02, rotations=True)
    assert rotations_flaw(mechanism, data) is None
    assert said in (rotations_flaw(mechanism, written(data, convention)) or "")


AXES = np.array([1.0, 1.0, 1.001])


def joint_4(data: Dataset) -> Dataset:
    return replace(data, q=data.q * np.where(np.arange(6) == 3, 1.001, 1.0))


def said(change: Callable[[Dataset], Dataset], arm: str, **settings: object) -> Remark:
    mechanism, made = robot(60, name=arm, **settings)
    (one,) = [r for r in check_dataset(mechanism, change(made.dataset)) if "scale" in r.text]
    return one


@pytest.mark.parametrize("arm", some(["irb6400r", "ur10"], "ur10"))
@pytest.mark.parametrize(
    ("change", "words", "fit"),
    [
        (lambda d: replace(d, position=1.01 * d.position), "x, y and z look scaled by 1.0", False),
        (lambda d: replace(d, position=AXES * d.position), "column 'z' looks scaled by 1.0010", True),
        (joint_4, "looks scaled by 1.00", True),
    ],
)
def test_a_scaled_column_is_named(change: Callable[[Dataset], Dataset], words: str, fit: bool, arm: str) -> None:
    found = said(change, arm)
    assert found.severity == "warning"
    assert words in found.text
    assert fit == (not found.unfit)


@pytest.mark.parametrize(
    "effects", [(), ("base_compliance=1e-6",), ("joint_compliance J2=2e-6", "joint_compliance J3=2e-6")]
)
def test_an_arm_that_yields_is_not_scaled(effects: tuple[str, ...]) -> None:
    found = said(lambda d: d, "irb6400r", effects=effects)
    assert found.severity == "note"
    assert abs(float(found.text.split(": ")[1].split(" ")[0]) - 1.0) < 1e-3


def test_lengths_of_a_tenth_of_a_percent_are_no_scale_but_are_said() -> None:
    found = said(lambda d: replace(d, position=1.001 * d.position), "ur5")
    assert found.severity == "note"
    value, deviation = (float(text) for text in found.text.split(": ")[1].split(" ± "))
    assert abs(value - 1.001) < 3 * deviation < 3e-3


@pytest.mark.parametrize("seed", [2, 40])
@pytest.mark.parametrize("sigma", ["0 mm", "0.5 mm"])
def test_a_tool_on_any_side_of_a_joint_about_one_centre_is_found(seed: int, sigma: str) -> None:
    """The whole joint turns about one point: a mirrored table is one with the tool on the other side."""
    joint = gp.load_mechanism("spherical-joint")
    made = gp.simulate(joint, poses=60, geometry_sigma=sigma, seed=seed)
    assert mixed_up(joint, made.table) is None


def test_a_torque_of_no_joint_is_said_to_be_an_input() -> None:
    arm = gp.load_mechanism("ur5")
    frame = gp.simulate(arm, poses=60).to_dataframe()
    frame = frame.assign(**{"torque_J9 [N*m]": range(60), "effort_index [1]": range(60)})
    (said,) = [f.text for f in gp.check(arm, frame).findings if "torque_J9" in f.text]
    assert "names no joint of ur5 and is an input like any other; expected torque_" in said
    assert not [f for f in gp.check(arm, frame).findings if "effort_index" in f.text]


@pytest.mark.long
def test_two_arms_before_one_tracker_are_no_mix_up(tmp_path: Path) -> None:
    """The frames of both are no chain, one after the other."""
    links = ((136, 0, 90), (0, 425, 0), (0, 392, 0), (110, 0, 90), (95, 0, -90), (82, 0, 0))
    text = 'convention = "standard"'
    for arm, tilt in (("left", -15), ("right", 15)):
        rows = [("torso", 900, 0, tilt), *((f"{arm}_{i}", *link) for i, link in enumerate(links, 1))]
        text += f'\n[[arm]]\nname = "{arm}"\n' + "\n".join(
            f'[[arm.joint]]\nname = "{name}"\nd_mm = {d}\na_mm = {a}\nalpha_deg = {alpha}' for name, d, a, alpha in rows
        )
    (tmp_path / "arms.toml").write_text(text)
    made = gp.simulate(tmp_path / "arms.toml", poses=100, geometry_sigma="0.3 mm", seed=1)
    assert gp.check(made.truth.mechanism, made.table).valid
    fit = gp.calibrate(made.truth.mechanism, made.table, holdout=0.0)
    assert fit.record.ladder[-1].train.rms_mm < 0.1
    refused = fit.model.export().summary()
    assert "several arms; expected a serial chain" in " ".join(refused.split())


SOUND = table(60, name="ur5")


def of_the_controller(decimals: int) -> object:
    own = table(60, name="ur5", noise=0.0, geometry_sigma=0.0).astype(float)
    return own.assign(**{f"{a} [mm]": own[f"{a} [mm]"].round(decimals) for a in "xyz"})


@pytest.mark.parametrize("decimals", [1, 3])
def test_positions_of_the_nominal_arm_are_called_computed(decimals: int) -> None:
    judged = gp.check("ur5", of_the_controller(decimals))
    assert ("these positions are computed, not measured" in " ".join(judged.summary().split())) == (decimals == 3)
    assert judged.valid == (decimals != 3)


@pytest.mark.parametrize("fit", [gp.calibrate, gp.discover])
def test_nothing_is_fitted_to_computed_positions(fit: Callable[..., object]) -> None:
    with pytest.raises(gp.InputError, match="these positions are computed, not measured"):
        fit("ur5", of_the_controller(3))


def test_no_accuracy_is_certified_by_computed_positions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as before:
        before.setattr("gpmodel.checks.judge.computed", lambda *_: iter(()))
        fit = gp.calibrate("ur5", of_the_controller(3), holdout=0)
        write_numbers(fit.record, fit.model, tmp_path)
    for result in (fit, tmp_path):
        with pytest.raises(gp.InputError, match=r"are computed, not measured.*an accuracy cannot be certified"):
            gp.certificate(result)


@pytest.mark.long
def test_no_accuracy_is_certified_by_predictions_of_the_model() -> None:
    verified = gp.calibrate("ur5", SOUND, holdout=0).model.verify(table(40, 5, name="ur5"))
    predicted = replace(verified, record=replace(verified.record, chi_square=1e-9))
    with pytest.raises(gp.InputError, match="errors smaller than the noise of the model allows"):
        gp.certificate(predicted)


def test_the_standard_error_of_a_factor_has_two_digits() -> None:
    assert Factor("x, y and z", 1.0000012, 0.0000031, 0.5, 1.0, 0.0).size == "1.0000012 ± 0.0000031"
