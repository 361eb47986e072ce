"""Test of a model on poses measured after its fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel import wording
from gpmodel.api.arguments import called, switch
from gpmodel.api.model import Model
from gpmodel.api.saved import model_of
from gpmodel.api.table import Described, Shown, TableLike, told_of_reading
from gpmodel.api.verification import VerifyResult, judged_by, later_table, verify_saved
from gpmodel.application.model_file import SavedModel
from gpmodel.application.next_check import FIRST, HiddenChange, Pool, significance
from gpmodel.application.repair import MOST_MORE, Repaired, repaired
from gpmodel.application.verify import afterwards
from gpmodel.arrays import Array
from gpmodel.progress import Say, silent
from gpmodel.report.verification import VerifyRequest
from gpmodel.table.bundles import different_poses
from gpmodel.table.cells import CONTROLLER_DECIMALS, joint_table, table_text

NAMED_BY = 12
"""Poses after which a change is named. If none is named by then, no single change explains the poses."""
TWICE = 2.0
"""Largest undetected motion of the tool, in expected errors of the model, where no tolerance is given."""


@dataclass(frozen=True, repr=False)
class RepairedModel(Shown):
    """The model of a machine after a change, fitted to the poses of the check with the old model as prior. found: its
    numbers and the error that it expects."""

    found: Repaired

    @property
    def model(self) -> Model:
        """The model; `save` writes it."""
        return Model(self.found.saved)

    @property
    def more(self) -> pd.DataFrame | None:
        """Poses to measure until it expects at most 1.2 times the error before the change; None where 30 are not enough
        for that."""
        return None if self.found.more is None else _row(self.found.saved, self.found.more)

    def to_dataframe(self) -> pd.DataFrame:
        """One row a number that changed: name, unit, value and standard error before and after, SI."""
        rows = [(n.name, n.unit, *n.before, *n.after) for n in self.found.numbers]
        return pd.DataFrame(rows, columns=["name", "unit", "before", "stderr before", "after", "stderr after"])

    def summary(self) -> str:
        """State what changed with its ±, the error that the model expects, and how many poses are missing."""
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
            lines.append(f"These poses are not enough, nor are {MOST_MORE} more: calibrate again.")
        elif len(more):
            lines.append(f"These poses are not enough to be as good as before: measure {len(more)} more, add them:")
            lines.append(table_text(more, CONTROLLER_DECIMALS).rstrip("\n"))
        return "\n".join(lines)


@dataclass(frozen=True, repr=False)
class NextCheck(Shown):
    """A check so far. judged: by the poses there are, None of too few. poses: their number, of different ones.
    limit: mm by which the tool may move unseen. unseen: zeros that may still have changed by more. next: the pose to
    measure, None where the check has ended. repaired: the model of the machine now, where a change is named."""

    judged: VerifyResult | None
    poses: int
    limit: float
    unseen: tuple[HiddenChange, ...]
    next: pd.DataFrame | None
    repaired: RepairedModel | None = None

    @property
    def decided(self) -> bool:
        """True where no further pose is needed."""
        return self.next is None

    @property
    def holds(self) -> bool | None:
        """True if the model holds; None while it is not decided."""
        return None if self.judged is None or not self.decided else self.judged.holds

    def summary(self) -> str:
        """Summarise the answer so far, and what to measure next."""
        from gpmodel.report.verification_words import sentences

        lines = [] if self.judged is None else [*sentences(self.judged.record)]
        limit = wording.length(self.limit)
        if self.judged is None:
            lines.append(f"{self.poses} of the {FIRST} different poses that a check begins with.")
        elif self.unseen:
            worst = max(self.unseen, key=lambda one: one.moves)
            by = f"by {wording.length(1e3 * worst.moves)}" if np.isfinite(worst.moves) else "by centimetres"
            others = f", those of {len(self.unseen) - 1} more joints too" if len(self.unseen) > 1 else ""
            lines.append(
                f"Not decided after {self.poses} poses: the zero of {worst.joint} could have changed and moved the "
                f"tool {by} unseen{others}; the limit is {limit}."
            )
        elif self.judged.holds:
            lines.append(
                f"Decided after {self.poses} poses: a change of any joint's zero that moves the tool by {limit} would "
                "have been seen. Of a machine that did not change, one check in twenty says that it did."
            )
        elif self.decided:
            lines.append(f"Decided after {self.poses} poses.")
            lines.append(
                "No repaired model: no change that is named explains the poses; calibrate again."
                if self.repaired is None
                else self.repaired.summary()
            )
        else:
            lines.append(f"What changed is not decided after {self.poses} poses.")
        if self.next is not None:
            lines += ["Measure next, and add it to the table:", table_text(self.next, CONTROLLER_DECIMALS).rstrip("\n")]
        return "\n".join(lines)


def next_check(
    saved: SavedModel, table: TableLike | None, asked: VerifyRequest, tolerance: str | None, in_order: bool,
    sights: Mapping[str, Described],
) -> NextCheck:  # fmt: skip
    """The check by the poses of a table, or its first pose. Raises InputError as `gpmodel.verify_next`."""
    if table is None:
        return NextCheck(None, 0, np.nan, (), _row(saved, Pool.of(saved).next(np.zeros((0, 0)))))
    later = later_table(saved, table, sights)
    fresh = later[0].subset(afterwards(saved, later[0]))
    count = different_poses(fresh)
    if count < FIRST:
        return NextCheck(None, count, np.nan, (), _row(saved, Pool.of(saved).next(fresh.q)))
    result, found = judged_by(saved, later, asked, tolerance, in_order, significance(count))
    record, pool = result.record, Pool.of(saved, found.session)
    limit = record.tolerance_mm if record.tolerance_mm is not None else TWICE * record.promised_mm
    lacking = pool.unseen(found.visible, 1e-3 * limit) if result.holds else ()
    unnamed = not (result.holds or record.changes) and count < NAMED_BY
    further = _row(saved, pool.next(fresh.q)) if lacking or unnamed else None
    repair = None if result.holds or further is not None else repaired(found, pool)
    return NextCheck(result, count, limit, lacking, further, None if repair is None else RepairedModel(repair))


def _row(saved: SavedModel, q: Array) -> pd.DataFrame:
    """Poses (n,) or (M, n) with the headers of the table of the fit."""
    return joint_table(saved.mechanism, np.atleast_2d(q), saved.columns)


COMMAND = "gpmodel.verify"


def verify(
    model: Model | str | Path, table: TableLike, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None, progress: Say = silent,
    command: str = COMMAND,
) -> VerifyResult:  # fmt: skip
    """Judge a model by poses measured afterwards: does it hold, has the machine drifted, or is it another one?

    The registration is found anew, and where what stands in the world is: a camera in the hall, a board on the table,
    planes, points. Tool point, what links carry and everything else are the model's, at the end of its session. With r
    what the model leaves, V its covariance (noise and all that the model does not know better) and z the part of
    V^(-1/2) r at right angles to the registration, |z|² is compared with chi-square, and what could have changed
    (zeros, tool, sizes of effects, geometry, the catalogue) is tested against z. The two tests together call an
    unchanged machine changed in one case of a hundred.

    model: a fitted model, or its folder or file. table: as in `read_table`; if it has the columns
    corrected_J1, ... of `compensate`, the machine went there, and the errors left of its targets J1, ... are said too.
    tolerance: what no row may exceed, as "0.1 mm", of pixels "0.5 px". in_order: as in `predict`. cameras, board,
    surfaces: as in `read_table`, where they are others than in the table of the fit. progress: called with what is
    being done. command: what verify.json says made it. The verdict rests on 2000 rows of more, in even stretches; the
    tolerance on all, where points were measured.
    Raises InputError where the table does not fit the model, reads in a unit that the fit did not, or has fewer than
    four poses.
    """
    name, judged = Path(model).name if isinstance(model, str | Path) else "model", model_of(model, "model")
    called(progress, "progress")
    told_of_reading(table, progress)
    asked = VerifyRequest(command, name, judged.sha256)
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    return verify_saved(judged.saved, table, asked, tolerance, switch(in_order, "in_order"), sights)


def verify_next(
    model: Model | str | Path, table: TableLike | None = None, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None,
) -> NextCheck:  # fmt: skip
    """Check a model pose by pose: what the poses say so far, and which one to measure next, until it is decided.

    Measure the pose of `next`, add it to the table, call it again. A look at n poses has the significance
    0.05 · 6 / (π² (n - 5)²), so that of machines that did not change at most one check in twenty ends with a change,
    however long it goes on. It ends where a change is seen and named, or where a change of any joint's zero that moves
    the tool by more than the tolerance would be with the chance 0.9; without a tolerance twice the error that the model
    expects. Poses are chosen among those of the fit, where the arm is known to go: the one that shows most of the zero
    that is seen worst. Where a change is named, `repaired` is the model fitted to these poses, its own numbers and
    their ± as prior, what changed free: `repaired.model.save(...)`; `repaired.more` are the poses that it lacks.

    model, table, tolerance, in_order, cameras, board, surfaces: as in `verify`; no table, or fewer than six poses:
    the next of the first poses, far from the others. Raises InputError as `verify`, and where the model does not hold
    the table of its fit. Source: Robbins (1970), statistical methods related to the law of the iterated logarithm.
    """
    judged = model_of(model, "model")
    name = Path(model).name if isinstance(model, str | Path) else "model"
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    asked = VerifyRequest(COMMAND, name, judged.sha256)
    return next_check(judged.saved, table, asked, tolerance, switch(in_order, "in_order"), sights)
