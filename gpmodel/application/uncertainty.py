"""Uncertainty of the predicted tool position."""

from collections.abc import Sequence

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.observed import Observed


def point_deviation(saved: SavedModel, poses: Poses, observed: Observed, *, placed: bool = True) -> Array:
    """Standard deviation (N,), m, of the predicted point: √ (trace(J Σ Jᵀ) + 3 d²) over everything fitted.

    It holds the uncertainty of the parameters and the model discrepancy d, not what the instrument adds. placed:
    whether registration and tool are in it, as in the instrument's frame. NaN where nobody fitted the model.
    """
    return np.asarray(np.linalg.norm(coordinate_deviations(saved, poses, observed, placed=placed), axis=1))


def coordinate_deviations(saved: SavedModel, poses: Poses, observed: Observed, *, placed: bool = True) -> Array:
    """Return the standard error of each coordinate (N, 3) along the axes of the instrument: √ (diag(J Σ Jᵀ) + d²)."""
    if len(saved.stderr) and not saved.covariance.placement:
        return np.full((len(poses), 3), np.nan)
    first = 0 if placed else len(saved.covariance.placement)
    columns = point_columns(saved, poses, observed)[:, :, first:]
    variance: Array = np.sum((columns @ saved.covariance.values[first:, first:]) * columns, axis=2)
    return np.sqrt(np.maximum(variance, 0.0) + saved.discrepancy**2)


def point_columns(saved: SavedModel, poses: Poses, observed: Observed, more: Sequence[Effect] = ()) -> Array:
    """Change (N, 3, P + E) of the point per unknown of registration, tool, every effect of the model and `more`."""
    effects = effect_columns((*saved.model.effects, *more), saved.model, poses, observed)[:, :3]
    return np.concatenate([placement_columns(saved, poses, observed), effects], axis=2)


def placement_columns(saved: SavedModel, poses: Poses, observed: Observed) -> Array:
    """Change (N, 3, P) of the point per unknown of registration and tool, in the instrument's axes."""
    tip, labels = observed.tip, poses.dataset
    out = np.zeros((len(tip), 3, len(saved.covariance.placement)))
    arm = tip[:, :3, 3] - saved.covariance.centre
    for k, name in enumerate(saved.covariance.placement):
        what, axis = name.split(" ", 1)[0], name.rsplit(" ", 1)[1]
        if what not in ("registration", "tool"):
            continue
        label = name.removeprefix(what).removesuffix(axis).strip()
        here = labels.label("setup" if what == "registration" else "tool") == label
        unit = np.eye(3)[AXES.index(axis) % 3]
        if what == "registration":
            out[here, :, k] = unit if axis.startswith("T") else np.cross(unit, arm[here])
        elif axis.startswith("T"):
            out[here, :, k] = tip[here, :3, :3] @ unit
    return out
