"""Genetic programming on the residual: what it evolves, which inputs it keeps, and what chance evolves."""

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations

import numpy as np
from scipy import stats

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.null import shuffled
from gpmodel.discovery.residual import Residual
from gpmodel.discovery.score import saved, scores
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import aimed, targets
from gpmodel.errors import InputError
from gpmodel.evolution.chance import chance
from gpmodel.evolution.kinds import ANGLE, NUMBER, SHORT, SHORT_RANGE
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.representation import label
from gpmodel.evolution.search import Evolution, evolve
from gpmodel.evolution.settings import Settings
from gpmodel.evolution.threads import side_by_side
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Columns, Expression
from gpmodel.formula.program import Program
from gpmodel.model.effect import axis_unit
from gpmodel.model.memory import read_by
from gpmodel.model.sites import Site
from gpmodel.model.states import States
from gpmodel.numerics.least_squares import MANY_COLUMNS
from gpmodel.progress import Teller

KINDS = {"m": "length", "Nm": "torque", "N": "force", "degC": "temperature", "K": "temperature", "s": "time"}
"""What a column is a measure of, by its unit; other units are kinds of their own."""


@dataclass(frozen=True)
class Turn:
    """Which round this is, and where its messages go.

    opening: the first round where named effects are offered, explored with a small budget. pooled: rounds before ran
    with the same budget on shuffled residuals.
    """

    number: int
    tell: Teller
    opening: bool = False
    pooled: bool = False


@dataclass(frozen=True)
class Task:
    """One GP run, on the residual or on a shuffled one: all that a worker needs."""

    problem: SlotProblem
    settings: Settings
    rng: np.random.Generator


def run_task(task: Task) -> Evolution:
    """Run it; the same numbers wherever it runs."""
    return evolve(task.problem, task.settings, task.rng)


@dataclass(frozen=True)
class Histogram:
    """Runs whose best program references each input in effective code, by representation, and on shuffled residuals.

    p_values: the larger of two chances times the number of inputs: count_p of the count, strength_p of what the best
    such run saves. runs, shuffled_runs: how many there were.
    """

    inputs: tuple[str, ...]
    linear: tuple[int, ...]
    tree: tuple[int, ...]
    shuffled: tuple[int, ...]
    p_values: tuple[float, ...]
    significant: tuple[str, ...]
    count_p: tuple[float, ...]
    strength_p: tuple[float, ...]
    runs: int
    shuffled_runs: int


@dataclass(frozen=True)
class Exploration:
    """What GP made of one residual: candidates, the null of their description lengths, and the histogram."""

    candidates: tuple[Candidate, ...]
    null_nats: Array
    histogram: Histogram


