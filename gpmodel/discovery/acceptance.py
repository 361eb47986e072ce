"""Test candidate effects, and eliminate findings that fail a test given all other findings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gpmodel import wording
from gpmodel.calibration.result import Calibration
from gpmodel.evidence.criteria import Test, Verdict
from gpmodel.evidence.cross_validation import Predicted, better_by, cross_validated, gained
from gpmodel.evidence.dependence import inflation, order_matters
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import Score, gains_by_inflation, unique_share
from gpmodel.evolution.chance import PValue
from gpmodel.families.candidate import Candidate
from gpmodel.selection.causes import CredibleSet


@dataclass(frozen=True)
class Hypothesis:
    """A candidate effect with its score, p-value, test results and credible set, all from training poses.

    chance: p-value of the candidate's gain on random residuals. cv_rms, cv_before: cross-validated 3-D RMS
    error, m, with the candidate and without. causes: possible causes, None for a rejected candidate. rivals: names of
    alternative causes, each with the cross-validated 3-D RMS error, m, of the model with that cause.
    """

    candidate: Candidate
    score: Score
    chance: PValue
    cv_rms: float
    cv_before: float
    verdict: Verdict
    causes: CredibleSet | None = None
    rivals: tuple[tuple[str, float], ...] = ()

    @property
    def accepted(self) -> bool:
        """True if the candidate effect passed every test."""
        return self.verdict.accepted

    @property
    def why(self) -> str:
        """Reason for the verdict on the candidate effect, in words."""
        chance = wording.chance(self.chance.p, self.chance.shuffles, self.chance.noun)
        return self.verdict.why or f"removes {100 * self.score.gain:.0f} % of the residual energy, p {chance}"


def tested(residual: Residual, candidate: Candidate, score: Score, by_chance: PValue, before: Predicted) -> Hypothesis:
    """Test a candidate effect by every criterion. residual: residual of the model without the candidate."""
    criteria = residual.criteria
    after = cross_validated(residual, candidate.effects)
    cv_t = gained(before, after, criteria.outlier_sigmas)
    inflated = inflation(residual, candidate)
    share = unique_share(residual, candidate)
    predicts = criteria.minimum_cv_t if candidate.family else criteria.clear_cv_t
    tests = [
        Test("chance", by_chance.p, criteria.significance, by_chance.p < criteria.significance),
        Test("nats", score.nats, criteria.minimum_nats, score.nats > criteria.minimum_nats),
        Test("cross-validation", cv_t, predicts, cv_t > predicts),
        Test("unique share", share, criteria.minimum_share, share > criteria.minimum_share),
    ]
    if order_matters(residual, candidate):
        t = better_by(residual.contiguous_folds, candidate.effects)
        apart = criteria.apart_cv_t if candidate.family else criteria.clear_cv_t
        tests.append(Test("stretches", t, apart, t > apart))
    shared = {name: factor for name, factor in inflated.items() if factor > 1.0}
    for name, nats in zip(shared, gains_by_inflation(residual, candidate, tuple(shared.values())), strict=True):
        tests.append(Test(name, nats, criteria.minimum_nats, nats > criteria.minimum_nats))
    return Hypothesis(candidate, score, by_chance, after.rms, before.rms, Verdict(tuple(tests)))


Fit = Callable[[Sequence[Candidate], Calibration], Calibration]
Judge = Callable[[Calibration, Mapping[str, Candidate]], dict[str, Hypothesis]]


def eliminate(
    offered: Mapping[str, Candidate], calibration: Calibration, judge: Judge, fit: Fit
) -> tuple[dict[str, Hypothesis], Calibration]:
    """Delete candidate effects that fail a test given all others, in each pass the weaker half of the failing ones.

    judge: function that tests each candidate given all others. fit: function that calibrates with candidates, starting
    from an earlier fit. Returns the last test result of each candidate, and the calibration with the accepted
    candidates, which are tested again at the end.
    """
    inside, judged = dict(offered), dict[str, Hypothesis]()
    asked: Mapping[str, Candidate] = inside
    while True:
        judged.update(now := judge(calibration, asked))
        failed = [name for name, hypothesis in now.items() if not hypothesis.accepted]
        if not failed and len(asked) == len(inside):
            return judged, calibration
        for name in sorted(failed, key=lambda name: now[name].score.nats)[: max(1, len(failed) // 2)]:
            inside.pop(name)
        if failed:
            calibration = fit(tuple(inside.values()), calibration)
        asked = {name: inside[name] for name in failed if name in inside} or inside
