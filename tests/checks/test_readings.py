"""Test that the correct interpretation of a misread table is named and nothing is fitted."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from instances import some

from gpmodel.checks.mixed_up import mixed_up
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics.se3 import exp
from gpmodel.planning.simulate import Simulation
from gpmodel.table.dataset import Dataset


def with_joints(made: Simulation, q: np.ndarray) -> Dataset:
    return replace(made.dataset, q=q)


def coupled(made: Simulation) -> Dataset:
    """The pendant of a parallel bar shows J3 less J2."""
    q = made.dataset.q.copy()
    q[:, 2] -= q[:, 1]
    return with_joints(made, q)


def far_apart_swapped(made: Simulation) -> Dataset:
    return with_joints(made, made.dataset.q[:, [0, 3, 2, 1, 4, 5]])


def one_lost(made: Simulation) -> Dataset:
    """From row 31 on each position stands beside the joint values of the next pose."""
    keep = np.delete(np.arange(60), 30)
    return replace(made.dataset.subset(keep), q=np.delete(made.dataset.q, 59, axis=0), row=np.arange(1, 60))


def two_stands(made: Simulation) -> Dataset:
    moved = exp(np.array([0.1, 0.3, 0.0, 0.0, 0.0, 0.4]))
    second = made.dataset.position @ moved[:3, :3].T + moved[:3, 3]
    return replace(made.dataset, position=np.where(np.arange(60)[:, None] < 35, made.dataset.position, second))


def columns(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Simulation], Dataset]:
    """Joint values that are written otherwise."""
    return lambda made: with_joints(made, change(made.dataset.q))


def late(q: np.ndarray) -> np.ndarray:
    return np.column_stack([q[:, :3], np.roll(q[:, 3], 1), q[:, 4:]])


def flip(q: np.ndarray) -> np.ndarray:
    return q * turned(1) * turned(4) * turned(6)


def zeros(joint: int) -> np.ndarray:
    """A quarter turn of one joint."""
    return np.pi / 2 * np.eye(6)[joint - 1]


def turned(joint: int) -> np.ndarray:
    return 1 - 2 * np.eye(6)[joint - 1]


LOOKS = "column 'joint_{0}' should probably be {1}"
CASES: dict[str, tuple[Callable[[Simulation], Dataset], str]] = {
    "coupled": (coupled, "column 'joint_3' should probably be 'joint_3' + 'joint_2'"),
    "J2 and J4": (far_apart_swapped, "columns 'joint_2' and 'joint_4' look swapped"),
    "one reading lost": (one_lost, "on every position probably belongs to the pose"),
    "KUKA's signs": (columns(flip), "columns 'joint_1', 'joint_4' and 'joint_6' probably have the opposite sign"),
    "reverse order": (columns(lambda q: q[:, ::-1]), "the joint columns look in reverse order"),
    "three exchanged": (
        columns(lambda q: q[:, [0, 2, 3, 1, 4, 5]]),
        "look to hold, in this order, 'joint_1', 'joint_3', 'joint_4', 'joint_2', 'joint_5' and 'joint_6'",
    ),
    "a zero": (
        columns(lambda q: q - zeros(2)),
        LOOKS.format(2, "'joint_2' + 90 deg: the description has another joint zero"),
    ),
    "a zero and a sign": (columns(lambda q: q * turned(2) - zeros(2)), "should probably be -'joint_2' - 90 deg"),
    "coupled from another zero": (
        columns(lambda q: q - zeros(2) + np.outer(q[:, 1] - np.pi / 2, np.eye(6)[2])),
        LOOKS.format(2, "'joint_2' + 90 deg"),
    ),
    "KUKA's signs and zeros": (
        columns(lambda q: flip(q) - zeros(2) + zeros(3)),
        "or equally well columns 'joint_1', 'joint_4' and 'joint_6' probably have the opposite sign and column "
        "'joint_2' should probably be 'joint_2' + 90 deg and column 'joint_3' should probably be 'joint_3' - 90 deg",
    ),
    "coupled before a zero": (
        columns(lambda q: q - zeros(2) + np.outer(q[:, 1], np.eye(6)[2])),
        LOOKS.format(3, "'joint_3' - 'joint_2' - 90 deg"),
    ),
    "a late column": (columns(late), "column 'joint_4' is probably a row late"),
    "two stands": (two_stands, "two set-ups or tools in one table: 25 rows"),
}


LIKE_OTHERS = {
    "reverse order",
    "three exchanged",
    "a zero",
    "a zero and a sign",
    "coupled from another zero",
    "coupled before a zero",
    "one reading lost",
    "a late column",
    "two stands",
}


@pytest.mark.parametrize("case", some(CASES, *(c for c in CASES if c not in LIKE_OTHERS)))
def test_the_right_reading_is_named(case: str) -> None:
    make, said = CASES[case]
    mechanism, made = robot(60, name="ur5")
    names = {joint.name: f"joint_{i}" for i, joint in enumerate(mechanism.joints, 1)}
    text = mixed_up(mechanism, make(made)) or ""
    for name, short in names.items():
        text = text.replace(f"'{name}'", f"'{short}'")
    assert said in text


class InMillimetres:
    """A mechanism whose lengths were written in mm where m are meant."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __getattr__(self, name: str) -> object:
        return getattr(self.mechanism, name)

    def transforms(self, q: np.ndarray) -> np.ndarray:
        out = self.mechanism.transforms(q).copy()
        out[..., :3, 3] *= 1e3
        return out


def test_lengths_of_the_description_in_another_unit_are_not_blamed_on_the_table() -> None:
    mechanism, made = robot(60, name="ur5")
    assert "the lengths of ur5 look 1000 times too large" in (mixed_up(InMillimetres(mechanism), made.dataset) or "")  # type: ignore[arg-type]
