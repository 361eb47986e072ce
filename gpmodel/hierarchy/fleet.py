"""Calibrate machines of one type: each machine alone, then the type, then each machine with the type as its prior."""

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.hierarchy import block
from gpmodel.hierarchy.between import Deviations, deviations
from gpmodel.hierarchy.record import NOISE, BlockPart, FleetPart, SharedPart, prior_parts
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import table_names, translate

WIDE = 3e-3
"""Prior standard deviation of geometric constants in the fit of one machine, m and rad: more than that of any machine.
The wide prior is removed before the type is estimated and remains only for constants that no poses determine."""

STEPS, SETTLED = 500, 1e-4
"""Largest number of EM iterations, and the relative change of every variance τ² at which they end: a hundredth of the
standard error of τ² with hundreds of machines."""


@dataclass(frozen=True)
class Information:
    """Information of the poses of each machine about all effects b: matrix Λ and vector η.

    The likelihood of effects b is exp(ηᵀb - bᵀΛb / 2).
    """

    matrix: Array
    vector: Array


def type_prior(
    machines: Sequence[tuple[Mechanism, Poses]], own: Sequence[Calibration], effects: tuple[Effect, ...]
) -> tuple[Effect, ...]:
    """Return the effects with the mean of the type and the prior deviation √(τ² + var μ) of a further machine.

    own: fit of each machine to its poses alone. The noise of each fit weights the poses; the fits contain at least the
    effects that are not constant. Constant effects of one unit have one spread τ, every other effect has its own τ. The
    mean of a constant has a prior of WIDE about zero; the mean of any other effect the smaller of the effect's prior
    and its size over the machines.
    Source: Laird and Ware (1982), by the EM algorithm.

        b_i ~ N(μ, T),  T = diag(τ²)                                b_i: all effects of machine i, geometry complete

    The geometry of each machine keeps its redundant constants. Machines differ independently in all constants; a model
    without the redundant constants would have correlated differences.
    """
    constant = np.array([e.constant for e in effects])
    size = np.array([WIDE if e.constant else min(e.prior, _size(own, e.name)) for e in effects])
    wide = tuple(replace(e, mean=0.0, prior=float(s)) for e, s in zip(effects, size, strict=True))
    fits = [
        calibrate(ErrorModel(mechanism, (*wide, *extras(fit, wide)), fit.sigma), poses, condition_limit=LARGEST_LIMIT)
        for (mechanism, poses), fit in zip(machines, own, strict=True)
    ]
    kinds = np.unique([e.unit if e.constant else e.name for e in effects], return_inverse=True)[1]
    mean, deviation = _expectation_maximisation(_information(fits, size), kinds, constant)
    return tuple(
        replace(e, mean=float(m * s), prior=float(d * s))
        for e, m, d, s in zip(effects, mean, deviation, size, strict=True)
    )


