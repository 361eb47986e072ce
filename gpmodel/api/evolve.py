"""Evolve compensators or basis functions by genetic programming, and count the inputs of the evolved programs."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pandas as pd

from gpmodel.api.arguments import (
    MechanismLike,
    brief,
    check_choice,
    check_function,
    check_integer,
    check_limit,
    check_list,
    check_share,
    check_texts,
    file_path,
    mechanism_of,
)
from gpmodel.api.calibrate import distinct_poses, named_group, split
from gpmodel.api.model import Model, load_model
from gpmodel.api.results import save_record, write_results
from gpmodel.api.table import Shown, TableLike, aligned
from gpmodel.application.compensator import TrainingProblem, cartesian_task, slot_task
from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Models, steps_of
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.input_histogram import Histogram, histogram
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation, label
from gpmodel.evolution.runs import KeptRuns, Plan, Run, run_all
from gpmodel.evolution.settings import Budget, SelectionScheme, Settings, thesis_settings
from gpmodel.evolution.tree import Tree
from gpmodel.executor import Forks, Workers
from gpmodel.extras import extra_for
from gpmodel.files import write_text
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import standard_effects
from gpmodel.progress import Reporter, Say, silent
from gpmodel.report import words
from gpmodel.report.build import Ladder
from gpmodel.report.from_discovery import compensation, from_evolution
from gpmodel.report.origin import Origin
from gpmodel.report.schema import STANDARD, Report
from gpmodel.report.schema_search import CompensationRecord
from gpmodel.wording import left_out

Space = Literal["cartesian", "slot"]
POPULATIONS = {"cartesian": {"linear": 65536, "tree": 8192}, "slot": {"linear": 1024, "tree": 512}}
"""Number of programs in the population of a run.
For compensators, the number of sequences is that of Robertson (2003), 5.2.2; an eighth as many trees take equal time.
At a frame (slot of an error), one formula of one input is sought, and smaller populations suffice.
"""
GENERATIONS = 100
"""Number of generations of a run. Robertson (2003) gives none; after 100 the programs of a population are alike."""
UNLIMITED, NO_END = 1_000_000, 1e9
"""Largest number of generations of a run with a time limit, and longest time, s, of a run without a limit."""


@dataclass(frozen=True)
class Effort:
    """Requested size of a run of genetic programming and the selection scheme; None for the defaults."""

    population: int | None = None
    generations: int | None = None
    seconds: float | None = None
    selection: SelectionScheme | None = None


def evolved(value: object) -> tuple[Representation, ...]:
    """Check that `strategies` are program representations with different names; otherwise raise InputError."""
    chosen: list[Representation] = []
    for strategy in check_list(value, "strategies", "(gp.Linear(), gp.Tree())"):
        if isinstance(strategy, type) or not isinstance(strategy, Representation):
            raise InputError(f"{brief(strategy)}, expected gpmodel.Linear(...) or gpmodel.Tree(...)", "strategies")
        chosen.append(strategy)
    if not chosen:
        raise InputError("(), expected gpmodel.Linear(), gpmodel.Tree() or both", "strategies")
    for name, count in Counter(map(label, chosen)).items():
        if count > 1:
            raise InputError(f"{count} are called '{name}', expected each name once", "strategies")
    return tuple(chosen)


def selecting(value: object, argument: str) -> SelectionScheme:
    """Check that a value is a selection scheme of genetic programming; otherwise raise InputError."""
    if isinstance(value, type) or not isinstance(value, SelectionScheme):
        raise InputError(f"{brief(value)}, expected gpmodel.Truncation(...) or gpmodel.Tournament(...)", argument)
    return value


def default_strategies(space: Space) -> tuple[Linear | Tree, ...]:
    """Return the default program representations: those of Robertson (2003) for Cartesian space, gpmodel's for
    frames."""
    return (Linear.thesis(), Tree.thesis()) if space == "cartesian" else (Linear(), Tree())


def settings_for(space: Space, strategies: Sequence[Representation], effort: Effort) -> dict[str, Settings]:
    """Return the settings of evolution by representation: for Cartesian space as in Robertson (2003), else defaults.

    Raises InputError for a population too small for the selection.
    """
    generations = effort.generations
    if generations is None:
        generations = GENERATIONS if effort.seconds is None else UNLIMITED
    seconds = NO_END if effort.seconds is None else effort.seconds
    chosen: dict[str, Settings] = {}
    for strategy in strategies:
        name = label(strategy)
        size = effort.population or POPULATIONS[space].get(name, min(POPULATIONS[space].values()))
        settings = (
            thesis_settings(strategy, size, generations)
            if space == "cartesian"
            else Settings(strategy, budget=Budget(size, generations))
        )
        budget = replace(settings.budget, seconds=seconds)
        chosen[name] = replace(settings, budget=budget, selection=effort.selection or settings.selection)
    return chosen


COMMAND = "gpmodel.evolve"
Norm = Literal["max", "rms"]
SPACES: tuple[Space, ...] = get_args(Space)
NORMS: tuple[Norm, ...] = get_args(Norm)


@dataclass(frozen=True, repr=False)
class EvolutionResult(Shown):
    """Genetic programming runs on residuals and on permuted residuals, with input counts of the best programs.

    start: models fitted to the training poses; programs are evolved on the residual of the last model.
    settings: settings of evolution, one per representation.
    best: the best program on the training poses.
    """

    _with_rows = False
    runs: tuple[Run, ...]
    histogram: Histogram
    start: Ladder
    settings: tuple[str, ...]
    origin: Origin
    best: CompensationRecord

    @property
    def fit(self) -> Calibration:
        """The fitted model on whose residual programs are evolved."""
        return self.start.final

    @cached_property
    def record(self) -> Report:
        """Content of report.json."""
        found = from_evolution(self.start, self.runs, self.histogram, self.origin, self.best)
        return replace(found, settings=self.settings)

    @property
    def verdict(self) -> str:
        """Verdict on the evolved programs in one sentence."""
        return self.record.verdict

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per run: representation, number of the run, shuffled (residual permuted), gain (removed share
        of the residual), heldout (gain on held-out poses), complexity (nodes), site, program."""
        columns = ["representation", "number", "shuffled", "gain", "heldout", "complexity", "site", "program"]
        return pd.DataFrame(self.runs, columns=columns)

    def front(self) -> pd.DataFrame:
        """Return the programs on each run's Pareto front of gain and length, simplest first."""
        columns = ["representation", "number", "complexity", "gain", "program"]
        rows = [(run.representation, run.number, *one) for run in self.runs if not run.shuffled for one in run.front]
        return pd.DataFrame(rows, columns=columns)

    def inputs(self) -> pd.DataFrame:
        """Return one row per input: runs using the input on residuals and on permuted residuals; corrected p-value."""
        counted = self.histogram
        columns: dict[str, object] = {"input": counted.inputs}
        for kind in counted.counts:
            columns |= {kind: counted.counts[kind], f"{kind} shuffled": counted.shuffled[kind]}
        return pd.DataFrame(columns | {"p_value": counted.p_values})

    def summary(self) -> str:
        """Return text: best program of each run, counts of inputs and operators, verdict."""
        counted = self.histogram
        best = [
            (run.representation, str(run.number + 1), f"{run.gain:.3f}",
             "-" if run.heldout is None else f"{run.heldout:.3f}", str(run.complexity), run.site)
            for run in self.runs if not run.shuffled
        ]  # fmt: skip
        rows = [
            (name, *(f"{counted.counts[kind][k]} ({counted.shuffled[kind][k]})" for kind in counted.counts),
             f"{counted.p_values[k]:.2g}")
            for k, name in enumerate(counted.inputs)
        ]  # fmt: skip
        head = ("input", *(f"{kind}, {counted.runs[kind]} runs" for kind in counted.counts), "p, corrected")
        record = self.record
        return "\n".join(
            [
                "Best program of each run",
                aligned([("", "run", "gain", "held out", "nodes", "site"), *best]),
                "\nRuns whose best program contains each input (in brackets: on permuted residuals)",
                aligned([head, *rows]),
                "\nRuns whose best program contains each operator",
                aligned(words.operators(record.histograms[0])),
                words.removed(record),
                *([left_out(record.data.outliers, record.data.poses)] if record.data.outliers else []),
                f"significant inputs: {words.significant_inputs(counted)}",
            ]
        )

    def programs(self) -> str:
        """Return the best evolved program of every run on the residual, one per line."""
        lines = [f"{r.representation} {r.number + 1}: {r.program}" for r in self.runs if not r.shuffled]
        return "\n".join(lines) + "\n"

    def report(self, folder: str | Path) -> None:
        """Write programs.txt, report.json, report.html and figures into `folder`; on an error nothing is written."""
        write_results(self.record, folder, lambda draft: write_text(draft / "programs.txt", self.programs()))

    def save(self, file: str | Path) -> None:
        """Write report.json to `file`. Raises InputError if the file cannot be written."""
        save_record(self.record, file)

    def __repr__(self) -> str:
        found = words.significant_inputs(self.histogram)
        return f"<{len(self.runs)} runs on {self.start.poses.dataset.source}: significant inputs: {found}>"


