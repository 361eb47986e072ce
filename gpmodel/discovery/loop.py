"""Run the loop: calibrate, evolve programs for the residual, select and test effects, repeat."""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step, steps_of
from gpmodel.calibration.gauge import moving_sites
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.choose import Problem, choose, simplified
from gpmodel.discovery.explore import Exploration, OutOfTime, RoundContext, explore
from gpmodel.discovery.final_fit import final_fit
from gpmodel.discovery.judge import judge
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery, FinalFit, Finding, Round, State, usable_rows
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import Confirmation, confirmation
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.input_histogram import input_prices
from gpmodel.evolution.runs import KeptRuns
from gpmodel.executor import called_beside
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Offer, catalogue, distinct
from gpmodel.families.catalogue import candidates as instances_of
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.least_squares import give_back
from gpmodel.progress import Reporter, Say, silent
from gpmodel.table.blocks import FOLD_SEED


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
    noise: float | None = None,
    condition_limit: float | None = None,
    seed: int = 0,
    errors_alone: bool = False,
    progress: Say = silent,
    kept: KeptRuns | None = None,
) -> Discovery:
    """Run the whole search for missing effects. Held-out poses only measure errors and select no effect.

    At the end the held-out poses decide whether the model with the findings or the standard model is saved.

    train, heldout: row numbers of `poses`; heldout may be empty. candidates: effects that may be missing.
    standard: effects of the standard model; None for the complete geometry.
    known: effects in the initial model. noise: σ that weights finite priors, m; None for the σ of the residual.
    condition_limit: largest condition number of the standard model; None for a cross-validated limit.
    errors_alone: compute only the errors of each model, without a fit to all poses and without simplified formulas.
    progress: called with one line on the current task. kept: finished runs of an interrupted search. Raises InputError
    for different candidates of one name, or if no held-out pose has a known set-up and tool.
    """
    started = time.monotonic()
    search, say = search or Search(), Reporter(progress)
    poses, train, heldout = usable_rows(poses, train, heldout, say)
    offers = distinct(candidates)
    if not errors_alone:
        instances_of(mechanism, poses.states, offers)  # bad offers are refused before anything is searched
    base_model = ErrorModel(mechanism, geometric_effects(mechanism) if standard is None else standard, noise=noise)
    ends = math.inf if search.stop_after is None else started + search.stop_after
    state = State(
        mechanism, poses, train, heldout, base_model, known, offers, search, criteria or Criteria(), condition_limit,
        seed, say, kept or KeptRuns(), ends, errors_alone,
    )  # fmt: skip
    state.say("standard model")
    base = state.fit(ErrorModel(mechanism, ()))
    standard_fit = state.fit(state.model(()))
    top, stopped = _searched(state, standard_fit)
    state.say("the ladder of held-out errors, and the final fit on all poses")
    give_back()

    def ended() -> tuple[Calibration, _Last]:
        calibration = top()
        return calibration, (_unfinished if errors_alone else _finished)(state, standard_fit, calibration)

    (calibration, (last, final, doubt)), rungs = called_beside(search.here, ended, _rungs(state, standard_fit))
    steps = _ladder(state, base, standard_fit, [*rungs, calibration])
    give_back()
    return Discovery(
        mechanism, poses, train, heldout, tuple(steps), tuple(state.findings), tuple(state.rounds), last, final,
        doubt, state.standard.effects, time.monotonic() - started, stopped,
    )  # fmt: skip


def _searched(state: State, standard_fit: Calibration) -> tuple[Callable[[], Calibration], str]:
    """Search on sampled rows; return a function that fits findings to all training rows, and why the search ended."""
    sampled = len(state.sample) < len(state.train)
    start = state.fit_sample(state.model(()), standard_fit) if sampled else standard_fit
    calibration, stopped = _run_rounds(state, start)
    if sampled and state.findings:
        return partial(state.fit, state.model(state.found), standard_fit), stopped
    return (lambda: standard_fit if sampled else calibration), stopped


def _run_rounds(state: State, standard_fit: Calibration) -> tuple[Calibration, str]:
    """Run search rounds until a round changes nothing or a limit is reached; return the fit and why the rounds ended.

    If the time limit is reached in the first round, the first round is repeated without evolution.
    """
    search, calibration = state.search, standard_fit
    while not state.repeating:
        if len(state.findings) >= search.max_effects:
            return calibration, f"stopped at {search.max_effects} effects"
        try:
            if state.rounds and state.late:
                raise OutOfTime
            calibration = one_round(state, standard_fit, calibration)
        except OutOfTime:
            if not state.rounds:
                state.search = replace(search, runs=0)
                calibration = one_round(state, standard_fit, calibration)
            return calibration, f"stopped after {search.stop_after:g} s; there may be more to find"
    return calibration, "no further effect is significant"


_Last = tuple[FinalFit, Calibration, Confirmation | None]


def _unfinished(state: State, standard_fit: Calibration, calibration: Calibration) -> _Last:
    """Return the findings with their values in the fit to the training poses, without a fit to all poses."""
    return FinalFit(calibration, state.found, ((),) * len(state.found)), calibration, None


