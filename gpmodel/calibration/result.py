"""Result of a calibration: parameter values, standard errors and diagnostics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.directions import PositionResiduals, independent_share, with_noise
from gpmodel.calibration.iterate import Fitted, Fitting
from gpmodel.calibration.linearise import Linearised, Weighting, linearise
from gpmodel.calibration.noise import freedom
from gpmodel.calibration.overall_scale import unrepresented_constants
from gpmodel.calibration.priors import JointPriors, fit_priors
from gpmodel.calibration.serial import serial_noise
from gpmodel.calibration.unmeasured_joints import solve_joints
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, pose_error
from gpmodel.model.observation import Observation, Weights, weight_of
from gpmodel.numerics import rank as ident
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import MANY_COLUMNS, inverse_gram, inverse_of
from gpmodel.numerics.rank import RankChoice

CORRELATED = 0.8
"""Correlation of two parameters above which the report calls the parameters interchangeable. At a correlation of 0.8, a
standard error is 1.7 times as large as if the other parameter were known."""


@dataclass(frozen=True)
class PlacementNumber:
    """One number of the registration or the tool: name, value, and standard error in m or rad (`unit`)."""

    name: str
    value: float
    stderr: float
    unit: str


@dataclass(frozen=True)
class Covariance:
    """Covariance of registration, tool and effects, SI units; zero for effects that are not fitted.

    placement: names of the unknowns of registration and tool, which precede the effects.
    centre: point about which a rotation of the registration turns, (3,), m in the instrument's frame.
    alternatives: effects that could explain the data instead of an accepted effect; zero in the fit.
    over_causes: second moment of registration, tool, effects and `alternatives` about the fit, averaged over the
    alternative explanations, SI units; empty if the fit has none.
    """

    values: Array
    placement: tuple[str, ...]
    centre: Array
    alternatives: tuple[Effect, ...] = ()
    over_causes: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def predictive(self) -> Array:
        """Covariance of the unknowns for predictions, SI units: effects of the model, then alternative explanations, if
        any."""
        return self.over_causes if len(self.over_causes) else self.values

    def subset(self, kept: Mask) -> "Covariance":
        """Return the covariance of registration, tool and the effects of the mask `kept`."""
        rows = np.concatenate([np.ones(len(self.placement), dtype=bool), kept])
        every = np.concatenate([rows, np.ones(len(self.alternatives), dtype=bool)])
        moments = self.over_causes[np.ix_(every, every)] if len(self.over_causes) else self.over_causes
        return replace(self, values=self.values[np.ix_(rows, rows)], over_causes=moments)

    def with_certain(self, names: Sequence[str]) -> "Covariance":
        """Return the covariance with zero variance of some unknowns of registration and tool."""

        def left(matrix: Array) -> Array:
            kept = np.isin(np.arange(len(matrix)), [self.placement.index(name) for name in names], invert=True)
            return matrix * np.outer(kept, kept)

        return replace(self, values=left(self.values), over_causes=left(self.over_causes))


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of the parameters of a fit.

    stderr, unique_share: standard error and unique share of each effect, NaN and zero for dropped effects.
    correlation: correlation matrix of the estimated effects.
    covariance: covariance of all fitted quantities.
    placement_numbers: coordinates of registration and tool, with names and standard errors.
    sigma: standard deviation of one component of the reference kind of measurement about the model, m.
    freedom: degrees of freedom of sigma, and of Student's t of the estimates.
    rank: number of unknown parameters that the measurements determine.
    shape: covariance of the coordinates of a position relative to their mean variance, (3, 3), by the residuals; None
    for equal noise.
    left_out: measured minus predicted complete positions, (positions, 3), m, each predicted without its own value.
    """

    stderr: Array
    correlation: Array
    covariance: Covariance
    unique_share: Array
    placement_numbers: tuple[PlacementNumber, ...]
    sigma: float
    freedom: float
    rank: int
    shape: Array | None
    left_out: Array


