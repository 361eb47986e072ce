"""report.json as a tree of frozen records, schema 3: the result of a calibration, a discovery or an evolution.

Field names are the keys of the file. Fields ending in `_mm` are in millimetres; every other value is SI, with its unit
in a separate field. Joints and inputs have their names in the table. A number that was not computed is None.
"""

from dataclasses import dataclass, field
from statistics import median
from typing import Literal

from gpmodel.application.further import ErrorBounds
from gpmodel.arrays import Count, NotNegative, Share
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.runs import Run
from gpmodel.hierarchy.further import ALONE, PRIOR
from gpmodel.numerics.rank import RankChoice
from gpmodel.report.schema_search import (
    CandidateRecord,
    CompensationRecord,
    Correlation,
    EffectRecord,
    InstrumentRecord,
    PlotRecord,
    Positioning,
    Range,
    ReadingRecord,
    Repeatability,
    RoundRecord,
)
from gpmodel.wording import counted

SCHEMA = 3
"""Version of report.json: schema 3 stores histograms, runs of programs and the curve of error against rank."""
REGISTRATION, STANDARD = "registration", "standard"
VISIBLE = 1e-3
"""Relative difference from which two RMS errors are both stated: the last printed digit."""
MOST_REJECTED = 5
"""Largest number of rejected candidate effects in a report."""
NoiseSource = Literal["repeats", "instrument", "specification", "drift"]
Kind = Literal["calibrate", "discover", "evolve"]


@dataclass(frozen=True)
class ErrorsMm:
    """Statistics of 3-D errors over a set of poses, mm; all None for an empty set."""

    mean_mm: NotNegative | None = None
    rms_mm: NotNegative | None = None
    max_mm: NotNegative | None = None

    @property
    def known(self) -> bool:
        """True if errors of at least one pose are known."""
        return self.rms_mm is not None


@dataclass(frozen=True)
class PredictedRecord:
    """3-D errors, mm, of `gpmodel predict`: with `--session` (fields `as_measured`) or without an option.

    heldout: errors at held-out poses, by fits without these poses. model: errors at all poses, by model.json, which is
    fitted to all poses. `predict --session` includes instrument errors, and row k is predicted for the time of row k of
    the session. `predict` without an option omits instrument errors, and predicts for the end of the session.
    """

    heldout_as_measured: ErrorsMm = ErrorsMm()
    heldout: ErrorsMm = ErrorsMm()
    model_as_measured: ErrorsMm = ErrorsMm()
    model: ErrorsMm = ErrorsMm()

    @property
    def differs(self) -> bool:
        """True if the RMS error of `predict` without an option differs visibly from that of `predict --session`."""
        session, plain = self.model_as_measured.rms_mm, self.model.rms_mm
        return session is not None and plain is not None and abs(plain - session) > VISIBLE * session


@dataclass(frozen=True)
class StepRecord:
    """Errors of one model in a sequence of growing models. effect: index in `effects` of the effect that the model
    adds. rank: effective number of unknowns."""

    step: str
    train: ErrorsMm = ErrorsMm()
    heldout: ErrorsMm = ErrorsMm()
    rank: Count | None = None
    dropped: tuple[str, ...] = ()
    effect: Count | None = None

    @property
    def beyond_standard(self) -> bool:
        """True if the model contains effects in addition to the standard model."""
        return self.step not in (REGISTRATION, STANDARD)

    @property
    def errors(self) -> ErrorsMm:
        """Errors of the model at held-out poses, or at training poses if no poses were held out."""
        return self.heldout if self.heldout.known else self.train


@dataclass(frozen=True)
class DataRecord:
    """Record of the measured table.

    poses: number of rows; different: number of different poses.
    train, heldout: number of training rows and of held-out rows.
    folds: number of folds if every pose was held out once.
    outliers: row numbers of outliers in the final fit or in the last fit to training poses.
    ranges: measured range of every joint.
    marks: digest of each row; rows with equal joint values and measurements have equal digests in all tables.
    """

    file: str = ""
    sha256: str = ""
    poses: Count = 0
    different: Count = 0
    train: Count = 0
    heldout: Count = 0
    folds: Count = 0
    outliers: tuple[int, ...] = ()
    ranges: tuple[Range, ...] = ()
    marks: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """Name of the rows of the table: poses or measurements."""
        return "rows" if 0 < self.different < self.poses else "poses"

    @property
    def counted(self) -> str:
        """Number of measured poses as text, with the number of rows if the table has more rows than poses."""
        return counted(self.different, self.poses)


