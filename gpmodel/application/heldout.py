"""Errors at held-out poses, predicted as by `predict`, and the model discrepancy estimated from them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.further import left_out
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.predict import coordinate_deviations, observed_by
from gpmodel.application.usable import usable
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Unseen
from gpmodel.calibration.discrepancy import FEWEST, noise_within
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.discovery.state import Discovery
from gpmodel.model.error_model import Poses, pose_error
from gpmodel.numerics.least_squares import outlier_limit


def shipped(found: Discovery) -> int:
    """Return the index of the step that is saved: the last if held-out poses confirm it, else the standard model."""
    return len(found.steps) - 1 if found.confirmed else 1


def unseen_of(found: Discovery) -> tuple[Unseen, ...]:
    """Return fits of the saved step with their held-out poses: one per fold, or a single one."""
    number = shipped(found)
    return tuple(
        Unseen(part.step(number).calibration, part.poses.subset(part.train), part.poses.subset(part.heldout))
        for part in found.parts or (found,)
        if len(part.heldout)
    )


def predicted_errors(saved: SavedModel, poses: Poses, *, as_measured: bool) -> Array:
    """Return the 3-D error (N,), m, of a model at measured poses, predicted as by `predict`.

    as_measured: with the errors of the instrument and of the session, as for the rows of the session itself.
    """
    return pose_error(observed_by(usable(saved, session=as_measured), poses)[1], poses.dataset)


def unseen_errors(poses: Poses, parts: Sequence[Unseen], *, as_measured: bool) -> Array:
    """Return the 3-D error (N,), m, of every pose by the fit that excluded it; NaN if none did."""
    out = np.full(len(poses), np.nan)
    for part in parts:
        asked = part.known
        if len(asked):
            at = np.isin(poses.dataset.row, asked.dataset.row)
            out[at] = predicted_errors(saved_model(part.fit, part.seen), asked, as_measured=as_measured)
    return out


def with_discrepancy(
    saved: SavedModel, fit: Calibration, poses: Poses, parts: Sequence[Unseen] = (), noise: float | None = None
) -> SavedModel:
    """Add noise and model discrepancy of one coordinate, m, to a model fitted to `poses`.

        discrepancy² = max(0, mean square held-out error - noise² - variance by parameters and other causes)

    parts: fits with held-out poses; without any, each pose is left out in turn. noise: of the instrument as specified;
    None for `noise_within`. Only poses with x, y and z count.
    """
    if poses.dataset.joints_approximate or not len(_whole(poses)):
        return saved
    noise = noise_within(fit, poses) if noise is None else noise
    found = [_by_parameters(part) for part in parts]
    if 3 * sum(len(squares) for squares, _ in found) < FEWEST:
        found = [_one_left_out(fit, poses)]
    squares, known = (np.concatenate(values) for values in zip(*found, strict=True))
    error = np.sqrt(squares.sum(axis=1))
    if 3 * len(error) < FEWEST:
        return replace(saved, noise=noise)
    near = error <= outlier_limit(error)
    variance = float(np.mean(squares[near]) - noise**2 - np.mean(known[near])) - _by_other_causes(saved, poses)
    return replace(saved, noise=noise, discrepancy=float(np.sqrt(max(0.0, variance))))


def _by_other_causes(saved: SavedModel, poses: Poses) -> float:
    """Return the mean variance, m², of a fitted coordinate that alternative causes of findings add to the
    parameters'."""
    if not len(saved.covariance.over_causes):
        return 0.0
    alone = replace(saved, covariance=replace(saved.covariance, others=(), over_causes=np.zeros((0, 0))))
    at, observed = observed_by(saved, poses)
    both, one = (np.mean(coordinate_deviations(model, at, observed) ** 2) for model in (saved, alone))
    return float(both - one)


def _whole(poses: Poses) -> IntArray:
    return np.flatnonzero(np.isfinite(poses.dataset.position).all(axis=1))


def _by_parameters(part: Unseen) -> tuple[Array, Array]:
    """Return the squared errors (K, 3) of held-out coordinates, m², and their variance (K, 3) by the fit's
    parameters."""
    asked = part.known
    asked = asked.subset(_whole(asked))
    if not len(asked):
        return np.zeros((0, 3)), np.zeros((0, 3))
    saved = usable(saved_model(part.fit, part.seen), session=True)
    poses, observed = observed_by(saved, asked)
    left = poses.dataset.position - observed.tip[:, :3, 3]
    return left**2, coordinate_deviations(saved, poses, observed) ** 2


def _one_left_out(fit: Calibration, poses: Poses) -> tuple[Array, Array]:
    """Return squared errors and variances of every fitted pose, predicted by the fit without that pose."""
    rows = np.setdiff1d(_whole(poses), fit.outliers)
    if fit.freedom < FEWEST:
        return np.zeros((0, 3)), np.zeros((0, 3))
    left, blur = left_out(fit, problem_at(fit, poses), rows)
    return left**2, np.repeat(fit.sigma**2 * blur[:, None], 3, axis=1)
