"""The loop: calibrate, look at the residual, find what is missing, add it, look again."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.comparison import known_rows
from gpmodel.calibration.gauge import stands_still, still_joints
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on, without_outlier_marks
from gpmodel.discovery.acceptance import Hypothesis, judge
from gpmodel.discovery.confirmation import confirmation
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.explore import Exploration, Turn, explore
from gpmodel.discovery.null import shuffled
from gpmodel.discovery.pool import pool_of
from gpmodel.discovery.replacement import better
from gpmodel.discovery.residual import Residual, residual_of
from gpmodel.discovery.result import Discovery, Finding, Round, Step
from gpmodel.discovery.score import best_nats, scores
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
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

Resumed = tuple[Sequence[Finding], Sequence[Round]]


@dataclass
class _Loop:
    """The loop's running state: what is accepted so far and the ladder it has climbed."""

    mechanism: Mechanism
    poses: Poses
    train: IntArray
    heldout: IntArray
    standard: tuple[Effect, ...]
    known_effects: tuple[Candidate, ...]
    offers: tuple[Offer, ...]
    search: Search
    criteria: Criteria
    condition_limit: float | None
    seed: int
    say: Teller
    findings: list[Finding] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)

    @property
    def known(self) -> set[str]:
        """Names of what is in the model already beside the standard model."""
        return {f.candidate.name for f in self.findings} | {c.name for c in self.known_effects}

    def model(self, findings: Sequence[Finding]) -> ErrorModel:
        found = [e for f in findings for e in f.candidate.effects]
        known = [e for c in self.known_effects for e in c.effects]
        return ErrorModel(self.mechanism, (*self.standard, *known, *found))

    def fit(self, model: ErrorModel, start: Calibration | None = None, robust: bool = True) -> Calibration:
        train = self.poses.subset(self.train)
        again = without_outlier_marks(start) if start else None
        return calibrate(model, train, condition_limit=self.condition_limit, start=again, robust=robust, seed=self.seed)

    def refitted(self, fit: Calibration) -> Calibration:
        """The same model fitted to all poses, with the condition limit that the training poses chose."""
        return calibrate(fit.model, self.poses, condition_limit=fit.condition_limit, start=fit, seed=self.seed)

    def climb(self, name: str, calibration: Calibration, finding: int | None = None) -> None:
        heldout = errors_on(calibration, self.poses.subset(self.heldout))
        self.steps.append(Step(name, calibration, calibration.error, heldout, finding))


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
    keep: Callable[[Sequence[Finding], Sequence[Round]], None] = lambda findings, rounds: None,
    resume: Resumed = ((), ()),
) -> Discovery:
    """Run the whole loop. Held-out poses are only ever measured against, never looked at for a choice.

    After it they decide one thing: whether what was found is shipped, or the standard model.

    train, heldout: rows of `poses`. candidates: what may be missing, beside what GP evolves. standard: the effects of
    the standard model, None for the complete geometric set. known: effects enabled from the start beside it.
    condition_limit: of the standard model, None for cross-validated. progress: called with one line on what is being
    tried. keep: called after every round with all that is finished. resume: findings and rounds of an interrupted
    run that was asked the same; it goes on to the same numbers. Raises InputError where no held-out pose is of a
    set-up and tool trained on.
    """
    started = time.monotonic()
    search = search or Search()
    given, say = len(poses), Teller(progress)
    poses, train, heldout = _of_known_places(poses, train, heldout)
    if len(poses) < given:
        say(f"{given - len(poses)} held-out poses are of a set-up or tool that no training pose is of: left out")
    loop = _Loop(
        mechanism, poses, train, heldout, geometric_effects(mechanism) if standard is None else standard, known,
        distinct(candidates), search, criteria or Criteria(), condition_limit, seed, say,
    )  # fmt: skip
    loop.say("standard model")
    base = loop.fit(ErrorModel(mechanism, ()))
    standard_fit = loop.fit(loop.model(()))
    loop.findings.extend(resume[0])
    loop.rounds.extend(resume[1])
    calibration = loop.fit(loop.model(loop.findings), standard_fit) if loop.findings else standard_fit
    stopped = "nothing else stands out of chance"
    while not (loop.rounds and not any(h.accepted for h in loop.rounds[-1].hypotheses)):
        if len(loop.findings) >= search.max_effects:
            stopped = f"stopped at {search.max_effects} effects"
            break
        if loop.rounds and search.stop_after is not None and time.monotonic() - started > search.stop_after:
            stopped = f"stopped after {search.stop_after:g} s; there may be more to find"
            break
        calibration = _round(loop, calibration, standard_fit)
        keep(loop.findings, loop.rounds)
    loop.say("the ladder of held-out errors, and the final fit on all poses")
    _ladder(loop, base, standard_fit, calibration)
    found = loop.refitted(calibration)
    doubt = None
    if loop.findings:
        doubt = confirmation(standard_fit, calibration, poses.subset(heldout), loop.criteria)
    final = found if doubt is None or doubt.confirmed else loop.refitted(standard_fit)
    return Discovery(
        mechanism, poses, train, heldout, tuple(loop.steps), tuple(loop.findings), tuple(loop.rounds), found, final,
        doubt, loop.standard, time.monotonic() - started, stopped,
    )  # fmt: skip


