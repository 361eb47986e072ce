"""Test a fitted model on poses measured later."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel import wording
from gpmodel.api.arguments import check_bool, check_function
from gpmodel.api.model import Model
from gpmodel.api.saved import model_of
from gpmodel.api.table import Described, Shown, TableLike, announce_reading
from gpmodel.api.verification import VerifyResult, judged_by, later_table, verify_saved
from gpmodel.application.model_file import SavedModel
from gpmodel.application.next_check import FIRST, HiddenChange, Pool, level
from gpmodel.application.repair import MOST_MORE, Repaired, repaired
from gpmodel.application.verify import afterwards
from gpmodel.arrays import Array
from gpmodel.progress import Say, silent
from gpmodel.report.verification import VerifyRequest
from gpmodel.table.blocks import different_poses
from gpmodel.table.cells import CONTROLLER_DECIMALS, table_text
from gpmodel.table.convention import pose_table

NAMED_BY = 12
"""Largest number of poses to identify a change of a machine; if they do not suffice, no single change explains them."""
TWICE = 2.0
"""Displacement of the tool that must be detected, relative to the model's expected error, if no tolerance is given."""


@dataclass(frozen=True, repr=False)
class RepairedModel(Shown):
    """Model of a machine after a change, refitted to the poses of the check with the former model as prior.

    found: parameters and expected error of the refitted model.
    """

    found: Repaired

    @property
    def model(self) -> Model:
        """The refitted model of the changed machine, which `save` writes to a file."""
        return Model(self.found.saved)

    @property
    def more(self) -> pd.DataFrame | None:
        """Table of at most 30 poses to measure, after which the expected error is 1.2 times the old one; else None."""
        return None if self.found.more is None else _row(self.found.saved, self.found.more)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per changed parameter: name, unit, value and standard error before and after, SI units."""
        rows = [(n.name, n.unit, *n.before, *n.after) for n in self.found.numbers]
        return pd.DataFrame(rows, columns=["name", "unit", "before", "stderr before", "after", "stderr after"])

    def summary(self) -> str:
        """Summarise the machine's change with standard errors, the expected error, and the number of further poses."""
        numbers = (
            f"{n.name} {wording.measured(*n.after, n.unit)}, before {wording.measured(*n.before, n.unit)}"
            for n in self.found.numbers
        )
        now, was = (wording.length(1e3 * m) for m in (self.found.expected, self.found.before))
        more = self.more
        lines = [
            f"Repaired model: {'; '.join(numbers)}.",
            f"Expected error of the tool point: {now}; {was} before the change.",
        ]
        if more is None:
            lines.append(f"These poses are too few, and {MOST_MORE} more would also be too few: calibrate again.")
        elif len(more):
            lines.append(
                "The error before the change is not reached yet. Measure "
                f"{len(more)} more pose{'s' * (len(more) > 1)} and add the measurements to the table:"
            )
            lines.append(table_text(more, CONTROLLER_DECIMALS).rstrip("\n"))
        return "\n".join(lines)


