"""Test evolved programs as effects, and the histogram of their inputs."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, mechanism
from loop_cases import found, quick

from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import readable_inputs
from gpmodel.evidence.criteria import Criteria
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression, parse
from gpmodel.formula.program import Builder, Program
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import prepare
from gpmodel.model.states import states_of
from gpmodel.selection.programs import expression_text, parts, without_poles

STATES = states_of(mechanism("irb6400r"), bare("irb6400r", 40))
INPUTS, WRITTEN = readable_inputs(STATES, np.arange(40))


UNARY = ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "square", "tanh")
BINARY = ("add", "subtract", "multiply", "divide", "min", "max")


def random_program(seed: int) -> Program:
    """A program of up to a dozen operators over inputs and constants."""
    rng = np.random.default_rng(seed)
    builder = Builder()
    nodes = [builder.input(str(n)) for n in rng.choice(INPUTS.names, 3)]
    nodes.append(builder.constant(float(f"{rng.normal():.4g}")))
    for _ in range(rng.integers(1, 12)):
        if rng.random() < 0.5:
            nodes.append(builder.apply(str(rng.choice(UNARY)), int(rng.choice(nodes))))
        else:
            nodes.append(builder.apply(str(rng.choice(BINARY)), *(int(n) for n in rng.choice(nodes, 2))))
    return builder.program([nodes[-1]])


@pytest.mark.parametrize("seed", range(40))
def test_the_text_of_a_program_is_the_program(seed: int) -> None:
    """Over the table's own columns, to the five digits its constants are written with."""
    program = random_program(seed)
    values = dict(zip(INPUTS.names, INPUTS.values, strict=True))
    with np.errstate(all="ignore"):
        direct = program.evaluate(values)[0]
        written = Expression(expression_text(program, WRITTEN))(STATES)
    there = np.isfinite(direct) & (np.abs(direct) < 1e6)
    np.testing.assert_allclose(written[there], direct[there], rtol=1e-6, atol=1e-6)


def test_a_program_that_is_an_input_is_that_column_unscaled() -> None:
    builder = Builder()
    program = builder.program([builder.input("torque_J2")])
    assert expression_text(program, WRITTEN) == "torque_J2"


@pytest.mark.parametrize("name", MECHANISMS)
def test_inputs_are_of_order_one_and_written_as_they_are_scaled(name: str) -> None:
    states = states_of(mechanism(name), bare(name, 30))
    inputs, written = readable_inputs(states, np.arange(30))
    assert set(written) == set(inputs.names)
    for column, values in zip(inputs.names, inputs.values, strict=True):
        np.testing.assert_allclose(Expression(written[column])(states), values, atol=1e-12)
        assert 1e-3 < np.abs(values).max() < 10
    assert {j.name for j in mechanism(name).joints} <= set(inputs.names)
    assert {"temperature", "payload", "row"} <= set(inputs.names)
    kinds = dict(zip(inputs.names, inputs.kinds, strict=True))
    assert (kinds["temperature"], kinds["payload"], kinds["row"]) == ("temperature", "kg", "row")
    assert kinds.get("x", "length") == "length"  # a gantry has it as a joint


def test_constant_columns_and_reactions_are_not_offered() -> None:
    data = bare("irb6400r", 20, payload=False)
    states = prepare(mechanism("irb6400r"), data).states
    names = readable_inputs(states, np.arange(20))[0].names
    assert not {"payload", "force_base_z"} & set(names)
    assert not any(n.startswith(("force_", "moment_J")) for n in names)
    assert {"torque_J2", "moment_base_x"} <= set(names)


def test_a_load_in_proportion_to_a_length_is_not_offered_beside_it() -> None:
    """A carriage's weight turns the foot in proportion to where it stands."""
    states = states_of(mechanism("irb6400r"), bare("irb6400r", 20))
    rng = np.random.default_rng(0)
    share = {"unlike": 0.03, "alike": 0.003}
    for kind, part in share.items():
        moment = 3e3 * (states["x"] - 1.0 + part * np.std(states["x"]) * rng.normal(size=20))
        columns = MappingProxyType({**states.columns, "moment_base_x": moment})
        names = readable_inputs(replace(states, columns=columns), np.arange(20))[0].names
        assert ("moment_base_x" in names) is (kind == "unlike")
        assert "x" in names


@pytest.mark.parametrize(("part", "offered"), [(0.03, True), (0.003, False)])
def test_a_load_in_proportion_to_the_payload_is_not_offered_beside_it(part: float, offered: bool) -> None:
    """A lift carries it straight up."""
    states = states_of(mechanism("irb6400r"), bare("irb6400r", 20))
    rng = np.random.default_rng(0)
    force = -9.81 * states["payload"] * (1.0 + part * rng.normal(size=20))
    columns = MappingProxyType({**states.columns, "payload_torque_J1": force})
    names = readable_inputs(replace(states, columns=columns), np.arange(20))[0].names
    assert ("payload_torque_J1" in names) is offered
    assert "payload" in names


