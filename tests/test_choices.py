"""Test that an unknown name is answered with the most similar names in one short line."""

import doctest

import pytest

import gpmodel as gp
from gpmodel import errors
from gpmodel.errors import choices


def test_few_are_all_listed_and_of_many_the_nearest() -> None:
    assert doctest.testmod(errors).failed == 0
    assert choices("x", []) == "none"
    many = [f"joint_{k}" for k in range(40)]
    assert choices("JOINT_31", many).startswith("joint_31, ")
    assert choices("", many).endswith(" and 37 others")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (lambda arm, table: gp.load_mechanism("irb6400"), "irb6400r"),
        (lambda arm, table: gp.calibrate(arm, table, effects=["joint_complience J5"]), "joint_compliance"),
        (lambda arm, table: gp.calibrate(arm, table, effects=["J5.movin:Rz:1"]), "J5.moving"),
        (lambda arm, table: gp.calibrate(arm, table, effects=["J5.moving:Rz:torqe_J2"]), "torque_J2"),
        (lambda arm, table: gp.calibrate(arm, table, effects=["joint_compliance J9"]), "joint compliance, J"),
        (lambda arm, table: gp.Expression("sine(J1)"), "sin"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_answered_shortly_with_what_was_meant(asked: object, said: str) -> None:
    arm = gp.load_mechanism("irb6400r")
    table = gp.simulate(arm, [], poses=30, seed=0).table
    with pytest.raises(gp.InputError) as caught:
        asked(arm, table)  # type: ignore[operator]
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300
