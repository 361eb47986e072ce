"""Records of a search in report.json: findings, rejected candidates, counts."""

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
    """3-D errors, mm, of the training and of the held-out poses, each in the order of the rows."""

    train: tuple[float | None, ...] = ()
    heldout: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class ShapeRecord:
    """Partial residual of an effect over its first input, at the poses of the `rows` of the file, and the fitted curve
    where it reads that input alone."""

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
    """rows: (N,) rows of the file. points_mm: (N, 3) nominal positions in the mechanism's root frame.

    residual_mm: measured minus modelled (N, 3) in the same frame, of "registration", "standard" and "final".
    turn_mrad: angle (N,) between measured and modelled orientation, of the same; empty where none was measured.
    error_mm: by step of the ladder. chain_mm: the slots' origins (S, 3) of the poses `chain_poses`, to draw the arm.
    slots: their names.
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
        """Number of held-out poses, or of all where none are, with an angle of that name, and its RMS, mrad.

        outliers: rows of the file that do not count.
        """
        held, angles = any(self.heldout_mask), self.turn_mrad.get(name, ())
        each = zip(angles, self.heldout_mask, self.rows, strict=True) if angles else ()
        known = [a for a, out, row in each if a is not None and out >= held and row not in outliers]
        return len(known), math.sqrt(sum(a**2 for a in known) / len(known)) if known else None


@dataclass(frozen=True)
class ReadingRecord:
    """Readings of one kind: how many rows, and the RMS in their own unit of what registration and the last step leave
    of them, held out where any are."""

    name: str
    unit: str
    rows: Count
    before: NotNegative | None = None
    after: NotNegative | None = None


@dataclass(frozen=True)
class Repeatability:
    """ISO 9283 (1998) pose repeatability RP = l + 3 S_l, l the distances of repeats from their mean; over the poses.

    rms_mm: of these distances. rp_stderr_mm: standard uncertainty of the mean; None of one pose.
    """

    poses: Count
    measurements: Count
    rms_mm: NotNegative
    rp_mean_mm: NotNegative
    rp_max_mm: NotNegative
    rp_stderr_mm: NotNegative | None = None


@dataclass(frozen=True)
class Positioning:
    """ISO 9283 (1998) pose accuracy AP, the distance of the mean of a pose's repeats from where it should be: with the
    nominal geometry before, with the model after; mean over the poses with its standard uncertainty, and the largest.

    heldout: whether of poses that the model was not fitted to.
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
    """The specification of the instrument as it was given; limit_mm: of a coordinate at the typical distance of the
    poses, noise_mm: the standard deviation of a coordinate that it leads to expect."""

    specification: str
    limit_mm: NotNegative
    noise_mm: NotNegative


NOTICED = 0.01
"""Least relative fall of the cross-validated error by a listed rejected candidate: the last printed digit."""
SIGNIFICANT = ("chance", "nats")
"""Tests of significance; the others ask how well a candidate predicts."""


@dataclass(frozen=True)
class Correlation:
    """Another unknown and its correlation with this one."""

    name: str
    correlation: Annotated[float, Meta(ge=-1 - ROUNDING, le=1 + ROUNDING)]


@dataclass(frozen=True)
class Range:
    """Between which values of an input the model was trained, in `unit`."""

    input: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class RivalRecord:
    """Another candidate in the credible set of a finding, and the cross-validated RMS with it in its place."""

    name: str
    cv_rms_mm: NotNegative | None = None


@dataclass(frozen=True)
class CauseRecord:
    """A cause in the credible set of a finding, and its probability.

    names: of candidates that no measurement at these poses distinguishes, the most probable first. own: the finding is
    one of them.
    """

    names: tuple[str, ...]
    probability: Share
    own: bool = False


@dataclass(frozen=True)
class TermRecord:
    """One term of an effect: weight times basis along an axis of a slot."""

    slot: str
    axis: str
    basis: str
    weight: float = 1.0


@dataclass(frozen=True)
class MovedRecord:
    """By how much an effect moves the measured point, mm: points (K, 3) and displacements (K, 3) in the root frame.

    anywhere: at joint values anywhere within the limits; else at measured poses.
    """

    anywhere: bool = False
    points_mm: Vectors = ()
    moves_mm: Vectors = ()


