"""Many runs of the search, the same again on shuffled residuals, kept on disk as they finish."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.errors import InputError
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.input_histogram import RunRecord
from gpmodel.evolution.problems import CartesianProblem, Problem
from gpmodel.evolution.search import Evolution, Generation, evolve
from gpmodel.evolution.settings import Settings
from gpmodel.files import write_text
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

SCHEMA = 1


@dataclass(frozen=True)
class Run:
    """One finished run, as text and numbers. ``heldout`` is the gain on poses it never saw, None without."""

    representation: str
    number: int
    shuffled: bool
    program: str
    site: str
    gain: float
    heldout: float | None
    complexity: int
    strength: float
    evaluations: int
    seconds: float
    history: dict[str, list[float]]

    def record(self) -> RunRecord:
        """What the histogram of referenced inputs counts of it."""
        return RunRecord(self.representation, self.shuffled, parse(self.program), self.strength)


def strength_of(evolution: Evolution, problem: Problem) -> float:
    """What the best program explains, comparable between runs: nats for a slot, -log(1 - gain) for a compensator."""
    best = evolution.best
    if isinstance(problem, CartesianProblem):
        return float(fit_nats(best.gain, components=2))
    return float(problem.nats(best.gain, best.complexity + len(best.coefficients)))


@dataclass(frozen=True)
class Plan:
    """What to run: as many `runs` of each named setting, each beside one on a shuffled residual, from one seed."""

    settings: Mapping[str, Settings]
    runs: int
    seed: int


def run_all(
    problem: Problem,
    plan: Plan,
    heldout: Callable[[Program], float] | None = None,
    finished: Sequence[Run] = (),
    progress: Callable[[str, int, bool, Generation], None] | None = None,
) -> Iterator[Run]:
    """The runs of a plan, yielded as they finish; those in ``finished`` as they are.

    heldout: gain of a program on poses that no run sees. Every run has a random stream of its own, by the seed, its
    name and its number: what is left to do gives the same numbers.
    """
    known = {(run.representation, run.number, run.shuffled): run for run in finished}
    for name, choice in plan.settings.items():
        for number in range(plan.runs):
            for shuffled in (False, True):
                key = (name, number, shuffled)
                if key in known:
                    yield known[key]
                    continue
                rng = np.random.default_rng([plan.seed, len(name), number, shuffled])
                tried = problem.shuffled(rng) if shuffled else problem
                report = None if progress is None else _reporter(progress, *key)
                found = evolve(tried, choice, rng, report)
                best = found.best
                validation = heldout(best.program) if heldout and not shuffled else best.validation
                yield Run(
                    *key, str(best.program), best.site_name, best.gain, validation, best.complexity,
                    strength_of(found, tried), found.evaluations, found.seconds,
                    {quantity: column.tolist() for quantity, column in found.history.items()},
                )  # fmt: skip


def _reporter(
    progress: Callable[[str, int, bool, Generation], None], representation: str, number: int, shuffled: bool
) -> Callable[[Generation], None]:
    return lambda state: progress(representation, number, shuffled, state)


def save_runs(path: Path, request: dict[str, Any], runs: Sequence[Run]) -> None:
    """Write finished runs, with what was asked, as text."""
    content = {"schema": SCHEMA, "request": request, "runs": [asdict(run) for run in runs]}
    write_text(path, json.dumps(content))


def load_runs(path: Path, request: dict[str, Any]) -> list[Run]:
    """Finished runs of the same request; none where the file does not exist yet.

    Raises InputError where the file is damaged or belongs to another request.
    """
    if not path.exists():
        return []
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        asked, runs = content["request"], [Run(**run) for run in content["runs"]]
    except (ValueError, KeyError, TypeError, OSError, RecursionError) as error:
        raise InputError(f"{path} cannot be read ({error}); expected one written by evolve", "checkpoint") from None
    differing = sorted(key for key in request.keys() | asked.keys() if request.get(key) != asked.get(key))
    if content.get("schema") != SCHEMA or differing:
        raise InputError(
            f"{path} is of another request ({', '.join(differing) or 'schema'} differ); "
            "expected the same table and options, or a new file",
            "checkpoint",
        )
    return runs
