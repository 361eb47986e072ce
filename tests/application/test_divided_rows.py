"""Test that `verify` divides rows between two values of a constant, and judges the machine with the division."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from instances import some
from verify_cases import NOISE, Fitted, placed_anew, read_later

import gpmodel as gp
from gpmodel.application.divided_rows import _price
from gpmodel.application.possible_changes import PossibleChange
from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.wording import ranges
from gpmodel.wording import some as listed

CONSTANTS = {"tool": "tool point", "zero": "zero of J3", "mass": "mass at the tool", "set-up": "set-up"}
"""Name of each constant that has two values."""
UNCLEAR = {"mass": 2}
"""Number of rows at which both values of a constant predict nearly the same point."""
TOOL, SHIFT = (0.6, 0.0, 0.8), (0.36, 0.48, -0.8)
"""Directions of the displacements of the tool and of the set-up."""


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    """A robot that yields at J2, so that its poses depend on the load, with its model."""
    arm, made = robot(60, seed=3, noise=NOISE, effects=("joint compliance, J2=3e-7",), geometry_sigma=3e-4)
    return gp.calibrate(arm, made.dataset, ["joint compliance, J2"], holdout=0.0).model, made


def points(fitted: Fitted, q: Array, placement: Placement, constant: str, size: float) -> Array:
    """True points (N, 3) of the robot with another value of a constant."""
    made, moved = fitted[1], np.eye(4)
    if constant == "mass":
        arm = gp.load_mechanism("irb6400r", payload_com=made.placement.tool[""][:3, 3].tolist())
        poses = prepare(arm, unmeasured([j.name for j in arm.joints], q, np.full(len(q), size)))
        truth = ErrorModel(arm, made.model.effects)
        return np.asarray(observe(truth, poses, made.theta, placement).tip[:, :3, 3])
    if constant == "tool":
        moved[:3, 3] = size * np.array(TOOL)
        placement = replace(placement, tool={"": placement.tool[""] @ moved})
    if constant == "set-up":
        motion = se3.exp(size * np.array([*SHIFT, 0.1, 0.2, -0.2]))
        placement = replace(placement, registration={"": placement.registration[""] @ motion})
    angle = size if constant == "zero" else 0.0
    return read_later(made, q, placement, np.random.default_rng(0), 2, angle, noise=0.0).position


def later(fitted: Fitted, second: Mask, constant: str, size: float, zero: float = 0.0) -> Dataset:
    """Poses of which the rows `second` have another value of a constant; the zero of J4 moved in all rows, rad."""
    made, rng = fitted[1], np.random.default_rng([len(second), 6])
    placement, q = placed_anew(made, rng), random_poses(made.model.mechanism, len(second), rng)
    at = q + zero * np.eye(q.shape[1])[3]
    one, other = (points(fitted, at, placement, *value) for value in (("", 0.0), (constant, size)))
    noise = rng.normal(0.0, NOISE, one.shape)
    data = unmeasured([j.name for j in made.model.mechanism.joints], q)
    return replace(data, position=np.where(second[:, None], other, one) + noise, source="later.csv")


def mixed(count: int, share: float) -> Mask:
    return np.asarray(np.random.default_rng(1).permutation(count) < share * count)


def named(constant: str, rows: tuple[int, ...]) -> str:
    return f"{CONSTANTS[constant]} in {len(rows)} rows ({listed(ranges(rows))})"


QUICK = [
    (mixed(30, 0.5), "tool", 3e-4, 0.0),
    (mixed(30, 0.4), "zero", 4e-4, 1e-3),
]
LONG = [
    (mixed(30, 0.5), "zero", 3e-4, 0.0),
    (mixed(30, 0.4), "mass", 100.0, 0.0),
    (mixed(30, 0.4), "set-up", 1e-3, 0.0),
    (mixed(30, 0.5), "tool", 2.5e-3, 0.0),
    (mixed(12, 0.5), "tool", 2.5e-3, 0.0),
    (mixed(60, 0.2), "tool", 1e-3, 0.0),
    (mixed(30, 0.5), "tool", 2.5e-3, 1e-3),
    (mixed(16, 0.2), "zero", 5e-4, 0.0),
    (mixed(60, 0.4), "zero", 2e-4, 0.0),
]


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("second", "constant", "size", "zero"), [*QUICK, *(pytest.param(*one, marks=pytest.mark.long) for one in LONG)]
)
def test_rows_with_two_values_of_a_constant_are_divided(
    fitted: Fitted, second: Mask, constant: str, size: float, zero: float
) -> None:
    found = fitted[0].verify(later(fitted, second, constant, size, zero))
    own, *others = sorted(found.record.changes, key=lambda change: not change.rows)
    assert own.name == named(constant, own.rows)
    assert len({*own.rows} ^ {*(np.flatnonzero(second) + 1)}) <= UNCLEAR.get(constant, 0)
    assert [change.name for change in others] == (["zero of J4"] if zero else [])
    assert constant == "set-up" or abs(own.value - size) < 4 * own.stderr
    assert found.holds == (constant == "set-up")
    assert ("not the machine: " in found.verdict) == (constant != "zero" and not zero)
    assert "The other rows do not have this change." in found.verdict
    assert "explain" in found.verdict or found.holds


@pytest.mark.parametrize(
    ("first", "count", "constant", "size", "names"),
    some(
        [
            (15, 30, "tool", 2.5e-3, {"tool slipped after row 15"}),
            (10, 12, "tool", 2.5e-3, {"tool point after row 10"}),
            (48, 60, "tool", 1e-3, {"tool point after row 48", "tool slipped after row 48"}),
            (12, 30, "zero", 4e-4, {"zero slipped after row 12, J3"}),
            (17, 30, "mass", 100.0, {"mass at the tool after row 17"}),
            (17, 30, "set-up", 1e-3, {"set-up after row 17", "set-up up to row 17"}),
        ],
        (10, 12, "tool", 2.5e-3, {"tool point after row 10"}),
        (17, 30, "set-up", 1e-3, {"set-up after row 17", "set-up up to row 17"}),
    ),
)
def test_a_value_that_follows_another_is_named_by_the_last_row_before_it(
    fitted: Fitted, first: int, count: int, constant: str, size: float, names: set[str]
) -> None:
    found = fitted[0].verify(later(fitted, np.arange(count) >= first, constant, size))
    (change,) = found.record.changes
    assert change.name in names
    assert constant == "set-up" or abs(change.value - size) < 4 * change.stderr
    assert found.holds == (constant == "set-up")


def test_two_zeros_of_the_first_joint_are_no_motion_of_the_set_up(fitted: Fitted) -> None:
    """The registration absorbs one zero of J1, and six parameters of the set-up explain two zeros as well."""
    made, rng, second = fitted[1], np.random.default_rng(3), mixed(30, 0.4)
    placement, q = placed_anew(made, rng), random_poses(made.model.mechanism, 30, rng)
    one, other = (read_later(made, q, placement, np.random.default_rng(4), 0, angle) for angle in (0.0, 4e-4))
    found = fitted[0].verify(replace(one, position=np.where(second[:, None], other.position, one.position)))
    (change,) = found.record.changes
    assert change.name.startswith("zero of J1 in 12 rows")
    assert not found.holds


def test_a_check_of_divided_rows_hands_out_no_repaired_model(fitted: Fitted) -> None:
    made, rng, second = fitted[1], np.random.default_rng(6), mixed(12, 0.4)
    q, placement = made.dataset.q[:12], placed_anew(made, rng)
    one, other = (read_later(made, q, placement, np.random.default_rng(7), 1, angle) for angle in (0.0, 6e-4))
    found = gp.verify_next(fitted[0], replace(one, position=np.where(second[:, None], other.position, one.position)))
    assert found.decided
    assert found.repaired is None
    assert "the rows were measured with two values of a constant" in found.summary()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_errors_of_one_tool_are_not_divided(fitted: Fitted, seed: int) -> None:
    """A drifting instrument, heavy tails, gross errors of a tenth of the rows, and twice the noise."""
    rng = np.random.default_rng(seed)
    data = later(fitted, np.zeros(20 + seed, dtype=bool), "tool", 0.0)
    shape = data.position.shape
    drift, tails = np.cumsum(rng.normal(0.0, 5e-5, shape), axis=0), 2 * NOISE * rng.standard_t(2, shape)
    gross = rng.normal(0.0, 2e-3, shape) * (rng.permutation(shape[0]) < 2)[:, None]
    for error in (drift, tails, gross, rng.normal(0.0, 1.7 * NOISE, shape)):
        found = fitted[0].verify(replace(data, position=data.position + error)).record
        assert not any(change.rows and change.kind != "set-up" for change in found.changes)


def block(count: int, *of: tuple[int, int]) -> Mask:
    """Rows first to last, both included, of one table."""
    return np.asarray([any(first <= row <= last for first, last in of) for row in range(1, count + 1)])


BLOCKS = block(60, (11, 25), (41, 52))
"""Two blocks of rows, of a zero that moved by about the noise: the rows alone do not show their value."""
MANY = [
    (mixed(300, 0.5), "zero", 4e-4, "zero of J3 in 150 rows"),
    (mixed(1100, 0.3), "zero", 4e-4, "zero of J3 in 330 rows"),
    (block(1100, (386, 715)), "zero", 6e-5, "zero of J3 in 330 rows (386 to 715)"),
]


@pytest.mark.parametrize(
    ("second", "constant", "size", "name"),
    [(BLOCKS, "zero", 1e-4, "zero of J3 in 27 rows (11 to 25, 41 to 52)"),
     *(pytest.param(*one, marks=pytest.mark.long) for one in MANY)],
)  # fmt: skip
def test_the_division_of_a_long_table_has_the_price_of_its_shorter_description(
    fitted: Fitted, second: Mask, constant: str, size: float, name: str
) -> None:
    (change,) = fitted[0].verify(later(fitted, second, constant, size)).record.changes
    assert change.name.startswith(name)
    assert change.rows == tuple(np.flatnonzero(second) + 1)
    assert abs(change.value - size) < 4 * change.stderr


@pytest.mark.long
@pytest.mark.parametrize(("count", "seed"), [*((30, seed) for seed in range(14)), (300, 1), (300, 2), (1100, 3)])
def test_the_rows_of_an_unchanged_machine_are_not_divided(fitted: Fitted, count: int, seed: int) -> None:
    made, rng = fitted[1], np.random.default_rng([count, seed])
    q = random_poses(made.model.mechanism, count, rng)
    found = fitted[0].verify(read_later(made, q, placed_anew(made, rng), rng))
    assert found.holds
    assert not found.record.changes


def test_descriptions_of_all_divisions_are_together_no_more_than_certain() -> None:
    """Kraft's inequality. A division and its complement are one division."""
    every = np.array([[row >> k & 1 for k in range(10)] for row in range(1, 512)], dtype=bool)
    assert 0.5 < np.exp(-_price(every)).sum() <= 1.0


def test_a_division_of_many_rows_has_a_finite_price() -> None:
    change = PossibleChange("zero of J3", "zero", "rad", np.ones((6, 1)), share=0.1, division=2000 * np.log(2.0))
    assert change.log_share == pytest.approx(np.log(0.1) - 2000 * np.log(2.0))
    assert change.corrected(-np.inf) == 0.0
    assert change.corrected(-600.0) > 1.0 > change.corrected(-1400.0)
