"""Test operators of earlier poses against their definitions, and tables in measured order."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, mechanism
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.memory import jitter, lag, last_move, play, read_by, word
from gpmodel.model.states import States, states_of, unused_torques
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset

ARM = mechanism("irb6400r")
READ = ("last_move_J2", "stop_J2_0p1", "play_torque_J2_40", "lag_temperature_7p5", "lag_J1_20")
paths = st.lists(st.floats(-10, 10), min_size=2, max_size=40).map(np.array)
widths = st.floats(0.01, 5.0)


def in_order(count: int = 40, seed: int = 0) -> Dataset:
    return bare("irb6400r", count, seed, in_order=True)


def test_the_side_of_the_last_move_waits_for_a_move_and_forgets_at_a_gap() -> None:
    values = np.array([0.0, 0.0, 0.3, 0.3001, 0.1, 0.1, 0.5, 0.4])
    rows = np.array([1.0, 2, 3, 4, 5, 6, 9, 10])
    np.testing.assert_array_equal(last_move(values, rows, 5e-4), [0, 0, 1, 1, -1, -1, 0, -1])


@given(paths, widths)
def test_play_follows_at_its_width_and_no_further_than_it_is_pushed(values: Array, width: float) -> None:
    behind = play(values, width)
    assert np.all(np.abs(values - behind) <= width + 1e-12)
    pushed = np.abs(np.diff(behind)) > 0
    ends = np.abs((values - behind)[1:][pushed])
    np.testing.assert_allclose(ends, width, atol=1e-9)
    twice = np.repeat(values, 2)
    np.testing.assert_array_equal(play(twice, width)[::2], behind)


@given(paths, st.floats(0.1, 30.0), st.floats(0.1, 0.9))
def test_a_lag_is_the_exact_answer_to_straight_lines(values: Array, constant: float, part: float) -> None:
    time = np.arange(len(values), dtype=float)
    denser = np.concatenate([time, time[:-1] + part])
    order = np.argsort(denser)
    between = np.interp(denser[order], time, values)
    finer = lag(between, denser[order], constant)
    np.testing.assert_allclose(finer[np.isin(denser[order], time)], lag(values, time, constant), atol=1e-9)


def test_a_lag_of_a_step_is_an_exponential_and_waiting_lets_it_settle() -> None:
    time = np.array([0.0, 1e-9, 1.0, 2.0, 5.0, 50.0])
    np.testing.assert_allclose(lag(np.array([0.0, 1, 1, 1, 1, 1]), time, 2.0), 1 - np.exp(-time / 2.0), atol=1e-8)
    np.testing.assert_array_equal(lag(np.full(4, 3.0), np.zeros(4), 2.0), np.full(4, 3.0))


@pytest.mark.parametrize("name", READ)
def test_a_subset_remembers_poses_that_are_not_in_it(name: str) -> None:
    whole = states_of(ARM, in_order())
    rows = np.array([31, 2, 17, 18])
    for part in (whole.subset(rows), whole.subset(np.isin(np.arange(40), rows))):
        take = rows if part[name][0] == whole[name][31] else np.sort(rows)
        np.testing.assert_array_equal(part[name], whole[name][take])
    twice = whole.subset(np.arange(10, 40)).subset(np.array([5, 0]))
    np.testing.assert_array_equal(twice[name], whole[name][[15, 10]])


@pytest.mark.parametrize("name", READ)
def test_memory_follows_the_rows_not_their_place_in_the_table(name: str) -> None:
    data = in_order()
    turned = np.random.default_rng(1).permutation(40)
    np.testing.assert_array_equal(states_of(ARM, data.subset(turned))[name], states_of(ARM, data)[name][turned])


def test_standing_columns_are_there_only_where_the_rows_are_in_order() -> None:
    states, plain = states_of(ARM, in_order()), states_of(ARM, replace(in_order(), in_order=False))
    new = set(states.columns) - set(plain.columns)
    declared = {f"last_move_{j.name}" for j in ARM.joints if f"approach_{j.name}" in plain.columns}
    assert 0 < len(declared) < len(ARM.joints)
    assert {name for name in new if name.startswith("last_move")} | declared == {
        f"last_move_{j.name}" for j in ARM.joints
    }
    assert not declared & new
    assert any(n.startswith("lag_temperature_") for n in new)
    assert all(read_by(n) and np.isfinite(states[n]).all() and states.units[n] for n in new)
    assert states.units["last_move_J4"] == "1"
    with pytest.raises(InputError, match=r"'last_move_J4' depends on earlier rows; expected --in-order"):
        plain["last_move_J4"]
    with pytest.raises(InputError, match="'lag_colour_4' is neither in the table nor computed"):
        states["lag_colour_4"]


def test_a_short_move_that_was_commanded_counts_and_what_a_held_joint_reads_does_not() -> None:
    rng = np.random.default_rng(1)
    commanded = rng.uniform(-1.0, 1.0, 100)
    commanded[50] = commanded[49] + 1e-4
    held = np.repeat(rng.uniform(-1.0, 1.0, 20), 5)
    read = held + 5e-5 * rng.normal(size=100)
    rows = np.arange(100.0)
    assert last_move(commanded, rows, jitter(commanded))[50] == 1.0
    np.testing.assert_array_equal(last_move(read, rows, jitter(read)), last_move(held, rows, 0.0))


def test_a_joint_that_stays_has_no_last_move() -> None:
    data = in_order()
    q = data.q.copy()
    q[:, 3] = 0.2 + 1e-4 * np.random.default_rng(0).normal(size=40)
    assert "last_move_J4" not in states_of(ARM, replace(data, q=q)).columns


def timed(times: Array, said: bool) -> Dataset:
    data = replace(bare("irb6400r", len(times)), in_order=said)
    return replace(data, extras={**data.extras, "time": times}, extra_units={**data.extra_units, "time": "min"})


def test_times_that_never_fall_say_that_the_rows_are_in_order() -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.5, 4.0, 30))
    states = states_of(ARM, timed(times, said=False))
    expected = lag(states["temperature"], times, 12.0)
    np.testing.assert_array_equal(states["lag_temperature_12"], expected)
    assert states_of(ARM, timed(np.full(30, 2.0), said=False)).past is None
    assert states_of(ARM, timed(times[::-1].copy(), said=False)).past is None


def test_times_that_fall_in_a_table_said_to_be_in_order_are_refused() -> None:
    times = np.arange(30.0)
    times[17] = 3.0
    with pytest.raises(InputError, match=r"stated to be in the order of measurement, but 'time' falls at row 18"):
        states_of(ARM, timed(times, said=True))


def test_between_poses_a_remembered_column_lies_between() -> None:
    states = states_of(ARM, in_order())
    between = states.between(200)
    for name in ("J2", *READ):
        assert len(between) == len(between[name]) == 200
        assert states[name].min() <= between[name].min() <= between[name].max() <= states[name].max()


@pytest.mark.parametrize(
    ("value", "text"), [(0.0123, "0p0123"), (2400.0, "2400"), (1e-5, "0p00001"), (12.34567, "12p35")]
)
def test_a_constant_is_written_as_the_end_of_a_name(value: float, text: str) -> None:
    assert word(value) == text
    assert read_by(f"lag_room_temperature_2_{text}") == ("room_temperature_2",)
    assert read_by("lagging") == read_by("play_J2") == read_by("temperature_2") == ()
    assert isinstance(states_of(ARM, in_order())[f"play_J2_{text}"], np.ndarray)


def test_a_column_of_the_table_comes_before_a_derived_one() -> None:
    data = in_order()
    mine = np.arange(40.0)
    data = replace(
        data, extras={**data.extras, "last_move_J2": mine}, extra_units={**data.extra_units, "last_move_J2": "1"}
    )
    states: States = states_of(ARM, data)
    np.testing.assert_array_equal(states["last_move_J2"], mine)


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
    with pytest.raises(InputError, match="'lag_colour_4' is neither in the table nor computed"):
        states.unit("lag_colour_4")


def test_an_unknown_input_names_what_there_is() -> None:
    with pytest.raises(
        InputError,
        match=r"'J9' is neither in the table nor computed; available: J6, J5, J4 and \d+ others",
    ):
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


ARM_TORQUE, UR5 = mechanism("irb6400r"), mechanism("ur5")
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
    states, computed = states_of(ARM_TORQUE, data), states_of(ARM_TORQUE, replace(data, extras={}, extra_units={}))
    np.testing.assert_allclose(states["torque_J2"], scale * MEASURED)
    assert states.units["torque_J2"] == "Nm"
    np.testing.assert_array_equal(states["torque_J3"], computed["torque_J3"])
    assert column == "torque_J2" or column not in states.columns
    assert list(unused_torques(ARM_TORQUE, data)) == []


def test_joints_are_found_by_number_or_by_name() -> None:
    for column in ("torque_J2", "torque_shoulder_lift_joint", "tau_2"):
        states = states_of(UR5, told("ur5", column, "N*m"))
        np.testing.assert_allclose(states["torque_shoulder_lift_joint"], MEASURED)


def test_a_constant_torque_is_left_alone_with_one_line() -> None:
    data = told("irb6400r", "torque_J2", "N*m", np.full(12, 40.0))
    computed = states_of(ARM_TORQUE, replace(data, extras={}, extra_units={}))
    np.testing.assert_array_equal(states_of(ARM_TORQUE, data)["torque_J2"], computed["torque_J2"])
    (line,) = unused_torques(ARM_TORQUE, data)
    assert line == (
        "table: column 'torque_J2' is 40 in every row and is not used as the torque of J2; "
        "expected the torque of the joint at each pose"
    )


@pytest.mark.parametrize(("column", "unit"), [("torque_J9", "N*m"), ("torquemada_J2", "N*m"), ("tau_2", "A")])
def test_other_columns_stay_what_they_are(column: str, unit: str) -> None:
    states = states_of(ARM_TORQUE, told("irb6400r", column, unit))
    np.testing.assert_array_equal(states[column], MEASURED)
    assert np.abs(states["torque_J2"]).max() > 100.0


def test_of_one_pose_what_was_measured_is_the_load() -> None:
    data = told("irb6400r", "torque_J2", "N*m")
    for row in range(3):
        one = data.subset(np.array([row]))
        np.testing.assert_allclose(states_of(ARM_TORQUE, one)["torque_J2"], MEASURED[row])


class Massless:
    """An arm of which no masses are known."""

    def __getattr__(self, name: str) -> Any:
        return getattr(ARM_TORQUE, name)

    def loads(self, q: np.ndarray, payload: np.ndarray) -> dict[str, np.ndarray]:
        return {}


def test_where_no_masses_are_known_a_constant_torque_is_still_the_load() -> None:
    """Inputs of a fitted model must be known at any predicted pose."""
    data = told("irb6400r", "torque_J2", "N*m", np.full(12, 40.0))
    np.testing.assert_array_equal(states_of(cast(Mechanism, Massless()), data)["torque_J2"], 40.0)
