"""What else a finding could be: how likely each rival is, and how far it would move the values of other findings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg
from scipy.special import softmax

from gpmodel.arrays import Array
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.families.candidate import Candidate
from gpmodel.model.effect import Effect
from gpmodel.numerics.least_squares import solve

MOST_RIVALS = 6
"""Rivals shown beside a finding, those that predict best; of several that are one to the data the nearest."""

UNLIKELY = 0.01
"""Probability below which a rival moves nothing that anybody would notice."""


def probabilities(cv_rms: Sequence[float], freedom: float) -> Array:
    """Probability (R,) of each of several models, all alike beforehand: as likely as normal noise of what it leaves of
    poses left out, m, over so many independent values. Source: Yao et al. (2018), pseudo-BMA."""
    return np.asarray(softmax(-freedom * np.log(np.maximum(cv_rms, np.finfo(float).tiny))))


def averaged(residual: Residual, hypothesis: Hypothesis, rivals: Sequence[Candidate]) -> Hypothesis:
    """The hypothesis beside those of its rivals, nearest first as given, that predict best: its probability among them,
    by how much the best predicts better, and the deviations of the model's other values over them.

    residual: of the model without it.
    """
    own = cross_validated(residual, hypothesis.candidate.effects)
    every = ((cross_validated(residual, rival.effects), rival) for rival in reversed(rivals))
    one_each = {predicted.rms: (predicted, rival) for predicted, rival in every}
    best = [one_each[rms] for rms in sorted(one_each)[:MOST_RIVALS]]
    likely = probabilities([own.rms, *(predicted.rms for predicted, _ in best)], residual.freedom)
    spread = spread_by_rivals(residual, hypothesis.candidate.effects, [rival.effects for _, rival in best], likely)
    return replace(
        hypothesis,
        rivals=tuple((rival.name, predicted.rms) for predicted, rival in best),
        likely=float(likely[0]),
        moved=tuple(spread.items()),
    )


def spread_by_rivals(
    residual: Residual, effects: Sequence[Effect], rivals: Sequence[Sequence[Effect]], likely: Array
) -> dict[str, float]:
    """Standard deviation of every number of placement and model over a finding and its rivals, about the value beside
    the finding: √Σ p (value - value beside it)².

    residual: of the model without the finding. likely: (1 + R,) probability of it and of each rival. Source: Hoeting et
    al. (1999), the variance between models.
    """
    able = [(p, rival) for p, rival in zip(likely[1:], rivals, strict=True) if p > UNLIKELY]
    if not able:
        return {}
    own = _explained(residual, effects)
    apart = np.column_stack([own - _explained(residual, rival) for _, rival in able])
    moved, names = solve(residual.system, apart), (*residual.problem.placement_names, *residual.names)
    at = {e.name: i for i, e in enumerate(residual.calibration.model.effects, residual.problem.placement)}
    columns = residual.problem.columns[:, [*range(residual.problem.placement), *(at[name] for name in residual.names)]]
    unit = residual.system[: residual.measured]
    scale = np.linalg.norm(unit, axis=0) / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    spread = scale * np.sqrt(moved**2 @ np.array([p for p, _ in able]))
    return dict(zip(names, spread.tolist(), strict=True))


def _explained(residual: Residual, effects: Sequence[Effect]) -> Array:
    """What effects explain (M + B,) where they are fitted beside the model, their own columns alone."""
    columns = residual.columns(effects)
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    left, _ = residual.projected(effects)
    belief = np.array([residual.sigma / e.prior for e in effects]) / norms
    gram = left.T @ left + np.diag(belief**2)
    fitted = linalg.lstsq(gram, left.T @ residual.values, lapack_driver="gelsy", check_finite=False)[0]
    out = np.zeros(len(residual.values))
    out[: residual.measured] = columns @ (fitted / norms)
    return out