@dataclass(frozen=True, repr=False)
class NextCheck(Shown):
    """State of a pose-by-pose check of a machine against its model.

    judged: result of the tests on the measured poses; None before the first test.
    poses: number of different measured poses.
    limit: displacement of the tool, mm, that a change must cause to be detected.
    unseen: changes that could move the tool by more than `limit` without being detected.
    next: pose to measure next; None if the check has ended.
    repaired: refitted model of the changed machine, if the change is identified.
    suspect: name of the most probable change if a change is more probable than none; empty if not.
    """

    judged: VerifyResult | None
    poses: int
    limit: float
    unseen: tuple[HiddenChange, ...]
    next: pd.DataFrame | None
    repaired: RepairedModel | None = None
    suspect: str = ""

    @property
    def decided(self) -> bool:
        """True if the check of the machine needs no further pose."""
        return self.next is None

    @property
    def holds(self) -> bool | None:
        """True if the model is valid for the machine; None if the check is not yet decided."""
        return None if self.judged is None or not self.decided else self.judged.holds

    @property
    def _unrepaired(self) -> str:
        """Reason why a decided check has no repaired model."""
        if self.judged is not None and self.judged.record.divided:
            return (
                "No repaired model: the rows were measured with two values of a constant. Measure all rows with one "
                "tool and one load. If a joint has two zeros, repair its play first."
            )
        return "No repaired model: no single change explains the poses. Calibrate again."

    def summary(self) -> str:
        """Return the state of the check as text: the result so far and the pose to measure next."""
        from gpmodel.report.verification_words import sentences

        lines = [] if self.judged is None else [*sentences(self.judged.record)]
        limit = wording.length(self.limit)
        if self.judged is None:
            lines.append(f"The table has {self.poses} different poses. A check needs at least {FIRST}.")
        elif self.unseen:
            worst = max(self.unseen, key=lambda one: one.moves)
            by = f"by {wording.length(1e3 * worst.moves)}" if np.isfinite(worst.moves) else "by centimetres"
            others = f"; {len(self.unseen) - 1} more changes are undetectable" if len(self.unseen) > 1 else ""
            lines.append(
                f"Not decided after {self.poses} poses: a change of {worst.name} that moves the tool {by} "
                f"is not detectable yet{others}. The limit is {limit}."
            )
        elif self.suspect and not self.decided:
            lines.append(
                f"Not decided after {self.poses} poses: a change of {self.suspect} is more probable than no change, "
                "but not significant yet."
            )
        elif self.judged.holds:
            lines.append(
                f"Decided after {self.poses} poses: a change of a joint zero, the tool, the geometry or an effect of "
                f"the model that moves the tool by {limit} would have been detected. For unchanged machines, one check "
                "in twenty reports a change."
            )
        elif self.decided:
            lines.append(f"Decided after {self.poses} poses.")
            lines.append(self._unrepaired if self.repaired is None else self.repaired.summary())
        else:
            lines.append(f"The change is not identified after {self.poses} poses.")
        if self.next is not None:
            lines += [
                "Measure this pose next, and add the measurement to the table:",
                table_text(self.next, CONTROLLER_DECIMALS).rstrip("\n"),
            ]
        return "\n".join(lines)


def next_check(
    saved: SavedModel, table: TableLike | None, asked: VerifyRequest, tolerance: str | None, in_order: bool,
    sights: Mapping[str, Described],
) -> NextCheck:  # fmt: skip
    """Evaluate a pose-by-pose check on the poses of a table; without a table, propose the first pose of the check.

    Raises InputError if the table does not fit the model, or the model does not contain the table of its fit.
    """
    if table is None:
        return NextCheck(None, 0, np.nan, (), _row(saved, Pool.of(saved).next(np.zeros((0, 0)))))
    later = later_table(saved, table, sights)
    fresh = later[0].subset(afterwards(saved, later[0]))
    count = different_poses(fresh)
    if count < FIRST:
        return NextCheck(None, count, np.nan, (), _row(saved, Pool.of(saved).next(fresh.q)))
    spent = level(saved, replace(fresh, in_order=in_order or fresh.in_order))
    result, found = judged_by(saved, later, asked, tolerance, in_order, spent)
    record, pool = result.record, Pool.of(saved, found)
    limit = record.tolerance_mm if record.tolerance_mm is not None else TWICE * record.promised_mm
    lacking = pool.unseen(spent, 1e-3 * limit) if result.holds else ()
    repair = None if result.holds else repaired(found, pool)
    apart = None if repair is None or count >= NAMED_BY else repair.apart
    unnamed = not (record.divided or (len(record.changes) == 1 and found.complete))
    open_still = count < NAMED_BY and (found.suspect is not None if result.holds else unnamed)
    further = apart if apart is not None else pool.next(fresh.q) if lacking or open_still else None
    suspect = "" if found.suspect is None else found.suspect.name
    if further is not None:
        return NextCheck(result, count, limit, lacking, _row(saved, further), None, suspect)
    return NextCheck(result, count, limit, lacking, None, None if repair is None else RepairedModel(repair), suspect)


