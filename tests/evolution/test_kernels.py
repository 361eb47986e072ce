"""Test compiled kernels against NumPy."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from gpmodel.evolution import engine, linear
from gpmodel.evolution.kernels import batch, breeding, elementary
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import CartesianProblem, Inputs, SlotProblem
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.representation import Population, program_of
from gpmodel.evolution.tree import Tree
from gpmodel.evolution.tree_breeding import OPERATOR_CODES, OWN_CONSTANT
from gpmodel.formula.operators import ARITHMETIC, BY_CODE, STORE, TABLE_CONSTANTS, Operator, operator_set

SPECIAL = np.array(
    [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1e-310, 1e308, -1e308, 0.5, -0.5, 0.99, 30.0,
     1e5, 1.1e5, -1e20, 709.7, 709.9, -744.0, -746.0, 1e-300, 2.414, 0.66, 0.625, 2.0, 3.0, np.pi, -np.pi / 2]
)  # fmt: skip


def run(operator: Operator, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    rows = np.stack([a, b, np.empty_like(a)])
    execute(np.array([operator.code | 1 << 32]), 1, np.empty(0), rows, 2, len(a))
    return rows[2]


def twin(operator: Operator, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        return operator.function(*(a, b)[: operator.arity])


@pytest.mark.long
@pytest.mark.parametrize("operator", ARITHMETIC, ids=lambda operator: operator.name)
def test_operators_on_zeros_infinities_and_denormals(operator: Operator) -> None:
    a, b = np.repeat(SPECIAL, len(SPECIAL)), np.tile(SPECIAL, len(SPECIAL))
    found, expected = run(operator, a, b), twin(operator, a, b)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    np.testing.assert_allclose(found, expected, rtol=4e-16, atol=0)
    zeros = expected == 0.0
    np.testing.assert_array_equal(np.signbit(found[zeros]), np.signbit(expected[zeros]))


@pytest.mark.parametrize("operator", ARITHMETIC, ids=lambda operator: operator.name)
@pytest.mark.parametrize("width", [1, 7, 40, 129])
def test_operators_on_ordinary_numbers(operator: Operator, width: int) -> None:
    rng = np.random.default_rng(width)
    a, b = rng.normal(scale=3.0, size=(2, width))
    np.testing.assert_allclose(run(operator, a, b), twin(operator, a, b), rtol=4e-15, atol=4e-16)


@pytest.mark.parametrize(
    ("fast", "exact", "largest"),
    [
        (elementary.sine, np.sin, elementary.ANGLE_LIMIT),
        (elementary.cosine, np.cos, elementary.ANGLE_LIMIT),
        (elementary.arctangent, np.arctan, 1e9),
        (elementary.hyperbolic_tangent, np.tanh, 40.0),
    ],
)
def test_elementary_functions_hold_to_rounding(fast, exact, largest: float) -> None:
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-largest, largest, 2000), rng.normal(size=2000), np.logspace(-12, 0, 200)])
    found = np.array([fast(x) for x in points])
    assert np.abs(found - exact(points)).max() <= 4.5e-16


LAYOUTS = {
    "thesis": Layout(
        ("x", "y", "z", "J1", "J2"), operator_set("thesis"), TABLE_CONSTANTS, ("x", "y", "z", None, None, None), 3
    ),
    "slot": Layout(("J1", "J2"), operator_set("slot"), (1.0, 2.0), ("J1", "J2", "J1", None), 3, 4, True),
    "one": Layout(("a",), operator_set("add,sin"), (), (None,), 1),
    "all": Layout(tuple("abcdefg"), ARITHMETIC, (0.5,), tuple("gfedcba"), 7, 2, True),
}


def population(layout: Layout, representation: str, count: int, rng: np.random.Generator):
    size = {"outputs": layout.outputs, "own_constants": layout.own_constants}
    return (linear.Linear(61, 31, **size) if representation == "linear" else Tree(**size)).initial(layout, count, rng)


def interpreted(programs: Population, row: int, layout: Layout, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Run a program by its definition: a sequence gene by gene, a tree node by node."""
    poses = len(next(iter(columns.values())))
    rows = [*columns.values(), *(np.full(poses, c) for c in (*layout.constants, 0.0))]
    with np.errstate(all="ignore"):
        if isinstance(programs, linear.Sequences):
            rows += [np.full(poses, c) for c in programs.constants[row]]
            return run_sequence(programs.genes[row].tolist(), layout, rows)
        return np.array([run_tree(iter(tree), rows) for tree in programs.individuals[row]])


