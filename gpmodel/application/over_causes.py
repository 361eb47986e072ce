"""Spread of every fitted number over the credible sets of the findings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.priors import beliefs
from gpmodel.calibration.rivals import ROW, UNKNOWNS
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
from gpmodel.model.sites import translate
from gpmodel.numerics.least_squares import solve
from gpmodel.selection.causes import Cause
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
    if isinstance(rig, Reaching) and len(joint.placement.tool) == 1:  # a lever ends where the fit found the tool
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


UNLIKELY = 0.01
"""Probability of a cause below which it is left out of a standard error."""

RARE = 1e-3
"""Probability of a candidate of the catalogue below which it is left out. One that moves a number by ten standard
errors adds a tenth to its variance at this probability."""


def spreads(discovery: Discovery) -> list[dict[str, float]]:
    """Spread over the other causes of each finding: standard deviation of every other number, by its name."""
    sets = [finding.hypothesis.causes for finding in discovery.findings]
    if not any(found and found.others for found in sets):
        return [{} for _ in sets]
    poses = discovery.poses.subset(discovery.train)
    residual = residual_of(discovery.steps[-1].calibration, poses, Criteria(), JUDGED)
    effects = [finding.candidate.effects for finding in discovery.findings]
    return [
        spread_over(residual.without(own), own, found.others) if found and found.others else {}
        for own, found in zip(effects, sets, strict=True)
    ]


def tool_spreads(discovery: Discovery) -> list[dict[str, float]]:
    """Deviation of every number of the placement over the catalogue: with each candidate in the place of each finding,
    or added to a model without findings. The candidates' probabilities are those of the fit that states the numbers,
    p(h | y) ∝ exp(nats of h). A constant of the model may take up an effect too weak to be a finding.
    """
    poses = discovery.poses.subset(discovery.train)
    shipped = discovery.steps[-1 if discovery.confirmed else 1].calibration
    residual = residual_of(shipped, poses, Criteria(), JUDGED)
    known = {effect.name for effect in residual.calibration.model.effects}
    offered = catalogue.candidates(discovery.mechanism, poses.states)
    pool = [c for c in offered if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    pool = [c for c in pool if known.isdisjoint(e.name for e in c.effects)]
    found = [finding.candidate for finding in discovery.findings if discovery.confirmed]
    return [_over_pool(residual.without(own.effects), own, pool) for own in found] or [_over_pool(residual, None, pool)]


def _over_pool(residual: Residual, own: Candidate | None, pool: Sequence[Candidate]) -> dict[str, float]:
    """Deviation of every number over candidates in the place of `own`, None for nothing. residual: without it."""
    asked = [*pool, *([own] if own else [])]
    nats = np.append([score.nats for score in scores(residual, asked)], 0.0)
    likely = np.exp(nats - nats.max()) / np.exp(nats - nats.max()).sum()
    others = [(pool[k].effects, float(likely[k])) for k in np.flatnonzero(likely[: len(pool)] > RARE).tolist()]
    return _spread(residual, own.effects if own else (), [*others, ((), float(likely[-1]) * (own is not None))])


def spread_over(residual: Residual, effects: Sequence[Effect], others: Sequence[Cause]) -> dict[str, float]:
    """Deviation of every number over the causes of a finding; see `_spread`."""
    able = [cause for cause in others if cause.probability > UNLIKELY]
    return _spread(residual, effects, [(cause.groups[0].effects, cause.probability) for cause in able])


def _spread(
    residual: Residual, effects: Sequence[Effect], others: Sequence[tuple[Sequence[Effect], float]]
) -> dict[str, float]:
    """Deviation of every number of placement and model over other effects, with their probabilities p, in the place of
    effects: √Σ p ((value - value with the effects)² + variance beyond that with the effects).

    residual: of the model without the effects. Source: Hoeting et al. (1999), the variance between and within models.
    """
    if not others:
        return {}
    system = _system_of_fit(residual)
    own, own_variance = _moved(residual, system, effects)
    squares = np.zeros(len(own))
    for other, probability in others:
        moved, variance = _moved(residual, system, other)
        squares += probability * ((moved - own) ** 2 + np.maximum(variance - own_variance, 0.0))
    names = (*residual.problem.placement_names, *residual.names)
    return dict(zip(names, np.sqrt(squares).tolist(), strict=True))


def _system_of_fit(residual: Residual) -> Array:
    """Columns (M + B, K) of placement and model, SI, above the rows of all priors of the fit.

    The priors of tool and description decide among placements that the readings do not distinguish. A residual has no
    need of them, a value has.
    """
    fit, problem = residual.calibration, residual.problem
    kept = np.isin([e.name for e in fit.model.effects], residual.names)
    believed = beliefs(fit.model, problem, fit.theta, fit.placement, kept)
    return np.asarray(np.vstack([problem.columns, believed.rows])[:, problem.free(kept)])


def _moved(residual: Residual, system: Array, effects: Sequence[Effect]) -> tuple[Array, Array]:
    """Return by how much effects fitted in addition to the model move its unknowns (K,), SI, and add to their
    variance (K,)."""
    if not effects:
        return np.zeros(system.shape[1]), np.zeros(system.shape[1])
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
    return towards @ fitted, sigma2 * np.einsum("ki,ij,kj->k", towards, spread, towards)