@dataclass(frozen=True, eq=False)
class Calibration(Uncertainty):
    """Fitted model with its uncertainty and diagnostics.

    theta: value of each effect of the model, SI units, zero where dropped.
    free: True for each effect that is fitted.
    error: 3-D error of each pose, m.
    outliers: indices of the poses that are excluded from the fit.
    condition_limit, rank_curve: condition limit for dropping constants, and the cross-validation curve of the limit.
    weights: length, m, that counts as one unit of each kind of measurement.
    pose_ratio: variance shared by the repeats of a pose over the variance of one measurement; 0 without repeats.
    noise_shape: covariance of the coordinates of a position that weighs them in the fit; None for equal weights.
    status: converged, stalled, diverged or kept previous, explained by `reason`.
    """

    model: ErrorModel
    placement: Placement
    theta: Array
    free: Mask
    error: Array
    outliers: IntArray
    condition_limit: float
    rank_curve: tuple[RankChoice, ...]
    weights: Weights
    pose_ratio: float
    noise_shape: Array | None
    status: str
    reason: str

    @property
    def fitted_error(self) -> Array:
        """3-D errors of the fitted poses, outliers excluded, m."""
        return np.delete(self.error, self.outliers)

    def noise_of(self, kind: Observation) -> float:
        """Return the standard deviation of one component of a kind of measurement, in its SI unit."""
        return self.sigma / weight_of(kind, self.weights)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the effects that the poses could not determine."""
        return tuple(e.name for e, k in zip(self.model.effects, self.free, strict=True) if not k)

    @property
    def prior_errors(self) -> Array:
        """Prior standard deviation of each effect that the measurements do not show, SI units; NaN for effects that the
        measurements show."""
        deviation = np.sqrt(np.diag(self.covariance.values)[len(self.covariance.placement) :])
        return np.where(self.free | (deviation == 0.0), np.nan, deviation)

    @property
    def effective(self) -> int:
        """Effective number of unknowns; an unknown with a prior counts 1 - (stderr / prior)². Source: MacKay (1992)."""
        fitted = np.sqrt(np.diag(self.covariance.values)[len(self.covariance.placement) :])
        return round(self.rank - fixed_by_priors(self.model, np.where(self.free, fitted, np.nan)))

    def values_of(self, effects: Sequence[Effect]) -> list[float]:
        """Return the fitted values of some of the model's effects, in SI units, matched by name."""
        values = dict(zip((e.name for e in self.model.effects), self.theta.tolist(), strict=True))
        return [values[effect.name] for effect in effects]

    @cached_property
    def partners(self) -> Mapping[str, tuple[tuple[str, float], ...]]:
        """Map each fitted effect to the effects whose estimates correlate with its estimate by more than 0.8."""
        names, kept = [e.name for e in self.model.effects], np.flatnonzero(self.free)
        out: dict[str, list[tuple[str, float]]] = {names[i]: [] for i in kept}
        among = self.correlation[np.ix_(kept, kept)]
        near = (np.abs(among) > CORRELATED) & ~np.eye(len(kept), dtype=bool)
        for a, b in np.argwhere(near).tolist():
            out[names[kept[a]]].append((names[kept[b]], float(among[a, b])))
        return {name: tuple(partners) for name, partners in out.items()}


def fixed_by_priors(model: ErrorModel, stderr: Array) -> float:
    """Return the number of unknowns that the priors of the effects determine, Σ (stderr / prior)²; NaN counts as 0."""
    prior = np.array([e.prior for e in model.effects])
    return float(np.sum(np.nan_to_num(np.clip(stderr / prior, 0.0, 1.0)) ** 2))


def problem_at(calibration: Calibration, poses: Poses) -> Linearised:
    """Linearise a fitted model at any poses with known registrations and tools."""
    use = np.ones(len(poses), dtype=bool)
    model, theta, placement = calibration.model, calibration.theta, calibration.placement
    return linearise(model, poses, theta, placement, Weighting(calibration.weights, use, calibration.noise_shape))


