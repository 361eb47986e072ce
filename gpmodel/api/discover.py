"""Search a measured table for effects missing in the standard model, and confirm them on held-out poses."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from gpmodel import wording
from gpmodel.api.arguments import (
    NOISIEST,
    MechanismLike,
    brief,
    check_function,
    check_integer,
    check_limit,
    check_list,
    check_number,
    check_share,
    check_texts,
    errors_about,
    mechanism_of,
)
from gpmodel.api.calibrate import checked_poses, fleet_at, measured_joints
from gpmodel.api.evolve import evolved, selecting
from gpmodel.api.fitted import FittedResult
from gpmodel.api.model import Model
from gpmodel.api.table import TableLike, in_metres, read_table, specified
from gpmodel.application.further import heldout_fits, with_discrepancy
from gpmodel.application.model_file import check_kept, saved_model
from gpmodel.application.over_causes import over_causes
from gpmodel.application.true_loads import under_true_loads
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.result import Calibration
from gpmodel.checks.judge import rounding_of_table
from gpmodel.discovery.folds import Loop, discover_by_folds
from gpmodel.discovery.loop import discover as run_loop
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.runs import KeptRuns
from gpmodel.families.by_name import check_defined
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Family, Offer, catalogue, distinct, instances
from gpmodel.hierarchy.block import blocks
from gpmodel.hierarchy.further import ALONE, alone_steps, from_the_type, further_machine
from gpmodel.hierarchy.record import FleetPart, prior_model
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.observation import Weights
from gpmodel.model.sites import in_mechanism_names, names_of, standard_effects, translate
from gpmodel.model.states import States
from gpmodel.progress import Say, silent
from gpmodel.report import words
from gpmodel.report.build import Ladder
from gpmodel.report.from_discovery import from_discovery
from gpmodel.report.origin import Origin
from gpmodel.report.schema import Report, StepRecord
from gpmodel.report.schema_search import CandidateRecord
from gpmodel.report.verdict import of_discovery
from gpmodel.table.blocks import FOLD_SEED, FOLDS, USUAL, different_poses, hold_out, repeat_blocks
from gpmodel.table.dataset import Dataset

COMMAND = "gpmodel.discover"


@dataclass(frozen=True, repr=False)
class DiscoveryResult(FittedResult):
    """Result of a search for effects that the standard model lacks.

    found: result of the search. record: content of report.json. note: sentences added to the verdict.
    alone: fit of a machine without the prior of its type; () if the machine has too few poses.
    """

    found: Discovery
    origin: Origin
    note: str = ""
    alone: tuple[Step, ...] | None = None

    @cached_property
    def record(self) -> Report:
        """Content of report.json without the errors of exported files, which are added when the report is written."""
        record = from_discovery(self.found, self.origin, self.model.saved)
        if self.alone is not None:
            steps = Ladder(self.found.poses, self.found.train, self.alone, self.found.final)
            first, *others = record.ladder
            record = replace(record, ladder=(first, *(steps.records() if self.alone else [StepRecord(ALONE)]), *others))
        verdict = f"{of_discovery(record)} {words.fitted_loads(self.found.loads)} {self.note}".strip()
        return replace(record, model_sha256=self.model.sha256, verdict=verdict)

    @cached_property
    def model(self) -> Model:
        """Model for prediction and compensation, fitted to all poses; `save` and `report` write this model."""
        found = self.found
        saved = saved_model(found.final, found.poses, None if found.folds else found.heldout)
        return Model(with_discrepancy(saved, found.final, found.poses, heldout_fits(found), self.origin.noise))

    @property
    def fit(self) -> tuple[Calibration, Poses]:
        """The fitted model with all standard errors, fitted to all poses, and the dataset of the poses."""
        return self.found.final, self.found.poses

    @property
    def rejected(self) -> tuple[CandidateRecord, ...]:
        """Rejected candidates that lower the error; `choose_poses(after=, rejected=)` proposes poses to test a
        candidate."""
        return self.record.rejected

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per finding: name, value, stderr, unit, slot, axis, basis, inputs, unique share, p-value,
        causes."""
        columns = ["name", "value", "stderr", "unit", "slot", "axis", "basis", "unique_share", "p_value", "found_by"]
        return pd.DataFrame(self.findings, columns=columns).assign(
            inputs=[", ".join(f.inputs) for f in self.findings],
            causes=[words.causes(f) for f in self.findings],
        )

    def __repr__(self) -> str:
        names = "; ".join(f.name for f in self.findings) or "nothing"
        return f"<discovery on {self.found.poses.dataset.source}: added {names}>"


