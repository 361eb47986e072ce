"""Fit a further machine of a known type: combine its poses with the prior that the type gives."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize, special

from gpmodel import wording
from gpmodel.application.model_file import saved_model
from gpmodel.application.predict import point_deviation
from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step, fit_steps, nested_models, with_fit
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.priors import off_mean
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError
from gpmodel.hierarchy.block import distance, further_distance, parameter_information
from gpmodel.hierarchy.record import FleetPart, Part, prior_model
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe
from gpmodel.numerics import rank as ident
from gpmodel.numerics.interval import SIGNIFICANCE, holm
from gpmodel.wording import length

LARGEST = 1e3
"""Upper bound of a machine's distance ratio s (`TypeComparison.times`), and of its noise over the noise of the type."""

DOUBTFUL, TWICE = 1e-3, 2.0
"""P-value, and ratio of distances from the type's mean, from which a machine counts as different from its type. The
p-value neglects the error of the estimated prior; hence the ratio must be at least 2 as well. A ratio of noises above 2
is stated."""


@dataclass(frozen=True)
class TypeComparison:
    """Comparison of a machine with the machines of its type.

    times: ratio s of the machine's distance from the mean of the type to the RMS distance of machines of the type.
    chance: probability of a ratio s as large for a machine of the type.
    noise: standard deviation σ of one coordinate, m, if the machine is of the type.
    """

    times: float
    chance: float
    noise: float

    @property
    def may_be_of_type(self) -> bool:
        """True if the machine may be of its type: the distance ratio s is below TWICE or its p-value above DOUBTFUL."""
        return self.times < TWICE or self.chance > DOUBTFUL


def compare_with_type(fit: Calibration, poses: Poses) -> TypeComparison:
    """Compare a machine with its type by the marginal likelihood of its distance ratio s ≥ 1, at the likeliest noise σ.

    fit: fit to the poses with the prior and the noise of the type. Effects without a prior are fitted and not compared.
    The noise σ is at least that of the type and includes errors that the effects cannot describe. The p-value is half
    of that of χ² with one degree of freedom, as s = 1 is a bound (Self and Liang 1987).

        y = X (θ - μ) + e,   θ - μ ~ N(0, s² T),   e ~ N(0, σ² 1)            y: residual without registration and tool
    """
    problem, noise = problem_at(fit, poses), fit.model.noise or fit.sigma
    prior = np.array([e.prior for e in fit.model.effects])
    with_prior = np.isfinite(prior)
    columns, count = problem.columns[:, problem.placement :], len(problem.residual)
    free = np.hstack([problem.columns[:, : problem.placement], columns[:, ~with_prior]])
    fixed = ident.orthonormal(free)
    shown = ident.remove(fixed, columns[:, with_prior]) * (prior[with_prior] / noise)
    left = ident.remove(fixed, problem.residual + columns @ off_mean(fit.model, fit.theta)) / noise
    basis, sizes, _ = np.linalg.svd(shown, full_matrices=False)
    seen = sizes > 1e-9 * sizes.max(initial=0.0)
    parts, squares = (basis.T @ left)[seen] ** 2, sizes[seen] ** 2
    rest = max(float(left @ left - parts.sum()), 0.0)
    alone = max(count - fixed.shape[1] - int(seen.sum()), 0)

    def misfit(log_s: float, log_noise: float) -> float:
        variance = np.exp(2.0 * log_noise)
        expected = variance + np.exp(2.0 * log_s) * squares
        return float(np.sum(np.log(expected) + parts / expected) + 2.0 * alone * log_noise + rest / variance)

    def least(log_s: float) -> tuple[float, float]:
        found = optimize.minimize_scalar(lambda n: misfit(log_s, n), bounds=(0.0, np.log(LARGEST)), method="bounded")
        return float(found.fun), float(found.x)

    best = optimize.minimize_scalar(lambda s: least(s)[0], bounds=(0.0, np.log(LARGEST)), method="bounded")
    value, log_noise = least(0.0)
    chance = 0.5 * float(special.chdtrc(1.0, max(value - float(best.fun), 0.0)))
    return TypeComparison(float(np.exp(best.x)), chance, noise * float(np.exp(log_noise)))


PRIOR, ALONE = "the prior of the fleet", "its own poses alone"
"""Names of the last and of the second to last fit of a further machine of a known type."""

LOUDER = 1.1
"""Ratio of a machine's noise to the noise of its type from which its last fit is repeated."""


