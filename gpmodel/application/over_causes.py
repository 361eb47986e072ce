"""Uncertainty of all fitted parameters over the possible causes of the findings, by the law of total variance.

With causes i of probability p_i, and x_i ± Σ_i the parameters fitted with each cause,

    E (x - x₁)(x - x₁)ᵀ = Σ_i p_i (Σ_i + (x_i - x₁)(x_i - x₁)ᵀ),   x₁ the reported parameters

Source: Hoeting (1999), variance within and between models.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.alternatives import ROW, UNKNOWNS, session_inputs
from gpmodel.calibration.priors import fit_priors
from gpmodel.calibration.result import Calibration, PlacementNumber, placement_numbers, problem_at
from gpmodel.checks.smooth_errors import YIELDING
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError, choices
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.executor import ALONE, Forks, called
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Ball, FittedLever, Mechanism, Shift, balls_of
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import translate
from gpmodel.numerics.least_squares import solve
from gpmodel.table.blocks import FOLD_SEED

ALONG = 0.7
"""Least cosine between an effect and its assigned direction of a ball joint: an angle below 45 degrees."""


def ball_priors(name: str, joint: SavedModel, machine: Mechanism) -> tuple[Effect, ...]:
    """Return the effects of a ball joint measured alone, transferred to the ball `name` of a machine, as priors.

    An effect with value θ ± s along a direction of the socket, over the first or second angle, becomes N(θ, s²) along
    the
    corresponding direction over roll or pitch: the ball has the orientation of its rig, with its axis along the link at
    home. Effects of the rotation about the link, and constants of the rig, are not transferred.
    Raises InputError for an unknown ball, a result of another mechanism, or if no effect can be transferred.
    """
    balls = {ball.name: ball for ball in balls_of(machine) if ball.name}
    if name not in balls:
        raise InputError(f"'{name}' is no ball of {machine.name}; expected {choices(name, balls)}", "joint")
    rig = joint.mechanism
    if isinstance(rig, FittedLever) and len(joint.placement.tool) == 1:  # the lever ends at the fitted tool point
        rig = rig.reaching(next(iter(joint.placement.tool.values()))[:3, 3])
    single = balls_of(rig)
    if len(single) != 1 or single[0].name:
        raise InputError(
            f"{name}: a result of {joint.mechanism.name}, expected a result of a single ball joint", "joint"
        )
    there = balls[name]
    handed = [
        _handed(effect, float(theta), float(stderr), single[0], there)
        for effect, theta, stderr in zip(joint.model.effects, joint.theta, joint.stderr, strict=True)
    ]
    found = tuple(effect for effect in handed if effect is not None)
    if not found:
        known = ", ".join(e.name for e in joint.model.effects if not e.constant) or "constants alone"
        raise InputError(
            f"{name}: the result of this joint has {known}, expected a shift that depends on the tilt of the ball",
            "joint",
        )
    return found


def _handed(effect: Effect, theta: float, stderr: float, one: Ball, there: Ball) -> Effect | None:
    """Transfer an effect of a ball joint to another ball; None if not transferable or of unknown standard error."""
    names = dict(zip(one.angles, there.angles, strict=False))
    if effect.constant or not set(effect.inputs) <= set(names) or not stderr > 0:
        return None
    for (_, shift), (_, other) in zip(one.shifts.items(), there.shifts.items(), strict=True):
        weights = _weights(effect.terms, shift)
        if weights is not None:
            basis = Expression(translate(str(effect.terms[0].basis), names))
            size = float(np.linalg.norm(weights) * np.sign(weights @ [w for *_, w in shift]))
            terms = tuple(Term(slot, axis, basis, size * weight) for slot, axis, weight in other)
            name = f"{translate(effect.name, names)}, {there.name}"
            return replace(effect, name=name, terms=terms, mean=theta, prior=stderr)
    return None


def _weights(terms: Sequence[Term], shift: Shift) -> Array | None:
    """Return the weights of an effect along the axes of a ball's shift; None if it acts otherwise."""
    given = {(term.slot, term.axis): term.weight for term in terms}
    if len({str(term.basis) for term in terms}) > 1 or not set(given) <= {(slot, axis) for slot, axis, _ in shift}:
        return None
    weights = np.array([given.get((slot, axis), 0.0) for slot, axis, _ in shift])
    along = abs(weights @ [w for *_, w in shift]) / max(float(np.linalg.norm(weights)), 1e-300)
    return weights if along > ALONG else None


