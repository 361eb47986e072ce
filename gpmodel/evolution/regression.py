"""Symbolic regression of any table: programs are bred under link functions of the response, then the best ones further.

Under every link function (``gpmodel.evolution.links``) a population of linear sequences is bred, with the coefficients
of four outputs solved together. The formulas of the best programs are founders of one population of formulas of the
response itself (``gpmodel.evolution.memetic``).
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import chain, count

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError
from gpmodel.evolution.between import PointsBetween
from gpmodel.evolution.code import Code, Scores
from gpmodel.evolution.constants import polish
from gpmodel.evolution.engine import values
from gpmodel.evolution.formulas import formulas_at
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.links import LINKS, PRICE, LinkFunction, below_the_bar, scaled
from gpmodel.evolution.memetic import Formulas, evolve_formulas
from gpmodel.evolution.origins import Origins, rounding_share
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets, regression
from gpmodel.evolution.representation import Population, program_of
from gpmodel.evolution.scoring import projected_scores
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program

EXACT = 1e-20
"""Share of the response's variance below which a residual is a rounding error (rounding errors: about 1e-28)."""
PROMISING = 1.0 - 1e-7
"""Gain above which the formula of a program is tested for exactness at once."""
ROWS = 100
"""Table rows that are searched: ROWS (1 + seconds of computing time). Of a longer table random rows are searched; the
constants of the best formulas are fitted to all rows afterwards."""
FINISHING, FOUNDERS = 0.15, 12
"""Share of the computing time in which the best formulas are bred further, formulas of one term are searched, or
formulas are fitted to all rows of a long table; number of formulas that are bred further."""
PASSES = 2
"""Number of least-squares solutions of a quotient, each weighted by the denominator of the previous solution."""
MOST_INPUTS = 2
"""Largest number of inputs of a problem in which formulas of one term are searched at the end, under the best link
function."""
SEQUENCES = Linear(operators="physics", constants=(1.0, 2.0, np.pi), own_constants=1, outputs=4, registers=6)
BUDGET = Budget(population=512, restart_after=40)
"""Limits of the evolution of one population under a link function."""
COMPILING = 10
"""Number of time checks of the small search that compiles the loops: one generation and the last steps."""


@dataclass(frozen=True)
class Law:
    """A formula of a response. left: share of the response's variance in the residual and in poles of the formula
    between the rows. nats: description length, nats."""

    program: Program
    left: float
    nats: float

    @property
    def length(self) -> int:
        """Number of nodes and constants of the formula."""
        return self.program.complexity + len(self.program.constants)

    def written(self, program: Program) -> "Law":
        """Return the formula with an equivalent program."""
        other = replace(self, program=program)
        return replace(other, nats=self.nats + PRICE * (other.length - self.length))


def regression_front(
    inputs: Inputs,
    response: Array,
    rng: np.random.Generator,
    seconds: float = 5.0,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Law, ...]:
    """Return formulas of a response (points,) that fit better than all shorter ones; the mean of the response is first.

    The search ends after ``seconds``, or once the first exact formula is shortened. Description length: points / 2
    ln(share of variance) + PRICE (nodes + constants), with the share in the residual and in explosions between the rows
    (``gpmodel.evolution.between``). Each link function gets one generation in turn; a population without progress is
    replaced by a random one. A table of more than ROWS (1 + seconds) rows is searched on random rows. Inputs with a
    constant value are left out. Raises InputError if the response is constant or not finite.
    """
    regression(response)
    _compile_loops()
    began = clock()
    response = np.asarray(response, dtype=float)
    origins = Origins.of(inputs, response)
    exact = max(EXACT, *map(rounding_share, (*inputs.values, response)))
    inputs, response = origins.differences(inputs), response - origins.response
    some = np.sort(rng.permutation(len(response))[: round(ROWS * (1.0 + seconds))])
    varying = inputs.select([name for name in inputs.names if np.ptp(inputs[name][some]) > 0] or inputs.names[:1])
    few = replace(varying, values=varying.values[:, some])
    if not np.ptp(response[some]):
        raise InputError(f"response: constant in {len(some)} random rows, nothing to explain")
    between = PointsBetween(few.mapping(), float(response.var()), np.random.default_rng(0))
    is_long = len(some) < len(response)
    search_seconds = (1.0 - FINISHING * is_long) * seconds
    judged = _Judge(few.mapping(), response[some], between, exact)
    found = _searched(few, judged, rng, lambda share: clock() - began > share * search_seconds)
    if is_long:
        judged, targets = replace(judged, columns=inputs.mapping(), response=response), _plain(response)
        front, found = sorted(_front(found), key=lambda law: law.nats), []
        for law in front:
            again = law.program if clock() - began > seconds else polish(law.program, targets, 0, judged.columns)[0]
            found += judged([again])
    return _front(law.written(origins.restored(law.program)) for law in _front(found, judged.is_sound))


