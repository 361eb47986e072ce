"""From a pool of candidates to one hypothesis: what fits, what it would be, and what else it could be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.discovery.residual import Evidence, Score, deviations
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.numerics import rank as ident
from gpmodel.numerics.null_distribution import chance
from gpmodel.numerics.rank import canonical_correlation

LIKENESS = 0.95
SIGNIFICANCE = 0.01
MINIMUM_SIGMAS = 3.0
MINIMUM_SHARE = 0.03
MINIMUM_CV_T = 2.0
MINIMUM_NATS = 5.0
NAMING_MARGIN = 8.0
HEAD_START = 5.0
TIE = 1.0
FEWEST_POSES = 5.0
FEWEST_SHARE = 0.05
SHORTLIST = 4
LOOKED_AT = 48
WAITS = "passes, but another was preferred: judged again in the next round"
MOST_RIVALS = 6


@dataclass(frozen=True)
class Hypothesis:
    """A candidate with what speaks for and against it, all from training poses.

    cv_rms: m, cross-validated 3-D RMS with it; cv_before: without. sigmas: largest |coefficient| / σ. stable: whether
    the coefficients keep their signs in every fold. why: the reason of the verdict, in words.
    """

    candidate: Candidate
    score: Score
    p_value: float
    cv_rms: float
    cv_before: float
    cv_t: float
    sigmas: float
    stable: bool
    rivals: tuple[tuple[str, float], ...]
    accepted: bool
    why: str


@dataclass(frozen=True)
class Pool:
    """Candidates of one round, their scores, and the null maxima of where each came from."""

    candidates: tuple[Candidate, ...]
    scores: tuple[Score, ...]
    nulls: dict[str, Array]

    def p_value(self, i: int) -> float:
        """Chance of the score among shuffled residuals, times the number of searches that competed."""
        null = self.nulls[self.candidates[i].found_by]
        return min(1.0, len(self.nulls) * chance(self.scores[i].nats, null))


def judge(evidence: Evidence, pool: Pool) -> tuple[Hypothesis, ...]:
    """The distinct best candidates, best first, each with its verdict; naming and rivals included.

    Candidates whose projected columns correlate above 0.95 are one finding with several possible places. An expression
    that nobody named has to save 5 nats more than a named effect to come before it.
    """
    order = sorted(range(len(pool.scores)), key=lambda i: -worth(pool.scores[i].nats, pool.candidates[i]))
    order = [i for i in order if np.isfinite(pool.scores[i].nats)]
    named = [i for i in order if pool.candidates[i].family][:LOOKED_AT]
    unnamed = [i for i in order if not pool.candidates[i].family][:LOOKED_AT]
    looked_at = {*named, *unnamed}
    order = [i for i in order if i in looked_at]
    spans = {i: ident.orthonormal(evidence.projected(pool.candidates[i].effects)[0]) for i in order}
    leaders: list[int] = []
    followers: dict[int, list[int]] = {}
    for i in order:
        leader = next((k for k in leaders if _alike(spans[i], spans[k])), None)
        of_its_kind = sum((k in named) is (i in named) for k in leaders)
        if leader is None and (of_its_kind >= SHORTLIST or not sound(evidence, pool.candidates[i])):
            continue
        if leader is None:
            leaders.append(i)
            followers[i] = []
        else:
            followers[leader].append(i)
    before, per_pose, _ = evidence.cross_validated(())
    judged = [_verdict(evidence, pool, i, followers[i], before, per_pose) for i in leaders]
    best = _preferred(evidence, judged)
    return tuple(replace(h, accepted=False, why=WAITS) if h.accepted and h is not best else h for h in judged)


def _preferred(evidence: Evidence, judged: Sequence[Hypothesis]) -> Hypothesis | None:
    """The first that passed; a named one that passed before an expression that does not predict better by 2 deviations.

    What an expression explains beyond a named effect may be a few bad poses, which it has more ways to meet.
    """
    passed = [h for h in judged if h.accepted]
    first = next(iter(passed), None)
    named = next((h for h in passed if h.candidate.family), None)
    if first is None or named is None or first is named:
        return first
    better = evidence.better_by(first.candidate.effects, named.candidate.effects) > MINIMUM_CV_T
    return first if better else named


def worth(nats: float, *candidates: Candidate) -> float:
    """Description length saved, less the head start of named effects for every one of the candidates without a name."""
    return nats - HEAD_START * sum(not candidate.family for candidate in candidates)


def sound(evidence: Evidence, candidate: Candidate) -> bool:
    """Whether every part of an expression without a name speaks for more than a few poses.

    Each of its bases must act at 5 poses and a twentieth of them, and leaving any one out must cost 2 deviations in
    cross-validation: else a spike at the worst poses rides along with a shape that is there.
    """
    if candidate.family:
        return True
    effects = candidate.effects
    if evidence.poses_at_work(effects).min() < max(FEWEST_POSES, FEWEST_SHARE * len(evidence.poses)):
        return False
    if len(effects) == 1:
        return True
    whole = evidence.cross_validated(effects)[1]
    rest = (effects[:k] + effects[k + 1 :] for k in range(len(effects)))
    return all(deviations(evidence.cross_validated(fewer)[1] - whole) > MINIMUM_CV_T for fewer in rest)


def _alike(first: Array, second: Array) -> bool:
    return canonical_correlation(first, second) > LIKENESS


def _named(pool: Pool, leader: int, alike: Sequence[int]) -> tuple[int, Candidate]:
    """The catalogue's word for an evolved finding where one fits as well; and where GP found it too, that it did.

    Of expressions that save as much, within a nat, the one with the fewest operators speaks for them.
    """
    best = pool.candidates[leader]
    group = [leader, *alike]
    if best.found_by == "evolved":
        named = [i for i in alike if pool.candidates[i].family and pool.candidates[i].found_by == "catalogue"]
        for i in named:
            if pool.scores[i].nats > pool.scores[leader].nats - NAMING_MARGIN:
                return i, replace(pool.candidates[i], found_by="evolved")
        ties = [
            i for i in group if pool.scores[i].nats > pool.scores[leader].nats - TIE and not pool.candidates[i].family
        ]
        plainest = min(ties, key=lambda i: (_operators(pool.candidates[i]), -pool.scores[i].nats))
        return plainest, pool.candidates[plainest]
    evolved = any(pool.candidates[i].found_by == "evolved" for i in group)
    return leader, replace(best, found_by="evolved" if evolved else "catalogue")


def _operators(candidate: Candidate) -> int:
    return sum(Expression(str(effect.terms[0].basis)).operators for effect in candidate.effects)


def _restates(rival: Candidate, other: Candidate) -> bool:
    """Whether an evolved rival says the same with more words: same place, nothing read less than `other` reads."""
    if rival.name == other.name:
        return True
    first, second = rival.effects[0], other.effects[0]
    reads = {x for e in rival.effects for x in e.inputs}
    same_place = set(first.slots) & set(second.slots) and first.terms[0].axis == second.terms[0].axis
    return rival.found_by == "evolved" and bool(same_place) and reads >= {x for e in other.effects for x in e.inputs}


def _verdict(
    evidence: Evidence, pool: Pool, leader: int, alike: Sequence[int], before: float, per_pose: Array
) -> Hypothesis:
    chosen, candidate = _named(pool, leader, alike)
    score, p_value = pool.scores[chosen], pool.p_value(leader)
    cv_rms, after, coefficients = evidence.cross_validated(candidate.effects)
    cv_t = deviations(per_pose - after)
    believed = bool(np.isfinite(candidate.effects[0].prior))
    sigmas = 0.0 if believed else _sigmas(evidence, candidate)
    stable = believed or _stable(coefficients)
    rivals: list[tuple[str, float]] = []
    shown = [candidate]
    for i in sorted([leader, *alike], key=lambda k: (pool.candidates[k].found_by, -pool.scores[k].nats)):
        rival = pool.candidates[i]
        if len(rivals) < MOST_RIVALS and not any(_restates(rival, other) for other in shown):
            shown.append(rival)
            rivals.append((rival.name, evidence.cross_validated(rival.effects)[0]))
    tests = (
        (p_value < SIGNIFICANCE, f"chance of it on shuffled residuals {wording.chance(p_value)}, limit {SIGNIFICANCE}"),
        (score.nats > MINIMUM_NATS, f"description length saved {score.nats:.1f} nats, limit {MINIMUM_NATS}"),
        (cv_rms < before and cv_t > MINIMUM_CV_T, f"cross-validated gain {cv_t:.1f} deviations, limit {MINIMUM_CV_T}"),
        (believed or sigmas > MINIMUM_SIGMAS, f"coefficient {sigmas:.1f} sigma, limit {MINIMUM_SIGMAS}"),
        (stable, "sign changes between folds"),
        (score.share > MINIMUM_SHARE or believed, f"unique share {score.share:.3f}, limit {MINIMUM_SHARE}"),
    )  # fmt: skip
    failed = [text for passed, text in tests if not passed]
    why = "; ".join(failed) or f"removes {100 * score.gain:.0f} % of the residual energy, p {wording.chance(p_value)}"
    return Hypothesis(candidate, score, p_value, cv_rms, before, cv_t, sigmas, stable, tuple(rivals), not failed, why)


def _sigmas(evidence: Evidence, candidate: Candidate) -> float:
    span, _ = evidence.projected(candidate.effects)
    gram = np.linalg.pinv(span.T @ span)
    solved = gram @ (span.T @ evidence.residual)
    rest = evidence.residual - span @ solved
    sigma = np.sqrt(rest @ rest / max(evidence.freedom - span.shape[1], 1))
    deviation = sigma * np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return float(np.max(np.abs(solved) / deviation))


def _stable(coefficients: Array) -> bool:
    """Whether the largest coefficient of a set keeps its sign in every fold."""
    leading = int(np.argmax(np.abs(coefficients.mean(axis=0))))
    signs = np.sign(coefficients[:, leading])
    return bool(np.all(signs == signs[0]))