def discover(
    mechanism: MechanismLike,
    table: TableLike,
    *,
    holdout: float | None = None,
    folds: int | None = None,
    seed: int = 0,
    search: Search | None = None,
    criteria: Criteria | None = None,
    candidates: Iterable[Offer] = catalogue,
    standard: Sequence[str] = ("*",),
    condition_limit: float | None = None,
    noise: str | float | None = None,
    instrument: str | None = None,
    joints: Sequence[str] = (),
    like: str | Path | FleetPart | None = None,
    progress: Say = silent,
    kept: KeptRuns | None = None,
    command: str = COMMAND,
) -> DiscoveryResult:
    """Find error effects that the model of a mechanism lacks, name them, and confirm them on held-out poses.

    mechanism, table: objects, or names and paths. holdout: share of the poses that selection and fit do not use.
    folds: number of folds of a cross-validation in place of `holdout`. The search uses all poses, and is repeated
    without each fold to measure the prediction error. Default: holdout 0.3, or 5 folds with fewer than 150 poses.
    seed: random seed of the evolution. Held-out poses, folds and permutations do not depend on `seed`.
    search: effort of the search. criteria: tests that a candidate must pass to be accepted.
    candidates: families, candidates or single effects to test; () to test evolved formulas only. condition_limit:
    largest condition number of a fit; None: cross-validated. standard: patterns of the geometric constants to fit.
    noise: standard deviation of one measurement, "0.03 mm" or "0.1 px", if no pose is repeated.
    instrument: specification, "15um + 6um/m": largest error of a coordinate; the noise is half of the specification.
    joints: "BALL=RESULT" as in `calibrate`, added to the standard model. like: folder, file or record of a `fleet` of
    the type; the effects of the fleet, with mean and spread, replace the standard model.
    progress: function called with Progress messages, for example `print`. kept: finished runs of an interrupted search.
    command: command line recorded in the report. Raises InputError for an argument out of range or an invalid table.
    """
    search, criteria = _sensible(Search() if search is None else search, Criteria() if criteria is None else criteria)
    seed = check_integer(seed, "seed")
    offers = distinct(check_list(candidates, "candidates", "(*gp.catalogue, mine)"))
    check_function(progress, "progress")
    arm = mechanism_of(mechanism)
    geometry = _geometry(arm, standard)
    table = specified(read_table(table, arm), instrument)
    arm, poses, known, note = _placed(arm, table, geometry, _type_of(like, joints))
    stated = _stated(noise, poses.dataset)
    fitted = (*geometry, *(effect for _, effects in measured_joints(joints, arm) for effect in effects))
    run = partial(run_loop, condition_limit=check_limit(condition_limit, "condition_limit", 1.0), criteria=criteria,
                  candidates=_checked_offers(offers, arm, poses.states), standard=fitted, seed=seed)  # fmt: skip
    started = partial(_started, known, arm)
    whole_run = started(partial(run, search=search, progress=_in_table_names(progress, poses.dataset), kept=kept))
    fraction, parts = _split(holdout, folds, poses.dataset)
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are too small for several threads
        if parts:
            ways = (partial(run, search=way, errors_alone=True) for way in _repeating(search, bool(offers)))
            found = discover_by_folds(whole_run, [started(way) for way in ways], poses, parts, criteria, search.here)
        else:
            found = whole_run(poses, *hold_out(poses.dataset, fraction, np.random.default_rng(FOLD_SEED)))
    made = Origin(command, seed, found.seconds, stated(found.final.weights))
    note = f"{rounding_of_table(arm, poses, geometry)} {note}".strip()
    return DiscoveryResult(over_causes(found, search.here), made, note, alone_steps(found) if known else None)


def _stated(noise: str | float | None, dataset: Dataset) -> Callable[[Weights], float | None]:
    """Return the stated noise, m, as a function of the weights of a fit; None without a stated noise.

    Raises InputError for a noise in a unit that no measurement of the table has.
    """
    if noise is None:
        return lambda _: None
    in_metres(noise, dataset, "noise", NOISIEST)
    return partial(in_metres, noise, dataset, "noise", NOISIEST)


def _started(known: FleetPart | None, arm: Mechanism, loop: "partial[Discovery]") -> Loop:
    """Begin the search with the standard model or, if `known` is given, with the prior of the machine's type.

    A search that begins with the standard model and uses the catalogue also considers loads other than declared.
    """
    if known is not None:
        return partial(from_the_type, known, arm, partial(loop, arm))
    return (
        partial(under_true_loads, loop, loop.keywords["criteria"], arm)
        if loop.keywords["candidates"]
        else partial(loop, arm)
    )


def _type_of(like: object, joints: Sequence[str]) -> FleetPart | None:
    """Return the record of the machine's type or None; raise InputError if it is unreadable or `joints` are given."""
    if like is not None and joints:
        raise InputError("cannot be combined with joints; expected one of the two", "like")
    return None if like is None else fleet_at(like, "like")


