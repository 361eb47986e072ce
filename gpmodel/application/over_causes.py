"""Spread of every fitted number over the credible sets of the findings."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array
from gpmodel.discovery.state import Discovery
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.model.effect import Effect
from gpmodel.numerics.least_squares import solve
from gpmodel.selection.causes import Cause
from gpmodel.table.split import JUDGED

UNLIKELY = 0.01
"""Probability below which a cause moves nothing that anybody would notice."""


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


def spread_over(residual: Residual, effects: Sequence[Effect], others: Sequence[Cause]) -> dict[str, float]:
    """Standard deviation of every number of placement and model over the causes of a finding, about its value with the
    finding: √Σ p (value - value with the finding)².

    residual: of the model without the finding. others: causes in its place. Source: Hoeting et al. (1999), the variance
    between models.
    """
    able = [cause for cause in others if cause.probability > UNLIKELY]
    if not able:
        return {}
    own = _explained(residual, effects)
    apart = np.column_stack([own - _explained(residual, cause.groups[0].effects) for cause in able])
    moved, names = solve(residual.system, apart), (*residual.problem.placement_names, *residual.names)
    at = {e.name: i for i, e in enumerate(residual.calibration.model.effects, residual.problem.placement)}
    columns = residual.problem.columns[:, [*range(residual.problem.placement), *(at[name] for name in residual.names)]]
    unit = residual.system[: residual.measured]
    scale = np.linalg.norm(unit, axis=0) / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    spread = scale * np.sqrt(moved**2 @ np.array([cause.probability for cause in able]))
    return dict(zip(names, spread.tolist(), strict=True))


def _explained(residual: Residual, effects: Sequence[Effect]) -> Array:
    """Return the contribution (M + B,) of effects fitted in addition to the model, their own columns only."""
    columns = residual.columns(effects)
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    left, _ = residual.projected(effects)
    belief = np.array([residual.sigma / e.prior for e in effects]) / norms
    gram = left.T @ left + np.diag(belief**2)
    fitted = linalg.lstsq(gram, left.T @ residual.values, lapack_driver="gelsy", check_finite=False)[0]
    out = np.zeros(len(residual.values))
    out[: residual.measured] = columns @ (fitted / norms)
    return out
