"""Result of a solver of the joint, and the step that both solvers share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.model.error_model import Placement, Poses, pose_error


@dataclass(frozen=True)
class Progress:
    """One iteration: RMS 3-D error, m, before its step, and the largest motion of a predicted position, m."""

    rms: float
    moved: float


@dataclass(frozen=True)
class Solution:
    """theta: values of the model's effects. poses: with their solved angles. error: (N,) 3-D, m, at the end.

    status: converged, stalled or diverged; reason says why.
    """

    placement: Placement
    theta: Array
    poses: Poses
    error: Array
    history: tuple[Progress, ...]
    status: str
    reason: str

    @property
    def iterations(self) -> int:
        """Number of steps."""
        return len(self.history)


def truncated_step(problem: Linearised, truncation: float) -> tuple[Array, float]:
    """Step (K,) by SVD with 1/S set to zero below `truncation` of the largest S, and the largest motion it makes, m.

    Columns are scaled by their norms before any angle was eliminated.
    """
    scale = np.where(problem.sizes > 0, problem.sizes, 1.0)
    u, s, vt = np.linalg.svd(problem.columns / scale, full_matrices=False)
    good = s > truncation * s[0]
    step = vt[good].T @ ((u[:, good].T @ problem.residual) / s[good]) / scale
    return step, float(np.max(np.abs(problem.columns @ step), initial=0.0))


def error_of(problem: Linearised) -> Array:
    """3-D error (N,) of the poses a problem was linearised at, m."""
    return pose_error(problem.observed, problem.poses.dataset)


def verdict(history: Sequence[Progress], tolerance: float, limit: int) -> tuple[str, str] | None:
    """Status and reason once the iterations should stop, None to go on."""
    moved = [p.moved for p in history]
    if not np.isfinite(moved[-1]) or moved[-1] > 1e3 * max(moved[0], 1e-6):
        return "diverged", "steps grew: angles or positions in the wrong unit, or too small a truncation"
    if moved[-1] < tolerance:
        return "converged", f"the last step moved no position by more than {tolerance * 1e6:g} µm"
    if len(history) >= limit:
        rate = (moved[-1] / moved[0]) ** (1 / max(len(moved) - 1, 1)) if moved[0] > 0 else 1.0
        return (
            "stalled",
            f"still moving {moved[-1] * 1e6:.2g} µm after {limit} iterations, {100 * (1 - rate):.2g} % less each",
        )
    return None
