"""Spread of every fitted number over the credible sets of the findings."""

from collections.abc import Sequence

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.priors import beliefs
from gpmodel.calibration.rivals import ROW, UNKNOWNS
from gpmodel.discovery.state import Discovery
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.effect import Effect
from gpmodel.numerics.least_squares import solve
from gpmodel.selection.causes import Cause
from gpmodel.table.bundles import JUDGED

UNLIKELY = 0.01
"""Probability below which a cause moves nothing that anybody would notice."""

RARE = 1e-3
"""Probability below which a candidate of the catalogue is passed over: what moves a number by ten of its standard
errors adds a hundredth to its variance ten times as often."""


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