def evolve(
    mechanism: MechanismLike,
    table: TableLike,
    *,
    model: str | Path | Model | None = None,
    effects: Sequence[str | Effect] = (),
    strategies: Sequence[Representation] | None = None,
    space: Space = "cartesian",
    runs: int = 5,
    population: int | None = None,
    generations: int | None = None,
    seconds: float | None = None,
    selection: SelectionScheme | None = None,
    norm: Norm = "max",
    standard: Sequence[str] = ("*",),
    holdout: float = 0.3,
    workers: int = 0,
    executor: Workers | None = None,
    seed: int = 0,
    kept: KeptRuns | None = None,
    progress: Say = silent,
    command: str = COMMAND,
) -> EvolutionResult:
    """Evolve programs on the residual of a model, and on permuted residuals for comparison (thesis, chapter 5).

    mechanism, table: objects, or names and paths.
    model: result of `calibrate` or `discover`, or the folder or file of a result. A given model is refitted to the
    training poses. With None, programs are evolved on the residual of the standard model.
    effects: named effects of the model, as in `calibrate`.
    space: "cartesian" for compensators of the tool point, "slot" for basis function and site of an effect.
    strategies: representations of programs, Linear and Tree; None for the default representations of the space.
    runs: number of runs of each representation.
    population, generations, seconds: size and time limit of one run; None for the defaults (65536 sequences, 8192
    trees; 1024 and 512 at a slot; 100 generations).
    selection: gp.Truncation or gp.Tournament; None for the best 5 % as in the thesis, and for tournaments at a slot.
    norm: "max" or "rms" of a compensator's errors, mm. Outliers of the model are left out.
    workers, executor, kept: see `discover`. Raises InputError for an argument out of range.
    """
    fraction, seed, count = check_share(holdout, "holdout"), check_integer(seed, "seed"), check_integer(runs, "runs", 1)
    space, norm = check_choice(space, SPACES, "space"), check_choice(norm, NORMS, "norm")
    check_function(progress, "progress")
    with extra_for("gpmodel.evolve"):
        import gpmodel.evolution.kernels.compiler  # noqa: F401
    side_by_side = Forks(check_integer(workers, "workers")) if executor is None else executor
    effort = _effort(population, generations, seconds, selection)
    settings = settings_for(space, default_strategies(space) if strategies is None else evolved(strategies), effort)
    arm, named = mechanism_of(mechanism), check_list(effects, "effects", "['base_compliance']")
    patterns = check_texts(standard, "standard", "('J* R?',)")
    known = standard_effects(arm, patterns) if model is None else _effects_of(model, arm, patterns)
    arm, poses = distinct_poses(arm, table, tuple(e for e in known if e.constant))
    models = _models(known, [named_group(effect, arm, poses) for effect in named])
    (train, held), started = split(poses.dataset, fraction, seed), time.perf_counter()
    start = _start(poses, train, models, (arm, seed))
    task = _task(start, held, norm, space, seed)
    done = _finished(Plan(settings, count, seed), task, side_by_side, kept or KeptRuns(), Reporter(progress))
    counted = histogram([run.record() for run in done], task.problem.inputs.names, Criteria().input_significance)
    origin = Origin(command, seed, time.perf_counter() - started)
    asked = (f"space {space}, norm {norm}", *map(repr, settings.values()))
    return EvolutionResult(done, counted, start, asked, origin, compensation(done, task.problem))