def errors_on(calibration: Calibration, poses: Poses, weights: Weights | None = None) -> Array:
    """Return the 3-D error of each pose by a fitted model, m. Registrations and tools must be known; values of
    unmeasured joints are solved first. weights: weights of the kinds of measurements, by default those of the fit."""
    poses = resolved(calibration, poses)
    observed = observe(calibration.model, poses, calibration.theta, calibration.placement)
    return pose_error(observed, poses.dataset, calibration.weights if weights is None else weights)


def resolved(calibration: Calibration, poses: Poses) -> Poses:
    """Solve the values of unmeasured joints from the measurements; poses are unchanged if all joints are measured."""
    return solve_joints(calibration.model, poses, calibration.theta, calibration.placement, calibration.weights)


def without_outlier_marks(calibration: Calibration) -> Calibration:
    """Return the calibration without outliers, so that the next fit decides on every pose again."""
    return replace(calibration, outliers=np.zeros(0, dtype=np.int64))


def uncertainty(fitting: Fitting, fitted: Fitted, kept: Mask) -> Uncertainty:
    """Return the uncertainty at the end of a fit: covariance σ² (CᵀC)⁻¹ with noise σ, columns and prior rows C.

    The covariance allows for noise that depends on the direction, see `with_noise`.
    The noise variance is the sum of squares of the residual over (rows - rank), unless the model states its noise.
    Approximate values of unmeasured joints add rows for unknowns that the measurements do not determine.
    """
    problem, at = fitted.problem, np.flatnonzero(kept)
    free = problem.free(kept)
    priors = fit_priors(fitting.model, problem, fitted.theta, fitted.placement, kept)
    rows = priors.rows[:, free]
    count = len(problem.columns) + priors.effect_rows
    rank = int(free.sum())
    if problem.reduced is not None:
        both = np.vstack([problem.columns[:, free], rows[: priors.effect_rows]])
        rank = int(np.linalg.matrix_rank(both / _or_one(np.linalg.norm(both, axis=0)), 1e-9))
    left = float(np.sqrt(np.sum(problem.residual**2) / max(count - rank, 1)))
    sigma = left if fitting.model.noise is None else fitting.model.noise
    rows = np.vstack([rows, JointPriors.select(problem, rows, free, sigma).rows(problem)[:, free]])
    if free.sum() >= MANY_COLUMNS:
        products = (problem.columns.T @ problem.columns)[np.ix_(free, free)] + rows.T @ rows
        scale = _or_one(np.sqrt(np.diag(products)))
        inverse = inverse_of(products / np.outer(scale, scale))
        shares = np.minimum(1.0, 1.0 / np.sqrt(np.diag(inverse)))
    else:
        columns = np.vstack([problem.columns[:, free], rows])
        scale = _or_one(np.linalg.norm(columns, axis=0))
        inverse = inverse_gram(columns / scale)
        fixed = ident.orthonormal(columns[:count, : problem.placement])
        shares = ident.unique_shares(np.hstack([fixed, columns[:count, problem.placement :]]))
    own, inverse = problem.columns[:, free], inverse / np.outer(scale, scale)
    residuals = PositionResiduals.of(problem, own, inverse)
    if fitting.noise_shape is not None and fitting.model.noise is None:
        sigma = residuals.sigma
    serial = serial_noise(problem, own, residuals.rows) if fitting.model.noise is None else None
    covariance = with_noise(problem, own, sigma**2 * inverse, sigma, residuals.rows, serial)
    effects = slice(problem.placement, None)
    deviation = np.sqrt(np.diag(covariance))
    safe = np.where(deviation > 0, deviation, 1.0)
    n = len(kept)
    stderr, share, correlation = np.full(n, np.nan), np.zeros(n), np.zeros((n, n))
    stderr[at] = deviation[effects]
    share[at] = shares[len(shares) - len(at) :]
    correlation[np.ix_(at, at)] = (covariance / np.outer(safe, safe))[effects, effects]
    whole = np.zeros((len(free), len(free)))
    whole[np.ix_(free, free)] = covariance
    _add_unseen(whole, fitting, fitted, kept, sigma)
    unseen = np.flatnonzero(problem.sizes[: problem.placement] <= ident.NEGLIGIBLE)
    whole[unseen], whole[:, unseen] = 0.0, 0.0
    everything = Covariance(whole, problem.placement_names, problem.observed.tip[:, :3, 3].mean(axis=0))
    placed = placement_numbers(fitted.placement, problem, covariance[: problem.placement, : problem.placement])
    known = freedom(problem, fitting.block, fitting.ratio, rank - fixed_by_priors(fitting.model, stderr))
    known *= independent_share(residuals.shape) * (1.0 if serial is None else serial.independent)
    sigma *= 1.0 if serial is None else float(np.sqrt(serial.growth))
    return Uncertainty(
        stderr, correlation, everything, share, placed, sigma, known, rank, residuals.shape, residuals.left_out
    )


