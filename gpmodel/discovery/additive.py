"""The additive part of what is missing: groups chosen together, each then held to the criteria like any finding."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, eliminate_and_readmit, tested
from gpmodel.discovery.averaging import averaged
from gpmodel.discovery.choice import PLAIN, Choice, Laws, Together, chosen_again, chosen_together
from gpmodel.discovery.compact import compact_laws, leeway, replacement
from gpmodel.discovery.detail import detailed
from gpmodel.discovery.one_place import of_one_place
from gpmodel.discovery.refinement import refined_fit, told_apart
from gpmodel.evidence.criteria import Test, Verdict
from gpmodel.evidence.cross_validation import cross_validated, gained
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.evolution.chance import chance
from gpmodel.executor import called
from gpmodel.families.candidate import Candidate
from gpmodel.selection.result import Kept

MOST_DETERMINED = 20.0
"""Unknowns of a curve that the data determine, up to which a law may say the same: the most that a smooth curve has. A
law of seven nodes has three constants."""


PASSES = 3
"""How often what is chosen is asked for its laws: a law makes others of what it stood beside."""


@dataclass(frozen=True)
class Additive:
    """What was chosen together. hypotheses: every chosen group, judged, the worthiest first. calibration: with the
    accepted ones. null_nats: (T,) the most that any group gains on permuted residuals. laws: short ones evolved for the
    curves that were chosen, offered beside them. passed: the accepted by the names that they were offered by, before
    constants in them moved."""

    hypotheses: tuple[Hypothesis, ...]
    calibration: Calibration
    null_nats: Array
    laws: tuple[Candidate, ...] = ()
    passed: Mapping[str, Hypothesis] = field(default_factory=dict)


def additive(choice: Choice, evolved: Sequence[Candidate]) -> Additive:
    """Choose groups beside a calibration's own effects, fit them, and judge each beside all the others.

    evolved: what GP found, as groups among the others. A curve that a short law predicts as well as gives way to the
    law, and the groups are chosen once more; these stand where they are as likely as before, but for what every law is
    allowed. One that fails a criterion is left out and the rest fitted again. Where a random walk explains more than
    a law of the time, the groups are chosen without such laws, but those that passed: several of them together had
    stood for the walk. A finding gives way to a rival that predicts clearly better.
    """
    said = _with_laws(choice, chosen_together(choice, evolved), frozenset())
    found = replace(_accepted(choice, said.last), laws=said.every)
    if any(not h.verdict.passed("walk") for h in found.hypotheses):
        choice = replace(choice, timed=frozenset(found.passed))
        found = _again(choice, said, said.laws, found)
    return _with_better_rivals(choice, said, found)


@dataclass(frozen=True)
class _Said:
    """What was chosen, laws in the places of its curves, what is chosen with them, all laws on the way there, and the
    names of what was asked for its law."""

    first: Together
    laws: Laws
    last: Together
    every: tuple[Candidate, ...]
    asked: frozenset[tuple[str, ...]]


def _with_laws(choice: Choice, chosen: Together, asked: frozenset[tuple[str, ...]]) -> _Said:
    """What was chosen with its curves said as laws; what is chosen beside these is asked for its law in turn."""
    said = _Said(chosen, {}, chosen, (), asked)
    for _ in range(PASSES):
        first = said.last
        laws, asked = _laws(choice, first, said.asked)
        said = replace(said, asked=asked)
        last = chosen_again(choice, first, laws) if laws else first
        read = {name for law in laws.values() if law.name in last.candidates for name in law.inputs}
        gone = (c for name, c in first.candidates.items() if name not in last.candidates and read.issuperset(c.inputs))
        if not laws or first.chosen.likelier_by(last.chosen) > leeway(gone, choice.criteria):
            break
        said = _Said(first, laws, last, (*said.every, *laws.values()), asked)
    return said


def _again(choice: Choice, said: _Said, laws: Laws, found: Additive) -> Additive:
    """What is chosen and passes when less is offered; what was refused before stays among the hypotheses."""
    other = _with_laws(choice, chosen_again(choice, said.first, laws), said.asked)
    again = _accepted(choice, other.last)
    told = {h.candidate.name for h in again.hypotheses}
    refused = (h for h in found.hypotheses if not h.accepted and h.candidate.name not in told)
    return replace(again, hypotheses=(*again.hypotheses, *refused), laws=(*found.laws, *other.every))


def _with_better_rivals(choice: Choice, said: _Said, found: Additive) -> Additive:
    """What was found, or what is chosen instead where a rival predicts clearly better than one of the findings: these
    are not offered again, and the whole model has to predict no worse.

    The likelihood knows a finding by its price and by what stands beside it in the model; two parts of one effect can
    keep a third that says both from coming in, and one of the parts then fails.
    """
    limits = choice.criteria
    outdone = {name: h for name, h in found.passed.items() if h.outdone > limits.clear_cv_t}
    if not outdone:
        return found
    timed = choice.timed
    if timed is not None:
        timed = timed.union(name for h in outdone.values() for name, _ in h.rivals)
    kept = {names: law for names, law in said.laws.items() if law.name not in outdone}
    fewer = replace(choice, timed=timed, outdone=frozenset(outdone))
    other = _again(fewer, said, kept, found)
    before, after = (cross_validated(choice.residual(model.calibration), ()) for model in (found, other))
    if gained(before, after, limits.outlier_sigmas) <= 0.0:
        return found
    tests = {name: Test("rival", h.outdone, limits.clear_cv_t, passed=False) for name, h in outdone.items()}
    gone = (replace(h, verdict=Verdict((*h.verdict.tests, tests[name]))) for name, h in outdone.items())
    return replace(other, hypotheses=(*other.hypotheses, *gone))


def _laws(
    choice: Choice, first: Together, asked: frozenset[tuple[str, ...]]
) -> tuple[Laws, frozenset[tuple[str, ...]]]:
    """Of every curve that was chosen, of what was evolved in several terms or just now, and of several at one place
    together, but those asked for before: the law of one term that saves most, where it predicts as well within one
    standard error; and what was asked by now.

    Programs are bred at all places at once and miss forms that a search at one place looks at one by one. Curves with
    constants inside are refined instead. Terms were evolved beside poses that stood far out; now these are explained.
    """
    chosen = list(zip(first.candidates.values(), first.chosen.kept, strict=True))
    curves: dict[tuple[str, ...], Candidate] = {
        (c.name,): c
        for c, k in chosen
        if (PLAIN < k.determined <= MOST_DETERMINED and c.inner is None)
        or (not c.family and (len(c.effects) > 1 or c.name in choice.fresh))
    }
    learned = (replace(c, effects=k.effects) for c, k in chosen if k.determined <= MOST_DETERMINED)
    curves |= of_one_place(learned)
    curves = {names: curve for names, curve in curves.items() if names not in asked}
    names = {curve.name: names for names, curve in curves.items()}
    searched = () if choice.late() else compact_laws(first.left, list(curves.values()), choice.search)
    found = ((names[curve.name], replacement(curve, residual, laws)) for curve, residual, laws in searched)
    laws = {names: law.simplified() if choice.simplified else law.candidate for names, law in found if law}
    return laws, asked.union(curves)


def _accepted(choice: Choice, last: Together) -> Additive:
    """The chosen groups that stand every test beside each other, fine curves in as much detail as their evidence asks:
    what is a line of a curve is no finding."""
    kept, null_nats = {k.group.name: k for k in last.chosen.kept}, last.chosen.by_chance
    residual = lru_cache(1)(choice.residual)
    offered, calibration = _in_detail(choice, last)
    apart = told_apart(residual(calibration), offered)
    if apart != offered:
        calibration = choice.fit(tuple(apart.values()), calibration)
    candidates, calibration = refined_fit(choice.fit, residual, apart, calibration)

    def of_each(asked: Mapping[str, Candidate], look: Callable[[str], Hypothesis]) -> dict[str, Hypothesis]:
        found = called(choice.search.here, [partial(look, name) for name in asked])
        return dict(zip(asked, found, strict=True))

    def verdicts(calibration: Calibration, asked: Mapping[str, Candidate]) -> dict[str, Hypothesis]:
        left = residual(calibration)

        def verdict(name: str) -> Hypothesis:
            return _judged(left.without(asked[name].effects), asked[name], kept[name], null_nats)

        return of_each(asked, verdict)

    def with_rivals(name: str) -> Hypothesis:
        without = residual(calibration).without(judged[name].candidate.effects)
        return averaged(without, judged[name], [group for group, _ in kept[name].rivals])

    judged, calibration = eliminate_and_readmit(candidates, calibration, verdicts, choice.fit)
    residual(calibration)  # once, before it is looked at side by side
    judged = of_each(candidates, with_rivals)
    passed = {name: h for name, h in judged.items() if h.accepted}
    return Additive(tuple(judged.values()), calibration, null_nats, passed=passed)


def _in_detail(choice: Choice, last: Together) -> tuple[dict[str, Candidate], Calibration]:
    """What was chosen, its fine curves with twice their harmonics where they ask for them, and the fit with it."""
    calibration, offered = last.left.calibration, detailed(last.left, last.candidates)
    return offered, calibration if offered == last.candidates else choice.fit(tuple(offered.values()), calibration)


def _judged(residual: Residual, candidate: Candidate, kept: Kept, null_nats: Array) -> Hypothesis:
    """The verdict on a kept group beside all the others; residual: without it."""
    before = cross_validated(residual.at_own_noise(), ())
    nats = kept.gain - candidate.cost
    score = replace(scores(residual, [candidate])[0], nats=nats)
    by_chance = chance(nats - residual.criteria.head_start * (not candidate.family), null_nats)
    return tested(residual, candidate, score, by_chance, before)
