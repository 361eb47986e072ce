"""Fit the constants inside basis functions: by variable projection, then as unknowns of the final fit.

In variable projection the linear coefficients are solved for given constants, and the other effects are projected out.
Thus the residual is a function of the constants alone. Source: Golub and Pereyra (1973).
"""

import math
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
from gpmodel.families.catalogue import family
from gpmodel.families.curves import continued
from gpmodel.families.inner import Constant, NonlinearParameters, law_name, numbered
from gpmodel.formula.expression import DIGITS, Expression
from gpmodel.model.effect import Effect, Term
from gpmodel.model.states import States
from gpmodel.numerics import rank as ident

LOOKS = 2
"""Number of passes that refit the constants of all candidates; pass two allows for changes in the first pass."""

EVALUATIONS = 80
"""Largest number of residual evaluations per constant of a candidate; the simplex method needs half as many."""

SETTLED = 1e-4
"""Difference of the sum of squares between corners of the simplex at which its iterations end, in noise variances."""

ROUNDING = 0.005
"""Largest loss of log evidence, nats, by rounding a constant to fewer digits: a tenth of its standard error."""

ROW_LOSS = -np.log1p(-np.sqrt(0.95))
"""Loss of log likelihood, nats, at the ends of the 95 % confidence interval of an event's row: half of the quantile
-2 ln(1 - √0.95) of the likelihood ratio of a threshold. Source: Hansen (2000), Econometrica 68(3), theorem 2."""

WINDOW = 12
"""Number of rows on either side of an event that are tested first, besides the rows up to the next candidate row."""


@dataclass(frozen=True)
class Profile:
    """Log likelihood of an event after each of some table rows, nats, with the other constants of the event fixed."""

    rows: Array
    nats: Array

    @property
    def best(self) -> int:
        """The most likely table row after which an event (a step) occurs."""
        return int(self.rows[np.argmax(self.nats)])

    @property
    def interval(self) -> tuple[int, int]:
        """First and last row of the 95 % confidence interval of the row of an event (a step)."""
        there = self.rows[self.nats >= self.nats.max() - ROW_LOSS]
        return int(there.min()), int(there.max())


def detailed(left: Residual, found: Mapping[str, Candidate]) -> dict[str, Candidate]:
    """Double the number of harmonics of a drive's detailed angular errors if the description length falls.

    The angular error of a drive has harmonics up to twice its reduction ratio; half of the harmonics detect the error
    in an eighth of the time. left: residual of a model with all findings.
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
    """Fit the constants inside candidates given each other; return candidates by name and the fit with the candidates.

    fit: function that calibrates with candidates, starting from an earlier fit. residual: function from a fit to its
    residual. calibration: fit with the candidates.
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
    """Yield each candidate with refitted constants, as a replacement of all candidates with constants at its site.

    If a true constant lies between the constants of two candidates, both may be selected. residual: of the whole model.
    """
    movable = [c for c in candidates.values() if _movable(c)]
    for candidate in movable:
        effects = [e for c in movable if _acts(c) == _acts(candidate) for e in c.effects]
        yield refined(residual.without(effects), candidate)


def _acts(candidate: Candidate) -> frozenset[tuple[str, str]]:
    """Return the frames and axes of the twists by which a candidate's effects act."""
    return frozenset((term.slot, term.axis) for effect in candidate.effects for term in effect.terms)