def run_sequence(genes: list[int], layout: Layout, rows: list[np.ndarray]) -> np.ndarray:
    registers = [rows[layout.zero_row if name is None else layout.inputs.index(name)] for name in layout.start]
    accumulator, pending = registers[0], iter(genes)
    for gene in pending:
        code = int(layout.opcode_table[gene])
        if code in BY_CODE and BY_CODE[code].arity == 1:
            accumulator = BY_CODE[code].function(accumulator)
        elif (operand := next(pending, None)) is not None:
            where, number = layout.operand(code, operand)
            value = registers[number] if where == "register" else rows[number]
            if code == STORE:
                registers[number] = accumulator
            else:
                accumulator = BY_CODE[code].function(accumulator, value) if code in BY_CODE else value
    return np.array(registers[: layout.outputs])


def run_tree(nodes: Iterator[Any], rows: list[np.ndarray]) -> np.ndarray:
    node = next(nodes)
    if node.arity:
        return BY_CODE[node.code].function(*[run_tree(nodes, rows) for _ in range(node.arity)])
    return np.full(len(rows[0]), node.value) if node.code == OWN_CONSTANT else rows[node.code - OPERATOR_CODES]


@pytest.mark.parametrize("representation", ["linear", "tree"])
@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("poses", [1, 40, 300])
def test_programs_run_like_their_numpy_selves(name: str, representation: str, poses: int) -> None:
    layout = LAYOUTS[name]
    rng = np.random.default_rng(poses)
    programs = population(layout, representation, 60, rng)
    inputs = rng.normal(size=(len(layout.inputs), poses))
    code = programs.decoded(layout, slice(0, 60))
    found = engine.values(code, layout.fixed_rows(inputs))
    columns = dict(zip(layout.inputs, inputs, strict=True))
    sizes = batch.sizes_by_outputs(code, layout.base)
    compared = 0
    for p in range(60):
        program = program_of(programs, p, layout)
        expected = interpreted(programs, p, layout, columns)
        nearby = interpreted(programs, p, layout, {name: column * (1 + 1e-12) for name, column in columns.items()})
        np.testing.assert_array_equal(program.evaluate(columns), expected)
        with np.errstate(invalid="ignore"):
            stable = np.abs(nearby - expected) <= 1e-8 * (1.0 + np.abs(expected))
        np.testing.assert_allclose(found[p][stable], expected[stable], rtol=1e-6, atol=1e-7)
        compared += stable.sum()
        assert sizes[p].sum() >= program.complexity
    assert compared > 0.8 * found.size


def test_equal_effective_code_has_an_equal_hash_and_other_code_another() -> None:
    layout = LAYOUTS["slot"]
    programs = population(layout, "linear", 400, np.random.default_rng(0))
    hashes = programs.decoded(layout, slice(0, 400)).hashes
    words = [
        (code.words[0, : code.length[0]].tobytes(), code.outputs[0].tobytes(), code.constants[0].tobytes())
        for code in (programs.decoded(layout, slice(p, p + 1)) for p in range(400))
    ]
    constant_free = [w[:2] for w in words]
    assert len(set(hashes.tolist())) >= len(set(constant_free))
    again = programs.take(np.arange(400)[::-1].copy()).decoded(layout, slice(0, 400)).hashes
    np.testing.assert_array_equal(again[::-1], hashes)


def test_dead_code_does_not_change_the_hash() -> None:
    layout = LAYOUTS["one"]
    genes = np.array([[0, 0, 2, 0, 14, 14, 14], [0, 0, 2, 0, 3, 0, 14]], dtype=np.uint8)
    code = linear.Sequences(genes, np.zeros((2, 0))).decoded(layout, slice(0, 2))
    assert code.hashes[0] == code.hashes[1]
    assert code.length.tolist() == [0, 0]


@pytest.mark.parametrize("norm", ["max", "rms"])
@pytest.mark.parametrize("poses", [40, 200])
def test_compensator_fitness_is_the_norm_of_fig_5_5(norm: str, poses: int) -> None:
    rng = np.random.default_rng(1)
    layout = LAYOUTS["thesis"]
    inputs = Inputs(layout.inputs, rng.normal(size=(5, poses)))
    problem = CartesianProblem(inputs, inputs.values[:3] + 0.1 * rng.normal(size=(3, poses)), norm)
    programs = population(layout, "linear", 300, rng)
    fixed = layout.fixed_rows(inputs.values)
    code = programs.decoded(layout, slice(0, 300))
    found = problem.scores(code, fixed).score
    outputs = engine.values(code, fixed).copy()
    expected = np.array([problem.norm_of(o) if np.all(np.isfinite(o)) else np.inf for o in outputs])
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    limit = float(np.median(found))
    early = problem.scores(code, fixed, cutoff=limit).score
    np.testing.assert_array_equal(early[found <= limit], found[found <= limit])
    assert np.all(np.isinf(early[found > limit * (1 + 1e-12)]))