def explore(
    residual: Residual, sites: tuple[Site, ...], search: Search, rng: np.random.Generator, turn: Turn
) -> Exploration:
    """Evolve bases over all sites at once, `runs` times a strategy; then the same on shuffled residuals.

    After the first round the shuffled ones are left out where nothing evolved saves what a finding has to, for nothing
    could be accepted; half as many are enough where their maxima are pooled with those of rounds before.
    Above `evolved_poses` the GP sees a sample of them, half as many beside hundreds of columns (the work grows
    with both); what it finds is scored on all.
    """
    n = len(residual.poses)
    count = search.evolved_poses if residual.enabled.shape[1] < MANY_COLUMNS else search.evolved_poses // 2
    rows = np.sort(rng.permutation(n)[:count]) if n > count else np.arange(n)
    inputs, names = readable_inputs(residual.poses.states, rows)
    problem = SlotProblem(inputs, targets(residual, sites, rows), parsimony=search.nats_per_node)
    budget = search.budget(turn.opening)
    settings = [Settings(strategy, budget=budget) for strategy in search.strategies]
    real = [Task(problem, s, rng.spawn(1)[0]) for s in settings for _ in range(search.runs)]
    chances = max(1, search.runs // 2) if turn.pooled else search.runs
    orders = shuffled(residual, rng, chances * len(settings)).T
    shuffles = [
        Task(replace(problem, targets=aimed(problem.targets, residual, sites, rows, order)), s, rng.spawn(1)[0])
        for s, order in zip(np.repeat(np.array(settings, dtype=object), chances).tolist(), orders, strict=True)
    ]
    first = [*real, *shuffles] if turn.number == 1 else real
    found = _run(first, search, turn)
    tried: dict[str, list[Evolution]] = {label(strategy): [] for strategy in search.strategies}
    for task, run in zip(real, found, strict=False):
        tried[label(task.settings.representation)].append(run)
    candidates = _candidates(residual, sites, search, names, found[: len(real)])
    by_chance = found[len(real) :]
    if turn.number > 1 and _could_be_accepted(residual, candidates):
        by_chance = _run(shuffles, search, turn)

    def most(run: Evolution) -> float:
        return _most_saved(residual, search, run, len(sites))

    null = [most(run) for run in by_chance]
    histogram = referenced(inputs.names, tried, by_chance, most, residual.criteria.input_significance)
    return Exploration(candidates, np.array(null), histogram)


def _run(tasks: Sequence[Task], search: Search, turn: Turn) -> list[Evolution]:
    """All runs, in the order of the tasks, telling how many are done."""
    mapper = search.mapper or partial(side_by_side, threads=search.workers)
    turn.tell(f"evolving, 0 of {len(tasks)} runs done", passing=True)
    found = []
    for run in mapper(run_task, tasks):
        found.append(run)
        turn.tell(f"evolving, {len(found)} of {len(tasks)} runs done", passing=True)
    return found


def _candidates(
    residual: Residual, sites: tuple[Site, ...], search: Search, names: Mapping[str, str], runs: Sequence[Evolution]
) -> tuple[Candidate, ...]:
    """What the runs found, as effects at their sites, each once; without those that pass a pole."""
    states, between = residual.poses.states, residual.poses.states.between()
    found: dict[str, Candidate] = {}
    for item in chain.from_iterable(run.front for run in runs):
        for program in parts(item.program):
            cost = _cost(search, program.complexity, len(sites))
            candidate = as_candidate(program, sites[item.site], names, cost)
            if candidate is not None and without_poles(residual.criteria, candidate, states, between):
                found.setdefault(candidate.name, candidate)
    return tuple(found.values())


def _could_be_accepted(residual: Residual, candidates: Sequence[Candidate]) -> bool:
    """Whether any candidate saves the description length that a finding has to."""
    return any(score.nats > residual.criteria.minimum_nats for score in scores(residual, candidates))


def readable_inputs(states: States, rows: IntArray) -> tuple[Inputs, Mapping[str, str]]:
    """Columns worth offering to the GP, scaled to order one, and how each is written in terms of the table's.

    Joint reactions other than torques stay out (the torques and the base's moments span them); so do constant columns.
    """
    names, values, written = [], [], {}
    for name, column in states.columns.items():
        if name.startswith(("force_", "moment_")) and name not in ("moment_base_x", "moment_base_y"):
            continue
        spread, largest = float(np.ptp(column)), float(np.max(np.abs(column)))
        if spread < 1e-9 * max(largest, 1.0):
            continue
        if states.units[name] in ("rad", "m"):
            offset, scale = 0.0, 1.0
        elif states.units[name] in ("Nm", "N"):
            offset, scale = 0.0, float(f"{largest:.3g}")
        else:
            offset, scale = float(f"{column.mean():.4g}"), float(f"{max(column.std(), 1e-12):.3g}")
        names.append(name)
        values.append((column[rows] - offset) / scale)
        shifted = f"({name} - {offset!r})" if offset else name
        written[name] = shifted if scale == 1.0 else f"({shifted}/{scale!r})"
    kinds = tuple(kind_of(name, states) for name in names)
    return Inputs(tuple(names), np.array(values), kinds), written


def kind_of(name: str, states: States) -> str:
    """What a column is a measure of; what the rows before leave of an angle is a travel, which has no period."""
    unit = states.units[name]
    if name == "row":
        return "row"
    if unit == "rad":
        short = float(np.ptp(states[name])) < SHORT_RANGE
        return "travel" if read_by(name) else SHORT if short else ANGLE
    return NUMBER if unit == "1" else KINDS.get(unit, unit)


def _most_saved(residual: Residual, search: Search, run: Evolution, sites: int) -> float:
    """The largest description length that any program of a run saves."""
    nats = [saved(residual, c.gain, len(c.program.outputs), _cost(search, c.complexity, sites)) for c in run.front]
    return float(max(nats, default=-np.inf))


def _cost(search: Search, complexity: int, sites: int) -> float:
    return search.nats_per_node * complexity + float(np.log(sites))


def as_candidate(program: Program, site: Site, names: Mapping[str, str], cost: float) -> Candidate | None:
    """A program as effects at its site, one an output; None where it is no function of any input."""
    texts = [expression_text(program.select([k]), names) for k in range(len(program.outputs))]
    texts = [t for t in dict.fromkeys(texts)]
    try:
        bases = [Expression(t) for t in texts]
    except InputError:
        return None
    bases = [b for b in bases if b.inputs]
    if not bases:
        return None
    label = " and ".join(b.text for b in bases)
    name = f"{label} on {site.name}"
    unit = axis_unit(site.axis)
    effects = tuple(site.effect(f"{name} [{k}]" if len(bases) > 1 else name, b, unit) for k, b in enumerate(bases, 1))
    return Candidate(name, effects, "", cost, "evolved")


def parts(program: Program) -> list[Program]:
    """The program, each of its outputs alone, and all but one of three."""
    count = len(program.outputs)
    fewer = {size: list(combinations(range(count), size)) for size in range(1, count)}
    return [program, *(program.select(chosen) for chosen in chain(*fewer.values()))]


def without_poles(criteria: Criteria, candidate: Candidate, measured: States, between: Columns) -> bool:
    """Whether its bases stay of one size between the measured poses; a quotient that passes a pole there does not."""
    for effect in candidate.effects:
        for term in effect.terms:
            largest = float(np.max(np.abs(term.basis(between))))
            if not largest <= criteria.largest_between * float(np.max(np.abs(term.basis(measured)))):
                return False
    return True


def expression_text(program: Program, names: Mapping[str, str]) -> str:
    """A one-output program as one line of arithmetic over the table's columns.

    A program that is a bare input is that input unscaled: its coefficient takes the scale up.
    """
    infix = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/", "modulo": "%"}
    if len(program.nodes) == 1 and program.nodes[0].operator == "input":
        return str(program.nodes[0].value)
    texts: list[str] = []
    for node in program.nodes:
        arguments = [texts[k] for k in node.arguments]
        if node.operator == "input":
            texts.append(names[str(node.value)])
        elif node.operator == "constant":
            texts.append(f"({float(node.value or 0.0):.5g})")
        elif node.operator in infix:
            texts.append(f"({arguments[0]} {infix[node.operator]} {arguments[1]})")
        else:
            texts.append(f"{node.operator}({', '.join(arguments)})")
    return ast.unparse(ast.parse(texts[program.outputs[0]], mode="eval"))


def referenced(
    inputs: tuple[str, ...], tried: Mapping[str, list[Evolution]], by_chance: list[Evolution],
    saved: Callable[[Evolution], float], significance: float,
) -> Histogram:  # fmt: skip
    """The histogram of referenced inputs of real runs beside that of runs on shuffled residuals.

    Runs on one residual agree even where there is only noise, so counting them is not enough: an input's p-value is the
    larger of the count's and of the chance that a shuffled run saves as much as the best run that references it.
    """

    def count(runs: list[Evolution], name: str) -> int:
        return sum(name in run.best.program.inputs for run in runs)

    null = np.array([saved(run) for run in by_chance])
    real = [run for runs in tried.values() for run in runs]
    by_count, by_strength = [], []
    for name in inputs:
        yes, chance_yes = count(real, name), count(by_chance, name)
        table = [[yes, len(real) - yes], [chance_yes, len(by_chance) - chance_yes]]
        best = max((saved(run) for run in real if name in run.best.program.inputs), default=-np.inf)
        by_count.append(min(1.0, len(inputs) * float(stats.fisher_exact(table, "greater").pvalue)))
        by_strength.append(min(1.0, len(inputs) * chance(best, null).p))
    p_values = tuple(map(max, by_count, by_strength))
    return Histogram(
        inputs=inputs,
        linear=tuple(count(tried.get("linear", []), name) for name in inputs),
        tree=tuple(count(tried.get("tree", []), name) for name in inputs),
        shuffled=tuple(count(by_chance, name) for name in inputs),
        p_values=p_values,
        significant=tuple(n for n, p in zip(inputs, p_values, strict=True) if p < significance),
        count_p=tuple(by_count),
        strength_p=tuple(by_strength),
        runs=len(real),
        shuffled_runs=len(by_chance),
    )