def _placed(
    arm: Mechanism, table: Dataset, geometry: tuple[Effect, ...], like: FleetPart | None
) -> tuple[Mechanism, Poses, FleetPart | None, str]:
    """Return mechanism, poses of the table, prior of the machine's type (None without), and notes on the payload."""
    if like is None:
        return *checked_poses(arm, table, geometry), None, ""
    try:
        prior_model(like, arm)
    except InputError as error:
        raise InputError(error.said, "like") from None
    placed, poses = checked_poses(arm, table, ())
    machine = further_machine(like, placed, poses, poses.subset(np.zeros(0, dtype=np.int64)))
    names = [name for name, _ in blocks([e for e in machine.final.model.effects if not e.constant])]
    has = f", which has {wording.listed(names)}" if names else ""
    if not (unlike := machine.without_prior(poses, "like")):
        said = f"Prior of {len(like.machines)} machines of the type{has}. {machine.in_words(poses)}"
        return placed, poses, like, translate(said, names_of(table))
    return *checked_poses(arm, table, geometry), None, unlike


def _geometry(arm: Mechanism, standard: Sequence[str]) -> tuple[Effect, ...]:
    """Return the geometric constants that match the patterns; raise InputError if no constant matches."""
    found = standard_effects(arm, check_texts(standard, "standard", "('J* R?',)"))
    if not found:
        raise InputError(
            f"{brief(standard)}, expected geometric parameters of the standard model, as in ('J* R?',)",
            "standard",
        )
    return found


def _in_mechanism_names(offer: Offer, arm: Mechanism, states: States) -> Offer:
    """Translate the joint names of a user's candidate to those of the mechanism; families use the mechanism's names."""
    match offer:
        case Effect():
            return in_mechanism_names(offer, arm, states)
        case Candidate():
            return replace(offer, effects=tuple(in_mechanism_names(e, arm, states) for e in offer.effects))
        case _:
            return offer


def _in_table_names(progress: Say, dataset: Dataset) -> Say:
    """Translate the joint names in progress messages to the joint names of the table."""
    names = names_of(dataset)
    return lambda line: progress(replace(line, text=translate(line.text, names)))


def _checked_offers(offers: Sequence[Offer], arm: Mechanism, states: States) -> tuple[Offer, ...]:
    """Return the user's candidates with the joint names of the mechanism.

    Raises InputError for an effect that model.json cannot hold, or that is undefined at a pose.
    """
    with errors_about("candidates"):
        offers = tuple(_in_mechanism_names(offer, arm, states) for offer in offers)
        for offer in offers:
            for effect in chain.from_iterable(c.effects for c in instances(offer, arm, states)):
                check_kept(effect)
                if not isinstance(offer, Family):
                    check_defined(effect, arm, states)
    return offers


ENOUGH_HELD = 45
"""Least number of held-out poses; with fewer poses to hold out, cross-validation is used. With 88 poses, a formula of
two inputs was missed if 62 poses were searched, and found with 84 (``experiments.random_laws``)."""


def _split(holdout: object, folds: object, dataset: Dataset) -> tuple[float, int]:
    """Return the share to hold out, and the number of folds, 0 for none. Raises InputError if both are given."""
    check_split(holdout, folds)
    if folds is not None:
        return 0.0, check_integer(folds, "folds", 2)
    if holdout is not None:
        return check_share(holdout, "holdout", positive=True), 0
    units = int(repeat_blocks(dataset).max(initial=-1)) + 1
    return USUAL, FOLDS if USUAL * different_poses(dataset) < ENOUGH_HELD and units >= FOLDS else 0


def _repeating(search: Search, named: bool) -> list[Search]:
    """Return the searches to repeat in each fold of a cross-validation, the quickest first.

    If the search has candidates of the catalogue, the first repetition omits genetic programming, the second does not.
    """
    return [replace(search, runs=0), search] if named and search.runs else [search]


def check_split(holdout: object, folds: object) -> None:
    """Raise InputError if holdout and folds are both given, or if one of the two is out of range."""
    if holdout is not None and folds is not None:
        raise InputError("cannot be combined with holdout; expected one of the two", "folds")
    if holdout is not None:
        check_share(holdout, "holdout", positive=True)


LEAST = {"workers": 1, "population": 4, "opening_population": 4, "folds": 2, "blocks": 2, "shuffles": 1}
"""Smallest allowed values of the fields of Search and Criteria; fields without an entry may be zero."""


def _sensible(search: Search, criteria: Criteria) -> tuple[Search, Criteria]:
    """Check the fields of the arguments `search` and `criteria`.

    Raises InputError that names an argument of a wrong type, or the first invalid field.
    """
    if not isinstance(search, Search):
        raise InputError(f"{brief(search)}, expected gpmodel.Search(...)", "search")
    if not isinstance(criteria, Criteria):
        raise InputError(f"{brief(criteria)}, expected gpmodel.Criteria(...)", "criteria")
    check_limit(search.stop_after, "stop_after", 0.0)
    evolved(search.strategies)
    selecting(search.selection, "selection")
    for field, value in ((f, getattr(owner, f.name)) for owner in (search, criteria) for f in fields(owner)):
        if isinstance(field.default, int):
            check_integer(value, field.name, LEAST.get(field.name, 0))
        elif isinstance(field.default, float):
            check_number(value, field.name, 0.0)
    return search, criteria
