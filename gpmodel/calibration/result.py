"""Result of a fit, with its diagnostics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, linearise
from gpmodel.calibration.unmeasured_joints import solve_joints
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, pose_error
from gpmodel.numerics.rank import RankChoice

CORRELATED = 0.8
"""Correlation from which two numbers are said to stand for one another: together they are known far better than
either, whose deviation is at least 1.7 times what it would be alone."""


@dataclass(frozen=True)
class Placed:
    """One number of the registration or the tool: its name, value and deviation in m or rad (`unit`)."""

    name: str
    value: float
    stderr: float
    unit: str


@dataclass(frozen=True)
class Covariance:
    """Covariance of registration, tool and effects: values (P + E, P + E), SI, zero where not fitted.

    placement: names of the P unknowns before the effects. centre: (3,) m in the instrument's frame, about which a
    twist of the registration turns.
    """

    values: Array
    placement: tuple[str, ...]
    centre: Array


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a fit.

    stderr, unique_share: (E,), NaN and zero where dropped.
    correlation: (E, E).
    covariance: of all fitted quantities.
    placed: registration and tool, number by number.
    sigma: standard deviation of one measurement about the model, one component, m.
    freedom: degrees of freedom of sigma, and of the Student's t of the numbers in units of stderr.
    rank: number of unknowns that the measurements determine.
    """

    stderr: Array
    correlation: Array
    covariance: Covariance
    unique_share: Array
    placed: tuple[Placed, ...]
    sigma: float
    freedom: float
    rank: int


@dataclass(frozen=True, eq=False)
class Calibration(Uncertainty):
    """The fitted numbers and what is needed to distrust them.

    theta: (E,) values of model.effects, zero where dropped. kept: (E,) bool. error: (N,) 3-D error of each pose, m.
    outliers: indices of poses left out of the fit. rotation_weight: m that a radian of measured rotation counts.
    pose_ratio: variance of what repeats of a pose share over that of their measurements about it, zero where nothing
    was measured twice. status: converged, stalled, diverged or kept previous; reason says why.
    """

    model: ErrorModel
    placement: Placement
    theta: Array
    kept: Mask
    error: Array
    outliers: IntArray
    condition_limit: float
    rank_curve: tuple[RankChoice, ...]
    rotation_weight: float
    pose_ratio: float
    status: str
    reason: str

    @property
    def fitted_error(self) -> Array:
        """3-D errors of the poses that were fitted, without the outliers, m."""
        return np.delete(self.error, self.outliers)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the effects that the poses could not determine."""
        return tuple(e.name for e, k in zip(self.model.effects, self.kept, strict=True) if not k)

    def values_of(self, effects: Sequence[Effect]) -> list[float]:
        """Values of some of its effects, by name."""
        values = dict(zip((e.name for e in self.model.effects), self.theta.tolist(), strict=True))
        return [values[effect.name] for effect in effects]

    @cached_property
    def partners(self) -> Mapping[str, tuple[tuple[str, float], ...]]:
        """Effects correlated above CORRELATED in absolute value with each kept effect."""
        names, kept = [e.name for e in self.model.effects], np.flatnonzero(self.kept)
        out: dict[str, list[tuple[str, float]]] = {names[i]: [] for i in kept}
        among = self.correlation[np.ix_(kept, kept)]
        near = (np.abs(among) > CORRELATED) & ~np.eye(len(kept), dtype=bool)
        for a, b in np.argwhere(near).tolist():
            out[names[kept[a]]].append((names[kept[b]], float(among[a, b])))
        return {name: tuple(partners) for name, partners in out.items()}


def problem_at(calibration: Calibration, poses: Poses) -> Linearised:
    """The weighted linear problem of a fitted model at any poses of known setups and tools, every one of them."""
    use = np.ones(len(poses), dtype=bool)
    model, theta, placement = calibration.model, calibration.theta, calibration.placement
    return linearise(model, poses, theta, placement, calibration.rotation_weight, use)


def errors_on(calibration: Calibration, poses: Poses) -> Array:
    """3-D error (N,) of a fitted model on any poses of known setups and tools, m; free joints are solved first."""
    poses = resolved(calibration, poses)
    observed = observe(calibration.model, poses, calibration.theta, calibration.placement)
    return pose_error(observed, poses.dataset)


def resolved(calibration: Calibration, poses: Poses) -> Poses:
    """The poses with the free joints of the mechanism solved against what was measured; the same without any."""
    return solve_joints(calibration.model, poses, calibration.theta, calibration.placement)


def without_outlier_marks(calibration: Calibration) -> Calibration:
    """Return the calibration without outlier marks, to judge every pose anew."""
    return replace(calibration, outliers=np.zeros(0, dtype=np.int64))
