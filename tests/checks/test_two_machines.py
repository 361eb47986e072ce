"""Test that a table of two machines, one after the other, is refused, and that of one changing machine is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from instances import some

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.numerics import se3
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import Dataset

COUNT, AT = 90, 50
BENT = "joint_compliance shoulder_lift_joint=1e-6"


def measured(
    q: Array, *effects: str, machine: int = 0, tool: float = 0.1, name: str = "ur5", payload: Array | None = None
) -> Dataset:
    """Return a table of one machine: its geometry depends on its number alone."""
    arm, rng = MechanismChoice(name).load(), np.random.default_rng(machine)
    point = np.array([0.05, 0.08, tool])
    made = simulate(arm, q, effects, rng, noise=3e-5, geometry_sigma=3e-4, tool_point=point, payload=payload)
    return made.dataset


def then(first: Dataset, second: Dataset) -> Dataset:
    """Return the first table with the positions of the second from row AT + 1 on."""
    return replace(first, position=np.vstack([first.position[:AT], second.position[AT:]]))


def other_machine(q: Array, name: str = "ur5") -> Dataset:
    one, two = measured(q, name=name), measured(q, machine=1, name=name)
    turn, shift = se3.fit_rotation(two.position, one.position)
    return then(one, replace(two, position=two.position @ turn.T + shift))


def moved_instrument(q: Array) -> Dataset:
    one = measured(q, BENT)
    return then(one, replace(one, position=one.position @ se3.exp(np.full(6, 5e-4))[:3, :3].T + 1e-3))


STEP = f"step(row - {AT})"
ONE_MACHINE: dict[str, Callable[[Array], Dataset]] = {
    "unchanged": lambda q: measured(q, BENT),
    "another tool": lambda q: then(measured(q, BENT), measured(q, BENT, tool=0.103)),
    "a moved instrument": moved_instrument,
    "a joint zero": lambda q: measured(q, BENT, f"wrist_1_joint.moving:Rz:{STEP}=1 mrad"),
    "a payload with its column": lambda q: measured(q, BENT, payload=np.where(np.arange(COUNT) < AT, 0.0, 5.0)),
    "warming": lambda q: measured(
        q, BENT, "elbow_joint.moving:Tx:exp(-row/20)=0.5 mm", "shoulder_lift_joint.moving:Rz:exp(-row/20)=1 mrad"
    ),
    "drift": lambda q: measured(q, BENT, "base:Tx:row=3 um", "base:Ry:row=3 urad"),
    "rows in order of a joint": lambda q: measured(q[np.argsort(q[:, 1])], BENT, "gear_harmonic elbow_joint=60 arcsec"),
}


def poses(name: str = "ur5") -> Array:
    return random_poses(MechanismChoice(name).load(), COUNT, np.random.default_rng(7))


@pytest.mark.parametrize("name", some({"ur5": 0, "ur10": 0, "irb6400r": 0}, "ur5"))
def test_two_machines_in_one_table_are_refused_with_the_row(name: str) -> None:
    both = other_machine(poses(name), name)
    said = f"from row {AT + 1} on, the table is of another machine or state"
    for refused in (gp.calibrate, gp.discover):
        with pytest.raises(gp.InputError, match=said):
            refused(name, both)
    assert said in gp.check(name, both).findings[0].text
    assert gp.calibrate(name, both.subset(np.arange(AT))).record.ladder[-1].train.rms_mm < 0.1


@pytest.mark.parametrize("case", some(ONE_MACHINE, "unchanged", "a moved instrument", "a payload with its column"))
def test_a_machine_that_changes_is_no_other_machine(case: str) -> None:
    assert gp.check("ur5", ONE_MACHINE[case](poses())).valid
