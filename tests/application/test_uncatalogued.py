"""Test that `verify` names breaks in the curve of a joint, and scale errors of measured coordinates."""

import re
from dataclasses import replace

import numpy as np
import pytest
from instances import some
from verify_cases import NOISE, Fitted, fitted_robot, placed_anew, read_later

from gpmodel.arrays import Array
from gpmodel.families.session import arm_growth
from gpmodel.formula.expression import ONE
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.table.dataset import Dataset, unmeasured

PLACE = re.compile(r"(step|kink) of (J\d) between (\S+) and (\S+) deg, (above|below) it")


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    return fitted_robot()


def later(
    fitted: Fitted, seed: int, joint: int = 0, off: float = 0.0, slope: float = 0.0, place: float = 0.0
) -> Dataset:
    """Thirty poses; beyond `place` the joint is off by `off`, rad, and by `slope` times the angle beyond."""
    made, rng = fitted[1], np.random.default_rng(seed)
    q, placement = random_poses(made.model.mechanism, 30, rng), placed_anew(made, rng)
    beyond = q[:, joint] - place
    at = q + np.where(beyond > 0, off + slope * beyond, 0.0)[:, None] * np.eye(q.shape[1])[joint]
    return replace(read_later(made, at, placement, rng), q=q)


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", some([1, 2], 1))
@pytest.mark.parametrize(
    ("joint", "kind", "size"),
    some(
        [(1, "step", 4e-4), (2, "step", 3e-4), (2, "kink", 5e-4), (3, "kink", 1e-3)],
        (1, "step", 4e-4),
        (2, "kink", 5e-4),
    ),
)
def test_a_break_in_the_curve_of_a_joint_is_one_change_with_its_place(
    fitted: Fitted, seed: int, joint: int, kind: str, size: float
) -> None:
    place = float(np.median(later(fitted, seed).q[:, joint])) + 0.01
    off, slope = (size, 0.0) if kind == "step" else (0.0, size)
    found = fitted[0].verify(later(fitted, seed, joint, off, slope, place)).record
    (change,) = found.changes
    places = [match.groups() for name in (change.name, *change.rivals) if (match := PLACE.match(name))]
    assert all(own == f"J{joint + 1}" for _, own, *_ in places)
    assert any(float(low) - 15.0 <= np.degrees(place) <= float(high) + 15.0 for _, _, low, high, _ in places)
    assert PLACE.match(change.name)[1] == kind
    assert abs(change.value - size) < 4.0 * change.stderr
    assert found.explained


@pytest.mark.first(1)
@pytest.mark.parametrize("axes", some(["x", "y", "z", "xyz"], "z", "xyz"))
def test_a_scale_of_measured_coordinates_is_an_error_of_the_instrument(fitted: Fitted, axes: str) -> None:
    data = later(fitted, 4)
    scales: Array = 1.0 + 1e-3 * np.array([axis in axes for axis in "xyz"])
    found = fitted[0].verify(replace(data, position=data.position * scales))
    (change,) = found.record.changes
    assert change.name == f"scale of the measured {axes if len(axes) == 1 else 'coordinates'}"
    assert abs(change.value - 1e-3) < 4.0 * change.stderr
    assert found.holds
    assert "Set-up or instrument changed, not the machine" in found.verdict


@pytest.mark.long
def test_growth_of_the_machine_is_no_scale_of_the_instrument(fitted: Fitted) -> None:
    """Growth moves the flange and not the tool point within it."""
    made, rng = fitted[1], np.random.default_rng(5)
    arm, placement = made.model.mechanism, placed_anew(made, rng)
    (grown,) = arm_growth("growth", arm, ONE, "1", "thermal_growth")
    data = unmeasured([j.name for j in arm.joints], random_poses(arm, 30, rng))
    truth, theta = ErrorModel(arm, (*made.model.effects, grown)), np.append(made.theta, 5e-4)
    tip = observe(truth, prepare(arm, data), theta, placement).tip[:, :3, 3]
    found = fitted[0].verify(replace(data, position=tip + rng.normal(0.0, NOISE, tip.shape), source="later.csv"))
    (change,) = found.record.changes
    assert change.name == "scale of the machine"
    assert abs(change.value - 5e-4) < 4.0 * change.stderr
    assert not found.holds