def _of_known_places(poses: Poses, train: IntArray, heldout: IntArray) -> tuple[Poses, IntArray, IntArray]:
    """The poses without the held-out ones of set-ups and tools that no training pose is of, and the rows again."""
    data = poses.dataset
    known = heldout[known_rows(data.subset(train), data.subset(heldout))]
    if len(heldout) and not len(known):
        raise InputError(
            f"{data.source}: every held-out pose is of a set-up or tool that no training pose is of; expected groups "
            "of poses that lie within set-ups and tools, or another seed or share to hold out"
        )
    if len(known) == len(heldout):
        return poses, train, heldout
    kept = np.sort(np.concatenate([train, known]))
    return poses.subset(kept), np.searchsorted(kept, train), np.searchsorted(kept, known)


def _ladder(loop: _Loop, base: Calibration, standard_fit: Calibration, calibration: Calibration) -> None:
    """Registration, the standard model, and the findings one after the other, each with its errors."""
    loop.climb("registration", base)
    loop.climb("standard", standard_fit)
    for i in range(len(loop.findings)):
        last = i + 1 == len(loop.findings)
        rung = calibration if last else loop.fit(loop.model(loop.findings[: i + 1]), standard_fit)
        loop.climb(f"effect {i + 1}", rung, i)


def _round(loop: _Loop, calibration: Calibration, standard_fit: Calibration) -> Calibration:
    """One round; the fit after it depends on the findings alone, so that a resumed run repeats it."""
    number = len(loop.rounds) + 1
    rng = np.random.default_rng([loop.seed, number])
    train = loop.poses.subset(loop.train)
    rows = np.arange(len(train))
    if len(train) > loop.search.scored_poses:
        rows = np.sort(rng.permutation(len(train))[: loop.search.scored_poses])
    residual = residual_of(calibration, train.subset(rows), loop.criteria, loop.seed)
    loop.say(f"round {number}: residual {1e3 * residual.rms:.3f} mm, scoring the catalogue")
    known = loop.known
    still = still_joints(loop.mechanism, residual.poses.dataset)
    offered = instances_of(loop.mechanism, residual.poses.states, loop.offers)
    instances = tuple(c for c in offered if not all(stands_still(e.slots, still) for e in c.effects))
    named = tuple(c for c in instances if c.name not in known)
    hypotheses, exploration, nulls = _look(loop, residual, named, rng, number)
    if residual.winsorised.any():
        loop.say(f"round {number}: {residual.winsorised.sum()} poses stand far out; would a law explain them?")
        everything = np.ones(len(rows), dtype=bool)
        full = residual_of(calibration, residual.poses, loop.criteria, loop.seed, trusted=everything)
        looks = (hypotheses, _look(loop, full, named, rng, number)[0])
        explained = max(
            (_explained(loop, look, rows, standard_fit) & residual.winsorised for look in looks), key=np.sum
        )
        if explained.any():
            loop.say(f"round {number}: again, with the {explained.sum()} in full that it explains")
            cleared = residual_of(calibration, residual.poses, loop.criteria, loop.seed, trusted=explained)
            hypotheses, exploration, nulls = _look(loop, cleared, named, rng, number)
    best = next((h for h in hypotheses if h.accepted), None)
    dropped: tuple[str, ...] = ()
    added: tuple[Hypothesis, ...] = ()
    if best is not None:
        loop.say(f"round {number}: added {best.candidate.name}")
        loop.findings.append(Finding(best, number))
        calibration = loop.fit(loop.model(loop.findings), standard_fit)
        dropped, added, calibration = _revised(loop, calibration, standard_fit, named, nulls)
    loop.rounds.append(Round(number, (*hypotheses, *added), exploration, dropped))
    return calibration


