"""Test that `check` passes machines with large unmodelled effects, and refuses wrong columns of the same size.

A wrong factor of a column is exact. An effect of a machine is another smooth function of a joint.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from cli_cases import robot
from effect_cases import mechanism
from instances import some

from gpmodel.api.check import check
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import Dataset

ROBOTS = ("irb6400r", "ur10", "panda", "ur5", "ur3")
EFFECTS = {
    "a spring between two links, 5 mrad": "sin({q})*(1 - 0.8/sqrt(1.04 + 0.4*cos({q})))=5 mrad",
    "a quadratic spring, 5 mrad": "sin({q})*abs(sin({q}))=5 mrad",
    "a cubic spring, 5 mrad": "sin({q})**3=5 mrad",
    "an eccentric gear, 3 mrad": "cos({q})=3 mrad",
    "an oval gear, 1.5 mrad": "sin(2*{q})=1.5 mrad",
}


@pytest.mark.parametrize(
    ("arm", "case"),
    some(product(ROBOTS, EFFECTS), ("irb6400r", "a cubic spring, 5 mrad"), ("ur10", "a quadratic spring, 5 mrad")),
)
def test_an_arm_with_a_large_effect_of_its_second_joint_is_fit(arm: str, case: str) -> None:
    joint = robot(2, name=arm)[0].joints[1]
    slot, axis, _ = joint.drive[0]
    mechanism, made = robot(80, 0, arm, effects=(f"{slot}:{axis}:{EFFECTS[case].format(q=joint.name)}",))
    assert check(mechanism, made.dataset).unfit == ()


@pytest.mark.parametrize("arm", some(ROBOTS, "ur5"))
def test_a_hot_arm_is_fit(arm: str) -> None:
    mechanism, made = robot(80, 0, arm)
    assert check(mechanism, replace(made.dataset, position=1.0015 * made.dataset.position)).unfit == ()


@pytest.mark.parametrize("size", some([1.0, 3.0], 3.0))
@pytest.mark.parametrize("axis", some(["Tx", "Ty", "Tz"], "Ty"))
def test_a_large_gantry_that_sags_is_fit(axis: str, size: float) -> None:
    arm, rng = mechanism("gantry"), np.random.default_rng(0)
    joint, travels = arm.joints[1], size * np.array([6.0, 3.0, 1.0])
    length = travels[1]
    sag = f"{joint.drive[0][0]}:{axis}:4*{joint.name}/{length}*(1 - {joint.name}/{length})=8 mm"
    made = simulate(arm, rng.uniform(0.0, travels, (80, 3)), [sag], rng, noise=3e-5, geometry_sigma=3e-4)
    assert check(arm, made.dataset).unfit == ()


def scaled_joint(k: int) -> Callable[[Dataset], Dataset]:
    return lambda data: replace(data, q=data.q * np.where(np.arange(data.q.shape[1]) == k, 0.99, 1.0))


WRONG = {
    "the second joint scaled": (scaled_joint(1), "columns with a wrong scale"),
    "the fourth joint scaled": (scaled_joint(3), "columns with a wrong scale"),
    "positions scaled": (lambda d: replace(d, position=1.01 * d.position), "columns with a wrong scale"),
    "z scaled": (lambda d: replace(d, position=[1.0, 1.0, 1.003] * d.position), "columns with a wrong scale"),
    "noise of 5 mm": (
        lambda d: replace(d, position=d.position + np.random.default_rng(3).normal(0.0, 5e-3, d.position.shape)),
        "the residual of the standard model is too large",
    ),
}


@pytest.mark.parametrize(
    ("arm", "case"), some(product(ROBOTS, WRONG), ("irb6400r", "the second joint scaled"), ("ur10", "noise of 5 mm"))
)
def test_a_wrong_column_is_refused_though_smooth_errors_of_the_joints_resemble_it(arm: str, case: str) -> None:
    change, said = WRONG[case]
    mechanism, made = robot(80, 0, arm)
    assert said in check(mechanism, change(made.dataset)).unfit


@pytest.mark.parametrize("arm", some(ROBOTS, "panda"))
def test_a_wrong_column_of_an_arm_with_a_spring_is_refused(arm: str) -> None:
    """The spring is another function of the joint than the factor: both are there."""
    joint = robot(2, name=arm)[0].joints[1]
    slot, axis, _ = joint.drive[0]
    mechanism, made = robot(80, 0, arm, effects=(f"{slot}:{axis}:sin({joint.name})**3=2 mrad",))
    assert "columns with a wrong scale" in check(mechanism, scaled_joint(3)(made.dataset)).unfit


def test_rows_of_three_linear_axes_in_another_order_are_refused() -> None:
    """With three linear axes, few signs of the columns are left to try."""
    arm, rng = mechanism("gantry"), np.random.default_rng(0)
    made = simulate(arm, rng.uniform(0.0, (6.0, 4.0, 2.0), (40, 3)), [], rng, noise=3e-5)
    judged = check(arm, replace(made.dataset, position=rng.permutation(made.dataset.position)))
    assert any("remain after registration and tool" in finding.text for finding in judged.findings)