def test_of_lengths_in_proportion_the_first_is_offered() -> None:
    """A SCARA's quill lifts the tool by its own travel."""
    states = states_of(mechanism("irb6400r"), bare("irb6400r", 20))
    rng = np.random.default_rng(0)
    for part, offered in ((0.03, {"x", "z"}), (0.003, {"x"})):
        height = 0.4 - states["x"] * (1.0 + part * rng.normal(size=20))
        columns = MappingProxyType({**states.columns, "z": height})
        names = readable_inputs(replace(states, columns=columns), np.arange(20))[0].names
        assert {"x", "z"} & set(names) == offered


@pytest.mark.long
def test_exploring_offers_distinct_finite_effects_that_read_known_inputs() -> None:
    answer = found("windup", 0)
    for entry in answer.rounds:
        offered = entry.exploration.candidates
        assert len({c.name for c in offered}) == len(offered) > 0
        for candidate in offered:
            assert candidate.found_by in ("sequence", "tree")
            assert candidate.family == ""
            assert candidate.cost > 0
            assert set(candidate.effects[0].inputs) <= set(answer.poses.states.columns)


@pytest.mark.long
def test_the_histogram_of_a_real_effect_shows_its_input_and_that_of_an_innocent_robot_none() -> None:
    first = found("windup", 0).rounds[0].exploration.histogram
    at = first.inputs.index("torque_J3")
    real = [sum(counts) for counts in zip(*first.counts.values(), strict=True)]
    assert real[at] >= 3 > max(first.referring_by_chance)
    assert found("nothing", 0).rounds[0].exploration.histogram.significant == ()


@pytest.mark.long
def test_every_round_in_which_something_could_be_accepted_has_its_own_null() -> None:
    for entry in quick().rounds:
        null = entry.exploration.null_nats
        asked = entry.number == 1 or any(
            h.score.nats > Criteria().minimum_nats for h in entry.hypotheses if h.candidate.found_by == "sequence"
        )
        assert not asked or np.isfinite(null).sum() >= 2
        assert sum(entry.exploration.histogram.shuffled_runs.values()) == len(null)


@pytest.mark.long
def test_nothing_is_accepted_of_a_round_without_a_null() -> None:
    for entry in [*found("nothing", 0).rounds, *found("windup", 0).rounds]:
        if not len(entry.exploration.null_nats):
            assert not any(h.accepted for h in entry.hypotheses if h.candidate.found_by == "sequence")


def test_an_opening_round_beside_a_catalogue_has_the_smaller_budget() -> None:
    small, full = Search().budget(True), Search().budget(False)
    assert (full.population, full.generations) == (Search().population, Search().generations)
    assert small.population < full.population
    assert small.generations < full.generations
    assert Search(population=48, generations=4).budget(True) == Search(population=48, generations=4).budget(False)


@pytest.mark.parametrize(
    ("text", "steadies"),
    [
        ("J4*J5", True),
        ("sin(2*J2)*cos(J4)", True),
        ("exp(-(J3 - 0.5)**2/0.1)", True),
        ("max(torque_J2 - 500, 0)", True),
        ("abs(J2 - J3)", True),
        ("J1/x", False),
        ("1/sin(J5)", False),
        ("exp(1/J3)", False),
    ],
)
def test_a_shape_with_a_pole_between_the_poses_is_no_candidate(text: str, steadies: bool) -> None:
    candidate = Candidate(text, (drive_effect(text, mechanism("irb6400r").joints[0], Expression(text)),), "", 1.0)
    assert without_poles(Criteria(), candidate, STATES, STATES.between()) is steadies


@pytest.mark.parametrize(("text", "count"), [("J1", 0), ("J1, sin(J2)", 2), ("J1, sin(J2), J3*J4", 6)])
def test_the_parts_of_a_program_are_every_choice_of_fewer_outputs(text: str, count: int) -> None:
    found = parts(parse(text))
    assert parse(text) not in found
    assert len(set(found)) == len(found) == count


def test_a_column_far_from_zero_is_read_from_its_middle() -> None:
    data = bare("irb6400r", 60, 1)
    data = replace(data, extras={"time": 1.7321e9 + np.arange(60.0)}, extra_units={"time": "s"})
    inputs, _ = readable_inputs(prepare(mechanism("irb6400r"), data).states, np.arange(60))
    values = inputs.values[inputs.names.index("time")]
    assert abs(values.mean()) < 0.1
    assert values.std() == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(("clock", "kept"), [(np.linspace(0.0, 3600.0, 20), False), (np.tile([0.0, 60.0], 10), True)])
def test_the_number_of_the_row_is_no_input_where_a_clock_runs_with_it(clock: np.ndarray, kept: bool) -> None:
    states = states_of(mechanism("irb6400r"), bare("irb6400r", 20))
    timed = replace(states, columns={**states.columns, "time": clock}, units={**states.units, "time": "s"})
    assert ("row" in readable_inputs(timed, np.arange(20))[0].names) == kept
    assert "row" in readable_inputs(states, np.arange(20))[0].names
