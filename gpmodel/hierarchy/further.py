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
from gpmodel.hierarchy.block import further_distance
from gpmodel.hierarchy.record import FleetPart, Part, prior_model
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe
from gpmodel.numerics.interval import SIGNIFICANCE, holm
from gpmodel.wording import length

PRIOR = "the prior of the fleet"
"""Name of the last step of a further machine."""


@dataclass(frozen=True)
class Further:
    """steps: registration, its own poses alone where they are enough, and with the prior of its type. final: the last
    of them; alone: the one before it, where it tells every effect. outlying: effects in which it is unlike its type."""

    steps: tuple[Step, ...]
    final: Calibration
    alone: Calibration | None
    outlying: tuple[str, ...]

    def in_words(self, poses: Poses) -> str:
        """State the value of the prior in poses, and the effects in which the machine differs from its type."""
        found = f" It is unlike its type in {', '.join(self.outlying)}." if self.outlying else ""
        if self.alone is None:
            return f"These {len(poses)} poses alone do not determine the model.{found}"
        both = _known(self.final, poses)
        alone = _known(self.alone, poses) * self.final.sigma / self.alone.sigma
        worth = round(max(len(poses) * ((alone / both) ** 2 - 1.0), 0.0))
        return (
            f"The {len(poses)} poses tell the point to {length(1e3 * alone)} alone, with the prior to "
            f"{length(1e3 * both)}: it is worth about {worth} pose{'s' * (worth != 1)} more.{found}"
        )


def further_machine(fleet: FleetPart, mechanism: Mechanism, seen: Poses, unseen: Poses, seed: int = 0) -> Further:
    """A machine of the type fitted to the poses `seen` and judged by those `unseen`.

    An effect whose value by these poses alone is beyond chance for the type keeps it, without a prior. Raises
    InputError where the fleet is of another mechanism.
    """
    prior = prior_model(fleet, mechanism)
    own = effects_alone(fleet, prior)
    bare = tuple(own.values())
    try:
        steps = climb(mechanism, growing(bare, ()), seen, unseen, seed=seed)
    except InputError:
        steps = climb(mechanism, growing((), ()), seen, unseen, seed=seed)
    last = steps[-1].calibration
    alone = last if len(steps) > 1 and last.kept.all() else None
    outlying = () if alone is None else _outlying(fleet, alone, prior, seen)
    fit = fitted_with_prior(fleet, prior, seen, alone, outlying)
    return Further((*steps, step_of(PRIOR, fit, seen, unseen)), fit, alone, outlying)


def effects_alone(fleet: FleetPart, prior: ErrorModel) -> dict[str, Effect]:
    """The effects that every machine's poses told, by name, as a machine by itself has them: with their own priors."""
    own = {part.name: part.effect for block in fleet.blocks for part in block.effects}
    told = own.keys() | {part.name for part in fleet.effects}
    return {e.name: own.get(e.name, replace(e, mean=0.0, prior=np.inf)) for e in prior.effects if e.name in told}


def fitted_with_prior(
    fleet: FleetPart, prior: ErrorModel, poses: Poses, alone: Calibration | None = None, outlying: tuple[str, ...] = ()
) -> Calibration:
    """Poses fitted with what is believed of the type but of the `outlying`, weighed by the larger of its noise and of
    that which the machine's poses `alone` leave."""
    names = set(outlying) | {e.name for block in fleet.blocks if block.name in outlying for e in block.effects}
    untaught = {name: effect for name, effect in effects_alone(fleet, prior).items() if name in names}
    effects = tuple(untaught.get(e.name, e) for e in prior.effects)
    return calibrate(replace(prior, effects=effects, noise=_noise(prior, alone)), poses, condition_limit=LARGEST_LIMIT)


def _noise(prior: ErrorModel, alone: Calibration | None) -> float:
    return max(prior.noise or 0.0, 0.0 if alone is None else alone.sigma)


def _outlying(fleet: FleetPart, alone: Calibration, prior: ErrorModel, poses: Poses) -> tuple[str, ...]:
    """Effects and blocks that the poses of the machine alone put beyond chance for its type."""
    noise = _noise(prior, alone)
    at = {e.name: k for k, e in enumerate(alone.model.effects)}
    parts: tuple[Part, ...] = (*fleet.effects, *fleet.blocks)
    others = [len(fleet.machines) - len(part.outliers) for part in parts]
    chances = [
        residual(
            alone.theta[at[p.name]], (alone.stderr[at[p.name]] * noise / alone.sigma) ** 2, p.mean, p.prior, count
        )[1]
        for p, count in zip(fleet.effects, others, strict=False)
    ]
    if fleet.blocks:
        fit = calibrate(replace(alone.model, noise=noise), poses, condition_limit=LARGEST_LIMIT)
        believed = {effect.name: effect for effect in prior.effects}
        for part, count in zip(fleet.blocks, others[len(fleet.effects) :], strict=True):
            own = tuple(p.effect for p in part.effects)
            chances.append(further_distance(fit, own, tuple(believed[e.name] for e in own), count)[1])
    return tuple(part.name for part, p in zip(parts, holm(np.array(chances)), strict=True) if p < SIGNIFICANCE)


def _known(fit: Calibration, poses: Poses) -> float:
    """RMS standard deviation, m, of the predicted point over poses."""
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    return float(np.sqrt(np.mean(point_deviation(saved_model(fit, poses), poses, observed) ** 2)))
