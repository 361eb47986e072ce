"""Records of a search for effects in report.json: findings, rejected candidates, counts of inputs."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from gpmodel.arrays import ROUNDING, Count, NotNegative, Share
from gpmodel.families.inner import FittedConstant
from gpmodel.families.repair_advice import RepairAdvice, repair_advice
from gpmodel.wording import measured, shortened

Vectors = tuple[tuple[float | None, ...], ...]


@dataclass(frozen=True)
class SideErrors:
    """3-D errors of the training poses and of the held-out poses, mm, each in the order of the rows."""

    train: tuple[float | None, ...] = ()
    heldout: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class ShapeRecord:
    """Partial residual of an effect over its first input, at some rows of the table.
    curve_x, curve_y: points of the fitted function of one input, if the effect depends on one input alone."""

    effect: Count
    x_name: str = "row"
    x_unit: str = "1"
    y_unit: str = ""
    x: tuple[float | None, ...] = ()
    partial: tuple[float | None, ...] = ()
    heldout: tuple[bool, ...] = ()
    rows: tuple[int, ...] = ()
    curve_x: tuple[float | None, ...] = ()
    curve_y: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class PlotRecord:
    """Data of the pictures of a report.

    rows: row numbers in the file.
    points_mm: nominal positions in the root frame.
    residual_mm: measured minus modelled position in the root frame, by step "registration", "standard" and "final".
    turn_mrad: angle between measured and modelled orientation by step; empty without measured orientations.
    error_mm: 3-D errors by step.
    chain_mm: origins of the arm's frames at the poses `chain_poses`, to draw the arm; slots: names of these frames.
    """

    rows: tuple[int, ...] = ()
    points_mm: Vectors = ()
    heldout_mask: tuple[bool, ...] = ()
    residual_mm: dict[str, Vectors] = field(default_factory=dict)
    turn_mrad: dict[str, tuple[float | None, ...]] = field(default_factory=dict)
    error_mm: dict[str, SideErrors] = field(default_factory=dict)
    shapes: tuple[ShapeRecord, ...] = ()
    slots: tuple[str, ...] = ()
    chain_poses: tuple[Count, ...] = ()
    chain_mm: tuple[Vectors, ...] = ()

    def turned(self, name: str, outliers: Collection[int]) -> tuple[int, float | None]:
        """Return the number of poses with an orientation error after the step `name`, and the RMS of the errors, mrad.
        The RMS is over held-out poses, or over all poses if none were held out. outliers: excluded row numbers."""
        held, angles = any(self.heldout_mask), self.turn_mrad.get(name, ())
        each = zip(angles, self.heldout_mask, self.rows, strict=True) if angles else ()
        known = [a for a, out, row in each if a is not None and out >= held and row not in outliers]
        return len(known), math.sqrt(sum(a**2 for a in known) / len(known)) if known else None


@dataclass(frozen=True)
class ReadingRecord:
    """Residuals of one kind of measurement: number of rows, and RMS after registration and after the last step.
    The RMS residual has the unit of the measurement, and is over held-out rows if rows were held out.
    noise: standard deviation of one component, which weighs the kind in the fit; None if not estimated."""

    name: str
    unit: str
    rows: Count
    before: NotNegative | None = None
    after: NotNegative | None = None
    noise: NotNegative | None = None


@dataclass(frozen=True)
class Repeatability:
    """Pose repeatability RP = l + 3 S_l of ISO 9283 (1998); l: mean distance of repeats from their mean position.

    rms_mm: RMS distance of repeats from their mean position. rp_stderr_mm: standard uncertainty of the mean RP.
    """

    poses: Count
    measurements: Count
    rms_mm: NotNegative
    rp_mean_mm: NotNegative
    rp_max_mm: NotNegative
    rp_stderr_mm: NotNegative | None = None


@dataclass(frozen=True)
class Positioning:
    """Pose accuracy AP of ISO 9283 (1998): distance of the mean of a pose's repeats from the modelled position.

    before: AP with the nominal geometry. after: AP with the model. AP is stated as mean over the poses with standard
    uncertainty, and as maximum. heldout: True if the model was fitted without the poses of AP.
    """

    poses: Count
    heldout: bool
    before_mm: NotNegative
    before_stderr_mm: NotNegative
    after_mm: NotNegative
    after_stderr_mm: NotNegative
    after_max_mm: NotNegative


@dataclass(frozen=True)
class InstrumentRecord:
    """The specification of the instrument as given by the user.

    limit_mm: permissible error of a coordinate at the typical distance of the poses.
    noise_mm: expected standard deviation of a coordinate.
    """

    specification: str
    limit_mm: NotNegative
    noise_mm: NotNegative


NOTICED = 0.01
"""Least relative decrease of the cross-validated error for a rejected candidate to be listed: the last printed digit.
"""
SIGNIFICANT = ("chance", "nats")
"""Names of the acceptance tests for significance; tests with other names concern prediction."""


@dataclass(frozen=True)
class Correlation:
    """Name of a fitted parameter and its correlation with the recorded parameter or effect."""

    name: str
    correlation: Annotated[float, Meta(ge=-1 - ROUNDING, le=1 + ROUNDING)]


@dataclass(frozen=True)
class Range:
    """Smallest and largest value of an effect's input in the training rows, in `unit`."""

    input: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class RivalRecord:
    """Alternative cause in the credible set of a finding, and the cross-validated RMS error with this cause."""

    name: str
    cv_rms_mm: NotNegative | None = None


