"""Constants apart from undeclared effects, in readings without an instrument's frame.

An undeclared effect looks like constants where it was read, and like others elsewhere. With r (M,) the readings,
F the columns of the placement and of declared effects, A those of every constant, c_a the column of axis a,

    r = F ρ + A θ + Σ_a c_a ∘ f_a(q) + e,   θ ~ N(0, τ² I),   f_a ~ N(0, γ_a² K),   e ~ N(0, n² I)

where f_a are unknown smooth functions of the joint values. γ_a, τ and n are those of the largest restricted likelihood.
Constants are then fitted by generalised least squares with the covariance of the functions and the noise. Sources:
Kennedy and O'Hagan (2001), Bayesian calibration of computer models; Patterson and Thompson (1971); Zhou, Hu, Zhou and
Lange (2019), MM algorithms for variance components models.
"""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.discrepancy import alike
from gpmodel.calibration.gauss_newton import fitting_of
from gpmodel.calibration.iterate import Coloured, iterate
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.priors import of_the_description
from gpmodel.calibration.result import Calibration, uncertainty
from gpmodel.calibration.size import LEAST, MOST, TOLERANCE, relative
from gpmodel.model.error_model import ErrorModel, Poses, pose_error
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank

LENGTHS, ORDER = (2.0, 0.5), 2
"""Correlation lengths of an unknown function, in ranges of a joint, and the joints it reads. A load hardly changes over
a table, so that most of an effect is its mean. With 0.3 and 0.08 of a range constants take up that mean: touches then
leave 7 of 8 arms worse outside their region than the description does."""
MOST_ROWS, LARGEST = 400, 3000
"""Readings from which variances are estimated, drawn evenly along the rows; and readings up to which their covariance
is inverted, of more the noise is taken to be white."""
STEPS = 20
"""Updates of the variances; with 40 no constant changes by a tenth of its standard error."""
ALONE_STEPS = 200
"""Updates of τ and n alone; of 100 the likelihood is the same to a thousandth of a nat."""
EARNED = 20.0
"""Nats. The largest gain of 56 tables of touches and cameras without an undeclared effect was 11, the least of eight
with a yielding joint and two oval gears 38: at half one table of noise is called more, at double one effect noise."""
START, SMALLEST = (1e-4, 3e-4, 0.3), 1e-8
"""γ and τ, m and rad, and the share of noise in the readings at first; the least γ and n, rounding."""


@dataclass(frozen=True)
class Undeclared:
    """Standard deviations of undeclared effects, constants and noise.

    sizes: (A,) γ of the unknown function at each axis of `geometric_effects`, m and rad.
    constant: τ of a constant, m and rad.
    noise: n of a reading, m.
    gain: log restricted likelihood above that without the functions, nats.
    """

    sizes: Array
    constant: float
    noise: float
    gain: float

    @classmethod
    def estimated(cls, problem: Linearised, model: ErrorModel, theta: Array) -> "Undeclared":
        """Estimate γ, τ and n from a linear problem at constants `theta` (E,) by their restricted likelihood."""
        rows = np.linspace(0, len(problem.residual) - 1, min(len(problem.residual), MOST_ROWS)).astype(int)
        axes, constant = _axes(problem, model)[rows], of_the_description(model)
        effects = problem.columns[rows, problem.placement :]
        taken = rank.orthonormal(np.hstack([problem.columns[rows, : problem.placement], effects[:, ~constant]]))
        rest = np.linalg.qr(taken, mode="complete")[0][:, taken.shape[1] :]
        known = rest.T @ (problem.residual[rows] + effects[:, constant] @ theta[constant])
        kernel, shown = _kernel(problem)[np.ix_(rows, rows)], rest.T @ axes
        like = shown @ shown.T
        varying, reach = np.full(axes.shape[1], START[0] ** 2), START[1] ** 2
        noise = START[2] ** 2 * float(np.mean(known**2)) + SMALLEST**2
        for _ in range(STEPS):
            varied = rest.T @ (((axes * varying) @ axes.T) * kernel) @ rest
            inverse = np.linalg.inv(varied + reach * like + noise * np.eye(len(known)))
            pulled = inverse @ known
            along, spread = (rest @ pulled)[:, None] * axes, (rest @ inverse @ rest.T) * kernel
            found = np.sum(along * (kernel @ along), axis=0), np.sum(axes * (spread @ axes), axis=0)
            varying = np.maximum(varying * np.sqrt(found[0] / np.maximum(found[1], 1e-300)), SMALLEST**2)
            reach *= np.sqrt((pulled @ like @ pulled) / max(float(np.sum(inverse * like)), 1e-300))
            reach = float(np.clip(reach, LEAST**2, MOST**2))
            noise = max(noise * float(np.sqrt((pulled @ pulled) / np.trace(inverse))), SMALLEST**2)
        whole = rest.T @ (((axes * varying) @ axes.T) * kernel) @ rest + reach * like + noise * np.eye(len(known))
        gain = _likelihood(whole, known) - _without_functions(like, known)
        return cls(np.sqrt(varying), float(np.sqrt(reach)), float(np.sqrt(noise)), gain)

    @property
    def stands_out(self) -> bool:
        """Return whether the functions explain the readings beyond what noise would."""
        return self.gain > EARNED

    def coloured(self, problem: Linearised, model: ErrorModel) -> Coloured:
        """The covariance of the functions and the noise in the rows of a problem, in units of that of the noise."""
        axes = _axes(problem, model) * self.sizes / self.noise
        lower = np.asarray(np.linalg.cholesky((axes @ axes.T) * _kernel(problem) + np.eye(len(axes))), dtype=float)
        return Coloured(lower, self.noise / min(self.constant, TOLERANCE))


