"""Torques that were measured take the place of computed ones."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from effect_cases import bare, mechanism

from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.measured_torque import unused_torques
from gpmodel.model.states import states_of
from gpmodel.table.dataset import Dataset

ARM, UR5 = mechanism("irb6400r"), mechanism("ur5")
MEASURED = np.random.default_rng(0).normal(size=12)


def told(name: str, column: str, unit: str, values: np.ndarray = MEASURED) -> Dataset:
    return replace(bare(name, 12, payload=False), extras={column: values}, extra_units={column: unit})


@pytest.mark.parametrize(
    ("column", "unit", "scale"),
    [
        ("torque_J2", "N*m", 1.0), ("tau_2", "Nm", 1.0), ("effort_J2", "kN*m", 1e3), ("trq_j2", "N*mm", 1e-3),
        ("Torque_J2_measured", "N*m", 1.0), ("measured_torque_2", "N*m", 1.0),
    ],
)  # fmt: skip
def test_a_measured_torque_is_the_load_of_its_joint(column: str, unit: str, scale: float) -> None:
    data = told("irb6400r", column, unit)
    states, computed = states_of(ARM, data), states_of(ARM, replace(data, extras={}, extra_units={}))
    np.testing.assert_allclose(states["torque_J2"], scale * MEASURED)
    assert states.units["torque_J2"] == "Nm"
    np.testing.assert_array_equal(states["torque_J3"], computed["torque_J3"])
    assert column == "torque_J2" or column not in states.columns
    assert list(unused_torques(ARM, data)) == []


def test_joints_are_found_by_number_or_by_name() -> None:
    for column in ("torque_J2", "torque_shoulder_lift_joint", "tau_2"):
        states = states_of(UR5, told("ur5", column, "N*m"))
        np.testing.assert_allclose(states["torque_shoulder_lift_joint"], MEASURED)


def test_a_constant_torque_is_left_alone_with_one_line() -> None:
    data = told("irb6400r", "torque_J2", "N*m", np.full(12, 40.0))
    computed = states_of(ARM, replace(data, extras={}, extra_units={}))
    np.testing.assert_array_equal(states_of(ARM, data)["torque_J2"], computed["torque_J2"])
    (line,) = unused_torques(ARM, data)
    assert line == (
        "table: column 'torque_J2' is 40 in every row and is not used as the torque of J2; "
        "expected what the joint bears at each pose"
    )


@pytest.mark.parametrize(("column", "unit"), [("torque_J9", "N*m"), ("torquemada_J2", "N*m"), ("tau_2", "A")])
def test_other_columns_stay_what_they_are(column: str, unit: str) -> None:
    states = states_of(ARM, told("irb6400r", column, unit))
    np.testing.assert_array_equal(states[column], MEASURED)
    assert np.abs(states["torque_J2"]).max() > 100.0


def test_of_one_pose_what_was_measured_is_the_load() -> None:
    data = told("irb6400r", "torque_J2", "N*m")
    for row in range(3):
        one = data.subset(np.array([row]))
        np.testing.assert_allclose(states_of(ARM, one)["torque_J2"], MEASURED[row])


class Massless:
    """An arm of which no masses are known."""

    def __getattr__(self, name: str) -> Any:
        return getattr(ARM, name)

    def loads(self, q: np.ndarray, payload: np.ndarray) -> dict[str, np.ndarray]:
        return {}


def test_where_no_masses_are_known_a_constant_torque_is_still_the_load() -> None:
    """Inputs of a fitted model must be known at any predicted pose."""
    data = told("irb6400r", "torque_J2", "N*m", np.full(12, 40.0))
    np.testing.assert_array_equal(states_of(cast(Mechanism, Massless()), data)["torque_J2"], 40.0)
