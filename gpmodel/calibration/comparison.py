"""The ladder: one model after the other on the same poses, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on, without_outlier_marks
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Errors:
    """Statistics of 3-D errors, m: mean, root mean square, maximum; NaN over no poses."""

    mean: float
    rms: float
    max: float

    def as_mm(self) -> dict[str, float]:
        """The same in mm, as report.json has it."""
        return {"mean_mm": 1e3 * self.mean, "rms_mm": 1e3 * self.rms, "max_mm": 1e3 * self.max}


def summarise(error: Array) -> Errors:
    """Statistics of errors (N,), m."""
    if len(error) == 0:
        return Errors(np.nan, np.nan, np.nan)
    return Errors(float(np.mean(error)), float(np.sqrt(np.mean(error**2))), float(np.max(error)))


@dataclass(frozen=True)
class Rung:
    """One model: its name, its fit to the training poses, its errors there and on the poses held out."""

    step: str
    fit: Calibration
    train: Errors
    heldout: Errors


def climb(
    mechanism: Mechanism,
    poses: Poses,
    train: IntArray,
    heldout: IntArray,
    standard: tuple[Effect, ...],
    effects: Sequence[tuple[str, tuple[Effect, ...]]],
    *,
    condition_limit: float | None = None,
    seed: int = 0,
) -> tuple[Rung, ...]:
    """Registration, the standard model, then one named group of effects after the other, each fitted anew.

    train, heldout: rows of `poses`; of the held-out ones, those of a set-up or tool not trained on are left out.
    """
    seen = poses.subset(train)
    unseen = poses.subset(heldout[known_rows(seen.dataset, poses.dataset.subset(heldout))])
    models: list[tuple[str, tuple[Effect, ...]]] = [("registration", ())]
    if standard:
        models.append(("standard", standard))
    for name, group in effects:
        models.append((name, models[-1][1] + group))
    rungs: list[Rung] = []
    for step, of_model in models:
        start = without_outlier_marks(rungs[-1].fit) if rungs else None
        fit = calibrate(ErrorModel(mechanism, of_model), seen, condition_limit=condition_limit, start=start, seed=seed)
        errors = errors_on(fit, unseen) if len(unseen) else np.zeros(0)
        rungs.append(Rung(step, fit, summarise(fit.error), summarise(errors)))
    return tuple(rungs)


def known_rows(trained: Dataset, other: Dataset) -> IntArray:
    """Rows of `other` whose set-up and tool occur in `trained`."""
    known = np.ones(len(other), dtype=bool)
    for column in ("setup", "tool"):
        known &= np.isin(other.label(column), trained.label(column))
    return np.flatnonzero(known)
