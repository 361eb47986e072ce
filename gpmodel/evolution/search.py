"""The loop of genetic programming, for sequences and trees, and for compensators and effects."""

import time
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.kinds import Typing
from gpmodel.evolution.links import summed
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.memetic import Formulas, evolve_formulas
from gpmodel.evolution.pareto import Solution, best_of, description_length, pareto
from gpmodel.evolution.problems import Problem, SlotProblem
from gpmodel.evolution.settings import Settings
from gpmodel.formula.program import Program


@dataclass(frozen=True)
class Evolution:
    """Result of an evolution run.

    front: programs that remove a larger share of the residual than all simpler programs, simplest first.
    history: one array per quantity (generation, best, median, gain, distinct, evaluations_per_second, seconds). best
    and median are the best and the median score of programs with a finite score; smaller scores are better.
    evaluations: number of scored programs.
    """

    front: tuple[Solution, ...]
    best: Solution
    history: dict[str, Array]
    evaluations: int
    seconds: float


def evolve(problem: Problem, settings: Settings, rng: np.random.Generator) -> Evolution:
    """Evolve programs until the generations or the seconds of the budget are used up.

    If the number of generations ends the run, the result depends on the problem, the settings and the generator only.
    Raises InputError if no program of the first population has a finite score.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        return _search(problem, Generations(problem, settings, rng))


def _search(problem: Problem, run: Generations) -> Evolution:
    from deap import tools

    budget, archive = run.budget, run.archive
    log, statistics = tools.Logbook(), tools.Statistics()
    statistics.register("best", np.min)
    statistics.register("median", np.median)
    began, done = time.perf_counter(), False
    while not done:
        run.step()
        scores, evaluations = run.scores, (run.generation + 1) * budget.population
        seconds = time.perf_counter() - began
        finite = scores.score[np.isfinite(scores.score)]
        if not run.generation and not len(finite):
            raise InputError("evolve: no program of the first population is finite on these inputs")
        log.record(
            generation=run.generation, **statistics.compile([finite if len(finite) else np.inf]),
            gain=archive.best_gain, distinct=len(np.unique(scores.hashes)),
            evaluations_per_second=evaluations / seconds, seconds=seconds,
        )  # fmt: skip
        done = run.generation >= budget.generations or seconds >= budget.seconds or archive.best_gain >= budget.target
    front = archive.front(problem, run.layout)
    if budget.climb and isinstance(problem, SlotProblem):
        front = _finished(front, problem, run.layout, budget.climb)
    history = {name: np.array(log.select(name), dtype=float) for name in log[0]}
    return Evolution(front, best_of(front, problem), history, evaluations, time.perf_counter() - began)


def _finished(front: tuple[Solution, ...], problem: SlotProblem, layout: Layout, count: int) -> tuple[Solution, ...]:
    """Return the Pareto front, extended by formulas that are bred at the sites of its best programs, with their
    operators and kinds of quantities."""
    names, typing = problem.inputs.names, Typing(problem.inputs.kinds)
    offered = {operator.name for operator in layout.operators}

    def allows(program: Program) -> bool:
        return offered.issuperset(program.operator_counts) and typing.allows(program, names)

    found = list(front)
    for one in sorted(front, key=lambda solution: description_length(solution, problem))[:count]:
        population = Formulas(problem.only(one.site, names), allows)
        terms = [one.program.select([k]) for k in range(len(one.coefficients))]
        population.add([*terms, summed(list(zip(terms, one.coefficients.tolist(), strict=True)))])
        evolve_formulas(population, names)
        found += [replace(formula, site=one.site) for formula in population.found]
    return pareto(found)
