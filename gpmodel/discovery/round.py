"""One round of the loop: evolve programs for the residual, choose all that is missing together, judge it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.calibration.gauge import moving_sites
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.choose import Problem, choose, simplified
from gpmodel.discovery.explore import Exploration, RoundContext, explore
from gpmodel.discovery.judge import judge
from gpmodel.discovery.result import Finding, Round
from gpmodel.discovery.state import State
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.input_histogram import input_prices
from gpmodel.families.candidate import Candidate
from gpmodel.progress import Teller
from gpmodel.table.split import JUDGED


def one_round(state: State, standard_fit: Calibration, calibration: Calibration) -> Calibration:
    """Evolve programs for the residual of a calibration, choose everything again with them, and judge the choice.

    Returns the calibration with the findings, which are left in the state.
    """
    number = len(state.rounds) + 1
    poses = state.poses.subset(state.sample)
    residual = residual_of(calibration, poses, state.criteria, JUDGED)
    state.say(f"round {number}: residual {1e3 * residual.rms:.3f} mm")
    exploration = _explored(state, residual, number)
    new = _promising(state, residual, exploration)
    if state.rounds and not new:
        state.rounds.append(Round(number, (), exploration, (), state.rounds[-1].null_nats))
        return calibration
    state.say(f"round {number}: selecting effects")
    problem = Problem(
        standard_fit, lambda found, start: state.fit_sample(state.model(found), start) if found else standard_fit,
        poses, state.offers, state.search, state.criteria, _input_prices(state, exploration), lambda: state.late,
    )  # fmt: skip
    fresh = frozenset(c.name for c in new)
    fitted, proposals = choose(problem, (*state.evolved, *new), fresh)
    if not state.errors_alone:
        fitted = simplified(fitted, proposals.laws.values())
    null = np.concatenate([exploration.null_nats, *_earlier_nulls(state)])
    found = judge(problem, fitted, null)
    dropped = _taken(state, [h for h in found.hypotheses if h.accepted], number)
    laws = tuple(fitted.candidates[name] for name in proposals.laws if name in fitted.candidates)
    state.rounds.append(Round(number, found.hypotheses, exploration, (*new, *laws), found.null_nats, dropped))
    return found.calibration


def _taken(state: State, accepted: Sequence[Hypothesis], number: int) -> tuple[str, ...]:
    """Make the accepted hypotheses the findings; return the names of those before that are none any more."""
    before = {f.candidate.name: f for f in state.findings}
    state.findings = [
        replace(before[h.candidate.name], hypothesis=h) if h.candidate.name in before else Finding(h, number)
        for h in accepted
    ]
    for finding in state.findings:
        if finding.round == number:
            state.say(f"round {number}: added {finding.candidate.name}")
    return tuple(name for name in before if name not in {h.candidate.name for h in accepted})


def _input_prices(state: State, exploration: Exploration) -> dict[str, float]:
    """Nats by input, from what evolved programs of all rounds refer to."""
    return input_prices([*(r.exploration.histogram for r in state.rounds), exploration.histogram])


def _earlier_nulls(state: State) -> list[np.ndarray]:
    """Largest gains on permuted residuals in earlier rounds of one budget: those of an opening round stand alone."""
    return [r.exploration.null_nats for r in state.rounds[bool(state.offers) :]]


def _explored(state: State, residual: Residual, number: int) -> Exploration:
    """Programs that evolution makes of a residual, and its histogram of referenced inputs."""
    pooled = sum(len(nats) for nats in _earlier_nulls(state)) > 0
    tell = Teller(state.say.say, f"round {number}: ")
    context = RoundContext(number, tell, state.journal, lambda: state.late, state.opening(number), pooled)
    sites = moving_sites(state.mechanism, residual.poses.dataset)
    return explore(residual, sites, state.search, np.random.default_rng([state.seed, number]), context)


def _promising(state: State, residual: Residual, exploration: Exploration) -> tuple[Candidate, ...]:
    """New programs with a gain in description length, the best first, at most as many as the search offers."""
    known = {c.name for c in (*state.known_effects, *state.found, *state.evolved)}
    pool = [c for c in exploration.candidates if c.name not in known]
    ranked = sorted(zip(pool, scores(residual, pool), strict=True), key=lambda one: -one[1].nats)
    return tuple(c for c, score in ranked if score.nats > 0.0)[: state.search.considered]
