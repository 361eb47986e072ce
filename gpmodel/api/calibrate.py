"""Calibrate a machine: fit registration, then the standard model, then named effects."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gpmodel.api.arguments import (
    MechanismLike,
    brief,
    check_integer,
    check_limit,
    check_list,
    check_share,
    check_texts,
    errors_about,
    file_path,
    mechanism_of,
)
from gpmodel.api.fitted import FittedResult
from gpmodel.api.model import Model, model_file
from gpmodel.api.table import TableLike, read_table, specified
from gpmodel.application.further import with_discrepancy
from gpmodel.application.model_file import check_table, load_model, saved_model
from gpmodel.application.over_causes import ball_priors
from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step, fit_steps, nested_models
from gpmodel.calibration.gauss_newton import calibrate as fit_model
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.tool_point import find_lever, hang_payload
from gpmodel.calibration.undeclared import apart_from_effects
from gpmodel.checks.judge import refuse, rounding_of
from gpmodel.checks.warnings import poor_fit
from gpmodel.errors import InputError
from gpmodel.families.by_name import check_defined, effects_named
from gpmodel.hierarchy.further import further_machine
from gpmodel.hierarchy.record import FleetPart, fleet_file, read_fleet
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import in_mechanism_names, names_of, standard_effects, translate
from gpmodel.report.build import Ladder
from gpmodel.report.effects import from_calibration
from gpmodel.report.origin import Origin
from gpmodel.report.schema import Report
from gpmodel.table.blocks import copies, hold_out
from gpmodel.table.dataset import Dataset

COMMAND = "gpmodel.calibrate"


@dataclass(frozen=True, repr=False)
class CalibrationResult(FittedResult):
    """Calibration of a machine: fits of registration, of the standard model and of each added effect.

    note: sentences added to the verdict of the report.
    """

    calibrated: Ladder
    origin: Origin
    note: str = ""

    @cached_property
    def record(self) -> Report:
        """Content of report.json without the errors of exported files, which the function `export` adds."""
        ladder = replace(self.calibrated, saved=self.model.saved)
        record = replace(from_calibration(ladder, self.origin), model_sha256=self.model.sha256)
        return replace(record, verdict=f"{record.verdict} {self.note}".strip())

    @cached_property
    def model(self) -> Model:
        """Model for prediction and compensation, fitted to all poses; `save` and `report` write this model."""
        final, poses = self.fit
        saved = saved_model(final, poses, np.setdiff1d(np.arange(len(poses)), self.calibrated.train))
        return Model(with_discrepancy(saved, final, poses))

    @property
    def fit(self) -> tuple[Calibration, Poses]:
        """The fitted model with all standard errors, fitted to all poses, and the dataset of the poses."""
        return self.calibrated.final, self.calibrated.poses

    def __repr__(self) -> str:
        return f"<calibration of {self.model.mechanism.name} on {self.record.data.file}: {self.verdict}>"


def calibrate(
    mechanism: MechanismLike,
    table: TableLike,
    effects: Sequence[str | Effect] = (),
    *,
    standard: Sequence[str] = ("*",),
    condition_limit: float | None = None,
    holdout: float = 0.3,
    instrument: str | None = None,
    seed: int = 0,
    fleet: str | Path | FleetPart | None = None,
    joints: Sequence[str] = (),
    command: str = COMMAND,
) -> CalibrationResult:
    """Fit registration, tool point, standard model and named effects, and state the errors after each step.

    mechanism, table: objects, or names and paths. effects: names in the catalogue ("base_compliance", "gear_harmonic
    J4"), expressions ("slot:axis:expression"), or Effect objects.
    standard: patterns of geometric constants, "J* R?"; ("none",) for none. condition_limit: largest ratio of singular
    values of fitted constants; None for a cross-validated limit.
    holdout: share of the poses excluded from all but the final fit; 0 for none. seed: random seed of held-out poses.
    instrument: specification of the instrument, "15um + 6um/m": largest error of a coordinate.
    fleet: fleet.json of a fleet, or the record of a `FleetResult`; its prior replaces the standard model.
    A machine that is unlike the fleet is fitted without the prior, with the effects of the fleet.
    joints: "BALL=RESULT" of ball joints measured alone; the posterior of RESULT is the prior of ball BALL.
    command: command line recorded in the report. Raises InputError for an invalid table, an unknown effect, or a
    diverging fit.
    """
    started = time.perf_counter()
    fraction, seed = check_share(holdout, "holdout"), check_integer(seed, "seed")
    condition_limit = check_limit(condition_limit, "condition_limit", 1.0)
    named_effects = check_list(effects, "effects", "['base_compliance']")
    arm = mechanism_of(mechanism)
    geometry = standard_effects(arm, check_texts(standard, "standard", "('J* R?',)"))
    known = None if fleet is None else _fleet_of(fleet, named_effects)
    table = specified(read_table(table, arm), instrument)
    arm, poses = distinct_poses(arm, table, geometry if known is None else ())
    groups = [*measured_joints(joints, arm), *(named_group(effect, arm, poses) for effect in named_effects)]
    names = [effect.name for _, group in groups for effect in group]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"'{twice[0]}' is named twice, expected each effect once", "effects")
    train, held = split(poses.dataset, fraction, seed)
    seen, unseen = poses.subset(train), poses.subset(held)
    note = ""
    if known is None:
        models = nested_models(geometry, groups)
        steps = fit_steps(arm, models, seen, unseen, condition_limit, seed)
        final = fit_model(ErrorModel(arm, models[-1][1]), poses, condition_limit=condition_limit, seed=seed)
        final = apart_from_effects(final, poses)
    else:
        steps, final, note = _by_the_type(known, arm, poses, seen, unseen, seed)
        groups = [(e.name, (e,)) for e in final.model.effects if not e.constant]
    for step, tried in [*((s.name, s.calibration) for s in steps), ("all poses", final)]:
        if tried.status == "diverged":
            raise InputError(f"{poses.dataset.source}: the fit of {step} diverged: {tried.reason}")
    note = " ".join(filter(None, (note, *_remarks(len(table) - len(poses), final, poses))))
    named = tuple(effect for _, group in groups for effect in group)
    made = Origin(command, seed, time.perf_counter() - started)
    return CalibrationResult(Ladder(poses, train, steps, final, named), made, note)


def _by_the_type(
    known: FleetPart, mechanism: Mechanism, poses: Poses, seen: Poses, unseen: Poses, seed: int
) -> tuple[tuple[Step, ...], Calibration, str]:
    """Return the fits to the poses `seen`, the fit to all poses, and a note, all with the prior of the machine's type.

    If the machine is unlike its type, the effects of the type are fitted without the prior. Raises InputError if the
    poses are too few without the prior.
    """
    steps = further_machine(known, mechanism, seen, unseen, seed).steps
    machine = further_machine(known, mechanism, poses, unseen, seed)
    if note := machine.without_prior(poses, "fleet"):
        return steps[:-1], machine.steps[-2].calibration, note
    return steps, machine.final, translate(machine.in_words(poses), names_of(poses.dataset))


def _fleet_of(fleet: object, effects: tuple[object, ...]) -> FleetPart:
    """Return the record of the machine's type; raise InputError if the file is no fleet.json, or if effects are
    given."""
    if effects:
        raise InputError("the fleet already defines the effects; expected no further effects", "effects")
    return fleet_at(fleet, "fleet")


def fleet_at(fleet: object, argument: str) -> FleetPart:
    """Return the record of machines of one type, given as record, file or folder. Raises InputError if unreadable."""
    return fleet if isinstance(fleet, FleetPart) else read_fleet(fleet_file(file_path(fleet, argument)))


def checked_poses(
    mechanism: Mechanism, table: TableLike, standard: tuple[Effect, ...] | None = None
) -> tuple[Mechanism, Poses]:
    """Return the mechanism and the checked poses of a table, with the payload at the tool point of a first fit.

    standard: geometric constants to be fitted (default: all). Raises InputError for the first error in the table.
    """
    dataset = read_table(table, mechanism)
    check_table(dataset)
    poses = prepare(mechanism, dataset)
    refuse(mechanism, poses, standard)
    mechanism, poses = hang_payload(mechanism, poses)
    return find_lever(mechanism, poses), poses


def distinct_poses(
    mechanism: Mechanism, table: TableLike, standard: tuple[Effect, ...] | None = None
) -> tuple[Mechanism, Poses]:
    """Return the mechanism and the checked poses of a table, without rows that copy another row's measurement.

    A copy is no second measurement: its error is that of the first row, and ± would be too small.
    """
    arm, poses = checked_poses(mechanism, table, standard)
    copied = copies(poses.dataset)
    return arm, poses.subset(np.flatnonzero(~copied)) if copied.any() else poses


def _remarks(copied: int, final: Calibration, poses: Poses) -> Iterator[str]:
    """Yield sentences on copied rows, a large residual of the last fit, and rounding that explains the residual."""
    if copied:
        yield f"Rows that copy the measurement of another row are left out: {copied}."
    said = (*poor_fit(final, "the fit"), *rounding_of(final, poses))
    yield from (f"{poses.dataset.source}: {text}." for text in said)


def measured_joints(joints: Sequence[str], mechanism: Mechanism) -> list[tuple[str, tuple[Effect, ...]]]:
    """Read the joint results "BALL=RESULT", one per ball; raise InputError if a ball or a result is missing."""
    out = []
    for said in check_texts(joints, "joints", "('L3.fixed=rig',)"):
        name, _, result = said.partition("=")
        if not result:
            raise InputError(f"'{said}', expected BALL=RESULT, as in L3.fixed=rig", "joints")
        out.append((f"joint {name}", ball_priors(name, load_model(model_file(Path(result))), mechanism)))
    return out


def named_group(effect: object, mechanism: Mechanism, poses: Poses) -> tuple[str, tuple[Effect, ...]]:
    """Return the name and the effects of one step of the calibration; raise InputError for an unknown effect."""
    with errors_about("effects"):
        if isinstance(effect, Effect):
            effect = in_mechanism_names(effect, mechanism, poses.states)
            check_defined(effect, mechanism, poses.states)
            return effect.name, (effect,)
        if isinstance(effect, str):
            return effect, effects_named(effect, mechanism, poses.states)
    raise InputError(f"{brief(effect)}, expected a name or an Effect", "effects")


def split(dataset: Dataset, holdout: float, seed: int) -> tuple[IntArray, IntArray]:
    """Divide the rows of a table into training rows and held-out rows; none are held out if `holdout` is 0."""
    if holdout == 0.0:
        return np.arange(len(dataset)), np.zeros(0, dtype=np.int64)
    return hold_out(dataset, holdout, np.random.default_rng(seed))
