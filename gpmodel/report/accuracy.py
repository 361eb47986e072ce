"""Position accuracy over poses in the manner of ISO 9283, with what the number of poses leaves uncertain."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from gpmodel.arrays import Array
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import Report

CONFIDENCE = 0.95
"""Of the interval of an RMS: that of most instruments' certificates."""


@dataclass(frozen=True)
class Accuracy:
    """3-D errors over some poses, mm. low, high: 95 % interval of the RMS. within_95: the 95th percentile."""

    poses: int
    mean: float
    mean_3sd: float
    within_95: float
    largest: float
    rms: float
    low: float
    high: float


def accuracy(errors: Array) -> Accuracy:
    """Statistics of errors (N,), mm: mean, mean + 3 s, 95th percentile, maximum, RMS and its 95 % interval.

    The mean square of N errors is distributed as chi-square with ν = 2 N m² / v degrees of freedom, m and v the mean
    and variance of the squares (Satterthwaite 1946); ν = 3 N for isotropic Gaussian errors. Needs two poses.
    """
    squares = errors**2
    mean, variance = float(squares.mean()), float(squares.var(ddof=1))
    freedom = 2 * len(errors) * mean**2 / variance if variance > 0 else np.inf
    low, high = (
        np.sqrt(mean * freedom / stats.chi2.ppf(q, freedom)) if np.isfinite(freedom) else np.sqrt(mean)
        for q in ((1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2)
    )
    return Accuracy(
        poses=len(errors),
        mean=float(errors.mean()),
        mean_3sd=float(errors.mean() + 3 * errors.std(ddof=1)),
        within_95=float(np.percentile(errors, 95)),
        largest=float(errors.max()),
        rms=float(np.sqrt(mean)),
        low=float(low),
        high=float(high),
    )


def before_and_after(report: Report) -> tuple[Accuracy, Accuracy] | None:
    """Over the held-out poses, or the fitted ones where none were held out; None with fewer than two of them.

    Before is registration and tool alone: what the machine does with its nominal geometry.
    """
    first = report.ladder[0].step if report.ladder else ""
    steps = (pose_errors(report, (first, report.shipped))) if first else ()
    seen = [p for p in steps if (p.heldout or not report.held) and p.before is not None and p.after is not None]
    if len(seen) < 2:
        return None
    before, after = (np.array([getattr(p, name) for p in seen], dtype=float) for name in ("before", "after"))
    return accuracy(before), accuracy(after)