def _effects_of(model: object, arm: Mechanism, standard: tuple[str, ...]) -> tuple[Effect, ...]:
    """Return the effects of a saved model; raise InputError if the joints are not those of `arm`, or if `standard` is
    given."""
    if standard != ("*",):
        raise InputError(
            "patterns cannot be combined with a model, which fixes the geometry; expected no patterns", "standard"
        )
    known = model if isinstance(model, Model) else load_model(file_path(model, "model"), arm)
    if [j.name for j in known.mechanism.joints] != [j.name for j in arm.joints]:
        raise InputError(f"a model of {known.mechanism.name}; expected a model of {arm.name}", "model")
    return known.saved.model.effects


def _models(known: tuple[Effect, ...], groups: Models) -> Models:
    """Return the geometric model and, with further effects, the whole model; raise InputError for a repeated effect."""
    geometry, effects = (tuple(e for e in known if e.constant == side) for side in (True, False))
    groups = [*((e.name, (e,)) for e in effects), *groups]
    effects = tuple(effect for _, group in groups for effect in group)
    names = [effect.name for effect in effects]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"'{twice[0]}' appears twice, expected each effect once", "effects")
    whole = [(", ".join(name for name, _ in groups), (*geometry, *effects))] if groups else []
    return [(STANDARD, geometry), *whole]