@cache
def _compile_loops() -> None:
    """Run a search on a small table once per process, so that compilation does not count as time of a search."""
    rng = np.random.default_rng(0)
    inputs, response = Inputs(("a", "b"), rng.uniform(1.0, 2.0, (2, 12))), rng.uniform(1.0, 2.0, 12)
    between = PointsBetween(inputs.mapping(), float(response.var()), rng)
    asked = count()
    judged = _Judge(inputs.mapping(), response, between, EXACT)
    _searched(inputs, judged, rng, lambda share: next(asked) > COMPILING)


def _searched(
    inputs: Inputs, judged: "_Judge", rng: np.random.Generator, is_past: Callable[[float], bool]
) -> list[Law]:
    """Return the formulas of a search: programs are bred under all link functions, the best formulas further.
    is_past: function that returns whether a share of the computing time is over."""
    response = judged.response
    found = judged(map(parse, ("1", *map(repr, inputs.names))))
    problem = SlotProblem(inputs, _plain(response), PRICE, lambda: is_past(1.0))
    islands = [_Island(problem, response, link, rng) for link in LINKS if link.applies(response)]
    for island in islands:
        found += judged(island.formulas([[]]))
    has_short = len(inputs.names) <= MOST_INPUTS
    while not is_past(1.0 - FINISHING * (1 + has_short)) and not judged.has_exact(found):
        for island in islands:
            found += judged(island.step(islands))
    if not judged.has_exact(found):
        every = [judged(island.every()) for island in islands]
        found += chain.from_iterable(every)
        least = [min((law.nats for law in some), default=np.inf) for some in every]
        if has_short and not problem.is_over():
            found += judged(islands[int(np.argmin(least))].short())
    found += judged(_finished(found, problem, judged.between))
    return found


def _front(laws: Iterable[Law], allows: Callable[[Law], bool] = lambda _: True) -> tuple[Law, ...]:
    """Return the allowed formulas that fit better than all shorter allowed formulas, shortest first."""
    front: list[Law] = []
    for law in sorted(laws, key=lambda law: (law.length, law.left)):
        if (not front or law.left < front[-1].left) and allows(law):
            front.append(law)
    if not front:
        raise InputError("regress: no program is finite on these inputs")
    return tuple(front)


def _plain(response: Array) -> Targets:
    """Return the response as one site with unit sensitivity and without an intercept."""
    ones, nothing = np.ones((1, len(response))), np.zeros((1, 1, len(response)))
    energy = float(response @ response)
    return Targets(ones, nothing, response[None], energy, ("response",), len(response), ROUNDING_SHARE)


@dataclass(frozen=True)
class QuotientProblem(SlotProblem):
    """Search for a quotient: the outputs of a program are terms of its numerator and of its denominator."""

    response: Array = field(default_factory=lambda: np.zeros(0))

    def scores(self, code: Code, fixed: Array, cutoff: float = np.inf) -> Scores:
        """Return description length and gain of decoded programs; each output may enter a quotient's numerator and
        denominator."""
        outputs = values(code, fixed).copy()
        under = below_the_bar(outputs, self.response)
        offered = np.concatenate([outputs, under], axis=1)
        scores = projected_scores(offered.copy(), code, len(fixed), self.targets, self.parsimony)
        divided = np.flatnonzero(scores.chosen >> outputs.shape[1])
        if len(divided):
            some, chosen = offered[divided], scores.chosen[divided]
            gain = 1.0 - self._share_left(some, (chosen[:, None] >> np.arange(some.shape[1])) & 1 == 1)
            size = (scores.complexity[divided] + np.bitwise_count(chosen)).astype(float)
            scores.score[divided] = np.minimum(-self.nats(gain, size), 0.0)
            scores.gain[divided] = np.where(scores.score[divided] < 0.0, gain, 0.0)
        return scores

    def _share_left(self, offered: Array, chosen: Mask) -> Array:
        """Return for each program the share of the response's variance in the residual of its quotient.

        offered: terms of numerator and denominator, (programs, terms, points). chosen: terms in use. The denominator
        scales the errors; each iteration divides errors by the previous denominator (Sanathanan and Koerner 1963).
        """
        programs, columns, points = offered.shape
        table = np.concatenate([np.ones((programs, 1, points)), np.where(chosen[:, :, None], offered, 0.0)], axis=1)
        with np.errstate(all="ignore"):
            table /= np.maximum(np.abs(table).max(axis=2, keepdims=True), 1e-300)
            table[~np.isfinite(table).all(axis=(1, 2))] = 0.0
            used = np.any(table, axis=2)
            idle = np.eye(columns + 1) * np.where(used, 1e-13 * points, 1.0)[:, None]
            left, weight = np.ones(programs), np.ones((programs, points))
            for _ in range(PASSES):
                weighted = table * weight[:, None]
                gram = weighted @ table.swapaxes(1, 2) + idle
                solution = np.linalg.solve(gram, (weighted @ self.response)[:, :, None])
                parts, half = solution * table, 1 + columns // 2
                below = 1.0 - parts[:, half:].sum(axis=1) / self.response
                rest = np.square(self.response - parts[:, :half].sum(axis=1) / below).sum(axis=1)
                weight = np.nan_to_num(1.0 / np.square(below), posinf=0.0)
                weight /= np.maximum(
                    weight.max(axis=1, keepdims=True), 1e-300
                )  # since ``idle`` is relative to weights of 1
                left = np.fmin(left, rest / self.energy)
        return left

    @cached_property
    def energy(self) -> float:
        """Sum of squares of the response about its mean."""
        return float(np.sum(np.square(self.response - self.response.mean())))


