"""Inputs that a basis function may read, and no others."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, mechanism

from gpmodel.errors import InputError
from gpmodel.model.states import states_of
from gpmodel.numerics.se3 import chain


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_column_has_a_unit_and_a_value_a_pose(name: str) -> None:
    states = states_of(mechanism(name), bare(name, 11))
    assert set(states.columns) == set(states.units)
    assert len(states) == 11
    for column in states.columns.values():
        assert column.shape == (11,)
        assert np.isfinite(column).all()


@pytest.mark.parametrize("name", MECHANISMS)
def test_columns_are_joints_nominal_tip_loads_extras_and_row(name: str) -> None:
    arm, data = mechanism(name), bare(name, 11)
    states = states_of(arm, data)
    for i, joint in enumerate(arm.joints):
        np.testing.assert_array_equal(states[joint.name], data.q[:, i])
        assert states.units[joint.name] == ("rad" if joint.kind == "revolute" else "m")
    tip = chain(arm.transforms(data.q))[-1][:, :3, 3]
    np.testing.assert_allclose(np.column_stack([states[a] for a in "xyz"]), tip, atol=1e-14)
    for load, values in arm.loads(data.q, data.payload).items():
        np.testing.assert_array_equal(states[load], values)
        assert states.units[load] == ("N" if load.startswith("force") else "Nm")
    np.testing.assert_array_equal(states["row"], np.arange(1, 12))
    assert (states.units["temperature"], states.units["payload"]) == ("degC", "kg")


@pytest.mark.parametrize("name", MECHANISMS)
def test_what_the_payload_alone_exerts_is_the_difference_it_makes(name: str) -> None:
    arm, data = mechanism(name), bare(name, 11)
    states = states_of(arm, data)
    empty = states_of(arm, replace(data, payload=np.zeros(11))).columns
    for joint in arm.joints:
        load = f"torque_{joint.name}"
        np.testing.assert_allclose(states[load] - empty.get(load, 0.0), states[f"payload_{load}"], atol=1e-9)
        assert f"payload_{load}" not in empty
    assert max(np.ptp(states[f"payload_torque_{joint.name}"]) for joint in arm.joints) > 1.0


def test_a_derived_column_has_a_unit_as_a_listed_one_has() -> None:
    data = bare("irb6400r", 11)
    states = states_of(mechanism("irb6400r"), replace(data, position=data.q[:, :3].copy(), in_order=True))
    units = {"temperature": "degC", "lag_temperature_41p7": "degC", "last_move_J2": "1", "play_J2_0p01": "rad"}
    units |= {"instrument_azimuth": "rad", "torque_J2_of_J2_x": "m/s^2", "torque_J2_of_J4": "Nm"}
    assert {name: states.unit(name) for name in units} == units
    assert not set(states.columns) & {"play_J2_0p01", "lag_temperature_41p7", "instrument_azimuth"}
    with pytest.raises(InputError, match="'lag_colour_4' is not known here"):
        states.unit("lag_colour_4")


def test_an_unknown_input_names_what_there_is() -> None:
    with pytest.raises(InputError, match=r"'J9' is not known here; available: J6, J5, J4 and \d+ others"):
        states_of(mechanism("irb6400r"), bare("irb6400r", 11))["J9"]


@pytest.mark.parametrize("taken", ["J1", "x", "torque_J2", "row"])
def test_a_column_that_hides_a_built_in_one_is_refused(taken: str) -> None:
    data = replace(bare("irb6400r", 11), extras={taken: np.zeros(11)}, extra_units={taken: "1"})
    with pytest.raises(InputError, match=f"column '{taken}' .* computed input"):
        states_of(mechanism("irb6400r"), data)


def test_a_subset_is_the_same_at_some_poses_and_nothing_can_be_overwritten() -> None:
    states = states_of(mechanism("ur5"), bare("ur5", 11))
    part = states.subset(np.array([7, 2]))
    for name, column in states.columns.items():
        np.testing.assert_array_equal(part[name], column[[7, 2]])
    with pytest.raises(TypeError):
        states.columns["new"] = np.zeros(11)  # type: ignore[index]


def test_a_payload_that_is_the_same_everywhere_still_says_what_it_exerts() -> None:
    """No input of its own there, and yet what a model reads that was fitted where payloads differ."""
    arm = mechanism("ur5")
    data = replace(bare("ur5", 12), payload=np.full(12, 4.0))
    states = states_of(arm, data)
    mixed = states_of(arm, replace(data, payload=np.repeat([0.0, 4.0], 6)))
    for joint in arm.joints:
        name = f"payload_torque_{joint.name}"
        assert name not in states.columns
        assert states.unit(name) == mixed.unit(name)
        np.testing.assert_allclose(states.subset(np.arange(6, 12))[name], mixed[name][6:])
