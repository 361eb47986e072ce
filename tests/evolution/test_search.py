"""Test the results of the search, its independence of the number of workers, and its refusals."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import CartesianProblem, Inputs, SlotProblem
from gpmodel.evolution.projection import Targets, regression
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings, Tournament, thesis_settings
from gpmodel.evolution.tree import Tree

REPRESENTATIONS = ["linear", "tree"]
QUICK = {
    "linear": Settings(Linear(own_constants=1), budget=Budget(300, 60, seconds=1e9, restart_after=0)),
    "tree": Settings(Tree(own_constants=1), budget=Budget(250, 30, seconds=1e9, restart_after=0)),
}


def with_budget(settings: Settings, **change: int) -> Settings:
    return replace(settings, budget=replace(settings.budget, **change))


def joints(poses: int, seed: int = 0) -> Inputs:
    names = tuple(f"J{k}" for k in range(1, 6))
    return Inputs(names, np.random.default_rng(seed).uniform(-2.5, 2.5, (5, poses)), names)


def two_sites(inputs: Inputs, effect: np.ndarray, seed: int = 1) -> Targets:
    """The effect acts at "elbow"; "base" is the other place, with a constant there already enabled."""
    rng = np.random.default_rng(seed)
    sensitivity = rng.normal(size=(2, inputs.values.shape[1], 3))
    columns = np.linalg.qr(sensitivity.reshape(2, -1).T)[0]
    residual = (sensitivity[1] * effect[:, None]).ravel() + 0.02 * rng.normal(size=sensitivity[0].size)
    residual -= columns @ (columns.T @ residual)
    split = columns.reshape(-1, 3, 2)
    return Targets(
        np.square(sensitivity).sum(axis=2),
        np.einsum("snc,nck->skn", sensitivity, split),
        np.einsum("snc,nc->sn", sensitivity, residual.reshape(-1, 3)),
        float(residual @ residual),
        ("base", "elbow"),
        residual.size,
    )


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_place_and_shape_are_found_together(representation: str) -> None:
    inputs = joints(80)
    problem = SlotProblem(inputs, two_sites(inputs, np.sin(inputs["J4"]) * inputs["J2"]))
    best = evolve(problem, QUICK[representation], np.random.default_rng(2)).best
    assert best.site_name == "elbow"
    assert best.gain > 0.95
    assert set(best.program.inputs) >= {"J2", "J4"}


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_noise_alone_is_not_explained_by_much_code(representation: str) -> None:
    inputs = joints(80)
    problem = SlotProblem(inputs, two_sites(inputs, np.zeros(80)), parsimony=3.0)
    best = evolve(problem, QUICK[representation], np.random.default_rng(3)).best
    assert best.gain < 0.2
    assert best.complexity <= 8


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_numbers_depend_on_the_seed(representation: str) -> None:
    inputs = joints(60)
    problem = SlotProblem(inputs, regression(np.tanh(inputs["J1"] * inputs["J3"])))
    settings = with_budget(QUICK[representation], generations=12)
    runs = [evolve(problem, settings, np.random.default_rng(seed)) for seed in (5, 5, 6)]
    assert [str(c.program) for c in runs[0].front] == [str(c.program) for c in runs[1].front]
    for name in ("best", "median", "distinct", "gain"):
        np.testing.assert_array_equal(runs[0].history[name], runs[1].history[name])
    assert not np.array_equal(runs[0].history["median"], runs[2].history["median"])


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_the_last_bits_of_the_targets_decide_nothing(representation: str) -> None:
    """Another processor's linear algebra leaves targets that differ there, and another basis of what is enabled."""
    inputs, rng = joints(60), np.random.default_rng(8)
    here = two_sites(inputs, np.abs(inputs["J3"]) + 0.3 * np.sin(inputs["J1"]))
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    bits = [1.0 + 1e-13 * rng.normal(size=here.pull.shape) for _ in range(2)]
    cross = np.einsum("jk,skn->sjn", turn, here.cross)
    there = replace(here, weight=here.weight * bits[0], cross=cross, pull=here.pull * bits[1])
    settings = with_budget(QUICK[representation], generations=15)
    runs = [evolve(SlotProblem(inputs, targets), settings, np.random.default_rng(5)) for targets in (here, there)]
    assert [c.program.input_counts for c in runs[0].front] == [c.program.input_counts for c in runs[1].front]
    for name in ("best", "median", "gain"):
        np.testing.assert_allclose(runs[0].history[name], runs[1].history[name], rtol=0, atol=1e-5)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_the_front_grows_in_gain_and_complexity_and_is_true(representation: str) -> None:
    inputs = joints(60)
    problem = SlotProblem(inputs, two_sites(inputs, np.abs(inputs["J3"]) + 0.3 * inputs["J1"]))
    found = evolve(problem, QUICK[representation], np.random.default_rng(7))
    sizes, gains = zip(*((c.complexity, c.gain) for c in found.front), strict=True)
    assert list(sizes) == sorted(set(sizes))
    assert list(gains) == sorted(gains)
    for candidate in found.front:
        values = candidate.program.evaluate(inputs.mapping())
        gain = problem.targets.gain_of(values, candidate.coefficients, candidate.site)
        assert gain == pytest.approx(candidate.gain, rel=1e-9)
    assert found.evaluations == 31 * 250 if representation == "tree" else found.evaluations == 61 * 300


