"""What the loop found: findings, rounds, the ladder of models."""

from dataclasses import dataclass

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.explore import Exploration
from gpmodel.evidence.confirmation import Confirmation
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import FittedConstant
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses


@dataclass(frozen=True)
class Finding:
    """An accepted hypothesis and the round that found it."""

    hypothesis: Hypothesis
    round: int

    @property
    def candidate(self) -> Candidate:
        """What was found."""
        return self.hypothesis.candidate


@dataclass(frozen=True)
class Round:
    """One look at the residual: what GP made of it, then the groups chosen together, and what was dropped again.

    hypotheses: all that was judged, groups first. evolved: what GP found that was offered as groups from here on.
    null_nats: (T,) the most that any group gains on permuted residuals.
    """

    number: int
    hypotheses: tuple[Hypothesis, ...]
    exploration: Exploration
    evolved: tuple[Candidate, ...]
    null_nats: Array
    dropped: tuple[str, ...] = ()

    @property
    def stands_out(self) -> bool:
        """Whether anything in it is beyond chance, whatever the other tests say."""
        return bool(self.exploration.histogram.significant) or any(h.verdict.passed("chance") for h in self.hypotheses)


@dataclass(frozen=True)
class FinalFit:
    """The fit to all poses; the findings as they are in it, and the constants inside each, in their order."""

    calibration: Calibration
    candidates: tuple[Candidate, ...]
    constants: tuple[tuple[FittedConstant, ...], ...]


@dataclass(frozen=True)
class Discovery:
    """Everything the loop found, in order.

    fitted: all findings, fitted to all poses. confirmation: of them on the held-out poses, None without findings.
    final: the model to ship, that of `fitted` where it is confirmed, else the standard model as a calibration of all
    poses without any discovery would have it. parts: the same choice without each fold of the poses, where every one
    was held out once; none where some are for good.
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

    @property
    def folds(self) -> int:
        """How many parts of the poses were held out in turn; 0 where one is for good."""
        return len(self.parts)

    def step(self, number: int) -> Step:
        """A step of the ladder; of fewer the last stands for further ones."""
        return self.steps[min(number, len(self.steps) - 1)]

    @property
    def found(self) -> Calibration:
        """The model with all findings, fitted to all poses."""
        return self.fitted.calibration

    @property
    def confirmed(self) -> bool:
        """Whether the held-out poses bear out all that was added; nothing added is nothing to doubt."""
        return self.confirmation is None or self.confirmation.passed
