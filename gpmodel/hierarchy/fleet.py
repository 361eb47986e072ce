"""Many machines of one type calibrated together: own numbers, what the type has in common, and both together."""

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.checks.counting import measured_values
from gpmodel.hierarchy.between import Shared, Standing, between, standing
from gpmodel.hierarchy.prior import learned
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses


@dataclass(frozen=True)
class Fleet:
    """Machines calibrated together. own: each by its poses alone, all with the same effects. shrunken: with the type's
    `prior` beside its poses, geometry complete.

    values, stderr: (m, K + 1) of the own effects and, last, the logarithm of the noise. shared: of each of these.
    standing: of each machine in each. left_out: effects that not every machine's poses can tell.
    """

    own: tuple[Calibration, ...]
    shrunken: tuple[Calibration, ...]
    prior: tuple[Effect, ...]
    values: Array
    stderr: Array
    shared: tuple[Shared, ...]
    standing: Standing
    left_out: tuple[str, ...]


def calibrate_fleet(machines: Sequence[tuple[Mechanism, Poses]], effects: tuple[Effect, ...], seed: int = 0) -> Fleet:
    """Empirical Bayes over machines with the same effects: each estimated by itself, mean and spread of what they
    share learned from that, then each estimated again with it as its prior.

    Priors of the effects themselves are of the type's means, not of the machines. A machine that stands out in an
    effect keeps its own number there and teaches nothing of the type, unless fewer than two are left. Source: Efron and
    Morris (1975). Raises InputError where the poses of a machine are too few for the effects.
    """
    free = tuple(replace(effect, prior=np.inf) for effect in effects)
    alone = [calibrate(ErrorModel(mechanism, free), poses, seed=seed) for mechanism, poses in machines]
    held = np.all([fit.kept for fit in alone], axis=0)
    common = tuple(effect for effect, k in zip(free, held, strict=True) if k)
    own = tuple(
        calibrate(ErrorModel(mechanism, common), poses, condition_limit=LARGEST_LIMIT, seed=seed)
        for mechanism, poses in machines
    )
    values = np.array([[*fit.theta, np.log(fit.sigma)] for fit in own])
    stderr = np.array([[*fit.stderr, _of_logarithm(fit, poses)] for fit, (_, poses) in zip(own, machines, strict=True)])
    found = standing(values, stderr**2)
    shared = tuple(between(values[inside, k], stderr[inside, k] ** 2) for k, inside in enumerate(found.inside.T))
    typical = np.flatnonzero(found.inside[:, :-1].all(axis=1)).tolist()
    taught = typical if len(typical) > 1 else range(len(machines))
    whole = tuple(effect for effect, k in zip(effects, held, strict=True) if k or effect.constant)
    prior = learned([machines[i] for i in taught], [own[i] for i in taught], whole)
    shrunken = tuple(
        with_prior(fit, poses, prior, {e.name for e, k in zip(common, inside[:-1], strict=True) if not k})
        for fit, (_, poses), inside in zip(own, machines, found.inside, strict=True)
    )
    left_out = tuple(effect.name for effect, k in zip(free, held, strict=True) if not k)
    return Fleet(own, shrunken, prior, values, stderr, shared, found, left_out)


def with_prior(own: Calibration, poses: Poses, prior: tuple[Effect, ...], outlying: Set[str]) -> Calibration:
    """The same poses fitted with a prior of all but the `outlying`, weighed by the noise that the machine has."""
    effects = tuple(replace(e, prior=np.inf) if e.name in outlying else e for e in prior)
    return calibrate(ErrorModel(own.model.mechanism, effects, own.sigma), poses, condition_limit=LARGEST_LIMIT)


def _of_logarithm(fit: Calibration, poses: Poses) -> float:
    """Standard deviation of log σ, 1 / √(2 n) with n degrees of freedom."""
    used = np.setdiff1d(np.arange(len(poses)), fit.outliers)
    return float(1.0 / np.sqrt(2.0 * max(measured_values(poses.dataset.subset(used)) - fit.rank, 1)))
