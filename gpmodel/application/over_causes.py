"""Uncertainty of everything that is fitted over the causes of the findings, by the law of total variance.

With causes i of probability p_i, and x_i ± Σ_i the unknowns by the fit with each,

    E (x - x₁)(x - x₁)ᵀ = Σ_i p_i (Σ_i + (x_i - x₁)(x_i - x₁)ᵀ),   x₁ what is stated

Source: Hoeting et al. (1999), variance within and between models.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.priors import beliefs
from gpmodel.calibration.result import Calibration, Placed, placed_numbers, problem_at
from gpmodel.calibration.rivals import ROW, UNKNOWNS, of_the_session
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError, choices
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Ball, Mechanism, Reaching, Shift, balls_of
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import translate
from gpmodel.numerics.least_squares import solve
from gpmodel.table.bundles import JUDGED

ALONG = 0.7
"""Least cosine between an effect and the direction of the ball that stands for it: under 45 degrees."""


def of_the_ball(name: str, joint: SavedModel, machine: Mechanism) -> tuple[Effect, ...]:
    """Varying shifts of a measured ball joint, moved to the ball `name` of a machine; their posterior is the prior.

    An effect of the joint with value θ ± s along a direction of its socket, over its first or second angle, is there
    N(θ, s²) along the same direction of that ball, over its roll or pitch: the ball stands on the machine as on its
    rig, its axis along the link at home. What turns a ball about its own link is not known on a machine, and constants
    of the rig are its own; both stay behind.
    Raises InputError: no such ball, a result of something else than one ball joint, nothing that could be handed over.
    """
    balls = {ball.name: ball for ball in balls_of(machine) if ball.name}
    if name not in balls:
        raise InputError(f"'{name}' is no ball of {machine.name}; it has {choices(name, balls)}", "joint")
    rig = joint.mechanism
    if isinstance(rig, Reaching) and len(joint.placement.tool) == 1:  # the lever ends at the fitted tool point
        rig = rig.reaching(next(iter(joint.placement.tool.values()))[:3, 3])
    single = balls_of(rig)
    if len(single) != 1 or single[0].name:
        raise InputError(f"{name}: a result of {joint.mechanism.name}, expected one of a ball joint alone", "joint")
    there = balls[name]
    handed = [
        _handed(effect, float(theta), float(stderr), single[0], there)
        for effect, theta, stderr in zip(joint.model.effects, joint.theta, joint.stderr, strict=True)
    ]
    found = tuple(effect for effect in handed if effect is not None)
    if not found:
        known = ", ".join(e.name for e in joint.model.effects if not e.constant) or "constants alone"
        raise InputError(f"{name}: of that joint {known} is known, expected a shift over the tilt of its ball", "joint")
    return found


def _handed(effect: Effect, theta: float, stderr: float, one: Ball, there: Ball) -> Effect | None:
    """One effect at the other ball; None where it is none of the ball, or its size is unknown."""
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
    """Weights of an effect along the terms of a shift, None where it acts elsewhere or across it."""
    given = {(term.slot, term.axis): term.weight for term in terms}
    if len({str(term.basis) for term in terms}) > 1 or not set(given) <= {(slot, axis) for slot, axis, _ in shift}:
        return None
    weights = np.array([given.get((slot, axis), 0.0) for slot, axis, _ in shift])
    along = abs(weights @ [w for *_, w in shift]) / max(float(np.linalg.norm(weights)), 1e-300)
    return weights if along > ALONG else None


RARE = 1e-3
"""Probability of a candidate below which it is left out. One that moves a number by ten standard errors adds a tenth to
its variance at this probability."""


@dataclass(frozen=True)
class FittedCause:
    """An effect in the place of a finding: x = x₀ + towards w, w ~ N(values, covariance), x₀ of the model without.

    effects: (k,). towards: (K, k) steps of the unknowns of placement and model per unit of w, SI.
    """

    effects: tuple[Effect, ...]
    probability: float
    towards: Array
    values: Array
    covariance: Array


@dataclass(frozen=True)
class CausesThere:
    """A place of the model: the finding there, if there is one, and all other causes of what it explains.

    own: effects of the finding, with the changes of the constants inside it. names: unknowns (K,) of the model without.
    """

    own: tuple[str, ...]
    names: tuple[str, ...]
    stated: FittedCause
    others: tuple[FittedCause, ...]


def over_causes(found: Discovery) -> Discovery:
    """A discovery whose fits to all poses state everything over the causes of their findings."""
    fit = found.fitted.calibration
    with threadpool_limits(limits=1, user_api="blas"):
        stated = _stated(found, fit, found.fitted.candidates)
        final = stated if found.final is fit else _stated(found, found.final, ())
    return replace(found, final=final, fitted=replace(found.fitted, calibration=stated))


def _stated(found: Discovery, fit: Calibration, findings: Sequence[Candidate]) -> Calibration:
    """A fit to all poses with its uncertainty over what may be in the place of each finding, or of none without any.

    These are the credible sets of the findings and all effects of the catalogue that have as few unknowns. Their
    probabilities are those of the fit that states the numbers, p(h | y) ∝ exp(nats of h): a constant of the model may
    take up an effect too weak to be a finding.
    """
    offered = catalogue.candidates(found.mechanism, found.poses.states)
    sets = [finding.hypothesis.causes for finding in found.findings]
    listed = [group for one in sets if one for cause in one.others for group in cause.groups]
    few = [c for c in offered if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    known = {effect.name for effect in fit.model.effects}
    pool = list({c.name: c for c in (*few, *listed) if known.isdisjoint(e.name for e in c.effects)}.values())
    residual = residual_of(fit, found.poses, Criteria(), JUDGED)
    places = [place_of(residual, own, pool, found.fitted.changes.get(own.name, ())) for own in findings] or [
        place_of(residual, None, pool)
    ]
    return uncertain(fit, found.poses, places)


def place_of(
    residual: Residual, own: Candidate | None, pool: Sequence[Candidate], changes: Sequence[Effect] = ()
) -> CausesThere:
    """Weigh the candidates of a pool in the place of a finding. residual: of the model with the finding.

    changes: of the constants inside the finding, which the model has too.
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
    return CausesThere(tuple(e.name for e in inside), names, stated, (*others, *([nothing] if own else [])))