def _finished(state: State, standard_fit: Calibration, calibration: Calibration) -> _Last:
    """Fit the findings to all poses; return the fit, the model to save, and the test on held-out poses."""
    if not state.findings:
        final = state.standard_to_all()
        return FinalFit(final, (), ()), final, None
    last, doubt = final_fit(state, calibration), None
    if len(state.heldout):
        doubt = confirmation(standard_fit, calibration, state.poses.subset(state.heldout), state.criteria)
    final = last.calibration if doubt is None or doubt.passed else state.standard_to_all()
    return last, final, doubt


def _rungs(state: State, standard_fit: Calibration) -> list[Callable[[], Calibration]]:
    """Return functions that fit the first finding, the first two and so on, up to all findings but the last."""
    models = (state.model(state.found[:count]) for count in range(1, len(state.findings)))
    return [partial(state.fit, model, standard_fit) for model in models]


def _ladder(state: State, base: Calibration, standard_fit: Calibration, rungs: Sequence[Calibration]) -> list[Step]:
    """Return the errors of growing models: registration, the standard model, and the findings one after the other."""
    fits = [("registration", base), ("standard", standard_fit)]
    fits += [(f"effect {i + 1}", fit) for i, fit in enumerate(rungs[: len(state.findings)])]
    first, second, *others = steps_of(fits, *(state.poses.subset(rows) for rows in (state.train, state.heldout)))
    return [first, second, *(replace(step, finding=i) for i, step in enumerate(others))]


def one_round(state: State, standard_fit: Calibration, calibration: Calibration) -> Calibration:
    """Evolve programs for the residual of a calibration, select all effects again with them, and test the selection.

    The calibration with the findings is returned, and the findings are stored in `state`.
    """
    number = len(state.rounds) + 1
    poses = state.poses.subset(state.sample)
    residual = residual_of(calibration, poses, state.criteria, FOLD_SEED)
    state.say(f"round {number}: residual {1e3 * residual.rms:.3f} mm")
    exploration = _explored(state, residual, number)
    new = _promising(state, residual, exploration)
    if state.rounds and not new:
        state.rounds.append(Round(number, (), exploration, ()))
        return calibration
    state.say(f"round {number}: selecting effects")
    read = input_prices([*(r.exploration.histogram for r in state.rounds), exploration.histogram])
    problem = Problem(
        standard_fit, lambda found, start: state.fit_sample(state.model(found), start) if found else standard_fit,
        poses, state.offers, state.search, state.criteria, read, lambda: state.late,
    )  # fmt: skip
    fresh = frozenset(c.name for c in new)
    fitted, proposals = choose(problem, (*state.evolved, *new), fresh)
    if not state.errors_alone:
        fitted = simplified(problem, fitted, proposals.laws.values())
    null = np.concatenate([exploration.null_nats, *_earlier_nulls(state)])
    found = judge(problem, fitted, null, state.errors_alone)
    dropped = _taken(state, [h for h in found.hypotheses if h.accepted], number)
    laws = tuple(fitted.candidates[name] for name in proposals.laws if name in fitted.candidates)
    every = tuple(law.candidate for law in proposals.laws.values())
    state.rounds.append(Round(number, found.hypotheses, exploration, (*new, *laws), dropped, every))
    return found.calibration


def _taken(state: State, accepted: Sequence[Hypothesis], number: int) -> tuple[str, ...]:
    """Store the accepted candidates as findings; return the names of findings that are no longer accepted."""
    before = {f.candidate.name: f for f in state.findings}
    state.findings = [
        replace(before[h.candidate.name], hypothesis=h) if h.candidate.name in before else Finding(h, number)
        for h in accepted
    ]
    for finding in state.findings:
        if finding.round == number:
            state.say(f"round {number}: added {finding.candidate.name}")
    return tuple(name for name in before if name not in {h.candidate.name for h in accepted})


def _earlier_nulls(state: State) -> list[np.ndarray]:
    """Return the largest gains, nats, on permuted residuals of earlier rounds with the full budget of evolution."""
    return [r.exploration.null_nats for r in state.rounds[bool(state.offers) :]]


def _explored(state: State, residual: Residual, number: int) -> Exploration:
    """Evolve programs for a residual by genetic programming; return the programs and the histogram of their inputs."""
    pooled = sum(len(nats) for nats in _earlier_nulls(state)) > 0
    tell = Reporter(state.say.send, f"round {number}: ")
    context = RoundContext(number, tell, state.kept, lambda: state.late, state.opening(number), pooled)
    sites = moving_sites(state.mechanism, residual.poses.dataset)
    return explore(residual, sites, state.search, np.random.default_rng([state.seed, number]), context)


def _promising(state: State, residual: Residual, exploration: Exploration) -> tuple[Candidate, ...]:
    """Return new programs with a gain in description length, the best first, at most `Search.considered` programs."""
    known = {c.name for c in (*state.known_effects, *state.found, *state.evolved)}
    pool = [c for c in exploration.candidates if c.name not in known]
    ranked = sorted(zip(pool, scores(residual, pool), strict=True), key=lambda one: -one[1].nats)
    return tuple(c for c, score in ranked if score.nats > 0.0)[: state.search.considered]