def _look(
    loop: _Loop, residual: Residual, named: tuple[Candidate, ...], rng: np.random.Generator, number: int
) -> tuple[tuple[Hypothesis, ...], Exploration, dict[str, Array]]:
    """The catalogue and what GP evolves, judged; with what chance reaches."""
    known = loop.known
    null = best_nats(residual, named, shuffled(residual, rng, loop.criteria.shuffles))
    turn = Turn(number, Teller(loop.say.say, f"round {number}: "))
    still = still_joints(loop.mechanism, residual.poses.dataset)
    sites = tuple(s for s in sites_of(loop.mechanism) if not stands_still((t[0] for t in s.terms), still))
    exploration = explore(residual, sites, loop.search, rng, turn)
    pool = (*named, *(c for c in exploration.candidates if c.name not in known))
    earlier = [r.exploration.null_nats for r in loop.rounds]
    nulls = {"catalogue": null, "evolved": np.concatenate([exploration.null_nats, *earlier])}
    judged = judge(residual, pool_of(residual, pool, nulls), loop.search)
    return judged, exploration, nulls


def _explained(loop: _Loop, hypotheses: tuple[Hypothesis, ...], rows: IntArray, standard_fit: Calibration) -> Mask:
    """The poses (N,) that are no outliers of a fit with the best hypothesis; none where there is no hypothesis.

    Poses far out are drawn in for the search, which would bend a law that is strong at a few of them.
    """
    best = next((h for h in hypotheses if h.accepted), None)
    if best is None:
        return np.zeros(len(rows), dtype=bool)
    trial = loop.fit(loop.model([*loop.findings, Finding(best, 0)]), standard_fit)
    return ~np.isin(rows, trial.outliers)


def _revised(
    loop: _Loop, calibration: Calibration, standard_fit: Calibration, pool: Sequence[Candidate], nulls: dict[str, Array]
) -> tuple[tuple[str, ...], tuple[Hypothesis, ...], Calibration]:
    """Look at every finding again beside the newest: taken out where the others explain it (description length is less
    without it), replaced where named effects say it better. What was dropped, what came in, the fit after it."""
    dropped: list[str] = []
    added: list[Hypothesis] = []
    newest = loop.findings[-1]
    train = loop.poses.subset(loop.train[:: max(1, len(loop.train) // loop.search.scored_poses)])
    for finding in list(loop.findings):
        old = finding.candidate
        without = residual_of(calibration, train, loop.criteria, loop.seed, old.effects)
        superfluous = finding is not newest and scores(without, [old])[0].nats < 0
        taken = {f.candidate.name for f in loop.findings}
        left = [c for c in pool if c.name not in taken]
        instead = () if superfluous else better(without, old, left, nulls, loop.search)
        if superfluous or instead:
            loop.findings.remove(finding)
            loop.findings += [Finding(h, newest.round) for h in instead]
            calibration = loop.fit(loop.model(loop.findings), standard_fit)
            dropped.append(old.name)
            added += instead
            explained_by = " and ".join(h.candidate.name for h in instead) or "the others"
            loop.say(f"dropped {old.name}, explained by {explained_by}")
    return tuple(dropped), tuple(added), calibration