def _cause(residual: Residual, system: Array, effects: Sequence[Effect], probability: float) -> FittedCause:
    """Fit effects to what a model without them leaves. system: of that model."""
    if not effects:
        return FittedCause((), probability, np.zeros((system.shape[1], 0)), np.zeros(0), np.zeros((0, 0)))
    columns = residual.columns(effects)
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    left, _ = residual.projected(effects)
    belief = np.array([residual.sigma / e.prior for e in effects]) / norms
    spread = np.linalg.pinv(left.T @ left + np.diag(belief**2), rcond=1e-12, hermitian=True)
    fitted = spread @ (left.T @ residual.values)
    padded = np.zeros((len(system), len(norms)))
    padded[: residual.measured] = columns / norms
    scale = np.maximum(np.linalg.norm(system, axis=0), np.finfo(float).tiny)
    towards = solve(system / scale, padded) / scale[:, None]
    sigma2 = float(np.sum((residual.values - left @ fitted) ** 2)) / residual.freedom
    covariance = sigma2 * spread / np.outer(norms, norms)
    return FittedCause(tuple(effects), probability, -towards * norms, fitted / norms, covariance)


def _system_of_fit(residual: Residual) -> Array:
    """Columns (M + B, K) of placement and model, SI, above the rows of all priors of the fit.

    The priors of tool and description decide among placements that the readings do not distinguish. A residual has no
    need of them, a value has.
    """
    fit, problem = residual.calibration, residual.problem
    kept = np.isin([e.name for e in fit.model.effects], residual.names)
    believed = beliefs(fit.model, problem, fit.theta, fit.placement, kept)
    return np.asarray(np.vstack([problem.columns, believed.rows])[:, problem.free(kept)])


