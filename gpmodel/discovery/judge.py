"""Judge a selection: each group tested given all the others, those that fail eliminated, alternatives weighed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy import linalg
from scipy.special import softmax

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, eliminate, tested
from gpmodel.discovery.choose import FittedSelection, Problem
from gpmodel.discovery.refinement import detailed, refined_fit
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.evolution.chance import chance, larger
from gpmodel.executor import called
from gpmodel.families.candidate import Candidate, is_program
from gpmodel.model.effect import Effect
from gpmodel.numerics.least_squares import solve
from gpmodel.selection.result import Kept


@dataclass(frozen=True)
class Judged:
    """hypotheses: every selected group with its tests, the strongest first. calibration: with the accepted ones."""

    hypotheses: tuple[Hypothesis, ...]
    calibration: Calibration


def judge(problem: Problem, last: FittedSelection, evolved_null: Array) -> Judged:
    """Test every selected group given all the others, eliminate those that fail, and weigh the alternatives.

    Fine curves get as many harmonics as their evidence asks for, and constants inside move to where they are most
    likely. evolved_null: (S,) largest gain of any program on permuted residuals; an evolved term has to stand out of
    both nulls, since it was searched for twice.
    """
    if not last.candidates:
        return Judged((), last.left.calibration)
    kept = {k.group.name: k for k in last.chosen.kept}
    nulls = last.chosen.permutation_null, evolved_null
    alternatives, residual = last.chosen.alternatives, lru_cache(1)(problem.residual)
    fine = detailed(last.left, last.candidates)
    calibration = last.left.calibration
    if fine != last.candidates:
        calibration = problem.fit(tuple(fine.values()), calibration)
    candidates, calibration = refined_fit(problem.fit, residual, fine, calibration)

    def of_each(asked: Mapping[str, Candidate], look: Callable[[str], Hypothesis]) -> dict[str, Hypothesis]:
        found = called(problem.search.here, [partial(look, name) for name in asked])
        return dict(zip(asked, found, strict=True))

    def verdicts(calibration: Calibration, asked: Mapping[str, Candidate]) -> dict[str, Hypothesis]:
        left = residual(calibration)
        return of_each(asked, lambda name: _judged(left.without(asked[name].effects), asked[name], kept[name], nulls))

    def with_alternatives(name: str) -> Hypothesis:
        without = residual(calibration).without(judged[name].candidate.effects)
        return averaged(without, judged[name], [group for group, _ in alternatives[name]])

    judged, calibration = eliminate(candidates, calibration, verdicts, problem.fit)
    residual(calibration)  # once, before workers look at it side by side
    judged = of_each(candidates, with_alternatives)
    return Judged(tuple(judged.values()), calibration)


def _judged(residual: Residual, candidate: Candidate, kept: Kept, nulls: tuple[Array, Array]) -> Hypothesis:
    """Test a selected group. residual: of the model without it. nulls: of the selection, and of evolution."""
    before = cross_validated(residual.at_own_noise(), ())
    nats = kept.gain - candidate.cost + kept.shared
    score = replace(scores(residual, [candidate])[0], nats=nats)
    by_chance = chance(nats - residual.criteria.head_start * (not candidate.family), nulls[0])
    if is_program(kept.group.found_by) and len(nulls[1]):
        by_chance = larger(by_chance, chance(nats, nulls[1]))
    return tested(residual, candidate, score, by_chance, before)


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
