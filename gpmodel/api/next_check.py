"""A check that goes on pose by pose: what it says so far, and the pose to measure next."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gpmodel import wording
from gpmodel.api.display import Shown
from gpmodel.api.table import Described, TableLike
from gpmodel.api.verification import VerifyResult, judged_by, later_table
from gpmodel.application.model_file import SavedModel
from gpmodel.application.next_check import FIRST, HiddenChange, Pool, significance
from gpmodel.application.verify import afterwards
from gpmodel.arrays import Array
from gpmodel.report.verification import VerifyRequest
from gpmodel.table.bundles import different_poses
from gpmodel.table.write import CONTROLLER_DECIMALS, joint_table, table_text

NAMED_BY = 12
"""Poses by which a change is named; where it is not, no single one explains it."""
TWICE = 2.0
"""Times the expected error of the model, by which the tool may move unseen where no tolerance is given."""


@dataclass(frozen=True, repr=False)
class NextCheck(Shown):
    """A check so far. judged: by the poses there are, None of too few. poses: their number, of different ones.
    limit: mm by which the tool may move unseen. unseen: zeros that may still have changed by more. next: the pose to
    measure, None where the check has ended."""

    judged: VerifyResult | None
    poses: int
    limit: float
    unseen: tuple[HiddenChange, ...]
    next: pd.DataFrame | None

    @property
    def decided(self) -> bool:
        """True where no further pose is needed."""
        return self.next is None

    @property
    def holds(self) -> bool | None:
        """Whether the model holds; None while it is not decided."""
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
    return NextCheck(result, count, limit, lacking, further)


def _row(saved: SavedModel, q: Array) -> pd.DataFrame:
    """One pose with the headers of the table of the fit."""
    return joint_table(saved.mechanism, q[None], saved.columns)