RARE = 1e-3
"""Probability below which a possible cause of a finding is ignored. At this probability, a cause that changes a
parameter by ten standard errors adds a tenth to the parameter's variance."""


@dataclass(frozen=True)
class FittedCause:
    """An effect that replaces a finding: x = x₀ + towards w, w ~ N(values, covariance), x₀ the fit without the finding.

    effects: effects with the unknowns w. towards: change of registration, tool and model per unit of w, SI units.
    """

    effects: tuple[Effect, ...]
    probability: float
    towards: Array
    values: Array
    covariance: Array


@dataclass(frozen=True)
class CauseSet:
    """A finding, if any, and all alternative causes of the part of the residual that the finding explains.

    own: effects of the finding, with corrections of its constants. names: parameters of the model
    without the finding. stated: the finding and its coefficients.
    """

    own: tuple[str, ...]
    names: tuple[str, ...]
    stated: FittedCause
    others: tuple[FittedCause, ...]


def over_causes(found: Discovery, workers: Forks = ALONE) -> Discovery:
    """Include in a search's fits to all poses the uncertainty about the causes of their findings.

    workers: processes that fit the causes of the findings.
    """
    fit = found.fitted.calibration
    with threadpool_limits(limits=1, user_api="blas"):
        stated = _stated(found, fit, found.fitted.candidates, workers)
        final = stated if found.final is fit else _stated(found, found.final, (), workers)
    return replace(found, final=final, fitted=replace(found.fitted, calibration=stated))


