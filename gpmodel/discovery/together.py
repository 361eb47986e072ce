"""Backward elimination of findings that fail a test, then re-inclusion of those that pass beside the rest."""

from collections.abc import Callable, Mapping, Sequence

from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.families.candidate import Candidate

Fit = Callable[[Sequence[Candidate], Calibration], Calibration]
Judge = Callable[[Calibration, Mapping[str, Candidate]], dict[str, Hypothesis]]


def eliminate_and_readmit(
    offered: Mapping[str, Candidate], calibration: Calibration, judge: Judge, fit: Fit
) -> tuple[dict[str, Hypothesis], Calibration]:
    """Eliminate and readmit: the last verdict on each candidate, and the calibration with the accepted ones.

    judge: verdicts on candidates beside all the others that a calibration has. fit: calibrates with candidates, from a
    fit to go on from. All that fail are left out at once, until none does. What failed beside much that is out
    by then may pass beside the rest: the strongest of those comes back, one after the other; then all are judged
    once more (the floating search of Pudil et al. 1994). What fails the test of significance never comes back.
    """
    inside, outside = dict(offered), dict[str, Candidate]()
    judged: dict[str, Hypothesis] = {}

    def weeded(calibration: Calibration) -> Calibration:
        while True:
            judged.update(now := judge(calibration, inside))
            failed = [name for name, hypothesis in now.items() if not hypothesis.accepted]
            if not failed:
                return calibration
            outside.update({name: inside.pop(name) for name in failed})
            calibration = fit(tuple(inside.values()), calibration)

    calibration = weeded(calibration)
    before = len(inside)
    while again := {name: c for name, c in outside.items() if judged[name].verdict.passed("chance")}:
        judged.update(now := judge(calibration, again))
        best = max((n for n, h in now.items() if h.accepted), key=lambda n: now[n].score.nats, default=None)
        if best is None:
            break
        inside[best] = outside.pop(best)
        calibration = fit(tuple(inside.values()), calibration)
    return judged, weeded(calibration) if len(inside) > before else calibration