@dataclass(frozen=True)
class MechanismRecord:
    """The mechanism of a report. joints: joint names in the table. sliding: names of the prismatic joints.
    tip_at_probe_m: position of the measured link at fixed joint values, m, which identifies the mechanism."""

    name: str = ""
    joints: tuple[str, ...] = ()
    tip_at_probe_m: tuple[float, float, float] | None = None
    sliding: tuple[str, ...] = ()


@dataclass(frozen=True)
class ParameterRecord:
    """One parameter of the fitted model, SI units.

    stderr: standard error of the value. A parameter held at zero has kept = False; its stderr is the standard deviation
    of its prior if no measurement depends on the parameter, and None if other parameters absorb the parameter.
    """

    name: str
    value: float | None = None
    stderr: NotNegative | None = None
    unit: str = "1"
    unique_share: Share | None = None
    kept: bool = True
    correlated_with: tuple[Correlation, ...] = ()


@dataclass(frozen=True)
class MimicRecord:
    """A constant of the standard model and a catalogue effect that move the measured points equally, by their names."""

    constant: str
    rival: str


@dataclass(frozen=True)
class ExportRecord:
    """An exported file of the model.

    rms_mm, max_mm: differences from `predict` at random poses within the measured ranges.
    heldout_rms_mm: RMS error of the file on held-out poses.
    missing: effects that the file cannot contain.
    """

    file: str
    what: str = ""
    rms_mm: NotNegative | None = None
    max_mm: NotNegative | None = None
    heldout_rms_mm: NotNegative | None = None
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """The content of the file report.json.

    kind: function that made the report: calibrate, discover or evolve. settings: settings of an evolution.
    noise_floor_mm: 3-D RMS of the instrument alone; noise_from: its source; drift: unknown, since repeats drift.
    stopped: reason for the end of the search.
    placement: tool point in the flange frame and root pose in the instrument's frame; rotations as vectors.
    unobservable: effects absorbed by joint values that are solved at every pose.
    hidden: sentences on effects equivalent to constants of the standard model; mimics: names of equivalent pairs.
    further: expected errors at further poses. predicted: errors of predictions.
    discrepancy_mm: standard deviation of one coordinate due to missing effects (model discrepancy).
    readings: residuals of measurements other than points, by kind; unseen: quantities that are not determined, if no
    positions were measured.
    sigma_mm: standard deviation of one component from the fit; freedom: degrees of freedom of sigma_mm.
    model_sha256: digest of the model.json that belongs to the report.
    """

    command: str = ""
    schema: int = SCHEMA
    kind: Kind = "discover"
    versions: dict[str, str] = field(default_factory=dict)
    seed: int = 0
    data: DataRecord = DataRecord()
    mechanism: MechanismRecord = MechanismRecord()
    ladder: tuple[StepRecord, ...] = ()
    effects: tuple[EffectRecord, ...] = ()
    histograms: tuple[Histogram, ...] = ()
    rounds: tuple[RoundRecord, ...] = ()
    runs: tuple[Run, ...] = ()
    settings: tuple[str, ...] = ()
    compensation: CompensationRecord | None = None
    parameters: tuple[ParameterRecord, ...] = ()
    placement: tuple[ParameterRecord, ...] = ()
    rank_curve: tuple[RankChoice, ...] = ()
    condition_limit: NotNegative | None = None
    status: str = ""
    reason: str = ""
    stopped: str = ""
    sigma_mm: NotNegative | None = None
    discrepancy_mm: NotNegative | None = None
    freedom: NotNegative | None = None
    model_sha256: str = ""
    noise_floor_mm: NotNegative | None = None
    noise_from: NoiseSource | None = None
    instrument: InstrumentRecord | None = None
    repeatability: Repeatability | None = None
    positioning: Positioning | None = None
    further: ErrorBounds | None = None
    predicted: PredictedRecord | None = None
    confirmation: Confirmation | None = None
    unobservable: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    mimics: tuple[MimicRecord, ...] = ()
    readings: tuple[ReadingRecord, ...] = ()
    unseen: tuple[str, ...] = ()
    exports: tuple[ExportRecord, ...] = ()
    plots: PlotRecord = field(default_factory=PlotRecord)
    verdict: str = ""
    seconds: NotNegative | None = None

    @property
    def held(self) -> bool:
        """True if any model of the report has errors at held-out poses."""
        return any(rung.heldout.known for rung in self.ladder)

    def step(self, name: str) -> StepRecord | None:
        """Return the calibration step with the given name, such as "standard", or None."""
        return next((rung for rung in self.ladder if rung.step == name), None)

    def title(self, rung: StepRecord) -> str:
        """Return the title of a calibration step for a heading."""
        if rung.effect is not None and rung.effect < len(self.effects):
            return f"+ {self.effects[rung.effect].name}"
        standard = "standard model" if self.step(ALONE) is None else PRIOR
        return {REGISTRATION: "registration only", STANDARD: standard}.get(rung.step, rung.step)

    def turn_mrad(self, rung: StepRecord) -> float | None:
        """Return the RMS angle between measured and modelled orientation after a step of the calibration, mrad.
        Without measured orientations, and for models between standard and last model, the RMS angle is None."""
        last = self.ladder and rung.step == self.ladder[-1].step
        return self.plots.turned("final" if last else rung.step, self.data.outliers)[1]

    @property
    def orientation(self) -> tuple[float, float] | None:
        """RMS orientation error before and after calibration, mrad; None without measured orientations."""
        kinds = (kind for kind in self.readings if kind.unit == "mrad")
        return next(((k.before, k.after) for k in kinds if k.before is not None and k.after is not None), None)

    def before_and_after(self) -> tuple[str, str]:
        """Return the names of the two compared models: standard model and last model. Without effects in addition to
        the standard model, registration and standard model are compared."""
        names = [rung.step for rung in self.ladder] or [STANDARD]
        before = STANDARD if self.ladder and self.ladder[-1].beyond_standard and STANDARD in names else names[0]
        return before, names[-1]

    @property
    def shipped(self) -> str:
        """Name of the step whose model is saved: the standard model if held-out poses do not confirm the findings."""
        refused = self.confirmation is not None and not self.confirmation.passed
        return STANDARD if refused else self.before_and_after()[1]

    def geometry(self) -> tuple[ParameterRecord, ...]:
        """Return the fitted geometric parameters, without parameters of named or found effects."""
        effects = tuple(e.name for e in self.effects)
        return tuple(p for p in self.parameters if p.kept and not p.name.startswith(effects or ("\0",)))

    @property
    def rejected(self) -> tuple[CandidateRecord, ...]:
        """Rejected candidates that are significant and lower the cross-validated error, the largest gain first."""
        last = {c.name: c for r in self.rounds for c in r.candidates}
        named = {effect.name for effect in self.effects}
        undecided = (c for c in last.values() if c.undecided and c.name not in named)
        return tuple(sorted(undecided, key=lambda c: -(c.nats or 0.0))[:MOST_REJECTED])

    def removed(self, shuffled: bool) -> float | None:
        """Return the median share of the error norm that the best evolved programs explain; None without evolution."""
        gains = [run.gain for run in self.runs if run.shuffled == shuffled]
        return median(gains) if gains else None

    def dropped(self) -> tuple[str, ...]:
        """Return the names of the parameters that the measured poses do not determine; the final model holds them at
        zero."""
        listed = tuple(p.name for p in self.parameters if not p.kept)
        return listed or (self.ladder[-1].dropped if self.ladder else ())

    def histogram_of(self, effect: EffectRecord) -> Histogram | None:
        """Return the histogram of the round that found an effect, or None."""
        if effect.round is None or not 1 <= effect.round <= len(self.histograms):
            return None
        return self.histograms[effect.round - 1]
