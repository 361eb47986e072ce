"""The loop: calibrate, look at the residual, find what is missing, add it, look again."""

import math
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import known_rows
from gpmodel.calibration.gauge import stands_still, still_joints
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, as_searched, judge
from gpmodel.discovery.additive import Choice, additive
from gpmodel.discovery.explore import Exploration, OutOfTime, RoundContext, explore
from gpmodel.discovery.final_fit import final_fit
from gpmodel.discovery.journal import Journal, NullJournal
from gpmodel.discovery.result import Discovery, FinalFit, Finding, Round
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import State
from gpmodel.errors import InputError
from gpmodel.evidence.confirmation import confirmation
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.executor import Threads
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates as instances_of
from gpmodel.families.catalogue import catalogue
from gpmodel.families.offer import Offer, distinct
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.geometric import geometric_effects
from gpmodel.model.sites import sites_of
from gpmodel.progress import Say, Teller, silent
from gpmodel.table.bundles import copies


def discover(
    mechanism: Mechanism,
    poses: Poses,
    train: IntArray,
    heldout: IntArray,
    *,
    search: Search | None = None,
    criteria: Criteria | None = None,
    candidates: Iterable[Offer] = catalogue,
    standard: tuple[Effect, ...] | None = None,
    known: tuple[Candidate, ...] = (),
    condition_limit: float | None = None,
    seed: int = 0,
    progress: Say = silent,
    journal: Journal | None = None,
) -> Discovery:
    """Run the whole loop. Held-out poses are only ever measured against, never looked at for a choice.

    After it they decide one thing: whether what was found is shipped, or the standard model. train, heldout: rows
    of `poses`; none held out measure nothing. candidates: what may be missing, beside what GP evolves. standard:
    the effects of the standard model, None for the complete geometric set. known: effects enabled from the start
    beside it. condition_limit: of the standard model, None for cross-validated. progress: called with one line on
    what is being tried. journal: keeps what is finished, None for nothing; where an interrupted search was asked
    the same it goes on to the same numbers. Raises InputError where no held-out pose is of a set-up and tool
    trained on, and for two different candidates of one name.
    """
    started = time.monotonic()
    search, journal = search or Search(), journal or NullJournal()
    say = Teller(progress)
    poses, train, heldout = drop_duplicate_rows(poses, train, heldout, say)
    given = len(poses)
    poses, train, heldout = _drop_unseen_setups(poses, train, heldout)
    offers = distinct(candidates)
    instances_of(mechanism, poses.states, offers)  # what cannot be offered is refused before anything is searched
    findings, rounds = journal.begin()
    if len(poses) < given:
        say(f"{given - len(poses)} held-out poses are of a set-up or tool that no training pose is of: left out")
    loop = State(
        mechanism, poses, train, heldout, geometric_effects(mechanism) if standard is None else standard, known,
        offers, search, criteria or Criteria(), condition_limit, seed, say, journal,
        math.inf if search.stop_after is None else started + search.stop_after, findings, rounds,
    )  # fmt: skip
    loop.say("standard model")
    base = loop.fit(ErrorModel(mechanism, ()))
    standard_fit = loop.fit(loop.model(()))
    calibration = loop.fit(loop.model(loop.found), standard_fit) if loop.findings else standard_fit
    calibration, stopped = _run_rounds(loop, standard_fit, calibration)
    loop.say("the ladder of held-out errors, and the final fit on all poses")
    _ladder(loop, base, standard_fit, calibration)
    last = final_fit(loop, calibration) if loop.findings else FinalFit(loop.standard_to_all(), (), ())
    doubt = None
    if loop.findings and len(heldout):
        doubt = confirmation(standard_fit, calibration, poses.subset(heldout), loop.criteria)
    final = last.calibration if doubt is None or doubt.passed else loop.standard_to_all()
    return Discovery(
        mechanism, poses, train, heldout, tuple(loop.steps), tuple(loop.findings), tuple(loop.rounds), last, final,
        doubt, loop.standard, time.monotonic() - started, stopped,
    )  # fmt: skip


def _run_rounds(loop: State, standard_fit: Calibration, calibration: Calibration) -> tuple[Calibration, str]:
    """Rounds until nothing new is seen or a limit of the search is met, and why they ended.

    Where the time is up before the first round is done, it is done without GP.
    """
    search = loop.search
    while not loop.repeating:
        if len(loop.findings) >= search.max_effects:
            return calibration, f"stopped at {search.max_effects} effects"
        try:
            if loop.rounds and loop.late:
                raise OutOfTime
            calibration = _round(loop, standard_fit, calibration)
        except OutOfTime:
            if not loop.rounds:
                loop.search = replace(search, runs=0)
                calibration = _round(loop, standard_fit, calibration)
                loop.journal.keep(loop.findings, loop.rounds)
            return calibration, f"stopped after {search.stop_after:g} s; there may be more to find"
        loop.journal.keep(loop.findings, loop.rounds)
    return calibration, "no further effect is significant"


def drop_duplicate_rows(
    poses: Poses, train: IntArray, heldout: IntArray, say: Teller
) -> tuple[Poses, IntArray, IntArray]:
    """The poses without rows that copy another, which would count twice, and the rows again."""
    copied = copies(poses.dataset)
    if not copied.any():
        return poses, train, heldout
    say(f"{copied.sum()} rows copy the measurement of another to the last digit: left out")
    return _only(poses, train[~copied[train]], heldout[~copied[heldout]])


def _only(poses: Poses, train: IntArray, heldout: IntArray) -> tuple[Poses, IntArray, IntArray]:
    """The poses of some rows, and these again."""
    kept = np.sort(np.concatenate([train, heldout]))
    return poses.subset(kept), np.searchsorted(kept, train), np.searchsorted(kept, heldout)