def _task(start: Ladder, held: IntArray, norm: Norm, space: Space, seed: int) -> TrainingProblem:
    """Return the problem of genetic programming for the residual of the training poses."""
    if space == "cartesian":
        train, held = (np.setdiff1d(rows, start.outliers) for rows in (start.train, held))
        return cartesian_task(start.final, start.poses, train, held, norm)
    return slot_task(start.final, start.final.model.mechanism, start.of_final, seed)


def _start(poses: Poses, train: IntArray, models: Models, how: tuple[Mechanism, int]) -> Ladder:
    """Fit models to the training poses. how: mechanism and random seed."""
    arm, seed = how
    seen, unseen = poses.subset(train), poses.subset(np.setdiff1d(np.arange(len(poses)), train))
    fits = [(name, calibrate(ErrorModel(arm, of), seen, seed=seed)) for name, of in models]
    named = tuple(e for e in models[-1][1] if e not in models[0][1])
    gross = calibrate(ErrorModel(arm, models[-1][1]), poses, seed=seed).outliers.tolist()
    return Ladder(poses, train, steps_of(fits, seen, unseen), fits[-1][1], named, final_rows=train, gross=tuple(gross))


def _finished(
    plan: Plan, task: TrainingProblem, workers: Workers, kept: KeptRuns, tell: Reporter
) -> tuple[Run, ...]:  # fmt: skip
    """Execute planned runs of genetic programming, with a progress message after each finished run."""
    tasks = plan.tasks(task.problem)

    def said(done: int) -> None:
        tell(f"evolving, {done} of {len(tasks)} runs done", passing=True)

    finished = run_all(tasks, workers, kept, said)
    runs = {number: plan.run(number, found, task.problem, task.heldout) for number, found in finished}
    return tuple(runs[number] for number in tasks)


def _effort(population: object, generations: object, seconds: object, selection: object) -> Effort:
    """Return the requested size of a run of genetic programming; raise InputError for the first invalid number."""
    return Effort(
        None if population is None else check_integer(population, "population", 4),
        None if generations is None else check_integer(generations, "generations"),
        check_limit(seconds, "seconds", 0.0),
        None if selection is None else selecting(selection, "selection"),
    )