@dataclass(frozen=True)
class Further:
    """Fits of a further machine of a known type.

    steps: registration, the fit to its poses alone if there are enough, and the fit with the type's prior.
    final: the last fit, to all poses.
    individual: the fit to the machine's poses alone, None if the poses do not determine every effect.
    outlying: names of effects in which the machine differs from its type.
    comparison: comparison with the type in the effects that are not outlying, or in all if at least half are outlying.
    louder: ratio of the noise of the machine, its effects unknown to the type included, to the noise of the type.
    """

    steps: tuple[Step, ...]
    final: Calibration
    individual: Calibration | None
    outlying: tuple[str, ...]
    comparison: TypeComparison
    louder: float

    @property
    def too_few(self) -> bool:
        """True if the poses of the machine have fewer measurements than the model has unknowns."""
        return [step.name for step in self.steps] == ["registration", PRIOR]

    @property
    def dissimilarity(self) -> str:
        """Text that states how far the machine is from its type; empty if the machine may be of the type."""
        if self.comparison.may_be_of_type:
            return ""
        times, chance = wording.significant(self.comparison.times, 2), wording.chance(self.comparison.chance)
        return f"is unlike the machines of its type: {times} times as far from the mean, p {chance}"

    def without_prior(self, poses: Poses, argument: str) -> str:
        """State that the prior of the type is not used; empty if the machine may be of the type.

        Raises InputError for `argument` if the poses are too few without the prior.
        """
        if not self.dissimilarity:
            return ""
        message = f"This machine {self.dissimilarity}; the prior of the type is not used."
        if self.too_few:
            raise InputError(
                f"{message} Without the prior, {len(poses)} poses are too few; expected more poses", argument
            )
        return message

    def in_words(self, poses: Poses) -> str:
        """State how many poses the type's prior replaces, and the effects in which a machine of the type deviates."""
        found = f" This machine is unlike its type in {', '.join(self.outlying)}." if self.outlying else ""
        if self.louder > TWICE:
            found += (
                f" The residual is {wording.significant(self.louder, 2)} times the noise of the type: an effect that "
                "the type lacks, or another instrument."
            )
        if self.individual is None:
            return f"These {len(poses)} poses alone do not determine the model.{found}"
        both = _known(self.final, poses)
        alone = _known(self.individual, poses) * self.final.sigma / self.individual.sigma
        worth = round(max(len(poses) * ((alone / both) ** 2 - 1.0), 0.0))
        return (
            f"± of the tool point: {length(1e3 * alone)} by the {len(poses)} poses alone, {length(1e3 * both)} "
            "with the "
            f"prior, which replaces about {worth} pose{'s' * (worth != 1)}.{found}"
        )


def further_machine(fleet: FleetPart, mechanism: Mechanism, seen: Poses, unseen: Poses, seed: int = 0) -> Further:
    """Fit a machine of the type to the poses `seen` and compute its errors on the poses `unseen`.

    An effect that deviates significantly from the type in the fit to the poses `seen` alone loses the prior of the
    type. Raises InputError if `mechanism` is not the mechanism of the fleet.
    """
    prior = prior_model(fleet, mechanism)
    steps = _own_poses(fleet, prior, seen, unseen, seed)
    last = steps[-1].calibration
    alone = last if len(steps) > 1 and last.free.all() else None
    outlying = () if alone is None else _outlying(fleet, alone, prior, seen)
    fit = fitted_with_prior(fleet, prior, seen, alone, outlying)
    most = 2 * len(outlying) >= len(fleet.effects) + len(fleet.blocks)
    judged = fitted_with_prior(fleet, prior, seen, alone) if most else fit
    compared = compare_with_type(judged, seen)
    louder = compared.noise / fleet.noise
    return Further(with_fit(steps, PRIOR, fit, seen, unseen), fit, alone, outlying, compared, louder)


def _own_poses(fleet: FleetPart, prior: ErrorModel, seen: Poses, unseen: Poses, seed: int) -> tuple[Step, ...]:
    """Return the fit of registration alone and, if the machine has enough poses, the fit without the type's prior."""
    bare = tuple(effects_alone(fleet, prior).values())
    try:
        return fit_steps(prior.mechanism, nested_models(bare, ()), seen, unseen, seed=seed)
    except InputError:
        return fit_steps(prior.mechanism, nested_models((), ()), seen, unseen, seed=seed)


