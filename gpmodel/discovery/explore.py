"""Evolve programs for a residual and for permuted residuals, and count the inputs that the programs use."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import aimed, readable_inputs, targets
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import mdl_gain, scores
from gpmodel.evolution.chance import FEWEST
from gpmodel.evolution.constants import polish
from gpmodel.evolution.input_histogram import Histogram, RunRecord, histogram, without_runs
from gpmodel.evolution.problems import SlotProblem
from gpmodel.evolution.representation import label
from gpmodel.evolution.runs import KeptRuns, Task, run_all
from gpmodel.evolution.search import Evolution
from gpmodel.evolution.settings import Settings
from gpmodel.families.candidate import Candidate, maker_of
from gpmodel.formula.program import Program
from gpmodel.model.sites import Site
from gpmodel.numerics.least_squares import MANY_COLUMNS
from gpmodel.progress import Reporter
from gpmodel.selection.programs import as_candidate, parts, without_poles


@dataclass(frozen=True)
class RoundContext:
    """Context of a round of the search: its number, its messages, and the storage of finished runs of evolution.

    late: function that returns whether the time limit of the search is reached.
    opening: True for the first round of a search with a catalogue, which evolves with a small budget.
    pooled: True if earlier rounds evolved programs with an equal budget on permuted residuals.
    """

    number: int
    tell: Reporter
    kept: KeptRuns
    late: Callable[[], bool] = lambda: False
    opening: bool = False
    pooled: bool = False


class OutOfTime(Exception):
    """Raised if the time limit of the search is reached before all runs of evolution are done."""


@dataclass(frozen=True)
class Exploration:
    """Evolved candidates for one residual, null distribution of their gains (nats), and histogram of their inputs."""

    candidates: tuple[Candidate, ...]
    null_nats: Array
    histogram: Histogram


def explore(
    residual: Residual, sites: tuple[Site, ...], search: Search, rng: np.random.Generator, context: RoundContext
) -> Exploration:
    """Evolve programs at all sites at once, `runs` times by each representation, then on permuted residuals.

    After the first round the permuted runs are omitted if no program has the least gain, nats, of a finding. Half as
    many permuted runs suffice if their largest gains are pooled with earlier ones, but at least as many as a p-value
    needs. With more than `evolved_poses` poses evolution uses a sample of them (half of it if the model has hundreds of
    columns); programs are scored on all poses. Without runs the input counts are 0. Raises OutOfTime at the time limit.
    """
    n = len(residual.poses)
    count = search.evolved_poses if residual.span.size < MANY_COLUMNS else search.evolved_poses // 2
    rows = np.sort(rng.permutation(n)[:count]) if n > count else np.arange(n)
    question = posed(residual, sites, search, rows)
    problem, _ = question
    if not search.runs:
        return Exploration((), np.zeros(0), without_runs(problem.inputs.names, residual.criteria.input_significance))
    budget = search.budget(context.opening)
    settings = [Settings(strategy, search.selection, budget) for strategy in search.strategies]
    real = [Task(problem, s, rng.spawn(1)[0]) for s in settings for _ in range(search.runs)]
    chances = max(1, search.runs // 2) if context.pooled else max(search.runs, -(-FEWEST // len(settings)))
    orders = residual.permuted(rng, chances * len(settings)).T
    shuffles = [
        Task(replace(problem, targets=aimed(problem.targets, residual, sites, rows, order)), s, rng.spawn(1)[0])
        for s, order in zip(np.repeat(np.array(settings, dtype=object), chances).tolist(), orders, strict=True)
    ]
    tasks = dict(enumerate([*real, *shuffles]))
    first = tasks if context.number == 1 else dict(list(tasks.items())[: len(real)])
    found = run(first, search, context)
    makers = (maker_of(label(task.settings.representation)) for task in real)
    candidates = candidates_of(residual, sites, search, question, zip(makers, found, strict=False))
    by_chance = found[len(real) :]
    if context.number > 1 and any(s.nats > residual.criteria.minimum_nats for s in scores(residual, candidates)):
        by_chance = run(dict(list(tasks.items())[len(real) :]), search, context)

    ran = [*zip(real, found, strict=False), *zip(shuffles, by_chance, strict=False)]
    strengths = [_most_saved(residual, search, evolution, len(sites)) for _, evolution in ran]
    records = [
        RunRecord(label(task.settings.representation), k >= len(real), evolution.best.program, strength)
        for k, ((task, evolution), strength) in enumerate(zip(ran, strengths, strict=True))
    ]
    counted = histogram(records, problem.inputs.names, residual.criteria.input_significance)
    return Exploration(candidates, np.array(strengths[len(real) :]), counted)


def posed(
    residual: Residual, sites: tuple[Site, ...], search: Search, rows: IntArray
) -> tuple[SlotProblem, Mapping[str, str]]:
    """Return the problem of genetic programming at some poses and all sites, and inputs in terms of table columns."""
    inputs, names = readable_inputs(residual.poses.states, rows)
    return SlotProblem(inputs, targets(residual, sites, rows), parsimony=search.nats_per_node), names


def run(tasks: Mapping[int, Task], search: Search, context: RoundContext) -> list[Evolution]:
    """Run numbered tasks of evolution. Each finished run is stored and reported; stored runs are not repeated."""

    def said(done: int) -> None:
        if 0 < done < len(tasks) and context.late():
            raise OutOfTime
        context.tell(f"evolving, {done} of {len(tasks)} runs done", passing=True)

    numbered = {(context.number, n): task for n, task in tasks.items()}
    found = dict(run_all(numbered, search.side_by_side, context.kept, said))
    return [found[number] for number in numbered]


def candidates_of(
    residual: Residual, sites: tuple[Site, ...], search: Search, question: tuple[SlotProblem, Mapping[str, str]],
    runs: Iterable[tuple[str, Evolution]],
) -> tuple[Candidate, ...]:  # fmt: skip
    """Return each distinct program as a candidate effect at its site, without programs that have a pole.

    The constants of each part of a program are refitted, since one output alone often explains the effect of two
    outputs. question: the problem of evolution, and its inputs in table columns. runs: programs with origins.
    """
    states, between = residual.poses.states, residual.poses.states.between()
    problem, names = question
    columns, held = problem.inputs.mapping(), {c for s in search.strategies for c in s.constants}

    @cache
    def fitted(part: Program, site: int) -> Program:
        return polish(part, problem.targets, site, columns, tuple(held))[0]

    found: dict[str, Candidate] = {}
    for maker, item in ((maker, item) for maker, run in runs for item in run.front):
        for program in (item.program, *(fitted(part, item.site) for part in parts(item.program))):
            cost = search.cost(program.complexity, len(sites))
            candidate = as_candidate(program, sites[item.site], names, cost, maker)
            if candidate is not None and without_poles(residual.criteria, candidate, states, between):
                found.setdefault(candidate.name, candidate)
    return tuple(found.values())


def _most_saved(residual: Residual, search: Search, run: Evolution, sites: int) -> float:
    """Return the largest gain in description length, nats, of any program of an evolution run. sites: their count."""
    nats = [mdl_gain(residual, c.gain, len(c.program.outputs), search.cost(c.complexity, sites)) for c in run.front]
    return float(max(nats, default=-np.inf))