def _row(saved: SavedModel, q: Array) -> pd.DataFrame:
    """Return joint values, rad and m, as a table with the headers of the fitted table."""
    return pose_table(saved.mechanism, np.atleast_2d(q), saved.columns, saved.convention)


COMMAND = "gpmodel.verify"


def verify(
    model: Model | str | Path, table: TableLike, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None, progress: Say = silent,
    command: str = COMMAND,
) -> VerifyResult:  # fmt: skip
    """Test a fitted model on later poses: the model is valid, the machine has changed, or it is another machine.

    The registration and stationary objects (a fixed camera, a board on the table, planes, points) are fitted again.
    Tool point and objects on links keep their fitted values at the end of the session. With r the residual, V its
    covariance (noise and uncertainty of the model) and z the part of V^(-1/2) r orthogonal to the registration, |z|² is
    compared with chi-square. Possible changes (zeros, tool, sizes of effects, geometry, the catalogue) are tested
    against z. The two tests together report a change for one in a hundred unchanged machines.

    model: a fitted model, or its folder or file.
    table: as in `read_table`. If a table has the columns corrected_J1, ... of `compensate`, the machine was at the
    corrected joint values, and the error at the targets J1, ... is also reported.
    tolerance: largest allowed error of a row, "0.1 mm", or "0.5 px" for pixels.
    in_order: see `Model.predict`.
    cameras, board, surfaces: as in `read_table`, if different from the descriptions in the model.
    progress: called with progress messages. command: command line, recorded in verify.json.
    If a table has more than 2000 rows, the tests use 2000 evenly spaced rows; the tolerance applies to all rows with
    measured points.
    Raises InputError if the table does not fit the model, has a kind of measurement that the fit lacked, or fewer than
    four poses.
    """
    name, judged = Path(model).name if isinstance(model, str | Path) else "model", model_of(model, "model")
    check_function(progress, "progress")
    announce_reading(table, progress)
    asked = VerifyRequest(command, name, judged.sha256)
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    return verify_saved(judged.saved, table, asked, tolerance, check_bool(in_order, "in_order"), sights)


def verify_next(
    model: Model | str | Path, table: TableLike | None = None, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None,
) -> NextCheck:  # fmt: skip
    """Check a model pose by pose: test the measured poses, and propose the next pose until the result is decided.

    Measure the pose `next`, add its row to the table, and call again. A test with n poses has the significance 0.05 · 6
    / (π² (n - 5)²), so that at most one check in twenty of an unchanged machine ends with a change. A change reported
    at n poses remains if later poses confirm it at the level of n poses. The check ends when a change is identified:
    one change is named and its rivals predict almost the same tool points, or twelve poses are measured. The check also
    ends when any change of a joint zero, tool, geometry or effect that moves the tool by more than the tolerance
    would be detected with probability 0.9, and no change is more probable than none. The default tolerance is twice the
    expected error of the model. The proposed pose is the pose of the fit at which the possible causes
    differ most; before a change is named, the pose most sensitive to the most probable or the least determined change.
    If a change is identified, `repaired` is the model refitted to the poses of the check. The prior of the refit is the
    former model, with the changed parameters free. `repaired.model.save(...)` writes the model; `repaired.more` is the
    table of further poses that the refit needs.

    model, table, tolerance, in_order, cameras, board, surfaces: as in `verify`. Without a table, or with fewer than six
    poses, a pose far from the others is proposed. Raises InputError as `verify` does, and if the model does not contain
    the table of its fit. Source: Robbins (1970), statistical methods related to the law of the iterated logarithm.
    """
    judged = model_of(model, "model")
    name = Path(model).name if isinstance(model, str | Path) else "model"
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    asked = VerifyRequest(COMMAND, name, judged.sha256)
    return next_check(judged.saved, table, asked, tolerance, check_bool(in_order, "in_order"), sights)
