"""The thesis' machine on islands: populations side by side, whose best move on to the next one now and then."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.pareto import Archive, Solution, best_of
from gpmodel.evolution.problems import CartesianProblem
from gpmodel.evolution.representation import Population
from gpmodel.evolution.scoring import Scores
from gpmodel.evolution.settings import Settings

EVERY, MIGRANTS = 25, 10
"""Generations between migrations, and how many of the best go: rare and few, so that islands stay different (Cantú-Paz
2000, Efficient and Accurate Parallel Genetic Algorithms, ch. 7)."""

State = tuple[Population, Scores]


def evolve_on_islands(
    problem: CartesianProblem, settings: Settings, islands: int, rng: np.random.Generator
) -> tuple[Solution, Array]:
    """The best program, and the best fitness (G + 1,) after every generation; the population is shared out evenly."""
    budget = replace(settings.budget, population=settings.budget.population // islands)
    runs = [Generations(problem, replace(settings, budget=budget), stream) for stream in rng.spawn(islands)]
    archive = Archive()
    states = [run.start() for run in runs]
    best = []
    for generation in range(settings.budget.generations + 1):
        for state in states:
            archive.add(*state)
        best.append(problem.initial_norm() * (1.0 - archive.best_gain))
        if generation and generation % EVERY == 0:
            states = migrated(states)
        states = [run.following(*state) for run, state in zip(runs, states, strict=True)]
    return best_of(archive.front(problem, runs[0].layout), problem), np.array(best)


def migrated(states: list[State]) -> list[State]:
    """The worst of each island replaced by the best of the one before it, in a ring."""
    ranked = [np.argsort(scores.score, kind="stable") for _, scores in states]
    out = []
    for k, (population, scores) in enumerate(states):
        other, their_scores = states[k - 1]
        stay, come = ranked[k][:-MIGRANTS], ranked[k - 1][:MIGRANTS]
        out.append((population.take(stay).join(other.take(come)), scores.take(stay).join(their_scores.take(come))))
    return out
