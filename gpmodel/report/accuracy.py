"""Position accuracy over poses in the manner of ISO 9283."""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import Report


@dataclass(frozen=True)
class Accuracy:
    """3-D errors over some poses, mm. within_95: the 95th percentile."""

    poses: int
    mean: float
    mean_3sd: float
    within_95: float
    largest: float
    rms: float


def accuracy(errors: Array) -> Accuracy:
    """Statistics of errors (N,), mm: mean, mean + 3 s, 95th percentile, maximum and RMS. Needs two poses."""
    return Accuracy(
        poses=len(errors),
        mean=float(errors.mean()),
        mean_3sd=float(errors.mean() + 3 * errors.std(ddof=1)),
        within_95=float(np.percentile(errors, 95)),
        largest=float(errors.max()),
        rms=float(np.sqrt(np.mean(errors**2))),
    )


def errors_before_and_after(report: Report) -> Array | None:
    """Errors (N, 2), mm, at the held-out poses, or the fitted ones where none were held out; None with fewer than two.

    Before is registration and tool alone: what the machine does with its nominal geometry.
    """
    first = report.ladder[0].step if report.ladder else ""
    steps = (pose_errors(report, (first, report.shipped))) if first else ()
    seen = [p for p in steps if (p.heldout or not report.held) and p.before is not None and p.after is not None]
    return np.array([(p.before, p.after) for p in seen], dtype=float) if len(seen) > 1 else None


def before_and_after(report: Report) -> tuple[Accuracy, Accuracy] | None:
    """The accuracy of both; None where there are no errors."""
    errors = errors_before_and_after(report)
    return None if errors is None else (accuracy(errors[:, 0]), accuracy(errors[:, 1]))