@dataclass(frozen=True)
class CauseRecord:
    """A cause in the credible set of a finding, and its probability.

    names: candidates that are indistinguishable at the measured poses, the most probable first.
    own: True if the finding is among `names`. amount: value of the finding if the cause is true, relative to the fitted
    value; 0 if the cause does not contain the finding.
    """

    names: tuple[str, ...]
    probability: Share
    own: bool = False
    amount: float = 0.0


@dataclass(frozen=True)
class TermRecord:
    """One term of an error effect: weight times basis function, along an axis of a frame (slot)."""

    slot: str
    axis: str
    basis: str
    weight: float = 1.0


@dataclass(frozen=True)
class MovedRecord:
    """Displacement of the measured point by an effect, mm: points and displacements in the root frame.
    anywhere: True for random joint values within the limits, False for measured poses."""

    anywhere: bool = False
    points_mm: Vectors = ()
    moves_mm: Vectors = ()


@dataclass(frozen=True)
class FormulaRecord:
    """A formula on the Pareto front of a finding's site: it gains more log likelihood than every shorter formula.
    nodes: length of the formula. nats: gain in log likelihood, given the rest of the model. taken: True if selected."""

    basis: str
    nodes: Count
    nats: float
    taken: bool = False


@dataclass(frozen=True)
class TestRecord:
    """One acceptance test of a candidate effect: value, limit, and result (passed or failed)."""

    __test__ = False
    name: str
    value: float | None
    limit: float | None
    passed: bool