def extras(fit: Calibration, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects of one machine's fit that are not effects of its type."""
    names = {effect.name for effect in effects}
    return tuple(effect for effect in fit.model.effects if effect.name not in names)


def _size(own: Sequence[Calibration], name: str) -> float:
    """Return the RMS over the machines of the larger of an effect's absolute value and its standard error."""
    at = [[e.name for e in fit.model.effects].index(name) for fit in own]
    values = [max(abs(fit.theta[k]), fit.stderr[k]) for fit, k in zip(own, at, strict=True)]
    return float(np.sqrt(np.mean(np.square(values))))


def _information(fits: Sequence[Calibration], size: Array) -> Information:
    """Compute the information of the poses alone about the first effects of each fit, in units of `size`.

    Λ = C⁻¹ - 1 and η = C⁻¹ θ, with θ and C the effects and covariance of fits with `size` as prior. Later effects of a
    fit belong to one machine alone."""
    of_effects = [slice(first := len(fit.covariance.placement), first + len(size)) for fit in fits]
    own = [fit.covariance.values[at, at] for fit, at in zip(fits, of_effects, strict=True)]
    inverse = np.linalg.inv(np.array(own) / np.outer(size, size))
    theta = np.array([fit.theta[: len(size)] / size for fit in fits])
    return Information(inverse - np.eye(len(size)), np.einsum("mij,mj->mi", inverse, theta))


def _expectation_maximisation(told: Information, kinds: IntArray, constant: Mask) -> tuple[Array, Array]:
    """Return the mean μ and the prior deviations of all effects of a further machine.

    Effects of one number in `kinds` have one spread τ. Expectation: C_i = (Λ_i + T⁻¹)⁻¹, b_i = C_i (η_i + T⁻¹ μ).
    Maximisation: μ is the mean of b_i with prior μ ~ N(0, 1), and τ² the mean of (b_i - μ)² + diag C_i. The precision
    of μ is P = 1 + Σ (1 + Λ_i T)⁻¹ Λ_i, its variance diag P⁻¹. For a `constant` effect the variance of μ is 1 / diag P,
    the variance with all other constants known, since several constants are equivalent."""
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


@dataclass(frozen=True)
class Fleet:
    """Machines of one type calibrated together.

    individual: calibration of each machine alone, with its own selection of effects.
    type_effects: calibration of each machine by its poses alone, with the effects of the type.
    shrunk: calibration of each machine by its poses and the type's `prior`, with complete geometry.
    effects: names of effects without priors of their own.
    values, stderr: value and standard error of each effect and, last, of the logarithm of the noise, by machine.
    shared: mean and spread over the machines of each effect and, last, of the logarithm of the noise.
    blocks: records of the effects with priors of their own.
    deviations: deviation of each machine in each parameter and block.
    undetermined: names of effects that the poses of some machine do not determine.
    """

    individual: tuple[Calibration, ...]
    type_effects: tuple[Calibration, ...]
    shrunk: tuple[Calibration, ...]
    prior: tuple[Effect, ...]
    effects: tuple[Effect, ...]
    values: Array
    stderr: Array
    shared: tuple[block.TypeDistribution, ...]
    blocks: tuple[BlockPart, ...]
    deviations: Deviations
    undetermined: tuple[str, ...]


def calibrate_fleet(
    machines: Sequence[tuple[Mechanism, Poses]], alone: Sequence[Calibration], effects: tuple[Effect, ...]
) -> Fleet:
    """Estimate each machine alone, the mean and spread of the type, then each machine with the type as its prior.

    alone: fit of each machine alone, with `effects` first and then the effects of the machine alone. The effects of the
    machine alone stay in all fits of the machine.
    effects: effects of the type. The prior of an effect holds for a machine alone and for the mean of the type.

    A machine that is an outlier in an effect or a block keeps its own value of the effect or block. The type is learned
    without outlying machines, unless fewer than two machines remain. Source: Efron and Morris (1975), empirical Bayes.
    Raises InputError if a machine has too few poses for the effects.
    """
    held = np.all([fit.free[: len(effects)] for fit in alone], axis=0)
    common = tuple(effect for effect, k in zip(effects, held, strict=True) if k)
    own = tuple(
        calibrate(
            ErrorModel(mechanism, (*common, *extras(fit, effects)), fit.sigma), poses, condition_limit=LARGEST_LIMIT
        )
        for (mechanism, poses), fit in zip(machines, alone, strict=True)
    )
    bare = np.array([np.isinf(effect.prior) for effect in common], dtype=bool)
    values = np.array([[*fit.theta[: len(bare)][bare], np.log(fit.sigma)] for fit in own])
    stderr = np.array([[*fit.stderr[: len(bare)][bare], 1.0 / np.sqrt(2.0 * fit.freedom)] for fit in own])
    groups = block.blocks(common)
    alike = [block.parameter_information(v, e) for v, e in zip(values.T, stderr.T, strict=True)]
    told = [*alike, *(block.block_information(own, group) for _, group in groups)]
    found = deviations(told, len(machines))
    spreads = [block.type_distribution(of.subset(i)) for of, i in zip(told, found.inside.T, strict=True)]
    shared, of_blocks = tuple(spreads[: len(alike)]), spreads[len(alike) :]
    spread = tuple(
        BlockPart(name, prior_parts(group), of.spread, of.low, of.high, *_of_machines(found, k))
        for k, ((name, group), of) in enumerate(zip(groups, of_blocks, strict=True), len(alike))
    )
    plain = tuple(effect for effect, k in zip(common, bare, strict=True) if k)
    names = [*({e.name} for e in plain), set(), *({e.name for e in of.effects} for of in spread)]
    outlying = [set().union(*(n for n, k in zip(names, i, strict=True) if not k)) for i in found.inside]
    typical = [k for k, outside in enumerate(outlying) if not outside]
    taught = typical if len(typical) > 1 else range(len(machines))
    whole = tuple(effect for effect, k in zip(effects, held, strict=True) if k or effect.constant)
    prior = type_prior([machines[i] for i in taught], [own[i] for i in taught], whole)
    shrunken = tuple(
        with_prior(fit, poses, prior, outside) for fit, (_, poses), outside in zip(own, machines, outlying, strict=True)
    )
    left_out = tuple(effect.name for effect, k in zip(effects, held, strict=True) if not k)
    return Fleet(tuple(alone), own, shrunken, prior, plain, values, stderr, shared, spread, found, left_out)


def with_prior(own: Calibration, poses: Poses, prior: tuple[Effect, ...], outlying: Set[str]) -> Calibration:
    """Refit a machine's parameters with the prior of its type, at the machine's noise level.

    Effects in `outlying` and effects of the machine alone keep their priors.
    """
    untaught = {e.name: e for e in own.model.effects if e.name in outlying}
    effects = (*(untaught.get(e.name, e) for e in prior), *extras(own, prior))
    return calibrate(ErrorModel(own.model.mechanism, effects, own.sigma), poses, condition_limit=LARGEST_LIMIT)


def _of_machines(found: Deviations, k: int) -> tuple[tuple[float, ...], tuple[float, ...], tuple[int, ...]]:
    """Return deviation z and chance of each machine in the quantity with the index `k`, and the indices of outlying
    machines."""
    outside = np.flatnonzero(np.logical_not(found.inside[:, k]))
    return tuple(found.z[:, k].tolist()), tuple(found.chance[:, k].tolist()), tuple(outside.tolist())


def shared_parts(final: Fleet) -> tuple[SharedPart, ...]:
    """Return the fleet.json record of every effect without a prior of its own and, last, of the noise."""
    noise = Effect(NOISE, (), "1")
    out = []
    for k, (effect, of) in enumerate(zip((*final.effects, noise), final.shared, strict=True)):
        z, chances, outliers = _of_machines(final.deviations, k)
        fits = () if effect.constant else final.shrunk
        at = [[e.name for e in fit.model.effects].index(effect.name) for fit in fits]
        both = [(float(fit.theta[j]), float(fit.stderr[j])) for fit, j in zip(fits, at, strict=True)]
        out.append(
            SharedPart(
                name=effect.name, unit=effect.unit, constant=effect.constant and effect != noise,
                mean=float(of.mean[0]), stderr=float(np.sqrt(of.covariance[0, 0])),
                spread=of.spread, low=of.low, high=of.high,
                values=tuple(final.values[:, k].tolist()), stderrs=tuple(final.stderr[:, k].tolist()),
                shrunken=tuple(v for v, _ in both), shrunken_stderrs=tuple(e for _, e in both),
                z=z, chances=chances, outliers=outliers,
            )
        )  # fmt: skip
    return tuple(out)


def in_table_names(fleet: FleetPart) -> FleetPart:
    """Return a fleet record with the tables' joint names, for the report; fleet.json has the mechanism's names."""
    names, renamed = table_names(fleet.joints, fleet.columns), msgspec.structs.replace

    def said(of: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(translate(name, names) for name in of)

    return renamed(
        fleet,
        chosen=translate(fleet.chosen, names),
        left_out=said(fleet.left_out),
        machines=tuple(renamed(m, effects=said(m.effects)) for m in fleet.machines),
        parameters=tuple(renamed(p, name=translate(p.name, names)) for p in fleet.parameters),
        blocks=tuple(renamed(b, name=translate(b.name, names)) for b in fleet.blocks),
    )