def _drop_unseen_setups(poses: Poses, train: IntArray, heldout: IntArray) -> tuple[Poses, IntArray, IntArray]:
    """The poses without the held-out ones of set-ups and tools that no training pose is of, and the rows again."""
    if not len(heldout):
        return poses, train, heldout
    data = poses.dataset
    known = heldout[known_rows(data.subset(train), data.subset(heldout))]
    if not len(known):
        raise InputError(
            f"{data.source}: every held-out pose is of a set-up or tool that no training pose is of; expected groups "
            "of poses that lie within set-ups and tools, or another seed or share to hold out"
        )
    if len(known) == len(heldout):
        return poses, train, heldout
    return _only(poses, train, known)


def _ladder(loop: State, base: Calibration, standard_fit: Calibration, calibration: Calibration) -> None:
    """Registration, the standard model, and the findings one after the other, each with its errors; the fits go on from
    the standard model, side by side."""
    loop.climb("registration", base)
    loop.climb("standard", standard_fit)
    models = [loop.model(loop.found[:count]) for count in range(1, len(loop.findings))]
    rungs = dict(Threads(loop.search.workers)(lambda model: loop.fit(model, standard_fit), models))
    for i in range(len(loop.findings)):
        loop.climb(f"effect {i + 1}", rungs.get(i, calibration), i)


def _round(loop: State, standard_fit: Calibration, calibration: Calibration) -> Calibration:
    """One round: what GP makes of the residual, then all groups chosen again with what it found among them."""
    number = len(loop.rounds) + 1
    rng = np.random.default_rng([loop.seed, number])
    train = loop.poses.subset(loop.train)
    exploration, judged = _explored(loop, calibration, train, rng)
    passed = _one_a_place(h.candidate for h in judged if h.accepted)
    new = tuple(c for c in passed if c.name not in {e.name for e in loop.evolved})
    pointed = _pointed(loop, exploration)
    if loop.rounds and not new and pointed == loop.pointed:
        loop.rounds.append(Round(number, judged, exploration, (), loop.rounds[-1].null_nats))
        return calibration
    loop.say(f"round {number}: choosing groups of effects together")
    choice = Choice(
        standard_fit, lambda found, start: loop.fit(loop.model(found), start) if found else standard_fit, train,
        loop.offers, loop.search, loop.criteria, loop.seed, pointed, lambda: loop.late,
    )  # fmt: skip
    found = additive(choice, (*loop.evolved, *new))
    before = {f.candidate.name: f for f in loop.findings}
    searched = [*judged, *(h for r in loop.rounds for h in r.hypotheses)]
    accepted = [as_searched(h, searched) for h in found.hypotheses if h.accepted]
    loop.findings = [
        replace(before[h.candidate.name], hypothesis=h)
        if h.candidate.name in before
        else _new_finding(h, number, exploration)
        for h in accepted
    ]
    dropped = tuple(n for n in before if n not in {h.candidate.name for h in accepted})
    for finding in loop.findings:
        if finding.round == number:
            loop.say(f"round {number}: added {finding.candidate.name}")
    loop.rounds.append(
        Round(number, (*found.hypotheses, *judged), exploration, (*new, *found.laws), found.null_nats, dropped)
    )
    return found.calibration


def _one_a_place(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """The first candidate at each place; others there are equivalent, or are found in the next round."""
    out: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        out.setdefault((candidate.place.slot, candidate.place.axis), candidate)
    return tuple(out.values())


def _pointed(loop: State, exploration: Exploration) -> frozenset[str] | None:
    """Inputs that the histograms point at, this round's included; None where nothing was evolved that could point."""
    if not loop.search.runs:
        return loop.pointed
    return (loop.pointed or frozenset()) | set(exploration.histogram.significant)


def _new_finding(hypothesis: Hypothesis, number: int, exploration: Exploration) -> Finding:
    """A finding of this round, and whether its histogram pointed at it."""
    pointed = set(exploration.histogram.significant) & set(hypothesis.candidate.inputs)
    return Finding(hypothesis, number, bool(pointed))


def _explored(
    loop: State, calibration: Calibration, train: Poses, rng: np.random.Generator
) -> tuple[Exploration, tuple[Hypothesis, ...]]:
    """What GP evolves on the residual of a calibration, and the verdicts on the best of it.

    Maxima on shuffled residuals are pooled over rounds of one budget: those of an opening round stand alone.
    """
    number = len(loop.rounds) + 1
    rows = np.arange(len(train))
    if len(train) > loop.search.scored_poses:
        rows = np.sort(rng.permutation(len(train))[: loop.search.scored_poses])
    residual = residual_of(calibration, train.subset(rows), loop.criteria, loop.seed)
    loop.say(f"round {number}: residual {1e3 * residual.rms:.3f} mm")
    opening = bool(loop.offers) and number == 1
    earlier = [r.exploration.null_nats for r in loop.rounds[bool(loop.offers) :]]
    pooled = sum(len(nats) for nats in earlier) > 0
    tell = Teller(loop.say.say, f"round {number}: ")
    context = RoundContext(number, tell, loop.journal, lambda: loop.late, opening, pooled)
    still = still_joints(loop.mechanism, residual.poses.dataset)
    sites = tuple(s for s in sites_of(loop.mechanism) if not stands_still((t[0] for t in s.terms), still))
    exploration = explore(residual, sites, loop.search, rng, context)
    known = {c.name for c in (*loop.known_effects, *loop.found, *loop.evolved)}
    pool = [c for c in exploration.candidates if c.name not in known]
    return exploration, judge(residual, pool, np.concatenate([exploration.null_nats, *earlier]), loop.search)
