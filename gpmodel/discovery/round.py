"""One round of the loop: look at the residual, evolve what may explain it, choose all that is missing together."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.calibration.gauge import moving_sites
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, as_searched
from gpmodel.discovery.additive import additive
from gpmodel.discovery.choice import Choice
from gpmodel.discovery.explore import Exploration, RoundContext, explore
from gpmodel.discovery.judge import judge
from gpmodel.discovery.result import Finding, Round
from gpmodel.discovery.state import State
from gpmodel.evidence.residual import residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import Poses
from gpmodel.progress import Teller
from gpmodel.table.split import JUDGED


def one_round(state: State, standard_fit: Calibration, calibration: Calibration) -> Calibration:
    """One round: what GP makes of the residual, then all groups chosen again with what it found among them.

    Returns the calibration with the findings, which are left in the state.
    """
    number = len(state.rounds) + 1
    rng = np.random.default_rng([state.seed, number])
    poses = state.poses.subset(state.sample)
    exploration, judged = _explored(state, calibration, poses, rng)
    passed = _one_a_place(h.candidate for h in judged if h.accepted)
    new = tuple(c for c in passed if c.name not in {e.name for e in state.evolved})
    pointed = _pointed(state, exploration)
    if state.rounds and not new and pointed == state.pointed:
        state.rounds.append(Round(number, judged, exploration, (), state.rounds[-1].null_nats))
        return calibration
    state.say(f"round {number}: choosing groups of effects together")
    choice = Choice(
        standard_fit, lambda found, start: state.fit_sample(state.model(found), start) if found else standard_fit,
        poses, state.offers, state.search, state.criteria, pointed, lambda: state.late, frozenset(c.name for c in new),
        simplified=not state.errors_alone,
    )  # fmt: skip
    found = additive(choice, (*state.evolved, *new))
    searched = [*judged, *(h for r in state.rounds for h in r.hypotheses)]
    accepted = [as_searched(h, searched) for h in found.hypotheses if h.accepted]
    dropped = _taken(state, accepted, number)
    state.rounds.append(
        Round(number, (*found.hypotheses, *judged), exploration, (*new, *found.laws), found.null_nats, dropped)
    )
    return found.calibration


def _taken(state: State, accepted: Sequence[Hypothesis], number: int) -> tuple[str, ...]:
    """Make the accepted hypotheses the findings; the names of those before that are none any more."""
    before = {f.candidate.name: f for f in state.findings}
    state.findings = [
        replace(before[h.candidate.name], hypothesis=h) if h.candidate.name in before else Finding(h, number)
        for h in accepted
    ]
    for finding in state.findings:
        if finding.round == number:
            state.say(f"round {number}: added {finding.candidate.name}")
    return tuple(name for name in before if name not in {h.candidate.name for h in accepted})


def _one_a_place(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """The first candidate at each place; others there are equivalent, or are found in the next round."""
    out: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        out.setdefault((candidate.place.slot, candidate.place.axis), candidate)
    return tuple(out.values())


def _pointed(state: State, exploration: Exploration) -> frozenset[str] | None:
    """Inputs that the histograms point at, this round's included; None where nothing was evolved that could point."""
    if not state.search.runs:
        return state.pointed
    return (state.pointed or frozenset()) | set(exploration.histogram.significant)


def _explored(
    state: State, calibration: Calibration, poses: Poses, rng: np.random.Generator
) -> tuple[Exploration, tuple[Hypothesis, ...]]:
    """What GP evolves on the residual of a calibration, and the verdicts on the best of it.

    Maxima on shuffled residuals are pooled over rounds of one budget: those of an opening round stand alone.
    """
    number = len(state.rounds) + 1
    residual = residual_of(calibration, poses, state.criteria, JUDGED)
    state.say(f"round {number}: residual {1e3 * residual.rms:.3f} mm")
    opening = state.opening(number)
    earlier = [r.exploration.null_nats for r in state.rounds[bool(state.offers) :]]
    pooled = sum(len(nats) for nats in earlier) > 0
    tell = Teller(state.say.say, f"round {number}: ")
    context = RoundContext(number, tell, state.journal, lambda: state.late, opening, pooled)
    sites = moving_sites(state.mechanism, residual.poses.dataset)
    exploration = explore(residual, sites, state.search, rng, context)
    known = {c.name for c in (*state.known_effects, *state.found, *state.evolved)}
    pool = [c for c in exploration.candidates if c.name not in known]
    return exploration, judge(residual, pool, np.concatenate([exploration.null_nats, *earlier]), state.search)