def uncertain(fit: Calibration, poses: Poses, places: Sequence[CausesThere]) -> Calibration:
    """Return a fit whose standard errors include the doubt about which cause is the right one at some places.

    The same fit where no place has another likely cause.

    The standard error of a finding is over the causes in the places of the others: it holds if the finding is one.
    Predictions allow for causes that joint values determine.
    """
    if not any(one.probability > RARE for place in places for one in place.others):
        return fit
    moments, own = _moments(fit, places)
    first, size = len(fit.covariance.placement), len(fit.covariance.values)
    added = (np.diag(moments) - np.pad(np.diag(fit.covariance.values), (0, len(moments) - size)))[:size]
    for at, by_its_place in own:
        added[at] -= by_its_place
    stderr = np.sqrt(np.maximum(fit.stderr**2 + added[first:], 0.0))
    mechanism = fit.model.mechanism
    anywhere = [
        replace(place, others=tuple(c for c in place.others if not of_the_session(poses, mechanism, c.effects)))
        for place in places
    ]
    others = _effects(anywhere)
    covariance = replace(fit.covariance, others=others, over_causes=_moments(fit, anywhere)[0])
    return replace(fit, stderr=stderr, covariance=covariance, placed=_placed(fit, poses, moments[:first, :first]))


def _placed(fit: Calibration, poses: Poses, moments: Array) -> tuple[Placed, ...]:
    """Numbers of registration and tool, whose variance grows as that of their unknowns does, to moments (P, P)."""
    problem, values = problem_at(fit, poses), fit.covariance.values[: len(moments), : len(moments)]
    before, after = (placed_numbers(fit.placement, problem, one) for one in (values, moments))
    variances = (p.stderr**2 + b.stderr**2 - a.stderr**2 for p, a, b in zip(fit.placed, before, after, strict=True))
    return tuple(replace(p, stderr=max(v, 0.0) ** 0.5) for p, v in zip(fit.placed, variances, strict=True))


def _effects(places: Sequence[CausesThere]) -> tuple[Effect, ...]:
    """Effects (A,) of all other causes, each once."""
    every = (effect for place in places for cause in place.others for effect in cause.effects)
    return tuple({effect.name: effect for effect in every}.values())


def _moments(fit: Calibration, places: Sequence[CausesThere]) -> tuple[Array, list[tuple[list[int], Array]]]:
    """Second moment (P + E + A, P + E + A) of all unknowns about the fit, other causes at the end; and what each place
    adds to the variance of its own finding, with the numbers of its effects."""
    effects = (*fit.model.effects, *_effects(places))
    names = [*fit.covariance.placement, *(effect.name for effect in effects)]
    number, size = {name: k for k, name in enumerate(names)}, len(fit.covariance.values)
    out, added = np.zeros((len(names), len(names))), []
    out[:size, :size] = fit.covariance.values
    for place in places:
        at = [number[name] for name in place.own]
        rest = [number[name] for name in place.names]
        before = np.diag(out)[at].copy()
        mean, _ = _spanned(place.stated, rest, number)
        share = sum(cause.probability for cause in place.others)
        out -= share * out[:, at] @ np.linalg.pinv(out[np.ix_(at, at)], rcond=1e-12, hermitian=True) @ out[at]
        for cause in place.others:
            other, within = _spanned(cause, rest, number)
            out += cause.probability * (np.outer(other - mean, other - mean) + within)
        added.append((at, np.diag(out)[at] - before))
    return out, added


def _spanned(cause: FittedCause, rest: Sequence[int], number: Mapping[str, int]) -> tuple[Array, Array]:
    """Steps (K,) of all unknowns by a cause, and what it adds to their covariance (K, K)."""
    directions = np.zeros((len(number), len(cause.effects)))
    directions[rest] = cause.towards
    for k, effect in enumerate(cause.effects):
        directions[number[effect.name], k] = 1.0
    return directions @ cause.values, directions @ cause.covariance @ directions.T
