"""Fit a sequence of growing models to the same poses, and compare their errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Linearised, Weighting, linearise
from gpmodel.calibration.result import Calibration, errors_on, without_outlier_marks
from gpmodel.calibration.undeclared import apart_from_effects
from gpmodel.calibration.unmeasured_joints import STARTING_WEIGHTS
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, prepare
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset

TOOL_POINT = (0.05, 0.07, 0.11)
"""Tool point relative to the flange, m. A tool point off every axis is displaced by errors of the last joint."""
CONDITION_LIMIT = 1e4
"""Condition number above which a combination of errors is not fitted, because joint values are rounded."""


def linearised_at_nominal(mechanism: Mechanism, effects: tuple[Effect, ...], data: Dataset) -> Linearised:
    """Linearise the measurements in registration, tool and effects, all zero, at the poses of a table.

    Of a measured value, only whether it is NaN matters. The fixed end of each measured distance is 2 m away.
    """
    anchors = {name: np.array([2.0, 0.3 + i, 0.1, 0.0]) for i, name in enumerate(data.distances)}
    model, placement = ErrorModel(mechanism, effects), Placement({"": np.eye(4)}, {"": se3.shift(TOOL_POINT)}, anchors)
    weighting = Weighting(STARTING_WEIGHTS, np.ones(len(data), dtype=bool))
    return linearise(model, prepare(mechanism, data), np.zeros(len(effects)), placement, weighting)


@dataclass(frozen=True)
class Step:
    """One model of a sequence of growing models: its name, its fit to the training poses and its 3-D errors, m.

    train_error: error of each training pose. heldout_error: error of each held-out pose, NaN for an unknown set-up or
    tool. finding: index of the accepted effect that the model adds.
    """

    name: str
    calibration: Calibration
    train_error: Array
    heldout_error: Array
    finding: int | None = None


@dataclass(frozen=True)
class HeldOutFit:
    """A fit of a model to the poses `train`, and the poses `heldout`, which the fit has not used."""

    fit: Calibration
    train: Poses
    heldout: Poses

    @property
    def known(self) -> Poses:
        """The held-out poses whose registration and tool point were fitted to training poses."""
        return self.heldout.subset(known_rows(self.train.dataset, self.heldout.dataset))


Models = Sequence[tuple[str, tuple[Effect, ...]]]
"""Names of calibration models, and the error terms (effects) of each calibration model."""


def nested_models(standard: tuple[Effect, ...], groups: Models) -> Models:
    """Return a sequence of models: registration, standard model, then one more group of effects in each model."""
    models: list[tuple[str, tuple[Effect, ...]]] = [("registration", ())]
    if standard:
        models.append(("standard", standard))
    for name, group in groups:
        models.append((name, models[-1][1] + group))
    return models


def fit_steps(
    mechanism: Mechanism, models: Models, train: Poses, heldout: Poses, condition_limit: float | None = None,
    seed: int = 0,
) -> tuple[Step, ...]:  # fmt: skip
    """Fit each model to the poses `train`, starting from the previous fit; evaluate each fit on the poses `heldout`."""
    fits: list[tuple[str, Calibration]] = []
    for name, of_model in models:
        start = without_outlier_marks(fits[-1][1]) if fits else None
        fit = calibrate(ErrorModel(mechanism, of_model), train, condition_limit=condition_limit, start=start, seed=seed)
        fits.append((name, apart_from_effects(fit, train)))
    return steps_of(fits, train, heldout)


def steps_of(fits: Sequence[tuple[str, Calibration]], train: Poses, heldout: Poses) -> tuple[Step, ...]:
    """Compute the errors of named fits, all by the weights of the last fit, so that the models are comparable.

    `with_fit` computes the steps again with a further fit, which changes the weights of all steps.
    """
    weights, known = fits[-1][1].weights, known_rows(train.dataset, heldout.dataset)
    there = heldout.subset(known)

    def step(name: str, fit: Calibration) -> Step:
        unseen = np.full(len(heldout), np.nan)
        if len(known):
            unseen[known] = errors_on(fit, there, weights)
        return Step(name, fit, fit.error if fit.weights == weights else errors_on(fit, train, weights), unseen)

    return tuple(step(*named) for named in fits)


def with_fit(steps: Sequence[Step], name: str, fit: Calibration, train: Poses, heldout: Poses) -> tuple[Step, ...]:
    """Return the steps and a further fit, with the errors of all by the weights of the further fit."""
    return steps_of([*((step.name, step.calibration) for step in steps), (name, fit)], train, heldout)


def known_rows(trained: Dataset, other: Dataset) -> IntArray:
    """Return the rows of the table `other` that have a registration and a tool of the table `trained`."""
    known = np.ones(len(other), dtype=bool)
    for column in ("setup", "tool"):
        known &= np.isin(other.label(column), trained.label(column))
    return np.flatnonzero(known)