def slot_targets(rng: np.random.Generator, sites: int, poses: int, enabled: int) -> Targets:
    sensitivity = rng.normal(size=(sites, poses, 3))
    columns, _ = np.linalg.qr(rng.normal(size=(3 * poses, enabled)))
    residual = rng.normal(size=3 * poses)
    residual -= columns @ (columns.T @ residual)
    return Targets(
        np.square(sensitivity).sum(axis=2),
        np.einsum("snc,nck->skn", sensitivity, columns.reshape(poses, 3, enabled)),
        np.einsum("snc,nc->sn", sensitivity, residual.reshape(poses, 3)),
        float(residual @ residual),
        tuple(map(str, range(sites))),
        3 * poses,
    )


@pytest.mark.long
def test_chosen_outputs_are_those_of_stepwise_least_squares() -> None:
    rng = np.random.default_rng(2)
    layout = LAYOUTS["slot"]
    targets = slot_targets(rng, 4, 50, 5)
    inputs = Inputs(layout.inputs, rng.normal(size=(2, 50)))
    programs = population(layout, "linear", 80, rng)
    fixed = layout.fixed_rows(inputs.values)
    code = programs.decoded(layout, slice(0, 80))
    scores = SlotProblem(inputs, targets, 1.5).scores(code, fixed)
    values = engine.values(code, fixed).copy()
    sizes = batch.sizes_by_outputs(code, layout.base)
    for p in range(80):
        best = 0.0
        for site in range(targets.sites):
            chosen: list[int] = []
            while len(chosen) < 3:
                trials = {
                    k: targets.set_gain(values[p, [*chosen, k]], site)
                    for k in range(3)
                    if k not in chosen and np.all(np.isfinite(values[p, k]))
                }
                trials = {k: gain for k, (gain, c) in trials.items() if np.all(c != 0.0)}
                if not trials:
                    break
                chosen.append(max(trials, key=lambda k: trials[k]))
                program = program_of(programs, p, layout)
                bits = sum(1 << k for k in chosen)
                size = sum(int(sizes[p, m]) for m in range(8) if m & bits)
                assert size >= program.select(chosen).complexity
                best = min(best, 75.0 * np.log(1.0 - trials[chosen[-1]]) + 1.5 * (size + len(chosen)))
        assert scores.score[p] == pytest.approx(best, rel=1e-6, abs=1e-9)


def test_breeding_copies_the_mother_where_no_rate_is_set() -> None:
    rng = np.random.default_rng(3)
    genes = rng.integers(0, 256, (10, 30), dtype=np.uint8)
    constants = rng.normal(size=(10, 2))
    mothers, fathers = rng.integers(0, 10, (2, 25))
    child, own = np.empty((25, 30), np.uint8), np.empty((25, 2))
    breeding.breed_sequences(genes, constants, mothers, fathers, np.uint64(1), 0.0, 0.0, child, own)
    np.testing.assert_array_equal(child, genes[mothers])
    np.testing.assert_array_equal(own, constants[mothers])


@pytest.mark.parametrize(("crossover", "mutation"), [(0.0, 0.02), (0.05, 0.0)])
def test_breeding_rates_are_per_element(crossover: float, mutation: float) -> None:
    parents = np.stack([np.zeros(1000, np.uint8), np.full(1000, 255, np.uint8)])
    mothers, fathers = np.zeros(400, np.int64), np.ones(400, np.int64)
    child = np.empty((400, 1000), np.uint8)
    none = np.empty((400, 0))
    breeding.breed_sequences(
        parents, np.empty((2, 0)), mothers, fathers, np.uint64(9), crossover, mutation, child, none
    )
    if mutation:
        assert np.mean(child != 0) == pytest.approx(mutation * 255 / 256, rel=0.05)
    else:
        assert set(np.unique(child)) == {0, 255}
        assert np.mean(child[:, 1:] != child[:, :-1]) == pytest.approx(crossover, rel=0.05)


def test_slot_problem_scores_do_not_depend_on_the_slice() -> None:
    rng = np.random.default_rng(4)
    layout = LAYOUTS["slot"]
    problem = SlotProblem(Inputs(layout.inputs, rng.normal(size=(2, 50))), slot_targets(rng, 4, 50, 5))
    programs = population(layout, "linear", 90, rng)
    fixed = layout.fixed_rows(problem.inputs.values)
    whole = problem.scores(programs.decoded(layout, slice(0, 90)), fixed)
    part = problem.scores(programs.decoded(layout, slice(30, 60)), fixed)
    np.testing.assert_allclose(part.score, whole.score[30:60], rtol=1e-9)
