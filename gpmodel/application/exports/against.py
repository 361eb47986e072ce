"""Compare exports with `predict` at unmeasured poses."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.forward import Forward, forward_of
from gpmodel.application.exports.sample import Place
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import placed_now, usable
from gpmodel.arrays import Array
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class PredictedPoints:
    """Unmeasured poses, and their points (N, 3), m, by `predict`."""

    dataset: Dataset
    points: Array

    @classmethod
    def of(cls, saved: SavedModel, dataset: Dataset) -> "PredictedPoints":
        """Predict the points without errors of the instrument and of the session."""
        kept = placed_now(usable(saved))
        poses = prepare(saved.mechanism, replace(dataset, observations=()))
        return cls(dataset, observe(kept.model, poses, kept.theta, kept.placement).tip[:, :3, 3])

    def errors(self, points: Array) -> tuple[float, float]:
        """Return RMS and largest distance, m, of points (N, 3) from the predicted ones."""
        off = np.linalg.norm(points - self.points, axis=1)
        return root_mean_square(off), float(off.max())


@dataclass(frozen=True)
class Check:
    """Predicted points, and the inputs (N, k) of a forward model at their poses."""

    forward: Forward
    predicted: PredictedPoints
    inputs: Array

    @classmethod
    def against(cls, saved: SavedModel, place: Place, dataset: Dataset) -> "Check":
        """Predict the points of a dataset and collect the inputs. Raises InputError as `forward_of`."""
        forward, states = forward_of(saved, place), prepare(saved.mechanism, dataset).states
        columns = [dataset.payload if n == "payload" else states[n] for n in forward.inputs]
        return cls(forward, PredictedPoints.of(saved, dataset), np.column_stack(columns))