@dataclass(frozen=True)
class FormulaRecord:
    """A formula of the Pareto front at a finding's site: that no shorter one equals in gain.

    nodes: its length. nats: gain in log likelihood with everything else in the model. taken: it is the finding.
    """

    basis: str
    nodes: Count
    nats: float
    taken: bool = False


@dataclass(frozen=True)
class TestRecord:
    """One test of the acceptance rule: what was measured, the limit it was held against, whether it passed."""

    __test__ = False
    name: str
    value: float | None
    limit: float | None
    passed: bool


@dataclass(frozen=True)
class EffectRecord:
    """An enabled effect: value ± stderr times basis, at slot and axis, and what speaks for it.

    kind: single, harmonic, vector or curve, as of a candidate; of a curve the value is the RMS over the measured poses.
    stderr: of the value, by the noise and over what the other findings could be in their places.
    causes: the 95 % credible set, the most probable first; None if not computed. without_name: probability in the
    set that the cause has no name. rivals: the other candidates in the set, with their cross-validated error. p_value:
    chance of it among `shuffles` of what was `shuffled`. gain: share of the residual energy that it removes where
    everything else is in the model.
    tool_rms_mm, tool_max_mm, tool_turn_mrad: how far it moves the measured point over the measured poses, and by what
    angle it turns the tool, RMS; alone_rms_mm: of that what
    nothing else in the model, registration and tool included, takes up; workspace_*: at joint values
    anywhere within the limits. of_specification: of an error of the instrument, how many times its specification it
    moves the readings by, RMS. ranges: of its inputs, as trained. constants: inside its law. front: formulas to choose
    among, the shortest first. moved: displacements
    pose by pose.
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
    shuffled: str = "shuffles"
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
        """One line."""
        size = measured(self.value, self.stderr, self.unit)
        return f"<effect {self.name}: {size} at {self.slot} {self.axis}, {shortened(self.basis, 60)}>"

    @property
    def repair(self) -> RepairAdvice | None:
        """Sign on the machine, check by hand, clause of a standard and what compensation can do; None of a finding that
        is of no family."""
        return repair_advice().get(self.catalogue or "")

    @property
    def probability(self) -> float | None:
        """Probability of the finding and of what no measurement distinguishes from it; None if not computed."""
        if self.causes is None:
            return None
        return next((cause.probability for cause in self.causes if cause.own), self.without_name)

    @property
    def others(self) -> tuple[CauseRecord, ...]:
        """Other causes in the credible set."""
        return tuple(cause for cause in self.causes or () if not cause.own)

    @property
    def alike(self) -> tuple[str, ...]:
        """Names that no measurement at these poses distinguishes from the finding."""
        return tuple(name for cause in self.causes or () if cause.own for name in cause.names if name != self.name)

    @property
    def stderr_over_causes(self) -> float | None:
        """Root mean square deviation of the amount from the value, which is zero where another is the cause:
        √(p σ² + (1 - p) value²). Source: Hoeting et al. (1999), variance within and between models."""
        if self.probability is None or self.value is None or self.stderr is None:
            return None
        return float((self.probability * self.stderr**2 + (1.0 - self.probability) * self.value**2) ** 0.5)


@dataclass(frozen=True)
class CandidateRecord:
    """Something that was tried: its score, and why it was added or not.

    cv_rms_mm, cv_before_mm: cross-validated 3-D RMS with it and without.
    """

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
    """One look at the residual. null_nats: the best of each search on shuffled residuals. dropped: taken out again."""

    round: Count = 0
    candidates: tuple[CandidateRecord, ...] = ()
    null_nats: tuple[float, ...] = ()
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class CompensationRecord:
    """The best program at the training poses.

    columns: (K, N) of the inputs that it refers to. values: (m, N) of its outputs.
    """

    run: str = ""
    inputs: tuple[str, ...] = ()
    columns: tuple[tuple[float | None, ...], ...] = ()
    outputs: tuple[str, ...] = ()
    values: tuple[tuple[float | None, ...], ...] = ()