def _likelihood(covariance: Array, known: Array) -> float:
    """Log density of values (M,) with a covariance (M, M), but for the constant."""
    lower = np.linalg.cholesky(covariance)
    return -float(np.log(np.diag(lower)).sum() + 0.5 * np.sum(np.linalg.solve(lower, known) ** 2))


def _without_functions(like: Array, known: Array) -> float:
    """Largest log density of values (M,) over τ and n, with the covariance τ² like + n² I."""
    values, vectors = np.linalg.eigh(like)
    squares, values = (vectors.T @ known) ** 2, np.maximum(values, 0.0)
    reach, noise = START[1] ** 2, START[2] ** 2 * float(np.mean(known**2)) + SMALLEST**2
    for _ in range(ALONE_STEPS):
        variance = reach * values + noise
        reach *= np.sqrt((values @ (squares / variance**2)) / max(float(np.sum(values / variance)), 1e-300))
        reach = float(np.clip(reach, LEAST**2, MOST**2))
        noise = max(noise * float(np.sqrt(np.sum(squares / variance**2) / np.sum(1.0 / variance))), SMALLEST**2)
    variance = reach * values + noise
    return -0.5 * float(np.sum(np.log(variance) + squares / variance))


def _axes(problem: Linearised, model: ErrorModel) -> Array:
    return problem.effect_rows(geometric_effects(model.mechanism), model)


def _kernel(problem: Linearised) -> Array:
    """K (M, M) of the rows of a problem."""
    poses, pose = np.unique(problem.pose_of_row, return_inverse=True)
    return alike(problem.poses.dataset.q[poses], LENGTHS, ORDER)[np.ix_(pose, pose)]


def apart_from_effects(fit: Calibration, poses: Poses) -> Calibration:
    """Fit the constants of a calibration again, apart from undeclared effects; as it is in an instrument's frame.

    sigma stays that of a reading about the constants alone, undeclared effects included.
    """
    fitting = fitting_of(fit, poses)
    raw = fitting.at(fit.theta, fit.placement)
    constants = fit.kept & of_the_description(fit.model)
    if not relative(raw) or not constants.any() or len(raw.residual) > LARGEST:
        return fit
    known = Undeclared.estimated(raw, fit.model, fit.theta).coloured(raw, fit.model)
    coloured = replace(fitting, coloured=known)
    again = iterate(coloured, fit.theta, fit.placement, fit.kept)
    told = uncertainty(coloured, again, fit.kept)
    placed = iterate(fitting, again.theta, again.placement, np.zeros_like(fit.kept))
    left = placed.problem.residual
    return replace(
        fit, **vars(told) | {"sigma": float(np.sqrt(left @ left / max(len(left) - told.rank, 1)))},
        theta=again.theta, placement=placed.placement, error=pose_error(placed.problem.observed, poses.dataset),
        status=fit.status if again.status == "stalled" else again.status,
    )  # fmt: skip