def refined(residual: Residual, candidate: Candidate) -> Candidate:
    """Fit the constants inside a candidate to the residual of a model without the candidate.

    If each effect of the candidate has its own constant, an effect is deleted if its gain is below the penalty of one
    coefficient and one constant."""
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
    """Compute the likelihood profile of the row of an event; None for a candidate without an event.

    Rows are added until both end rows are outside the confidence interval. residual: residual without the candidate.
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
    """Fit the row of an event by its likelihood profile, or other constants by the simplex method."""
    event = profile(residual, inner)
    if event is not None:
        return inner.at([event.best if c.whole else c.value for c in inner.constants])
    first, steps, least = np.array([(c.value, c.step, c.least) for c in inner.constants]).T

    def left(values: Array) -> float:
        return _left(residual, inner.at(values.tolist()).effects) if (values > least).all() else np.inf

    options = {
        "initial_simplex": first + np.vstack([np.zeros_like(steps), np.diag(0.5 * steps)]),
        "maxfev": EVALUATIONS * len(first), "fatol": SETTLED * residual.sigma**2, "xatol": np.inf,
    }  # fmt: skip
    found = minimize(left, first, method="Nelder-Mead", options=options)
    return inner.at(found.x.tolist())


def _written(residual: Residual, inner: NonlinearParameters) -> NonlinearParameters:
    """Round the constants inside a candidate to as few digits as the data determine."""
    best = _nats(residual, inner.effects)
    for digits in range(2, DIGITS):
        rounded = inner.at([c.value if c.whole else float(f"{c.value:.{digits}g}") for c in inner.constants])
        if _nats(residual, rounded.effects) > best - ROUNDING:
            return rounded
    return inner


def _nats(residual: Residual, effects: Sequence[Effect]) -> float:
    return float(fit_nats(1.0 - _left(residual, effects) / residual.energy, residual.freedom))


def _left(residual: Residual, effects: Sequence[Effect]) -> float:
    """Compute the sum of squares of a residual after the columns of effects are projected out, m²."""
    span = ident.orthonormal(residual.projected(effects)[0])
    return residual.energy - float(np.sum((span.T @ residual.values) ** 2))


STEP = 1e-3
"""Step, relative to the constant, of the central difference by a constant inside a formula."""

OWN = 0.005
"""Least unique share of the derivative with respect to a constant in a formula; a pure scale only rescales the
coefficient. Difference quotients approximate derivatives to a tenth of this share."""

MOST = 0.3
"""Prior standard deviation of a constant's change, which alters the formula by 30 % RMS; larger ones are not linear."""

HARMONICS = 12
"""Largest whole number in a formula that counts as periods per turn, not as a constant to fit."""


@dataclass(frozen=True)
class InnerChange:
    """A constant inside a formula, and the effect whose coefficient is the change of the constant."""

    constant: Constant
    effect: Effect


@dataclass(frozen=True)
class _Moved:
    """A constant inside a candidate, and the candidate's basis functions half a step below and above its value."""

    constant: Constant
    below: tuple[tuple[str, ...], ...]
    above: tuple[tuple[str, ...], ...]

    @property
    def step(self) -> float:
        """Difference of the constant between `above` and `below`."""
        return STEP * abs(self.constant.value)


def inner_changes(candidate: Candidate, theta: Sequence[float], states: States) -> tuple[InnerChange, ...]:
    """Return the change of each constant c inside a formula as an effect θ ∂φ/∂c, whose coefficient is the change.

    With the effects of changes in the model all standard errors are those of nonlinear least squares, and each constant
    has a standard error. A change that the coefficient or the geometry can absorb is left out. theta: fitted
    coefficient θ of each basis function φ of the candidate. Source: Seber and Wild (1989), 2.1.
    """
    sites = tuple(dict.fromkeys((t.slot, t.axis) for e in candidate.effects for t in e.terms))
    law = _motion(candidate.effects, theta, states, sites)
    constant = np.kron(np.eye(len(sites)), np.ones(len(states)))
    taken = [*constant, *(_motion([e], [1.0], states, sites) for e in candidate.effects)]
    out: list[InnerChange] = []
    for moved in _moved(candidate):
        effect = _change(candidate, theta, moved)
        column = _motion([effect], [1.0], states, sites)
        size = float(np.sqrt(np.mean(column**2)))
        own = np.column_stack(taken)
        left = column - own @ np.linalg.lstsq(own, column, rcond=None)[0]
        if not np.isfinite(size) or float(np.sqrt(np.mean(left**2))) <= OWN * size:
            continue
        taken.append(column)
        prior = MOST * float(np.sqrt(np.mean(law**2))) / size
        out.append(InnerChange(moved.constant, replace(effect, prior=prior)))
    return tuple(out)


