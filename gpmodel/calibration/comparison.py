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


Models = Sequence[tuple[str, tuple[Effect, ...]]]
"""Names of models and all effects of each."""


def growing(standard: tuple[Effect, ...], groups: Models) -> Models:
    """Registration, the standard model, then one named group of effects after the other added to it."""
    models: list[tuple[str, tuple[Effect, ...]]] = [("registration", ())]
    if standard:
        models.append(("standard", standard))
    for name, group in groups:
        models.append((name, models[-1][1] + group))
    return models


def climb(
    mechanism: Mechanism, models: Models, seen: Poses, unseen: Poses, condition_limit: float | None = None,
    seed: int = 0,
) -> tuple[Rung, ...]:  # fmt: skip
    """One model after the other, each fitted anew to the poses `seen` and measured against those `unseen`.

    Of these, the ones of a set-up or tool not trained on are left out.
    """
    unseen = unseen.subset(known_rows(seen.dataset, unseen.dataset))
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