def _stated(found: Discovery, fit: Calibration, findings: Sequence[Candidate], workers: Forks) -> Calibration:
    """Include in a fit to all poses the uncertainty about the cause of each finding, and about one undetected effect.

    Causes are the credible sets of the findings and all small effects of the catalogue. The probability of cause h is
    p(h | y) ∝ exp(log evidence of h in this fit). Small effects of the catalogue are included, as a constant or a
    finding can absorb them. If one part of an arm yields to gravity, every part does: the compliances c besides found
    compliances c₁ are undetected effects of probability 1, with the prior c ~ N(0, mean c₁²).
    """
    offered = catalogue.candidates(found.mechanism, found.poses.states)
    sets = [finding.hypothesis.causes for finding in found.findings]
    listed = [group for one in sets if one for cause in one.causes if not cause.own for group in cause.groups]
    few = [c for c in offered if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    known = {effect.name for effect in fit.model.effects}
    pool = list({c.name: c for c in (*few, *listed) if known.isdisjoint(e.name for e in c.effects)}.values())
    residual = residual_of(fit, found.poses, Criteria(), FOLD_SEED)
    soft = _compliances(residual, findings, pool)
    undetected = [c for c in pool if c.name not in {one.name for one in soft}]
    tasks = [partial(causes_of, residual, own, pool, found.fitted.changes.get(own.name, ())) for own in findings]
    places = called(workers, [*tasks, partial(causes_of, residual, None, undetected)])
    if soft:
        system, effects = _system_of_fit(residual), [effect for one in soft for effect in one.effects]
        nothing, every = (_cause(residual, system, of, p) for of, p in (((), 0.0), (effects, 1.0)))
        names = (*residual.problem.placement_names, *residual.names)
        places.append(CauseSet((), names, nothing, (every,)))
    return with_cause_variance(fit, found.poses, places)


def _compliances(residual: Residual, findings: Sequence[Candidate], pool: Sequence[Candidate]) -> list[Candidate]:
    """Return the single compliances that no finding has and the poses show, with the size of found ones as prior."""
    found = {effect for own in findings if own.family in YIELDING for effect in own.effects}
    sizes: dict[str, list[float]] = {}
    for effect, value in zip(residual.calibration.model.effects, residual.calibration.theta, strict=True):
        if effect in found:
            sizes.setdefault(effect.unit, []).append(float(value))
    prior = {unit: float(np.sqrt(np.mean(np.square(values)))) for unit, values in sizes.items()}
    single = [c for c in pool if c.family in YIELDING and all(effect.unit in prior for effect in c.effects)]
    return [
        replace(c, effects=tuple(replace(effect, prior=prior[effect.unit]) for effect in c.effects))
        for c, score in zip(single, scores(residual, single), strict=True)
        if np.isfinite(score.nats)
    ]


def causes_of(
    residual: Residual, own: Candidate | None, pool: Sequence[Candidate], changes: Sequence[Effect] = ()
) -> CauseSet:
    """Return all candidates that may replace the finding `own`, with probabilities.

    residual: residual of the model with `own`. pool: candidate effects. changes: corrections of constants in the
    finding, which are also parameters of the model.
    """
    inside = (*(own.effects if own else ()), *changes)
    without = residual.without(inside) if inside else residual
    asked = [*pool, *([own] if own else [])]
    nats = np.append([score.nats for score in scores(without, asked)], 0.0)
    likely = np.exp(nats - nats.max()) / np.exp(nats - nats.max()).sum()
    system = _system_of_fit(without)
    others = [
        _cause(without, system, asked[k].effects, float(likely[k]))
        for k in np.flatnonzero(likely[: len(pool)] > RARE).tolist()
    ]
    nothing = _cause(without, system, (), float(likely[-1]))
    stated = _cause(without, system, own.effects, float(likely[-2])) if own else nothing
    names = (*without.problem.placement_names, *without.names)
    return CauseSet(tuple(e.name for e in inside), names, stated, (*others, *([nothing] if own else [])))


def _cause(residual: Residual, system: Array, effects: Sequence[Effect], probability: float) -> FittedCause:
    """Fit an alternative cause to the residual without a finding. system: columns of the model without it."""
    if not effects:
        return FittedCause((), probability, np.zeros((system.shape[1], 0)), np.zeros(0), np.zeros((0, 0)))
    columns = residual.columns(effects)
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    left, _ = residual.projected(effects)
    prior_weight = np.array([residual.sigma / e.prior for e in effects]) / norms
    spread = np.linalg.pinv(left.T @ left + np.diag(prior_weight**2), rcond=1e-12, hermitian=True)
    fitted = spread @ (left.T @ residual.values)
    padded = np.zeros((len(system), len(norms)))
    padded[: residual.measured] = columns / norms
    scale = np.maximum(np.linalg.norm(system, axis=0), np.finfo(float).tiny)
    towards = solve(system / scale, padded) / scale[:, None]
    sigma2 = float(np.sum((residual.values - left @ fitted) ** 2)) / residual.freedom
    covariance = sigma2 * spread / np.outer(norms, norms)
    return FittedCause(tuple(effects), probability, -towards * norms, fitted / norms, covariance)


def _system_of_fit(residual: Residual) -> Array:
    """Return the derivatives with respect to registration, tool and effects, SI units, above the rows of all priors of
    the fit.

    Priors of tool and geometry decide among parameter values that the measurements do not distinguish: the residual is
    equal for all of them, but the parameter values differ.
    """
    fit, problem = residual.calibration, residual.problem
    kept = np.isin([e.name for e in fit.model.effects], residual.names)
    priors = fit_priors(fit.model, problem, fit.theta, fit.placement, kept)
    return np.asarray(np.vstack([problem.columns, priors.rows])[:, problem.free(kept)])


def with_cause_variance(fit: Calibration, poses: Poses, places: Sequence[CauseSet]) -> Calibration:
    """Return a fit whose standard errors include the uncertainty about the causes of its findings.

    A fit whose findings have no probable alternative cause is unchanged. The standard error of a finding assumes that
    the finding is right, and includes the alternative causes of other findings. Predictions include only causes that
    joint values determine.
    """
    if not any(one.probability > RARE for place in places for one in place.others):
        return fit
    moments, first, size = _moments(fit, places), len(fit.covariance.placement), len(fit.covariance.values)
    variances = np.diag(moments)[:size].copy()
    names = [*fit.covariance.placement, *(effect.name for effect in fit.model.effects)]
    for k, place in enumerate(places):
        own = np.isin(names, place.own)
        variances[own] = np.diag(_moments(fit, [*places[:k], *places[k + 1 :]]))[:size][own]
    added = variances - np.diag(fit.covariance.values)
    stderr = np.sqrt(np.maximum(fit.stderr**2 + added[first:], 0.0))
    mechanism = fit.model.mechanism
    anywhere = [
        replace(place, others=tuple(c for c in place.others if not session_inputs(poses, mechanism, c.effects)))
        for place in places
    ]
    others = _effects(anywhere)
    covariance = replace(fit.covariance, alternatives=others, over_causes=_moments(fit, anywhere))
    return replace(
        fit, stderr=stderr, covariance=covariance, placement_numbers=_placed(fit, poses, moments[:first, :first])
    )


def _placed(fit: Calibration, poses: Poses, moments: Array) -> tuple[PlacementNumber, ...]:
    """Replace the covariance of registration and tool by the second moments over the causes."""
    problem, values = problem_at(fit, poses), fit.covariance.values[: len(moments), : len(moments)]
    before, after = (placement_numbers(fit.placement, problem, one) for one in (values, moments))
    numbers = zip(fit.placement_numbers, before, after, strict=True)
    return tuple(replace(p, stderr=max(p.stderr**2 + b.stderr**2 - a.stderr**2, 0.0) ** 0.5) for p, a, b in numbers)


def _effects(places: Sequence[CauseSet]) -> tuple[Effect, ...]:
    """Return the effects of all alternative causes, without duplicates."""
    every = (effect for place in places for cause in place.others for effect in cause.effects)
    return tuple({effect.name: effect for effect in every}.values())


def _moments(fit: Calibration, places: Sequence[CauseSet]) -> Array:
    """Return the second moment of all parameters about the fit, SI units; effects of alternative causes come last."""
    effects = (*fit.model.effects, *_effects(places))
    names = [*fit.covariance.placement, *(effect.name for effect in effects)]
    number, size = {name: k for k, name in enumerate(names)}, len(fit.covariance.values)
    out = np.zeros((len(names), len(names)))
    out[:size, :size] = fit.covariance.values
    for place in places:
        at = [number[name] for name in place.own]
        rest = [number[name] for name in place.names]
        mean, _ = _spanned(place.stated, rest, number)
        share = sum(cause.probability for cause in place.others)
        out -= share * out[:, at] @ np.linalg.pinv(out[np.ix_(at, at)], rcond=1e-12, hermitian=True) @ out[at]
        for cause in place.others:
            other, within = _spanned(cause, rest, number)
            out += cause.probability * (np.outer(other - mean, other - mean) + within)
    return out


def _spanned(cause: FittedCause, rest: Sequence[int], number: Mapping[str, int]) -> tuple[Array, Array]:
    """Return the change of all parameters if a given cause is true, and the covariance that the cause adds."""
    directions = np.zeros((len(number), len(cause.effects)))
    directions[rest] = cause.towards
    for k, effect in enumerate(cause.effects):
        directions[number[effect.name], k] = 1.0
    return directions @ cause.values, directions @ cause.covariance @ directions.T
