"""Constants inside the bases of what was chosen, moved from the values that were offered to the most likely ones.

Variable projection: at given constants the unknowns are solved and everything else in the model is projected out, so
that what is left of the residual is a function of the constants alone. Source: Golub and Pereyra (1973).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.evolution.description_length import fit_nats
from gpmodel.families.candidate import Candidate
from gpmodel.families.curves import continued
from gpmodel.families.inner import DIGITS, NonlinearParameters
from gpmodel.model.effect import Effect
from gpmodel.numerics import rank as ident

LOOKS = 2
"""Fits between which constants are moved: what the others have taken up is settled after the first."""

EVALUATIONS = 80
"""Evaluations of the residual for each constant of a candidate; the simplex settles in half of them."""

SETTLED = 1e-4
"""Difference of the cost between the corners of a simplex where it ends, in variances of the noise."""

ROUNDING = 0.005
"""Nats that a constant written with fewer digits may cost: a tenth of its deviation."""

ROW_LOSS = -np.log1p(-np.sqrt(0.95))
"""Nats by which a row of an event may be less likely than the best one and still be it, at 95 %: half of the quantile
-2 ln(1 - √0.95) of the likelihood ratio of a threshold. Source: Hansen (2000), Econometrica 68(3), theorem 2."""

WINDOW = 12
"""Rows looked at on either side of an event at first, beyond those up to the next that was offered."""


@dataclass(frozen=True)
class Profile:
    """Nats (T,) of an event after each of some rows (T,), the others of its constants as they are."""

    rows: Array
    nats: Array

    @property
    def best(self) -> int:
        """The most likely row."""
        return int(self.rows[np.argmax(self.nats)])

    @property
    def interval(self) -> tuple[int, int]:
        """The rows from the first to the last that may be it, at 95 %."""
        there = self.rows[self.nats >= self.nats.max() - ROW_LOSS]
        return int(there.min()), int(there.max())


def detailed(left: Residual, found: Mapping[str, Candidate]) -> dict[str, Candidate]:
    """The findings, fine curves with twice their harmonics where the new ones lower the description length.

    A drive has lines up to twice its reduction ratio; half as many harmonics detect its curve in an eighth of the time.
    left: the residual of a model with all findings.
    """
    out = dict(found)
    for name, candidate in found.items():
        more = continued(candidate)
        if 2 * len(more) <= len(left.poses) and more:
            new = Candidate(name, more, candidate.family, 0.0)
            if scores(left, [new])[0].nats > left.criteria.minimum_nats:
                out[name] = replace(candidate, effects=(*candidate.effects, *more))
    return out


def refined_fit(
    fit: Callable[[Sequence[Candidate], Calibration], Calibration],
    residual: Callable[[Calibration], Residual],
    candidates: Mapping[str, Candidate],
    calibration: Calibration,
) -> tuple[dict[str, Candidate], Calibration]:
    """Candidates by name with their constants where they are most likely beside each other, and the fit with them.

    fit: of candidates, from a fit to go on from. residual: what a fit leaves. calibration: with the candidates.
    """
    found = dict(candidates)
    for _ in range(LOOKS if any(_movable(c) for c in found.values()) else 0):
        left = residual(calibration)
        better = {name: refined(left.without(c.effects), c) if _movable(c) else c for name, c in found.items()}
        if better == found:
            break
        found = better
        calibration = fit(tuple(found.values()), calibration)
    return found, calibration


def refined_at_one_site(residual: Residual, candidates: Mapping[str, Candidate]) -> Iterator[Candidate]:
    """Candidates with constants inside, these where they are most likely in the place of all such at the same site.

    Of a formula between two offered values both may be selected. residual: of a model with all candidates.
    """
    movable = [c for c in candidates.values() if _movable(c)]
    for candidate in movable:
        effects = [e for c in movable if _acts(c) == _acts(candidate) for e in c.effects]
        yield refined(residual.without(effects), candidate)


def _acts(candidate: Candidate) -> frozenset[tuple[str, str]]:
    """The slots and axes at which it acts."""
    return frozenset((term.slot, term.axis) for effect in candidate.effects for term in effect.terms)


def refined(residual: Residual, candidate: Candidate) -> Candidate:
    """A candidate with its constants where what it leaves of a residual without it is least.

    Where each effect has a constant of its own, those are left out whose unknown and constant save less than they take
    to describe.
    """
    if candidate.inner is None:
        return candidate
    inner = _settled(residual, candidate.inner)
    while len(inner.constants) > 1 and len(inner.constants) == len(inner.template):
        fewer = min((inner.without(k) for k in range(len(inner.constants))), key=lambda i: _left(residual, i.effects))
        fewer = _settled(residual, fewer)
        if _nats(residual, inner.effects) - _nats(residual, fewer.effects) > np.log(residual.measured):
            break
        inner = fewer
    return candidate.at(_written(residual, inner))


def profile(residual: Residual, inner: NonlinearParameters) -> Profile | None:
    """The likelihood of an event over the rows beside it, in a residual without it; None where there is no event.

    As many rows as it takes for those at both ends to be out of the interval.
    """
    event = next((c for c in inner.constants if c.whole), None)
    if event is None:
        return None
    rows = np.unique(residual.poses.states["row"])[:-1]
    known: dict[int, float] = {}
    width = WINDOW + int(event.step)
    while True:
        at = int(np.searchsorted(rows, event.value))
        near = range(max(0, at - width), min(len(rows), at + width + 1))
        for k in near:
            if k not in known:
                known[k] = _nats(residual, inner.at([rows[k] if c.whole else c.value for c in inner.constants]).effects)
        found = Profile(rows[list(near)].astype(int), np.array([known[k] for k in near]))
        inside = found.interval[0] > found.rows[0] and found.interval[1] < found.rows[-1]
        if inside or len(near) == len(rows):
            return found
        width *= 2


def _movable(candidate: Candidate) -> bool:
    return candidate.inner is not None and any(c.step > 0 for c in candidate.inner.constants)


def _settled(residual: Residual, inner: NonlinearParameters) -> NonlinearParameters:
    """Events by their most likely row, the other constants by a simplex that begins half a step wide."""
    event = profile(residual, inner)
    if event is not None:
        return inner.at([event.best if c.whole else c.value for c in inner.constants])
    first, steps = np.array(inner.values), np.array([c.step for c in inner.constants])

    def left(values: Array) -> float:
        return _left(residual, inner.at(values.tolist()).effects) if (values > 0).all() else np.inf

    options = {
        "initial_simplex": first + np.vstack([np.zeros_like(steps), np.diag(0.5 * steps)]),
        "maxfev": EVALUATIONS * len(first), "fatol": SETTLED * residual.sigma**2, "xatol": np.inf,
    }  # fmt: skip
    found = minimize(left, first, method="Nelder-Mead", options=options)
    return inner.at(found.x.tolist())


def _written(residual: Residual, inner: NonlinearParameters) -> NonlinearParameters:
    """The constants in as few digits as the data tell apart."""
    best = _nats(residual, inner.effects)
    for digits in range(2, DIGITS):
        rounded = inner.at([c.value if c.whole else float(f"{c.value:.{digits}g}") for c in inner.constants])
        if _nats(residual, rounded.effects) > best - ROUNDING:
            return rounded
    return inner


def _nats(residual: Residual, effects: Sequence[Effect]) -> float:
    return float(fit_nats(1.0 - _left(residual, effects) / residual.energy, residual.freedom))


def _left(residual: Residual, effects: Sequence[Effect]) -> float:
    """Sum of squares of the residual less what effects explain of it."""
    span = ident.orthonormal(residual.projected(effects)[0])
    return residual.energy - float(np.sum((span.T @ residual.values) ** 2))
