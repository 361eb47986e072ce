"""Test a fitted model on a complete table of poses measured later."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.api.arguments import file_path
from gpmodel.api.table import (
    CORRECTED,
    Described,
    Shown,
    TableLike,
    cells_of,
    check_named,
    dataset_of,
    described,
    in_metres,
)
from gpmodel.application.model_file import SavedModel
from gpmodel.application.named_changes import SIGNIFICANCE
from gpmodel.application.recheck import Session, errors_at
from gpmodel.application.verify import Verified, afterwards, misses_of, verified
from gpmodel.arrays import IntArray
from gpmodel.checks.judge import evenly
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.files import finished_folder, remove_files, write_text
from gpmodel.mechanism.source import choice_of
from gpmodel.model.instruments import with_observations
from gpmodel.report.verification import NAME, Others, Verification, VerifyRequest, by_row, to_json, verification
from gpmodel.table.convention import read_convention
from gpmodel.table.dataset import Dataset, with_payload
from gpmodel.table.read import dataset_from
from gpmodel.table.units import split_header

GIVEN_BESIDE = ("correction", "residual", "sigma", "outside", "status")
"""Columns other than corrected joint values that `compensate` adds to a table."""


@dataclass(frozen=True, repr=False)
class VerifyResult(Shown):
    """Result of testing a model on later poses. record: content of verify.json."""

    record: Verification

    @property
    def verdict(self) -> str:
        """Verdict of the verification in one sentence, with a second sentence if a tolerance was given."""
        from gpmodel.report.verification_words import verdict

        return verdict(self.record)

    @property
    def holds(self) -> bool:
        """True if the model is valid for later poses: the machine has not changed and is the machine of the model."""
        return self.record.verdict == "holds"

    @property
    def passed(self) -> bool:
        """True if the model is valid and every row is within the tolerance, if one was given."""
        return self.record.passed

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per later pose of the table, the largest error first.

        Columns: errors without and with the model, expected error, chance, and inputs outside the ranges of the fit.
        """
        frame = by_row(self.record)
        return frame if self.record.missed.known else frame.drop(columns="missed [mm]")

    def changes(self) -> pd.DataFrame:
        """Return one row per change of the machine: name, kind, value, stderr, unit, chance (p-value), rivals."""
        columns = ["name", "kind", "value", "stderr", "unit", "chance", "rivals"]
        return pd.DataFrame(self.record.changes, columns=columns)

    def summary(self) -> str:
        """Return the verification as text: verdict, errors, amount of data, and the rows with the largest errors."""
        from gpmodel.report.verification_words import text

        return text(self.record)

    def report(self, folder: str | Path) -> None:
        """Write verify.html, verify.csv and verify.json, the input of `certificate`, into `folder`; all files or none.

        A certificate of an earlier verification is removed. Raises InputError if a file cannot be written.
        """
        with extra_for("the page of a verification", "report"):
            from gpmodel.report.verification_words import html

        with finished_folder(file_path(folder, "folder")) as draft:
            write_text(draft / "verify.html", html(self.record))
            rows = by_row(self.record).astype({"outlier": int})
            write_text(draft / "verify.csv", rows.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
            self.save(draft / NAME)
        remove_files(file_path(folder, "folder"), ["certificate.html"])

    def save(self, file: str | Path) -> None:
        """Write the verification to verify.json. Raises InputError if the file cannot be written."""
        write_text(file_path(file, "file"), to_json(self.record))

    def __repr__(self) -> str:
        return f"<verification of {self.record.model_file} by {self.record.data.file}: {self.record.verdict}>"


def verify_saved(
    saved: SavedModel, table: TableLike, asked: VerifyRequest, tolerance: str | None, in_order: bool,
    sights: Mapping[str, Described],
) -> VerifyResult:  # fmt: skip
    """Test a saved model on a later table. sights: cameras, boards and surfaces that differ from the descriptions in
    the model.

    Raises InputError if the table does not fit the model, has a new kind of measurement, or fewer than four poses.
    """
    return judged_by(saved, later_table(saved, table, sights), asked, tolerance, in_order)[0]


def later_table(saved: SavedModel, table: TableLike, sights: Mapping[str, Described]) -> tuple[Dataset, Dataset | None]:
    """Return the table at the actual joint values, and the table at the targets of `compensate` (None without
    targets).

    Raises InputError if the table does not fit the model.
    """
    told = described(**sights)
    dataset, targets = _driven(saved, table, told)
    check_named(dataset, told)
    known = saved.convention
    if known is not None and dataset.convention:
        other = read_convention(dataset.convention, saved.mechanism, f"{dataset.source}, convention")
        if (other.turned != known.turned).any() or not np.allclose(other.zero, known.zero):
            raise InputError(
                f"{dataset.source} was imported with {other.text}, the table of the model with {known.text}; expected "
                "equal signs and zeros"
            )
    return dataset, targets


def judged_by(
    saved: SavedModel, later: tuple[Dataset, Dataset | None], asked: VerifyRequest, tolerance: str | None,
    in_order: bool, significance: float = SIGNIFICANCE,
) -> tuple[VerifyResult, Verified]:  # fmt: skip
    """Test a saved model on a table measured later. significance: significance level of each of the two tests."""
    dataset, targets = later
    fresh = afterwards(saved, dataset)
    old = np.setdiff1d(np.arange(len(dataset)), fresh)
    rows = fresh[evenly(len(fresh))]
    found = verified(saved, replace(dataset.subset(rows), in_order=in_order or dataset.in_order), significance)
    session = found.session
    data, weights = session.poses.dataset, session.saved.weights
    limit = None if tolerance is None else 1e3 * in_metres(tolerance, data, "tolerance", weights=weights)
    missed = None if targets is None else misses_of(found.session, targets.subset(rows))
    others = None
    if len(rows) < len(fresh) and not dataset.observations:
        others = _others(found.session, dataset, np.union1d(rows, old))
    record = replace(
        verification(found, asked, missed), tolerance_mm=limit, rows=len(fresh), others=others,
        fitted=tuple(dataset.row[old].tolist()),
    )  # fmt: skip
    return VerifyResult(record), found


def _others(session: Session, dataset: Dataset, judged: IntArray) -> Others:
    """Return the errors of rows with a measured point that the tests of the model did not use."""
    errors = errors_at(session, dataset)
    errors[judged] = np.nan
    known = np.isfinite(errors)
    return Others(tuple(dataset.row[known].tolist()), tuple((1e3 * errors[known]).tolist()))


def _driven(
    saved: SavedModel, table: TableLike, sights: Mapping[str, Mapping[str, object]]
) -> tuple[Dataset, Dataset | None]:
    """Return the table at the actual joint values, and one at the targets of `compensate` if the table has targets."""
    mechanism, known = saved.mechanism, {} if saved.measured is None else saved.measured.dataset.described
    if isinstance(table, Dataset):
        return dataset_of(
            table, mechanism, need_measurement=True, described=sights and {**table.described, **sights}
        ), None
    cells = cells_of(table)
    names = {header: split_header(header)[0] for header in cells.text.columns}
    if not any(name.startswith(CORRECTED) for name in names.values()):
        return dataset_of(table, mechanism, need_measurement=True, described={**known, **sights}), None
    joints = {name.removeprefix(CORRECTED): header for header, name in names.items() if name.startswith(CORRECTED)}
    own = [header for header, name in names.items() if name in GIVEN_BESIDE]
    went = cells.text[list(joints.values())].notna().all(axis=1)
    rows = cells.text[went].drop(columns=own)
    sent = rows.drop(columns=list(joints.values()))
    driven = sent.drop(columns=[h for h in sent.columns if names[h] in joints])
    driven = driven.assign(**{header.replace(CORRECTED, "", 1): rows[header] for header in joints.values()})
    both = (dataset_from(f, cells.path, mechanism, sha256=cells.sha256) for f in (driven, sent))
    payload, row = choice_of(mechanism).payload, np.flatnonzero(went) + 1
    first, second = (replace(with_payload(d, payload), row=row) for d in both)
    return with_observations(first, mechanism, {**known, **sights}), second