def test_coefficients_explain_other_poses_too() -> None:
    inputs, other = joints(60), joints(90, seed=4)
    truth = [np.sin(i["J4"]) for i in (inputs, other)]
    best = evolve(SlotProblem(inputs, regression(truth[0])), QUICK["linear"], np.random.default_rng(1)).best
    columns = best.program.evaluate(other.mapping())
    left = truth[1] - best.coefficients @ columns
    gain = regression(truth[1]).gain_of(columns, best.coefficients, 0)
    assert gain == pytest.approx(1.0 - np.var(left) / np.var(truth[1]), abs=1e-12)
    assert gain > 0.999


@pytest.mark.first(2)
@pytest.mark.parametrize("norm", ["max", "rms"])
@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_a_compensator_lowers_the_norm_of_the_distances(representation: str, norm: str) -> None:
    rng = np.random.default_rng(0)
    inputs = Inputs(("x", "y", "z", "J1"), rng.uniform(0.5, 2.0, (4, 40)))
    measured = inputs.values[:3] + np.stack([0.1 * np.ones(40), 0.0 * inputs["y"], 0.001 * np.sin(inputs["J1"])])
    problem = CartesianProblem(inputs, measured, norm)
    sequences = thesis_settings(replace(Linear.thesis(), length=24), 3000, 40)
    settings = sequences if representation == "linear" else thesis_settings(Tree.thesis(), 1000, 40)
    runs = [evolve(problem, settings, np.random.default_rng(seed)) for seed in (1, 2, 3)]
    found = max(runs, key=lambda run: run.best.gain)
    assert found.best.gain > 0.5
    after = problem.norm_of(found.best.program.evaluate(inputs.mapping()))
    assert found.best.gain == pytest.approx(1.0 - after / problem.initial_norm)


def test_a_target_and_a_time_end_the_run() -> None:
    inputs = joints(60)
    problem = SlotProblem(inputs, regression(np.sin(inputs["J1"])))
    found = evolve(problem, Settings(budget=Budget(target=0.999, seconds=60.0)), np.random.default_rng(0))
    assert found.best.gain > 0.999
    assert len(found.history["gain"]) < 50
    stopped = evolve(problem, Settings(budget=Budget(seconds=0.0)), np.random.default_rng(0))
    assert len(stopped.history["gain"]) == 1