def _add_unseen(whole: Array, fitting: Fitting, fitted: Fitted, kept: Mask, sigma: float) -> None:
    """Add to a covariance, SI units, the prior variance of constants that the measurements do not show."""
    problem, model = fitted.problem, fitting.model
    unseen = unrepresented_constants(model, problem, fitted.placement, kept)
    if not unseen.any():
        return
    free = problem.free(kept | unseen)
    rows = fit_priors(model, problem, fitted.theta, fitted.placement, kept | unseen).rows
    columns = np.vstack([problem.columns, rows])[:, free]
    scale = _or_one(np.linalg.norm(columns, axis=0))
    whole[np.ix_(free, free)] = sigma**2 * inverse_gram(columns / scale) / np.outer(scale, scale)


def _or_one(norms: Array) -> Array:
    """Return norms of columns, where a norm at the level of rounding is replaced by 1."""
    return np.where(norms < ident.NEGLIGIBLE, 1.0, norms)


def placement_numbers(placement: Placement, problem: Linearised, covariance: Array) -> tuple[PlacementNumber, ...]:
    """Return the coordinates of registration and tool with standard errors.

    Coordinates of a frame are a position, m, and a rotation vector, rad. The frames are the robot's root in the
    instrument's frame and the tool in the flange's frame.
    """
    out: list[PlacementNumber] = []
    centre = problem.observed.tip[:, :3, 3].mean(axis=0)
    for name, frame in placement.registration.items():
        arm = frame[:3, 3] - centre
        turn = np.block([[np.eye(3), -se3.hat(arm)], [np.zeros((3, 3)), np.eye(3)]])
        out += _frame(f"registration{f' {name}' if name else ''}", frame, turn, problem, covariance)
    for name, frame in placement.tool.items():
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = frame[:3, :3]
        out += _frame(f"tool{f' {name}' if name else ''}", frame, turn, problem, covariance)
    return tuple(out)


def _frame(name: str, frame: Array, turn: Array, problem: Linearised, covariance: Array) -> list[PlacementNumber]:
    """Return the coordinates (position, rotation vector) of a frame, without coordinates that no measurement
    determines.

    turn: (6, 6) map from a step of the frame to a shift and a rotation about the axes of the outer frame.
    """
    names = [f"{name} {axis}" for axis in AXES]
    at = [problem.placement_names.index(n) for n in names if n in problem.placement_names]
    values = np.concatenate([frame[:3, 3], se3.rotation_vector(frame[:3, :3])])
    change = turn[:, : len(at)].copy()
    change[3:] = se3.vector_change(values[3:]) @ change[3:]
    moved = change @ covariance[np.ix_(at, at)] @ change.T
    deviation = np.sqrt(np.maximum(np.diag(moved), 0.0))
    words = [*(f"{name} {axis}" for axis in "xyz"), *(f"{name} r{axis}" for axis in "xyz")][: len(at)]
    seen = ~np.any(change[:, problem.sizes[at] <= ident.NEGLIGIBLE], axis=1)
    return [
        PlacementNumber(word, float(values[k]), float(deviation[k]), "m" if k < 3 else "rad")
        for k, word in enumerate(words)
        if seen[k]
    ]
