"""State of a search for effects, and its result: rounds, findings, and growing models."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step, known_rows
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, without_outlier_marks
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.explore import Exploration
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.evolution.runs import KeptRuns
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Offer
from gpmodel.families.inner import FittedConstant
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.progress import Reporter
from gpmodel.table.blocks import FOLD_SEED, copies, sharing


@dataclass(frozen=True)
class Finding:
    """An accepted hypothesis (candidate effect that passed all tests) and the number of the round that found it."""

    hypothesis: Hypothesis
    round: int

    @property
    def candidate(self) -> Candidate:
        """Candidate effect of the finding."""
        return self.hypothesis.candidate


@dataclass(frozen=True)
class Round:
    """A round of the search: evolved programs, tested groups of the selection, and findings that were dropped.

    evolved: programs that are candidate groups from this round on.
    formulas: all formulas proposed for smooth terms.
    """

    number: int
    hypotheses: tuple[Hypothesis, ...]
    exploration: Exploration
    evolved: tuple[Candidate, ...]
    dropped: tuple[str, ...] = ()
    formulas: tuple[Candidate, ...] = ()

    @property
    def stands_out(self) -> bool:
        """True if any candidate or input of the round exceeds chance, regardless of the other tests."""
        return bool(self.exploration.histogram.significant) or any(h.verdict.passed("chance") for h in self.hypotheses)


@dataclass(frozen=True)
class FinalFit:
    """Fit to all poses: findings, their nonlinear constants, and effects of changes of the constants."""

    calibration: Calibration
    candidates: tuple[Candidate, ...]
    constants: tuple[tuple[FittedConstant, ...], ...]
    changes: Mapping[str, tuple[Effect, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Discovery:
    """Result of a search for missing effects.

    fitted: all findings, fitted to all poses.
    confirmation: test of the findings on held-out poses; None without findings.
    final: model to save: the model `fitted` if confirmed, else the standard model fitted to all poses.
    parts: results of the loop repeated without each fold; empty if a fixed set of poses is held out.
    alone: for a further machine of a type, the fit to its poses without the prior of the type.
    loads: loads that were fitted in the place of the declared ones, in words; empty for the declared loads.
    """

    mechanism: Mechanism
    poses: Poses
    train: IntArray
    heldout: IntArray
    steps: tuple[Step, ...]
    findings: tuple[Finding, ...]
    rounds: tuple[Round, ...]
    fitted: FinalFit
    final: Calibration
    confirmation: Confirmation | None
    standard_model: tuple[Effect, ...]
    seconds: float
    stopped: str
    parts: tuple["Discovery", ...] = ()
    alone: tuple[Step, ...] = ()
    loads: str = ""

    @property
    def folds(self) -> int:
        """Number of folds of poses that are held out in turn; 0 for one fixed held-out set."""
        return len(self.parts)

    def step(self, number: int) -> Step:
        """Return the record of model `number` of the growing models, or of the last model for larger numbers."""
        return self.steps[min(number, len(self.steps) - 1)]

    @property
    def found(self) -> Calibration:
        """The model with all findings, fitted to all poses."""
        return self.fitted.calibration

    @property
    def confirmed(self) -> bool:
        """True if the held-out poses confirm the findings, or if there are no findings."""
        return self.confirmation is None or self.confirmation.passed


Division = tuple[Poses, IntArray, IntArray]
"""Type of a division of a table: poses, row numbers for training, and numbers of the held-out rows."""


def usable_rows(poses: Poses, train: IntArray, heldout: IntArray, say: Reporter) -> Division:
    """Return poses and rows for a search. Raises InputError if no held-out pose has a known set-up and tool."""
    poses, train, heldout = drop_duplicate_rows(poses, train, heldout, say)
    if not len(heldout):
        return poses, train, heldout
    data = poses.dataset
    known = heldout[known_rows(data.subset(train), data.subset(heldout))]
    if not len(known):
        raise InputError(
            f"{data.source}: every held-out pose has a set-up or tool without training poses; expected groups "
            "of poses that lie within set-ups and tools, or another share to hold out"
        )
    if len(known) == len(heldout):
        return poses, train, heldout
    say(f"{len(heldout) - len(known)} held-out poses have a set-up or tool without training poses: left out")
    return _only(poses, train, known)


def drop_duplicate_rows(poses: Poses, train: IntArray, heldout: IntArray, say: Reporter) -> Division:
    """Drop table rows that copy another row, since a copy would count twice."""
    copied = copies(poses.dataset)
    if not copied.any():
        return poses, train, heldout
    say(f"{copied.sum()} rows are exact copies of the measurement of another row: left out")
    return _only(poses, train[~copied[train]], heldout[~copied[heldout]])


def evenly(poses: Poses, rows: IntArray, size: int) -> IntArray:
    """Sample about `size` of some rows: a random pose of each stretch of rows, with its repeats.

    All rows are returned if a sample would omit a third or less. The sampled poses are random, because every k-th pose
    of a grid could have a single value of a joint.
    """
    if 2 * len(rows) <= 3 * size:
        return rows
    pose_id = sharing(poses.subset(rows).dataset)
    count = int(pose_id.max()) + 1
    stretch = np.arange(count) * size // len(rows)
    drawn = np.lexsort((np.random.default_rng(FOLD_SEED).random(count), stretch))
    return rows[np.isin(pose_id, drawn[np.unique(stretch, return_index=True)[1]])]


def _only(poses: Poses, train: IntArray, heldout: IntArray) -> Division:
    """Keep the poses of the training and test rows, and renumber the rows."""
    kept = np.sort(np.concatenate([train, heldout]))
    return poses.subset(kept), np.searchsorted(kept, train), np.searchsorted(kept, heldout)


@dataclass
class State:
    """State of a search for effects: findings, rounds, and growing models.

    standard: effects of the model without known effects and findings. seed: seed of evolution. ends: end of the search
    time, on the clock of time.monotonic. errors_alone: compute errors only, see `loop.discover`.
    """

    mechanism: Mechanism
    poses: Poses
    train: IntArray
    heldout: IntArray
    standard: ErrorModel
    known_effects: tuple[Candidate, ...]
    offers: tuple[Offer, ...]
    search: Search
    criteria: Criteria
    condition_limit: float | None
    seed: int
    say: Reporter
    kept: KeptRuns
    ends: float = math.inf
    errors_alone: bool = False
    findings: list[Finding] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)

    @cached_property
    def sample(self) -> IntArray:
        """Training rows on which effects are selected."""
        return evenly(self.poses, self.train, self.search.scored_poses)

    @property
    def found(self) -> tuple[Candidate, ...]:
        """Candidate effects of the findings, in order."""
        return tuple(f.candidate for f in self.findings)

    @property
    def evolved(self) -> tuple[Candidate, ...]:
        """Candidates from genetic programming that the selection may use."""
        return tuple(c for r in self.rounds for c in r.evolved)

    @property
    def late(self) -> bool:
        """True if the time limit of the search is reached."""
        return time.monotonic() > self.ends

    @property
    def repeating(self) -> bool:
        """True if the last round changed no finding; a small first round that exceeds the permuted null is repeated."""
        last = self.rounds[-1] if self.rounds else None
        if last is None or last.dropped or any(f.round == last.number for f in self.findings):
            return False
        return not (self.opening(last.number) and self.search.runs and last.stands_out)

    def opening(self, number: int) -> bool:
        """Return whether a round is the first one of a search with a catalogue, which has a small budget."""
        return bool(self.offers) and number == 1

    def model(self, found: Sequence[Candidate], further: tuple[Effect, ...] = ()) -> ErrorModel:
        """Return the standard model with the known effects, the findings `found`, and further effects."""
        effects = [e for c in (*self.known_effects, *found) for e in c.effects]
        return replace(self.standard, effects=(*self.standard.effects, *effects, *further))

    def fit(self, model: ErrorModel, start: Calibration | None = None) -> Calibration:
        """Fit a model to the training poses, starting from the fit `start`, and determine the outliers of the fit."""
        return self._fit(model, self.train, start)

    def fit_sample(self, model: ErrorModel, start: Calibration | None = None) -> Calibration:
        """Fit a model to the sample of training poses on which effects are selected."""
        return self._fit(model, self.sample, start)

    def _fit(self, model: ErrorModel, rows: IntArray, start: Calibration | None) -> Calibration:
        again = without_outlier_marks(start) if start else None
        limit = self.condition_limit
        return calibrate(model, self.poses.subset(rows), condition_limit=limit, start=again, seed=FOLD_SEED)

    def to_all(self, model: ErrorModel, start: Calibration) -> Calibration:
        """Fit a model to all poses, starting from a fit, with the condition limit found on the training poses."""
        return calibrate(model, self.poses, condition_limit=start.condition_limit, start=start, seed=FOLD_SEED)

    def standard_to_all(self) -> Calibration:
        """Fit the standard model with the known effects to all poses, with the condition limit for all poses."""
        return calibrate(self.model(()), self.poses, condition_limit=self.condition_limit, seed=FOLD_SEED)
