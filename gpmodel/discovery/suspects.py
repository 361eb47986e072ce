"""What is odd and is no finding: an effect that too few poses show, or that failed a test.

Poses that stand far out are left out of the fits, so that no law bends to them; then an effect that only they show is
invisible. Here they are asked back, against the model that is shipped: does one effect of the catalogue explain them,
better than any explains them at poses drawn at random? Nothing is added by it: further poses decide.
"""

from collections.abc import Iterator
from functools import partial
from itertools import chain
from math import comb

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauge import stands_still, still_joints
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.readable import readable_inputs
from gpmodel.discovery.result import Suspect
from gpmodel.discovery.rows import evenly
from gpmodel.discovery.state import State
from gpmodel.evidence.residual import Residual, residual_of, squares
from gpmodel.evidence.score import best_nats, contribution, scores
from gpmodel.evolution.chance import chance
from gpmodel.executor import called
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.model.states import States
from gpmodel.numerics.outliers import outlier_limit
from gpmodel.table.split import JUDGED

FEWEST = 2
"""Poses that can have something in common."""
EXPLAINED = 0.5
"""Largest share of the error of odd poses that may be left where an effect is said to explain them."""
MOST = 5
"""Suspects at most: a list to act on."""
NOTICED = 0.01
"""Least relative fall of the cross-validated error by a rejected candidate: the last digit that is shown of it."""
AT_ONCE = 8
"""Parts of the catalogue that are scored side by side."""
MOST_ALTERNATIVES = 4
"""Other effects that explain the same about as well, that are listed."""


def suspects_of(state: State, final: Calibration) -> tuple[Suspect, ...]:
    """The suspects beside the model that is shipped, those of odd poses first."""
    found = [*_of_odd_poses(state, final), *_rejected(state)]
    first = {suspect.candidate.name: suspect for suspect in reversed(found)}
    return tuple(s for s in found if first[s.candidate.name] is s)[:MOST]


def _rejected(state: State) -> Iterator[Suspect]:
    """List candidates beyond chance that lower the cross-validated error and fail another test, strongest first."""
    last = {h.candidate.name: h for r in state.rounds for h in r.hypotheses}
    for candidate in state.found:
        last.pop(candidate.name, None)
    nothing = np.zeros(0, dtype=np.int64)
    for h in sorted(last.values(), key=lambda h: -h.score.nats):
        lower = h.cv_rms < (1.0 - NOTICED) * h.cv_before
        if lower and not h.accepted and h.verdict.passed("chance") and h.verdict.passed("nats"):
            yield Suspect(h.candidate, h.score.nats, h.chance, nothing, h.cv_before, h.cv_rms, h.why)


def _of_odd_poses(state: State, final: Calibration) -> Iterator[Suspect]:
    """The effect that explains the poses that stand far out, where one does beyond chance."""
    poses, criteria, odd = state.poses, state.criteria, np.flatnonzero(final.error > outlier_limit(final.error))
    pool = _pool(state) if len(odd) >= FEWEST else []
    if not pool:
        return
    some = np.union1d(evenly(poses, np.arange(len(poses)), state.search.scored_poses), odd)
    residual = residual_of(final, poses.subset(some), criteria, JUDGED, np.ones(len(some), dtype=bool))
    parts = np.array_split(np.arange(len(pool)), AT_ONCE)
    scored = called(state.search.here, [partial(scores, residual, [pool[k] for k in part]) for part in parts])
    known = list(chain.from_iterable(scored))
    best = max(range(len(pool)), key=lambda k: known[k].nats)
    left = residual.values - contribution(residual, pool[best])
    before, after = (_rms_at(residual, np.searchsorted(some, odd), values) for values in (residual.values, left))
    if after > EXPLAINED * before:
        return
    trials = residual.shuffled(np.random.default_rng(JUDGED), criteria.shuffles)
    by_chance = chance(known[best].nats, best_nats(residual, pool, trials))
    if by_chance.p >= criteria.significance:
        return
    near = [k for k in range(len(pool)) if k != best and known[k].nats > known[best].nats - criteria.rival_nats]
    near.sort(key=lambda k: -known[k].nats)
    why = f"{len(odd)} of {len(poses)} poses stand far out: so few may as well be wrong readings, left out of the fits"
    shared = in_common(poses.states, odd, criteria.significance)
    others = tuple(pool[k].name for k in near[:MOST_ALTERNATIVES])
    yield Suspect(pool[best], known[best].nats, by_chance, odd, before, after, why, shared, others)


def _pool(state: State) -> list[Candidate]:
    """What can be named, but at joints that stand still."""
    still = still_joints(state.mechanism, state.poses.dataset)
    offered = candidates(state.mechanism, state.poses.states, state.offers)
    return [c for c in offered if not all(stands_still(e.slots, still) for e in c.effects)]


def _rms_at(residual: Residual, rows: IntArray, values: Array) -> float:
    """3-D RMS, m, of the weighted rows of some poses."""
    squared = squares(residual.problem, values[: residual.measured], len(residual.poses))
    return float(np.sqrt(np.mean(squared[rows])))


def in_common(states: States, rows: IntArray, significance: float) -> str:
    """What the poses `rows` (K,) share that few others do: a side or a range of an input, or the sign of a load; empty
    where chance gives as much.

    Chance that K of N poses lie within a range that holds M: C(M, K) / C(N, K) at either end of an input, times
    N - M + 1 anywhere in it; times the number of inputs, twice.
    """
    names = readable_inputs(states, np.arange(len(states)))[0].names
    count, draws = len(states), comb(len(states), len(rows))
    best, said = significance / max(2 * len(names), 1), ""
    for name in names:
        column, unit = states[name], states.unit(name)
        low, high = float(column[rows].min()), float(column[rows].max())
        for places, inside, text in (
            (2, column >= low, _side(name, column, low, unit, "above", 1.0)),
            (2, column <= high, _side(name, column, high, unit, "below", -1.0)),
            (count, (column >= low) & (column <= high), f"{name} from {_said(low, unit)} to {_said(high, unit)}"),
        ):
            within = int(np.sum(inside))
            p = min(places, count - within + 1) * comb(within, len(rows)) / draws
            if p < best:
                best, said = p, text
    return said


def _side(name: str, column: Array, edge: float, unit: str, word: str, sign: float) -> str:
    """All poses beyond an edge; where no other has that sign, the sign."""
    if sign * edge > 0 and not np.any((sign * column > 0) & (sign * column < sign * edge)):
        return f"{name} {'positive' if sign > 0 else 'negative'}"
    return f"{name} {word} {_said(edge, unit)}"


def _said(value: float, unit: str) -> str:
    factor, unit = {"rad": (180.0 / np.pi, "deg"), "m": (1e3, "mm")}.get(unit, (1.0, unit))
    return f"{factor * value:.4g}{'' if unit == '1' else f' {unit}'}"