def from_the_type(
    fleet: FleetPart, mechanism: Mechanism, loop: "partial[Discovery]", poses: Poses, train: IntArray, heldout: IntArray
) -> Discovery:
    """Search for missing effects of a machine, with the effects and priors of its type as standard model.

    The findings are in addition to the effects of the type. If the noise of the machine's poses exceeds that of the
    type, the fit to all poses is repeated with the larger noise.
    """
    machine = further_machine(fleet, mechanism, poses.subset(train), poses.subset(heldout))
    learned = replace(machine.final.model, noise=fleet.noise)
    found = loop(
        poses, train, heldout, standard=learned.effects, noise=learned.noise, condition_limit=LARGEST_LIMIT
    )  # fmt: skip
    held = np.isin(poses.dataset.row[heldout], found.poses.dataset.row[found.heldout])
    own = (replace(step, name=ALONE, heldout_error=step.heldout_error[held]) for step in machine.steps[1:-1])
    found, final = replace(found, alone=tuple(own)), found.final
    noise = compare_with_type(final, found.poses).noise
    if noise < LOUDER * fleet.noise:
        return found
    final = calibrate(replace(final.model, noise=noise), found.poses, condition_limit=LARGEST_LIMIT, start=final)
    return replace(
        found, final=final, fitted=replace(found.fitted, calibration=final) if found.confirmed else found.fitted
    )


def alone_steps(found: Discovery) -> tuple[Step, ...]:
    """Return the fit to the machine's poses without the prior, with errors on the poses that `found` held out.

    Nothing is returned if the poses are too few for a fit without the prior.
    """
    rows = found.poses.dataset.row
    errors = np.full(len(rows), np.nan)
    for part in found.parts or (found,):
        for step in part.alone:
            errors[np.isin(rows, part.poses.dataset.row[part.heldout])] = step.heldout_error
    return tuple(replace(step, heldout_error=errors[found.heldout]) for step in found.alone)


def effects_alone(fleet: FleetPart, prior: ErrorModel) -> dict[str, Effect]:
    """Return the effects that every machine's poses determine, by name, with their own priors instead of the type's."""
    own = {part.name: part.effect for block in fleet.blocks for part in block.effects}
    told = own.keys() | {part.name for part in fleet.effects}
    return {e.name: own.get(e.name, replace(e, mean=0.0, prior=np.inf)) for e in prior.effects if e.name in told}


def fitted_with_prior(
    fleet: FleetPart, prior: ErrorModel, poses: Poses, alone: Calibration | None = None, outlying: tuple[str, ...] = ()
) -> Calibration:
    """Fit poses with the prior of the type, except for the `outlying` effects, which keep their own priors.

    The weight of the priors uses the larger noise of the type and of the fit `alone`.
    """
    names = set(outlying) | {e.name for block in fleet.blocks if block.name in outlying for e in block.effects}
    untaught = {name: effect for name, effect in effects_alone(fleet, prior).items() if name in names}
    effects = tuple(untaught.get(e.name, e) for e in prior.effects)
    return calibrate(replace(prior, effects=effects, noise=_noise(prior, alone)), poses, condition_limit=LARGEST_LIMIT)


def _noise(prior: ErrorModel, alone: Calibration | None) -> float:
    return max(prior.noise or 0.0, 0.0 if alone is None else alone.sigma)


def _outlying(fleet: FleetPart, alone: Calibration, prior: ErrorModel, poses: Poses) -> tuple[str, ...]:
    """Return names of effects and blocks that deviate significantly from the type in the fit `alone`."""
    noise = _noise(prior, alone)
    at = {e.name: k for k, e in enumerate(alone.model.effects)}
    parts: tuple[Part, ...] = (*fleet.effects, *fleet.blocks)
    others = [len(fleet.machines) - len(part.outliers) for part in parts]
    k = [at[p.name] for p in fleet.effects]
    told = parameter_information(alone.theta[k], alone.stderr[k] * noise / alone.sigma)
    chances = [
        distance(told, i, np.array([p.mean]), np.array([[p.prior**2]]), count)[1]
        for i, (p, count) in enumerate(zip(fleet.effects, others, strict=False))
    ]
    if fleet.blocks:
        fit = calibrate(replace(alone.model, noise=noise), poses, condition_limit=LARGEST_LIMIT)
        learned = {effect.name: effect for effect in prior.effects}
        for part, count in zip(fleet.blocks, others[len(fleet.effects) :], strict=True):
            own = tuple(p.effect for p in part.effects)
            chances.append(further_distance(fit, own, tuple(learned[e.name] for e in own), count)[1])
    return tuple(part.name for part, p in zip(parts, holm(np.array(chances)), strict=True) if p < SIGNIFICANCE)


def _known(fit: Calibration, poses: Poses) -> float:
    """Return the RMS over poses of the predicted point's standard deviation, m."""
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    return float(np.sqrt(np.mean(point_deviation(saved_model(fit, poses), poses, observed) ** 2)))
