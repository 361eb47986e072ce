"""Parallel runs of genetic programming on a residual and on permuted residuals, each stored as it finishes."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from gpmodel.arrays import Count, NotNegative
from gpmodel.errors import InputError
from gpmodel.evolution.description_length import gain_nats
from gpmodel.evolution.input_histogram import RunRecord
from gpmodel.evolution.problems import CartesianProblem, Problem
from gpmodel.evolution.representation import label
from gpmodel.evolution.search import Evolution, evolve
from gpmodel.evolution.settings import Settings
from gpmodel.executor import Workers
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program

Number = tuple[int, int]
"""Key of a run: index of its round or of its representation, and index of the run in the round."""


class KeptRuns:
    """Storage of finished evolution runs, so that an interrupted search repeats only unfinished runs. This base class
    stores nothing."""

    def run(self, number: Number) -> Evolution | None:
        """Return the stored run with the given number, or None if the run has not finished."""
        return None

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Store a finished evolution run. Raises WriteError if the run cannot be written."""


@dataclass(frozen=True)
class Task:
    """Data of one evolution run for a worker process. shuffled: whether to permute the residual over the poses."""

    problem: Problem
    settings: Settings
    rng: np.random.Generator
    shuffled: bool = False


def run_task(task: Task) -> Evolution:
    """Execute one run of genetic programming; its result does not depend on the process."""
    problem = task.problem.shuffled(task.rng) if task.shuffled else task.problem
    return evolve(problem, task.settings, task.rng)


_loaded: set[str] = set()
"""Names of the representations whose compiled loops this process has loaded."""


def load_loops(task: Task) -> None:
    """Load the compiled loops of a run, once per process; forked processes inherit the loaded loops. Loading compiled
    loops takes a thousandth of the time of a run."""
    kind = label(task.settings.representation)
    if kind not in _loaded:
        _loaded.add(kind)
        budget = replace(task.settings.budget, population=64, generations=1, climb=0)
        with suppress(InputError):
            evolve(task.problem, replace(task.settings, budget=budget), np.random.default_rng(0))


def run_all(
    tasks: Mapping[Number, Task], workers: Workers, kept: KeptRuns, said: Callable[[int], None]
) -> Iterator[tuple[Number, Evolution]]:
    """Yield every evolution run with its number: stored runs first, then other runs as they finish and are stored.
    said: function called with the number of finished runs, first at the start; its exceptions end the search."""
    found = {number: run for number in tasks if (run := kept.run(number)) is not None}
    left = [number for number in tasks if number not in found]
    said(len(found))
    yield from found.items()
    if left:
        load_loops(tasks[left[0]])
    for done, (place, run) in enumerate(workers(run_task, [tasks[number] for number in left]), len(found) + 1):
        kept.keep_run(left[place], run)
        said(done)
        yield left[place], run


@dataclass(frozen=True)
class Plan:
    """Plan of evolution runs: for each named setting `runs` runs on the residual and as many on permuted residuals."""

    settings: Mapping[str, Settings]
    runs: int
    seed: int

    def tasks(self, problem: Problem) -> dict[Number, Task]:
        """Return the task of every evolution run. A task's key is a pair: index of the setting, and twice the index of
        the run, plus one if the residual is permuted.
        The random stream of a task depends on the seed, on the name of the setting, on the index of the run, and on
        whether the residual is permuted."""
        tasks = {}
        for place, (name, settings) in enumerate(self.settings.items()):
            for number in range(self.runs):
                for shuffled in (False, True):
                    rng = np.random.default_rng([self.seed, crc32(name.encode()), number, shuffled])
                    tasks[place, 2 * number + shuffled] = Task(problem, settings, rng, shuffled)
        return tasks

    def run(
        self, number: Number, found: Evolution, problem: Problem, heldout: Callable[[Program], float] | None
    ) -> "Run":
        """Return the text record of a finished run. heldout: function that returns the share of the residual at
        held-out poses that a program removes."""
        best, shuffled = found.best, bool(number[1] % 2)
        return Run(
            tuple(self.settings)[number[0]], number[1] // 2, shuffled, str(best.program), best.site_name, best.gain,
            known(heldout(best.program) if heldout and not shuffled else None), best.complexity,
            strength_of(found, problem), found.evaluations, found.seconds,
            {quantity: [known(v) for v in column.tolist()] for quantity, column in found.history.items()},
            tuple((s.complexity, s.gain, str(s.program)) for s in found.front),
        )  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One finished run of the evolution, as text and numbers.

    heldout: removed share of the residual at held-out poses, None without held-out poses.
    front: complexity (nodes), gain (removed share of the residual) and text of each program with a larger gain than all
    simpler programs, simplest first.
    """

    representation: str
    number: Count
    shuffled: bool
    program: str
    site: str
    gain: float
    heldout: float | None
    complexity: Count
    strength: float
    evaluations: Count
    seconds: NotNegative
    history: dict[str, list[float | None]]
    front: tuple[tuple[Count, float, str], ...] = ()

    def record(self) -> RunRecord:
        """Return the record of the run for the histogram of referenced inputs."""
        return RunRecord(self.representation, self.shuffled, parse(self.program), self.strength)


def known(value: float | None) -> float | None:
    """Return a finite number, or None if the number is not finite."""
    return value if value is not None and np.isfinite(value) else None


def strength_of(evolution: Evolution, problem: Problem) -> float:
    """Return the strength of a run's best program, which is comparable between runs: the decrease of the description
    length in nats at a site, or -log(1 - gain) for a compensator."""
    best = evolution.best
    if isinstance(problem, CartesianProblem):
        return float(gain_nats(best.gain))
    return float(problem.nats(best.gain, best.complexity + len(best.coefficients)))