def moved(candidate: Candidate, values: Mapping[Constant, float]) -> Candidate:
    """Replace the values of some constants inside a candidate; an unnamed candidate is renamed after its formula.

    Constants such as a lag, a width or a rate keep their sign: a step lowers a constant by at most half its size.
    """
    if not values:
        return candidate
    inner = candidate.inner
    if inner is not None and set(values) <= set(inner.constants):
        return candidate.at(inner.at([_rounded(_same_sign(values.get(c, c.value), c)) for c in inner.constants]))
    texts = _with(_texts(candidate.effects), {c.value: _rounded(v) for c, v in values.items()})
    effects = tuple(
        replace(e, terms=tuple(replace(t, basis=Expression(text)) for t, text in zip(e.terms, own, strict=True)))
        for e, own in zip(candidate.effects, texts, strict=True)
    )
    if candidate.name != law_name(candidate.effects):
        return replace(candidate, effects=effects)
    return replace(candidate, name=law_name(effects), effects=numbered(effects))


def _same_sign(value: float, constant: Constant) -> float:
    """Limit the change of a constant toward zero to half of its size, and to its lower bound."""
    sign = math.copysign(1.0, constant.value)
    return sign * max(sign * value, 0.5 * sign * constant.value, constant.least)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _moved(candidate: Candidate) -> Iterator[_Moved]:
    """Yield each distinct constant inside a candidate; a constant of several effects is changed in each effect.

    A whole number of ripples per turn, or of millimetres of a screw's lead, is exact and therefore omitted.
    """
    inner, refit = candidate.inner, bool((known := family(candidate.family)) and known.refit_constants)
    if candidate.has_priors:
        return
    if inner is not None and (refit or any(c.step > 0 for c in inner.constants)):
        for k, constant in enumerate(inner.constants):
            if not constant.whole and not (refit and constant.value == round(constant.value)):
                own = inner.values
                sides = (inner.at([*own[:k], v, *own[k + 1 :]]) for v in _beside(constant.value))
                below, above = (_texts(side.effects) for side in sides)
                yield _Moved(constant, below, above)
    if candidate.family and not (refit and inner is None):
        return
    texts = _texts(candidate.effects)
    programs = [Expression(text).program for own in texts for text in own]
    for value in dict.fromkeys(c for program in programs for c in program.constants):
        if value != round(value) or abs(value) > HARMONICS:
            below, above = (_with(texts, {value: v}) for v in _beside(value))
            yield _Moved(Constant("", "1", value), below, above)


def _beside(value: float) -> tuple[float, float]:
    """Return the values half a difference step below and above a constant."""
    step = STEP * abs(value)
    return value - step / 2, value + step / 2


def _with(texts: tuple[tuple[str, ...], ...], new: Mapping[float, float]) -> tuple[tuple[str, ...], ...]:
    """Replace constants in the texts of all basis functions. new: new value of each constant, by its old value."""
    programs = [[Expression(text).program for text in own] for own in texts]
    return tuple(
        tuple(p.with_constants([new.get(c, c) for c in p.constants]).written_out() for p in own) for own in programs
    )


def _texts(effects: Sequence[Effect]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(str(term.basis) for term in effect.terms) for effect in effects)


def _change(candidate: Candidate, theta: Sequence[float], moved: _Moved) -> Effect:
    """Return the derivative θ (φ above - φ below) / step of a candidate with respect to one constant, as an effect."""
    terms = []
    for effect, value, below, above in zip(candidate.effects, theta, moved.below, moved.above, strict=True):
        for term, low, high in zip(effect.terms, below, above, strict=True):
            if low != high:
                basis = Expression(f"(({high}) - ({low}))*{1.0 / moved.step:.10g}")
                terms.append(Term(term.slot, term.axis, basis, term.weight * value))
    of = f"{moved.constant.name} {moved.constant.value:.5g}".strip()
    return Effect(f"{candidate.name}, change of {of}", tuple(terms), "1", candidate.family)


def _motion(
    effects: Sequence[Effect], theta: Sequence[float], states: States, sites: Sequence[tuple[str, str]]
) -> Array:
    """Compute Σ θ φ of effects at each site (frame and axis) as one vector, the poses of one site after another."""
    out = np.zeros((len(sites), len(states)))
    for effect, value in zip(effects, theta, strict=True):
        for term in effect.terms:
            out[sites.index((term.slot, term.axis))] += value * term.weight * term.basis(states)
    return out.ravel()
