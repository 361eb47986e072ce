"""An innocent table is not taken for one with columns mixed up."""

from pathlib import Path

import pytest

import gpmodel as gp
from gpmodel.checks.mixed_up import mixed_up


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
