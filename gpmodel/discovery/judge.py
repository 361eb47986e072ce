"""Test each selected group of effects given all others, delete groups that fail, and find causes of the others."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial, reduce

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, eliminate, tested
from gpmodel.discovery.choose import FittedSelection, Problem
from gpmodel.discovery.refinement import detailed, refined_fit
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.evolution.chance import RANDOM_SIGNS, chance_of
from gpmodel.executor import called
from gpmodel.families.candidate import Candidate, is_program
from gpmodel.selection.causes import credible_set
from gpmodel.selection.posterior import Active
from gpmodel.selection.result import Kept
from gpmodel.selection.sparse_bayes import reestimate

SURE = 4.0
"""Net gain over the largest gain by chance beyond which a group is sure to pass; unequal noise of poses gives 2.6."""


@dataclass(frozen=True)
class Judged:
    """Tested groups of effects by decreasing log evidence gain (`hypotheses`), and the fit of the accepted groups."""

    hypotheses: tuple[Hypothesis, ...]
    calibration: Calibration


def judge(problem: Problem, last: FittedSelection, evolved_null: Array, errors_alone: bool = False) -> Judged:
    """Test every selected group given all others, delete groups that fail, and find credible sets of the other groups.

    Detailed angular errors of a drive get as many harmonics as the evidence supports, and constants inside candidates
    are refitted. evolved_null: largest gain of any program on each permuted residual. An evolved term has to exceed the
    nulls of evolution and selection, because both searches selected the term. errors_alone: omit the credible sets.
    """
    if not last.candidates:
        return Judged((), last.left.calibration)
    kept = {k.group.name: k for k in last.chosen.kept}
    common = last.chosen.null_without()
    unsure = [name for name, k in kept.items() if k.gain - k.group.cost < SURE * common.max()]
    nulls = called(problem.search.here, [partial(last.chosen.null_without, name) for name in unsure])
    by_chance = dict.fromkeys(kept, common) | dict(zip(unsure, nulls, strict=True))
    residual = lru_cache(1)(problem.residual)
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
        return of_each(asked, lambda name: _judged(left, asked[name], kept[name], (by_chance[name], evolved_null)))

    def with_causes(name: str) -> Hypothesis:
        found = judged[name]
        if not found.accepted:
            return found
        causes = credible_set(model, number[name], *problem.smooth_sites)
        others = [group for cause in causes.causes for group in cause.groups if group.name != name]
        if not others:
            return replace(found, causes=causes)
        without = residual(calibration).without(found.candidate.effects)
        rivals = tuple((group.name, cross_validated(without, group.effects).rms) for group in others)
        return replace(found, causes=causes, rivals=rivals)

    judged, calibration = eliminate(candidates, calibration, verdicts, problem.fit)
    if errors_alone:
        return Judged(tuple(judged[name] for name in candidates), calibration)
    number = {last.chosen.active.pool.groups[g].name: g for g in last.chosen.active.found}
    failed = (g for name, g in number.items() if name not in judged or not judged[name].accepted)
    model = reestimate(reduce(Active.without, failed, last.chosen.active))
    residual(calibration)  # once, before workers share it
    judged = of_each(candidates, with_causes)
    return Judged(tuple(judged.values()), calibration)


def _judged(left: Residual, candidate: Candidate, kept: Kept, nulls: tuple[Array, Array]) -> Hypothesis:
    """Test a selected group of effects. left: residual of the model with all groups. nulls: gains by chance, nats."""
    residual = left.without(candidate.effects)
    before = cross_validated(residual.with_refitted_noise(), ())
    nats = kept.gain - candidate.cost + kept.shared
    score = replace(scores(residual, [candidate])[0], nats=nats)
    by_chance = chance_of(nats - residual.criteria.head_start * (not candidate.family), nulls[0], RANDOM_SIGNS)
    if is_program(kept.group.found_by) and len(nulls[1]):
        by_chance = max(by_chance, chance_of(nats, nulls[1]), key=lambda found: found.p)
    return tested(residual, candidate, score, by_chance, before)
