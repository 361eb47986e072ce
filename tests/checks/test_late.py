"""Test that positions measured before or after the joint values of a moving robot are named, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from instances import some
from verify_cases import fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.api.check import check
from gpmodel.arrays import Array
from gpmodel.checks.late import measured_late
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.simulate import simulate

STEP = 0.2
CASES: dict[str, tuple[float, str, float, list[str], str]] = {
    "5 ms late": (0.005, "time", 0.0, [], r"0\.00(49|5)\d* s after"),
    "20 ms early": (-0.02, "time", 0.0, [], r"0\.0(19|2)\d* s before"),
    "5 ms late, and a compliance": (0.005, "time", 0.0, ["base_compliance=5e-9"], "s after"),
    "a twentieth of a row late": (0.01, "row", 0.0, [], r"0\.0(49|5)\d* rows after"),
    "play of all joints": (0.0, "time", 3e-4, [], ""),
    "a compliance": (0.0, "time", 0.0, ["base_compliance=5e-8"], ""),
    "nothing": (0.0, "time", 0.0, [], ""),
    "late, but in no order": (0.005, "", 0.0, [], ""),
}


def path(time: Array) -> Array:
    """Joint values, rad, at the times of a smooth path, s."""
    return np.asarray(0.1 + 0.45 * np.sin(np.sqrt(np.arange(2.0, 8.0)) * 0.3 * time[:, None] + np.arange(6)))


@pytest.mark.first(2)
@pytest.mark.parametrize("case", some(CASES, "5 ms late", "a twentieth of a row late", "play of all joints"))
def test_a_delay_between_joint_values_and_positions_is_named(case: str) -> None:
    late, clock, play, effects, said = CASES[case]
    arm, time, rng = robot(1)[0], STEP * np.arange(120), np.random.default_rng(1)
    driven = path(time + late) + play * np.sign(path(time + 1e-3) - path(time))
    made = simulate(arm, driven, effects, rng, noise=3e-5, geometry_sigma=3e-4).dataset
    data = replace(made, q=path(time), in_order=clock == "row")
    if clock == "time":
        data = replace(data, extras={"time": time}, extra_units={"time": "s"})
    told = measured_late(arm, data, geometric_effects(arm))
    assert bool(told) == bool(said)
    assert re.search(said, told or "")


def test_a_table_with_a_delay_is_refused_with_its_size() -> None:
    arm, time, rng = robot(1)[0], STEP * np.arange(120), np.random.default_rng(1)
    made = simulate(arm, path(time + 0.005), [], rng, noise=3e-5, geometry_sigma=3e-4).dataset
    data = replace(made, q=path(time), extras={"time": time}, extra_units={"time": "s"})
    assert "s after the joint values of a moving robot" in " ".join(check(arm, data).summary().split())
    with pytest.raises(gp.InputError, match="joint values of a moving robot"):
        gp.calibrate(arm, data)


@pytest.mark.long
def test_a_moving_robot_whose_positions_are_late_is_no_other_machine() -> None:
    (model, made), time, rng = fitted_robot(), STEP * np.arange(40), np.random.default_rng(2)
    later = read_later(made, path(time + 0.01), placed_anew(made, rng), rng)
    data = replace(later, q=path(time), extras={"time": time}, extra_units={"time": "s"})
    with pytest.raises(gp.InputError, match=r"0\.0(099|1)\d* s after the joint values of a moving robot"):
        model.verify(data)
