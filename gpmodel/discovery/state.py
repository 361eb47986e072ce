"""The running state of the loop: what is accepted so far, and the ladder it has climbed."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on, without_outlier_marks
from gpmodel.discovery.result import Finding, Round
from gpmodel.discovery.rows import evenly
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.runs import KeptRuns
from gpmodel.families.candidate import Candidate
from gpmodel.families.offer import Offer
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.progress import Teller
from gpmodel.table.split import JUDGED


class Journal(KeptRuns):
    """Where a discovery notes what it has finished, so that an interrupted one goes on to the same numbers; here
    nowhere."""

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """What is finished already. Called once, before the first line of progress."""
        return [], []

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Called after every round with all that is finished. Raises WriteError where it cannot be written."""


@dataclass
class State:
    """The loop's running state: what is accepted so far and the ladder it has climbed.

    seed: of what is evolved. ends: when the time is up, on the clock of time.monotonic. errors_alone: as of the loop.
    """

    mechanism: Mechanism
    poses: Poses
    train: IntArray
    heldout: IntArray
    standard: tuple[Effect, ...]
    known_effects: tuple[Candidate, ...]
    offers: tuple[Offer, ...]
    search: Search
    criteria: Criteria
    condition_limit: float | None
    seed: int
    say: Teller
    journal: Journal
    ends: float = math.inf
    errors_alone: bool = False
    findings: list[Finding] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)

    @cached_property
    def sample(self) -> IntArray:
        """The training rows that choices are made on."""
        return evenly(self.poses, self.train, self.search.scored_poses)

    @property
    def found(self) -> tuple[Candidate, ...]:
        """The findings' candidates, in order."""
        return tuple(f.candidate for f in self.findings)

    @property
    def evolved(self) -> tuple[Candidate, ...]:
        """What GP found so far that is offered as groups."""
        return tuple(c for r in self.rounds for c in r.evolved)

    @property
    def late(self) -> bool:
        """Whether the time is up."""
        return time.monotonic() > self.ends

    @property
    def repeating(self) -> bool:
        """Whether another round would see what the last one saw: that neither found nor dropped anything, whatever was
        evolved in it. Where an opening round's small search sees more than chance and finds nothing, a whole one may.
        """
        last = self.rounds[-1] if self.rounds else None
        if last is None or last.dropped or any(f.round == last.number for f in self.findings):
            return False
        return not (self.opening(last.number) and self.search.runs and last.stands_out)

    def opening(self, number: int) -> bool:
        """Whether a round has the small search of a first one beside what the catalogue offers."""
        return bool(self.offers) and number == 1

    def model(self, found: Sequence[Candidate]) -> ErrorModel:
        """The standard model with what is known and what was found."""
        effects = [e for c in (*self.known_effects, *found) for e in c.effects]
        return ErrorModel(self.mechanism, (*self.standard, *effects))

    def fit(self, model: ErrorModel, start: Calibration | None = None) -> Calibration:
        """A model fitted to the training poses; start: a fit to go on from, its outliers judged anew."""
        return self._fit(model, self.train, start)

    def fit_sample(self, model: ErrorModel, start: Calibration | None = None) -> Calibration:
        """The same, of the poses that choices are made on."""
        return self._fit(model, self.sample, start)

    def _fit(self, model: ErrorModel, rows: IntArray, start: Calibration | None) -> Calibration:
        again = without_outlier_marks(start) if start else None
        limit = self.condition_limit
        return calibrate(model, self.poses.subset(rows), condition_limit=limit, start=again, seed=JUDGED)

    def to_all(self, model: ErrorModel, start: Calibration) -> Calibration:
        """A model fitted to all poses, with the condition limit that the training poses chose."""
        return calibrate(model, self.poses, condition_limit=start.condition_limit, start=start, seed=JUDGED)

    def standard_to_all(self) -> Calibration:
        """The standard model with what is known, as a calibration of all poses by themselves has it: on the training
        poses another condition limit may have been the best."""
        return calibrate(self.model(()), self.poses, condition_limit=self.condition_limit, seed=JUDGED)

    def add_rung(self, name: str, calibration: Calibration, finding: int | None = None) -> None:
        """Add a rung to the ladder: a fit with its errors on the training and the held-out poses."""
        heldout = errors_on(calibration, self.poses.subset(self.heldout)) if len(self.heldout) else np.zeros(0)
        self.steps.append(Step(name, calibration, calibration.error, heldout, finding))