@dataclass(frozen=True)
class EffectRecord:
    """An effect in the model: value ± stderr times basis function, slot and axis, and the evidence for the effect.

    kind: single (one number), harmonic, vector or curve (smooth term, whose value is the RMS over the measured poses).
    stderr: standard error of the value, with the noise and the uncertain causes of the other findings.
    causes: the 95 % credible set of causes, the most probable first; None if not computed.
    without_name: probability of a cause outside the catalogue.
    against: reason why the fitted value is impossible. rivals: other candidates in the credible set, with the
    cross-validated error.
    p_value: probability of the gain by chance, from `shuffles` permutations. shuffled: name of the permuted items.
    gain: share of the residual sum of squares that the effect removes, given everything else in the model.
    tool_rms_mm, tool_max_mm: displacement of the measured point over the measured poses; tool_turn_mrad: RMS rotation.
    alone_rms_mm: the part of the displacement that nothing else in the model absorbs, registration and tool included.
    workspace_*: displacement at random joint values within the limits.
    of_specification: RMS of an instrument error relative to its specification.
    ranges: ranges of the inputs in training. constants: constants inside the formula.
    moved: displacement of the measured point at each pose.
    front: alternative formulas for the effect, the shortest first; longer formulas fit better.
    """

    name: str
    slot: str = ""
    axis: str = ""
    basis: str = ""
    kind: str = "single"
    inputs: tuple[str, ...] = ()
    value: float | None = None
    stderr: NotNegative | None = None
    unit: str = "1"
    unique_share: Share | None = None
    found_by: str = ""
    catalogue: str | None = None
    explanation: str = ""
    against: str = ""
    kept: bool = True
    terms: tuple[TermRecord, ...] = ()
    causes: tuple[CauseRecord, ...] | None = None
    without_name: Share = 0.0
    rivals: tuple[RivalRecord, ...] | None = None
    correlated_with: tuple[Correlation, ...] = ()
    cv_rms_mm: NotNegative | None = None
    cv_before_mm: NotNegative | None = None
    p_value: Share | None = None
    shuffles: Count | None = None
    shuffled: str = "permutations"
    tests: tuple[TestRecord, ...] = ()
    gain: float | None = None
    sign_stable: bool | None = None
    round: Count | None = None
    heldout_rms_mm: NotNegative | None = None
    tool_rms_mm: NotNegative | None = None
    alone_rms_mm: NotNegative | None = None
    tool_max_mm: NotNegative | None = None
    tool_turn_mrad: NotNegative | None = None
    workspace_rms_mm: NotNegative | None = None
    workspace_max_mm: NotNegative | None = None
    of_specification: NotNegative | None = None
    ranges: tuple[Range, ...] = ()
    constants: tuple[FittedConstant, ...] = ()
    front: tuple[FormulaRecord, ...] = ()
    moved: MovedRecord | None = None

    def __repr__(self) -> str:
        """Return one line with name, size, site and basis function of the effect."""
        size = measured(self.value, self.stderr, self.unit)
        return f"<effect {self.name}: {size} at {self.slot} {self.axis}, {shortened(self.basis, 60)}>"

    @property
    def repair(self) -> RepairAdvice | None:
        """Repair advice for the effect: symptom, manual check, clause of a standard, use of compensation; or None."""
        return repair_advice().get(self.catalogue or "")

    @property
    def probability(self) -> float | None:
        """Probability of the finding and of causes indistinguishable from the finding; None if not computed."""
        if self.causes is None:
            return None
        return next((cause.probability for cause in self.causes if cause.own), self.without_name)

    @property
    def others(self) -> tuple[CauseRecord, ...]:
        """Possible causes (of the credible set) other than the finding."""
        return tuple(cause for cause in self.causes or () if not cause.own)

    @property
    def most_probable_cause(self) -> CauseRecord | None:
        """The most probable cause of the observed error if it is not the finding, else None."""
        most = max(self.others, key=lambda cause: cause.probability, default=None)
        return most if most and most.probability > (self.probability or 0.0) else None

    @property
    def alike(self) -> tuple[str, ...]:
        """Names of effects that cannot be distinguished from the finding at the measured poses."""
        return tuple(name for cause in self.causes or () if cause.own for name in cause.names if name != self.name)

    @property
    def stderr_over_causes(self) -> float | None:
        """Root mean square deviation of the true value from the fitted value over all causes. The deviation is √(σ² +
        value² Σ p (1 - a)²) over the causes of probability p that contain the share a of the value, with σ² for causes
        with the finding alone. For causes outside the credible set the share a is 0.
        Source: Hoeting (1999), variance within and between models."""
        if self.causes is None or self.probability is None or self.value is None or self.stderr is None:
            return None
        listed = [(c.probability, c.amount) for c in self.others]
        listed.append((1.0 - self.probability - sum(p for p, _ in listed), 0.0))
        within = self.probability + sum(p for p, amount in listed if amount)
        between = sum(p * (1.0 - amount) ** 2 for p, amount in listed)
        return float((within * self.stderr**2 + between * self.value**2) ** 0.5)


@dataclass(frozen=True)
class CandidateRecord:
    """A tested candidate effect: score, and reason for acceptance or rejection.
    cv_rms_mm, cv_before_mm: cross-validated 3-D RMS with and without the candidate."""

    name: str = ""
    slot: str = ""
    axis: str = ""
    basis: str = ""
    inputs: tuple[str, ...] = ()
    gain: float | None = None
    nats: float | None = None
    cv_rms_mm: NotNegative | None = None
    cv_before_mm: NotNegative | None = None
    found_by: str = ""
    catalogue: str | None = None
    p_value: Share | None = None
    shuffles: Count | None = None
    tests: tuple[TestRecord, ...] = ()
    accepted: bool = False
    why: str = ""

    @property
    def undecided(self) -> bool:
        """True if a candidate is significant and lowers the cross-validated error, but failed another test."""
        if self.accepted or self.cv_rms_mm is None or self.cv_before_mm is None:
            return False
        passed = all(test.passed for test in self.tests if test.name in SIGNIFICANT)
        return passed and self.cv_rms_mm < (1.0 - NOTICED) * self.cv_before_mm


@dataclass(frozen=True)
class RoundRecord:
    """One round of the search. null_nats: largest log evidence gain of each search on permuted residuals, nats.
    dropped: findings removed in the round."""

    round: Count = 0
    candidates: tuple[CandidateRecord, ...] = ()
    null_nats: tuple[float, ...] = ()
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class CompensationRecord:
    """Inputs and outputs of the best evolved program at the training poses.
    columns: values of the inputs at each pose. values: values of the program's outputs at each pose."""

    run: str = ""
    inputs: tuple[str, ...] = ()
    columns: tuple[tuple[float | None, ...], ...] = ()
    outputs: tuple[str, ...] = ()
    values: tuple[tuple[float | None, ...], ...] = ()
