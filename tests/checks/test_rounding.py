"""Test what `check` and `verify` state of rounded tables, whole degrees, joints at rest, and ordered poses."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from effect_cases import mechanism
from instances import some
from verify_cases import fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.api.check import check
from gpmodel.arrays import Array
from gpmodel.checks.rounding import last_digits
from gpmodel.mechanism.branches import random_poses
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import Dataset

SPRING = ["J2.moving:Rz:sin(J2)**3=1 mrad"]
CASES = {
    "angles of 0.1 deg": ("ur5", np.radians(0.1), 0.0, [], True),
    "angles of 0.001 rad": ("ur5", 1e-3, 0.0, [], True),
    "positions of 1 mm": ("ur5", 0.0, 1e-3, [], True),
    "travels of 1 mm": ("gantry", 1e-3, 0.0, [], True),
    "commanded angles of 10 deg": ("irb6400r", np.radians(10.0), 0.0, [], False),
    "commanded angles of 1 deg, and a spring": ("irb6400r", np.radians(1.0), 0.0, SPRING, False),
    "commanded angles of 0.1 deg, and a spring": ("irb6400r", np.radians(0.1), 0.0, SPRING, False),
    "commanded travels of 10 mm": ("gantry", 1e-2, 0.0, [], False),
}


def to_digits(values: Array, step: float) -> Array:
    return step * np.round(values / step) if step else values


@pytest.mark.parametrize(
    "case", some(CASES, "angles of 0.1 deg", "travels of 1 mm", "commanded angles of 1 deg, and a spring")
)
def test_rounding_is_the_cause_of_a_residual_of_its_size_alone(case: str) -> None:
    name, turn, step, effects, lost = CASES[case]
    arm, rng = mechanism(name), np.random.default_rng(3)
    q = random_poses(arm, 80, rng) if name != "gantry" else rng.uniform(0.0, [3.0, 2.0, 1.0], (80, 3))
    made = simulate(arm, q if lost else to_digits(q, turn), effects, rng, noise=3e-5, geometry_sigma=3e-4).dataset
    data = replace(made, q=to_digits(made.q, turn), position=to_digits(made.position, step))
    assert last_digits(data)[1].max() == pytest.approx(turn)
    said = check(arm, data).summary()
    assert ("rounding" in said) is lost


@pytest.mark.parametrize("lost", [True, False])
def test_discover_and_calibrate_repeat_the_warning_of_rounding(lost: bool) -> None:
    arm, made = robot(60, 3, "ur5")
    data = replace(made.dataset, q=to_digits(made.dataset.q, np.radians(0.1))) if lost else made.dataset
    [warning] = [f.text for f in check(arm, data).findings if "rounding explains" in f.text] or [""]
    found = gp.discover(arm, data, search=gp.Search(runs=0), candidates=(), folds=2)
    for record in (found.record, gp.calibrate(arm, data).record):
        assert bool(warning) is lost is ("rounding explains the residual: joint values are rounded" in record.verdict)
    assert warning in found.record.verdict


LATER: dict[str, tuple[float, bool, float, str | None]] = {
    "rounded to 0.1 deg": (0.1, True, 0.0, None),
    "commanded whole degrees": (1.0, False, 0.0, "holds"),
    "commanded whole degrees, and a zero that moved": (1.0, False, 3e-4, "drifted"),
}


@pytest.mark.parametrize("case", some(LATER, "rounded to 0.1 deg", "commanded whole degrees, and a zero that moved"))
def test_rounded_joint_values_are_no_other_machine(case: str) -> None:
    step, lost, moved, expected = LATER[case]
    (model, made), rng = fitted_robot(), np.random.default_rng(4)
    given = random_poses(made.model.mechanism, 30, rng)
    short = to_digits(given, np.radians(step))
    later = read_later(made, given if lost else short, placed_anew(made, rng), rng, joint=1, moved=moved)
    if expected is None:
        with pytest.raises(gp.InputError, match="rounding explains the residual: joint values are rounded to"):
            model.verify(replace(later, q=short))
    else:
        assert model.verify(replace(later, q=short)).record.verdict == expected


def swept(count: int = 60) -> tuple[gp.Mechanism, Dataset]:
    """Poses in which the shoulder alone moves, in one direction, of an arm whose shoulder yields."""
    arm, _ = robot(1, name="ur5")
    q = np.tile([0.3, 0.0, 0.4, 0.5, 0.9, 0.2], (count, 1))
    q[:, 1] = np.linspace(-1.1, 1.4, count)
    effects = ["joint_compliance shoulder_lift_joint=1e-5"]
    return arm, simulate(arm, q, effects, np.random.default_rng(0), noise=3e-5).dataset


def test_a_joint_at_rest_has_no_wrong_column_and_a_sweep_is_no_drift() -> None:
    said = " ".join(check(*swept()).summary().split())
    assert "should probably be" not in said
    assert "elbow_joint does not move" in said
    assert "or an effect of shoulder_lift_joint, whose values change along the rows" in said