def test_shuffled_problems_keep_the_inputs_and_lose_the_law() -> None:
    inputs = joints(60)
    problem = SlotProblem(inputs, regression(np.sin(inputs["J1"])))
    basis = np.sin(inputs["J1"])[None]
    shuffled = problem.shuffled(np.random.default_rng(0))
    assert problem.targets.gains(basis)[0] == pytest.approx(1.0)
    assert shuffled.targets.gains(basis)[0] < 0.2
    points = CartesianProblem(Inputs(("x", "y", "z"), inputs.values[:3]), inputs.values[:3] + inputs.values[2:5])
    assert points.shuffled(np.random.default_rng(0)).initial_norm == pytest.approx(points.initial_norm)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Budget(population=2), "population: 2"),
        (lambda: thesis_settings(Linear(), population=30), "too small to select 5.0% from"),
        (lambda: Linear(operators="thesis,sinus"), "unknown 'sinus', 'thesis'"),
        (lambda: Linear(outputs=5), "there are 4 registers"),
        (lambda: Tree(crossover=1.5), "crossover: 1.5"),
        (lambda: Tree(style="wild"), "style: 'wild'"),
        (lambda: Tournament(0), "size: 0"),
    ],
)
def test_choices_out_of_range_are_one_clear_line(build: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_inputs_that_are_not_numbers_are_named() -> None:
    values = np.ones((2, 5))
    values[1, 3] = np.nan
    with pytest.raises(InputError, match="column 'b' is not finite in row 3"):
        Inputs(("a", "b"), values)
    with pytest.raises(InputError, match="unknown 'c', available: a"):
        Inputs(("a",), values[:1]).select(("c",))
    with pytest.raises(InputError, match="'y' is missing, expected x, y and z"):
        CartesianProblem(Inputs(("x",), values[:1]), np.ones((3, 5)))


def test_no_finite_program_is_an_error() -> None:
    inputs = Inputs(("x", "y", "z"), np.full((3, 20), 1.0))
    problem = CartesianProblem(inputs, np.full((3, 20), 1e200))
    with pytest.raises(InputError, match="no program of the first population is finite"):
        evolve(problem, thesis_settings(Linear.thesis(), 100, 1), np.random.default_rng(0))


def test_dropping_the_hopeless_changes_nothing_that_is_selected(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    inputs = Inputs(("x", "y", "z", "J1"), rng.uniform(0.5, 2.0, (4, 400)))
    bent = np.stack([0.1 * inputs["J1"], 0.3 * np.sin(inputs["x"]), 0.2 * inputs["z"]])
    problem = CartesianProblem(inputs, inputs.values[:3] + bent)
    settings = thesis_settings(replace(Linear.thesis(), length=40), 1000, 12)
    early = evolve(problem, settings, np.random.default_rng(1))
    monkeypatch.setattr("gpmodel.evolution.problems.BLOCK", 10**6)
    full = evolve(problem, settings, np.random.default_rng(1))
    np.testing.assert_array_equal(early.history["best"], full.history["best"])
    assert [str(c.program) for c in early.front] == [str(c.program) for c in full.front]
    monkeypatch.undo()
    run = Generations(problem, settings, np.random.default_rng(1))
    population = run.representation.initial(run.layout, 1000, np.random.default_rng(2))
    whole = run.scored(population).score
    run.cutoff = float(np.partition(whole, 60)[60])
    dropped = run.scores_of_eligible(population, 50).score
    assert np.count_nonzero(np.isinf(dropped)) > np.count_nonzero(np.isinf(whole)) + 20
    np.testing.assert_array_equal(np.sort(dropped)[:60], np.sort(whole)[:60])


def test_known_code_keeps_its_score() -> None:
    inputs = joints(60)
    run = Generations(SlotProblem(inputs, regression(np.sin(inputs["J1"]))), QUICK["linear"], np.random.default_rng(0))
    population = run.representation.initial(run.layout, 300, np.random.default_rng(1))
    known = run.scored(population)
    children = run.representation.offspring(
        run.layout, population, np.arange(300), np.arange(300)[::-1].copy(), np.random.default_rng(2)
    )
    assert np.intersect1d(run.scored(children).hashes, known.hashes).size > 20
    fresh, reused = run.scored(children), run.scored(children, known=known)
    for name in ("gain", "complexity", "site", "hashes"):
        np.testing.assert_allclose(getattr(reused, name), getattr(fresh, name), rtol=1e-9)
