"""A further machine of a known type: its poses, and what is believed of it before they are measured."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.model_file import saved_model
from gpmodel.application.uncertainty import point_deviation
from gpmodel.calibration.comparison import Step, climb, growing, step_of
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.errors import InputError
from gpmodel.hierarchy.between import residual
from gpmodel.hierarchy.record import FleetPart, prior_model
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Poses, observe
from gpmodel.numerics.multiple import SIGNIFICANCE, holm
from gpmodel.wording import length

PRIOR = "the prior of the fleet"
"""What the last step of such a machine is called."""


@dataclass(frozen=True)
class Further:
    """steps: registration, its own poses alone where they are enough, and with the prior of its type. final: the last
    of them; alone: the one before it, where it tells every effect. outlying: effects in which it is unlike its type."""

    steps: tuple[Step, ...]
    final: Calibration
    alone: Calibration | None
    outlying: tuple[str, ...]

    def in_words(self, poses: Poses) -> str:
        """What the prior is worth in poses, and where the machine is unlike its type."""
        found = f" It is unlike its type in {', '.join(self.outlying)}." if self.outlying else ""
        if self.alone is None:
            return f"These {len(poses)} poses alone do not determine the model.{found}"
        both = _known(self.final, poses)
        alone = _known(self.alone, poses) * self.final.sigma / self.alone.sigma
        worth = len(poses) * ((alone / both) ** 2 - 1.0)
        return (
            f"The {len(poses)} poses tell the point to {length(1e3 * alone)} alone, with the prior to "
            f"{length(1e3 * both)}: it is worth about {max(worth, 0.0):.0f} poses more.{found}"
        )


def further_machine(fleet: FleetPart, mechanism: Mechanism, seen: Poses, unseen: Poses, seed: int = 0) -> Further:
    """A machine of the type fitted to the poses `seen` and judged by those `unseen`.

    An effect whose value by these poses alone is beyond chance for the type keeps it, without a prior. Raises
    InputError where the fleet is of another mechanism.
    """
    prior = prior_model(fleet, mechanism)
    told = {part.name for part in fleet.effects}
    bare = tuple(replace(effect, mean=0.0, prior=np.inf) for effect in prior.effects if effect.name in told)
    try:
        steps = climb(mechanism, growing(bare, ()), seen, unseen, seed=seed)
    except InputError:
        steps = climb(mechanism, growing((), ()), seen, unseen, seed=seed)
    last = steps[-1].calibration
    alone = last if len(steps) > 1 and last.kept.all() else None
    outlying = () if alone is None else _outlying(fleet, alone, prior)
    fit = fitted_with_prior(prior, seen, alone, outlying)
    return Further((*steps, step_of(PRIOR, fit, seen, unseen)), fit, alone, outlying)


def fitted_with_prior(
    prior: ErrorModel, poses: Poses, alone: Calibration | None = None, outlying: tuple[str, ...] = ()
) -> Calibration:
    """Poses fitted with what is believed of the type but of the `outlying`, weighed by the larger of its noise and of
    that which the machine's poses `alone` leave."""
    effects = tuple(replace(e, prior=np.inf) if e.name in outlying else e for e in prior.effects)
    noise = max(prior.noise or 0.0, 0.0 if alone is None else alone.sigma)
    return calibrate(replace(prior, effects=effects, noise=noise), poses, condition_limit=LARGEST_LIMIT)


def _outlying(fleet: FleetPart, alone: Calibration, prior: ErrorModel) -> tuple[str, ...]:
    """Effects that the poses of the machine alone put beyond chance for its type."""
    stderr = alone.stderr * max(1.0, (prior.noise or 0.0) / alone.sigma)
    chances = np.array(
        [
            residual(value, error**2, part.mean, part.prior, len(fleet.machines) - len(part.outliers))[1]
            if kept
            else 1.0
            for value, error, kept, part in zip(alone.theta, stderr, alone.kept, fleet.effects, strict=True)
        ]
    )
    return tuple(part.name for part, p in zip(fleet.effects, holm(chances), strict=True) if p < SIGNIFICANCE)


def _known(fit: Calibration, poses: Poses) -> float:
    """RMS standard deviation, m, of the predicted point over poses."""
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    return float(np.sqrt(np.mean(point_deviation(saved_model(fit, poses), poses, observed) ** 2)))
