"""Records of verify.json, the test of a model on later poses; lengths in mm, all other values in SI units."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, cast

import msgspec
import numpy as np
import pandas as pd

from gpmodel import files
from gpmodel.application.named_changes import NamedChange, Visible
from gpmodel.application.verify import Verified
from gpmodel.arrays import Array, NotNegative, Share
from gpmodel.errors import InputError
from gpmodel.model.error_model import turn_error
from gpmodel.model.observation import Observation, observations, weight_of
from gpmodel.model.sites import names_of, translate
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report.build import OWN_UNIT
from gpmodel.report.fitted import optional, statistics_mm
from gpmodel.report.origin import mechanism_record, repeatability, versions
from gpmodel.report.saved import LARGEST_FILE
from gpmodel.report.schema import DataRecord, ErrorsMm, MechanismRecord
from gpmodel.report.schema_search import ReadingRecord, Repeatability
from gpmodel.table.blocks import different_poses
from gpmodel.texts import parse_json, read_limited

NAME, KIND = "verify.json", "verify"
SCHEMA = 1

TOO_GOOD = 1e-6
"""Probability of a smaller chi-square below which the page remarks that the errors are implausibly small."""


@dataclass(frozen=True)
class PoseRecord:
    """Record of one row of new measurements that verify a model.

    without_mm, with_mm: 3-D position errors, mm, with the nominal geometry and with the model.
    promised_mm: expected RMS error, None for an outlier. chance: p-value of the error, None for an outlier.
    outside: inputs outside the ranges of the fit.
    missed_mm: error of a compensated target, mm.
    """

    row: int
    without_mm: NotNegative | None
    with_mm: NotNegative | None
    promised_mm: NotNegative | None = None
    chance: Share | None = None
    outside: str = ""
    outlier: bool = False
    missed_mm: NotNegative | None = None


@dataclass(frozen=True)
class Others:
    """Rows of a long table that the verification does not test, and their errors with the model, mm."""

    rows: tuple[int, ...]
    with_mm: tuple[NotNegative, ...]


@dataclass(frozen=True)
class KindRecord:
    """Measurements of one kind other than points: RMS in the unit of the kind. mm: millimetres that correspond to one
    unit."""

    name: str
    unit: str
    mm: NotNegative
    rows: int
    without: NotNegative | None
    after: NotNegative | None
    promised: NotNegative | None


@dataclass(frozen=True)
class Verification:
    """The content of verify.json: the result of testing a model on new measurements.

    verdict: holds, drifted or another machine.
    sigma_mm: noise of one coordinate, by the model. noise_degrees: degrees of freedom of sigma_mm, None if given.
    chi_square, degrees, chance: test of the residual of the model. chance_of_less: probability of a smaller chi-square.
    instrument: True if the measurements include the instrument errors of the model.
    tolerance_mm: largest allowed error of a row, or None.
    kinds: measurements other than points, whose errors are converted to mm.
    orientation: RMS angle, mrad, with nominal geometry and with the model. lever_m: distance of the tool point.
    rows: number of rows in the table, of which `poses` are tested; others: rows that are only compared with the
    tolerance.
    fitted: number of rows that were excluded because the model was fitted to them.
    explained: True if the residual without the changes is not significant.
    """

    command: str
    verdict: Literal["holds", "drifted", "another machine"]
    data: DataRecord
    mechanism: MechanismRecord
    model_file: str
    model_sha256: str
    without: ErrorsMm
    after: ErrorsMm
    promised_mm: NotNegative
    sigma_mm: NotNegative
    chi_square: NotNegative
    degrees: int
    noise_degrees: NotNegative | None
    chance: Share
    changes: tuple[NamedChange, ...]
    visible: tuple[Visible, ...]
    poses: tuple[PoseRecord, ...]
    missed: ErrorsMm = field(default_factory=ErrorsMm)
    instrument: bool | None = None
    repeatability: Repeatability | None = None
    tolerance_mm: NotNegative | None = None
    kinds: tuple[KindRecord, ...] = ()
    orientation: ReadingRecord | None = None
    lever_m: NotNegative = 0.0
    rows: int = 0
    others: Others | None = None
    fitted: tuple[int, ...] = ()
    chance_of_less: Share = 1.0
    explained: bool = False
    schema: int = SCHEMA
    kind: str = KIND
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def shown(self) -> tuple[str, float]:
        """Unit in which row errors are printed, and its size in mm: the unit of the measurements if they have one."""
        units = {(k.unit, k.mm) for k in self.kinds}
        alone = len(units) == 1 and sum(k.rows for k in self.kinds) + len(self.data.outliers) >= len(self.poses)
        return units.pop() if alone else ("mm", 1.0)

    @property
    def divided(self) -> bool:
        """True if the rows divide between two values of a constant of the machine or its load."""
        return any(change.divides for change in self.changes)

    @property
    def beyond_tolerance(self) -> tuple[PoseRecord, ...]:
        """New measurements with an error above the tolerance, outliers included, the largest first."""
        limit = self.tolerance_mm
        return () if limit is None else tuple(p for p in self.worst_first if (p.with_mm or 0.0) > limit)

    @property
    def worst_first(self) -> tuple[PoseRecord, ...]:
        """New measurements in order of decreasing error with the model; rows without a measured point last."""
        return tuple(sorted(self.poses, key=lambda p: -1.0 if p.with_mm is None else p.with_mm, reverse=True))

    @property
    def passed(self) -> bool:
        """True if the model holds and, if a tolerance was given, no row exceeds the tolerance."""
        return self.verdict == "holds" and not self.beyond

    @property
    def beyond(self) -> int:
        """Number of all new measurements that exceed the tolerance."""
        limit, others = self.tolerance_mm, self.others.with_mm if self.others else ()
        return len(self.beyond_tolerance) + sum(limit is not None and mm > limit for mm in others)

    @property
    def worst(self) -> tuple[int, float | None]:
        """Number of the row that has the largest error with the model, and that error, mm."""
        first = self.worst_first[0]
        pairs = list(zip(self.others.with_mm, self.others.rows, strict=True)) if self.others else []
        mm, row = max(pairs, default=(0.0, 0))
        return (row, mm) if mm > (first.with_mm or 0.0) else (first.row, first.with_mm)


@dataclass(frozen=True)
class VerifyRequest:
    """Command of a verification, and name and digest of the tested model file."""

    command: str
    model_file: str
    model_sha256: str


def verification(found: Verified, asked: VerifyRequest, missed: Array | None = None) -> Verification:
    """Return the record of a test of a model on later poses, with the joint names of the later table."""
    session = found.session
    data, count = session.poses.dataset, len(session.poses)
    names = names_of(data)
    measured = np.any([kind.readings.any(axis=1) for kind in observations(data)], axis=0)
    errors = np.where(measured, session.errors, np.nan)
    missed = np.full(count, np.nan) if missed is None else missed
    promised, chances = found.found.by_pose
    return Verification(
        command=asked.command,
        verdict=found.verdict,
        explained=found.explained,
        data=DataRecord(data.source, data.sha256, count, different_poses(data),
                        outliers=tuple(data.row[~session.use].tolist())),
        mechanism=mechanism_record(session.saved.mechanism, names),
        model_file=asked.model_file,
        model_sha256=asked.model_sha256,
        without=statistics_mm(found.alone[measured & session.use]),
        after=statistics_mm(errors[measured & session.use]),
        promised_mm=float(1e3 * np.sqrt(np.nanmean(promised**2))),
        sigma_mm=1e3 * found.found.spread.sigma,
        chi_square=found.found.chi_square,
        degrees=found.found.degrees,
        noise_degrees=optional(found.found.freedom),
        chance=found.found.chance,
        changes=tuple(
            replace(c, name=translate(c.name, names), rivals=tuple(translate(r, names) for r in c.rivals))
            for c in found.changes
        ),
        visible=tuple(replace(v, joint=translate(v.joint, names)) for v in found.visible),
        poses=tuple(
            PoseRecord(
                int(data.row[k]), optional(1e3 * found.alone[k]), optional(1e3 * errors[k]),
                optional(1e3 * promised[k]), optional(chances[k]), translate(found.outside[k], names),
                not session.use[k], optional(1e3 * missed[k]),
            )
            for k in range(count)
        ),
        missed=statistics_mm(missed[np.isfinite(missed)]),
        instrument=found.instrument,
        repeatability=repeatability(data),
        kinds=tuple(_kinds(found, promised)),
        orientation=_orientation(found),
        lever_m=session.saved.lever,
        chance_of_less=found.found.chance_of_less,
        versions=versions(),
    )  # fmt: skip


def _kinds(found: Verified, promised: Array) -> Iterator[KindRecord]:
    """Yield the record of each kind of measurement in a verification, without outliers."""
    session = found.session
    for kind in cast(tuple[Observation, ...], session.poses.dataset.observations):
        rows, (unit, factor) = kind.readings.any(axis=1) & session.use, OWN_UNIT[kind.unit]
        own = factor / weight_of(kind, session.saved.weights)
        sizes = [own * root_mean_square(v[rows]) for v in (found.alone, session.errors, promised)]
        yield KindRecord(kind.name, unit, 1e3 / own, int(rows.sum()), *map(optional, sizes))


def _orientation(found: Verified) -> ReadingRecord | None:
    """Return the RMS orientation errors of a verification without outliers; None without measured orientations."""
    session = found.session
    turns = (found.alone_turn[session.use], turn_error(session.observed, session.poses.dataset)[session.use])
    known = [values[np.isfinite(values)] for values in turns]
    if not len(known[1]):
        return None
    return ReadingRecord("orientation", "mrad", len(known[1]), *(1e3 * root_mean_square(values) for values in known))


def by_row(record: Verification) -> pd.DataFrame:
    """Return the verified rows as in verify.csv, the largest error with the model first."""
    return pd.DataFrame(record.worst_first).rename(columns=lambda name: name.replace("_mm", " [mm]"))


def to_json(record: Verification) -> str:
    """Return the text of verify.json."""
    return files.to_json(dataclasses.asdict(record))


def read_verification(folder: Path) -> Verification | None:
    """Return the saved Verification in `folder`, None without verify.json. Raises InputError for an unreadable file."""
    path = folder / NAME
    if not path.is_file():
        return None
    try:
        return msgspec.convert(parse_json(read_limited(path, LARGEST_FILE, "a verification")), Verification)
    except ValueError as error:
        raise InputError(f"{path}: cannot be read ({error}); expected the JSON that verify wrote") from None