class _Island:
    """A population of programs under one link function."""

    def __init__(self, plain: SlotProblem, response: Array, link: LinkFunction, rng: np.random.Generator) -> None:
        self.link, self.columns, self.response = link, plain.inputs.mapping(), response
        targets = link.targets(self.columns, response)
        self.problem: SlotProblem = (
            QuotientProblem(plain.inputs, targets, PRICE, plain.is_over, response)
            if link.quotient
            else replace(plain, targets=targets)
        )
        self.run = Generations(self.problem, Settings(SEQUENCES, budget=BUDGET), rng)
        self.run.step()

    def best(self) -> list[Population]:
        """Return the program with the least description length as a population of one; empty without a program."""
        kept = self.run.archive.kept
        nats = {k: float(self.problem.nats(one.gain, k + one.chosen.bit_count())) for k, one in kept.items()}
        return [kept[max(nats, key=nats.__getitem__)].population] if kept else []

    def step(self, islands: Iterable["_Island"]) -> Iterator[Program]:
        """Breed one generation, or restart with programs of the other populations; return formulas that may have no
        residual."""
        others = (other for other in islands if other is not self and self.run.is_stuck)
        improved = self.run.step([one for other in others for one in other.best()])
        return self._of_sizes(size for size in improved if self.run.archive.kept[size].gain > PROMISING)

    def short(self) -> Iterator[Program]:
        """Return sums of one further term and the terms that are in all formulas under the link function."""
        if self.link.quotient:
            return self.formulas([])
        return self.formulas([one.program] for one in formulas_at(self.problem, 0, self.problem.inputs.names))

    def every(self) -> Iterator[Program]:
        """Return the formula of the best program of each size."""
        return self._of_sizes(self.run.archive.kept)

    def _of_sizes(self, sizes: Iterable[int]) -> Iterator[Program]:
        count = self.run.layout.outputs
        for one in [self.run.archive.kept[size] for size in sizes]:
            program = program_of(one.population, 0, self.run.layout)
            above, below = ([program.select([k]) for k in range(count) if one.chosen >> k + s & 1] for s in (0, count))
            yield from self.formulas([above], below)

    def formulas(self, sets: Iterable[list[Program]], below: list[Program] | None = None) -> Iterator[Program]:
        """Yield the formula of each set of terms, if the coefficients of the set can be solved."""
        for terms in sets:
            formula = self.link.formula(terms, self.columns, self.response, below or [])
            if formula is not None:
                yield formula


def _finished(laws: Iterable[Law], problem: SlotProblem, between: PointsBetween) -> Iterator[Program]:
    """Return formulas bred from the shortest descriptions, with constants fitted to the response itself."""
    share = between.variance * problem.targets.poses / problem.targets.energy
    population = Formulas(problem, loss=lambda program, factor: share * between.loss(program, factor))
    population.add(law.program for law in sorted(laws, key=lambda law: law.nats)[:FOUNDERS])
    evolve_formulas(population, problem.inputs.names, 1)
    return (one.program for one in population.found)


@dataclass(frozen=True)
class _Judge:
    """Test of programs as formulas of a response. columns: values of the inputs. between: points between the rows.
    exact: share of the response's variance below which a residual is a rounding error."""

    columns: dict[str, Array]
    response: Array
    between: PointsBetween
    exact: float

    def has_exact(self, laws: Iterable[Law]) -> bool:
        """Return whether the residual of a formula is a rounding error."""
        return any(law.left < self.exact for law in laws)

    def is_sound(self, law: Law) -> bool:
        """Return whether a formula has no pole between the rows, or is exact at the rows."""
        rest = self.response - law.program.evaluate(self.columns)[0]
        return float(rest @ rest) < self.exact * self._energy or not self.between.has_pole(law.program)

    @cached_property
    def _energy(self) -> float:
        return float(np.sum(np.square(self.response - self.response.mean())))

    def __call__(self, programs: Iterable[Program]) -> list[Law]:
        """Convert programs with finite values to formulas, each multiplied by its best factor."""
        found, response = list[Law](), self.response
        for program in programs:
            fit = program.evaluate(self.columns)[0]
            with np.errstate(all="ignore"):
                size = float(fit @ fit)
            if not np.isfinite(size) or size <= 0:
                continue
            factor = float(fit @ response) / size
            left = float(np.sum(np.square(response - factor * fit))) / self._energy + self.between.loss(program, factor)
            law = Law(scaled(program, factor), left, 0.0)
            nats = 0.5 * len(response) * float(np.log(max(left, self.exact))) + PRICE * law.length
            found.append(replace(law, nats=nats))
        return found
