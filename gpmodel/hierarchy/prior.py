"""Prior of a further machine of a type, learned from the machines by marginal likelihood.

    b_i ~ N(μ, T),  T = diag(τ²)                                b_i: all effects of machine i, geometry complete

Coordinates of the complete geometry stand for one another in part; machines differ independently in all of them, where
in a set without such coordinates they would differ together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses

WIDE = 3e-3
"""Metres and radians of geometry that no machine is built worse than; it is taken off again before anything is learned,
and remains only of what no machine's poses show."""

STEPS, SETTLED = 500, 1e-4
"""Largest number of iterations, and the relative change of every τ² at which they end.

The change is a hundredth of the standard error of τ² with hundreds of machines.
"""


@dataclass(frozen=True)
class Information:
    """Information of poses about effects: Λ (m, E, E) and η (m, E), likelihood exp(ηᵀb - bᵀΛb / 2) of each of m
    machines.
    """

    matrix: Array
    vector: Array


def learned(
    machines: Sequence[tuple[Mechanism, Poses]], own: Sequence[Calibration], effects: tuple[Effect, ...]
) -> tuple[Effect, ...]:
    """The effects with the mean and the prior deviation √(τ² + var μ) of the type.

    own: fits of the machines by themselves, whose noise weighs their poses, with at least the varying ones of the
    effects. Constant effects of one unit have one τ, every other its own. Means are believed to be within WIDE of zero,
    within an effect's own prior, or of the size it has alone. Source: Laird and Ware (1982), by the EM algorithm.
    """
    constant = np.array([e.constant for e in effects])
    size = np.array([WIDE if e.constant else min(e.prior, _size(own, e.name)) for e in effects])
    wide = tuple(replace(e, mean=0.0, prior=float(s)) for e, s in zip(effects, size, strict=True))
    fits = [
        calibrate(ErrorModel(mechanism, (*wide, *beyond(fit, wide)), fit.sigma), poses, condition_limit=LARGEST_LIMIT)
        for (mechanism, poses), fit in zip(machines, own, strict=True)
    ]
    kinds = np.unique([e.unit if e.constant else e.name for e in effects], return_inverse=True)[1]
    mean, deviation = _expectation_maximisation(_information(fits, size), kinds, constant)
    return tuple(
        replace(e, mean=float(m * s), prior=float(d * s))
        for e, m, d, s in zip(effects, mean, deviation, size, strict=True)
    )


def beyond(fit: Calibration, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of a fit that are none of those of the type: what the machine alone has."""
    names = {effect.name for effect in effects}
    return tuple(effect for effect in fit.model.effects if effect.name not in names)


def _size(own: Sequence[Calibration], name: str) -> float:
    """Root mean square of an effect over the machines, or of its ± where that is larger."""
    at = [[e.name for e in fit.model.effects].index(name) for fit in own]
    values = [max(abs(fit.theta[k]), fit.stderr[k]) for fit, k in zip(own, at, strict=True)]
    return float(np.sqrt(np.mean(np.square(values))))


def _information(fits: Sequence[Calibration], size: Array) -> Information:
    """Compute the information of the poses alone, in units of `size`, about the first effects of each fit.

    Λ = C⁻¹ - 1 and η = C⁻¹ θ, with θ, C of fits with `size` as prior; later effects are the machine's own.
    """
    of_effects = [slice(first := len(fit.covariance.placement), first + len(size)) for fit in fits]
    own = [fit.covariance.values[at, at] for fit, at in zip(fits, of_effects, strict=True)]
    inverse = np.linalg.inv(np.array(own) / np.outer(size, size))
    theta = np.array([fit.theta[: len(size)] / size for fit in fits])
    return Information(inverse - np.eye(len(size)), np.einsum("mij,mj->mi", inverse, theta))


def _expectation_maximisation(told: Information, kinds: IntArray, constant: Mask) -> tuple[Array, Array]:
    """μ (E,) and the deviations (E,) of a further machine; effects of one kind (E,) have one τ.

    Expectation: C_i = (Λ_i + T⁻¹)⁻¹, b_i = C_i (η_i + T⁻¹ μ). Maximisation: μ their mean beside μ ~ N(0, 1), τ² that of
    (b_i - μ)² + diag C_i. The precision of μ is P = 1 + Σ (1 + Λ_i T)⁻¹ Λ_i; its variance diag P⁻¹, and 1 / diag P of
    what is `constant` (E,): of parameters that stand for one another each is as well known as beside the others.
    """
    count = np.bincount(kinds)
    mean, variance = np.zeros(len(kinds)), np.ones(len(kinds))
    for _ in range(STEPS):
        covariance = np.linalg.inv(told.matrix + np.diag(1.0 / variance))
        values = np.einsum("mij,mj->mi", covariance, told.vector + mean / variance)
        mean, before = values.sum(axis=0) / (len(values) + variance), variance
        single = np.mean((values - mean) ** 2 + np.diagonal(covariance, axis1=1, axis2=2), axis=0)
        variance = (np.bincount(kinds, single) / count)[kinds]
        if np.all(np.abs(variance - before) < SETTLED * before):
            break
    alone = np.eye(len(mean))
    precision = alone + np.linalg.solve(alone + told.matrix * variance, told.matrix).sum(axis=0)
    precision = 0.5 * (precision + precision.T)
    known = np.where(constant, 1.0 / np.diag(precision), np.diag(np.linalg.inv(precision)))
    return mean, np.sqrt(variance + known)
