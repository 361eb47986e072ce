"""Position accuracy over poses in the manner of ISO 9283."""

from collections.abc import Callable
from functools import partial

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import Report
from gpmodel.wording import millimetres

STATISTICS: tuple[tuple[str, Callable[[Array], float]], ...] = (
    ("mean", np.mean),
    ("mean + 3 s", lambda errors: errors.mean() + 3 * errors.std(ddof=1)),
    ("95 % of the poses within", partial(np.percentile, q=95)),
    ("largest", np.max),
    ("RMS", root_mean_square),
)
"""What is stated of the 3-D errors (N,) over two poses or more."""


def statistics(errors: Array) -> tuple[tuple[str, str, str], ...]:
    """Rows of the table of accuracy of errors (N, 2), mm: name, before, after."""
    before, after = errors.T
    return tuple((name, millimetres(float(of(before))), millimetres(float(of(after)))) for name, of in STATISTICS)


def errors_before_and_after(report: Report) -> Array | None:
    """Errors (N, 2), mm, at the held-out poses, or the fitted ones where none were held out; None with fewer than two.

    Before is registration and tool alone: what the machine does with its nominal geometry.
    """
    first = report.ladder[0].step if report.ladder else ""
    steps = (pose_errors(report, (first, report.shipped))) if first else ()
    seen = [p for p in steps if (p.heldout or not report.held) and p.before is not None and p.after is not None]
    return np.array([(p.before, p.after) for p in seen], dtype=float) if len(seen) > 1 else None
