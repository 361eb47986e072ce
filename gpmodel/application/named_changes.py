"""Significant changes of a machine since its model was fitted, selected among its possible changes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from gpmodel.application.possible_changes import (
    SET_UP,
    SHARES,
    Kind,
    PossibleChange,
    log_likelihood,
    wander,
    zero_of,
)
from gpmodel.application.recheck import LEAST_FREEDOM, Recheck
from gpmodel.application.stacked_changes import Compared, Stack
from gpmodel.arrays import Array, IntArray, Mask, NotNegative, Share
from gpmodel.numerics.interval import COVERAGE

SIGNIFICANCE = 0.005
"""Significance level of each of the two tests of a model (whole residual; named changes); both together have 1 %."""
MOST = 4
"""Largest number of identified changes of a machine. With more changes, the verdict is "another machine"."""
AS_LIKELY = 4.0
"""Largest difference of the chi-square that two equivalent changes explain: two standard deviations squared."""
LARGEST = 0.01
"""Largest detectable shift of a joint zero, rad or m, that is reported. Larger shifts are called undetectable."""
POWER = 0.9
"""Probability that a change is detected, for the change to be called detectable."""


@dataclass(frozen=True)
class NamedChange:
    """Identified change: value ± one standard error, in `unit`; for kind `size`, relative to the model's value.

    chance: probability that noise alone causes a change at least as significant, corrected for all tested changes.
    rivals: names of other changes that explain the later poses as well, and of those in the 95 % credible set, the most
    probable first.
    shares: posterior probabilities of the change and of the rivals.
    rows: rows of the table with the changed value, if the other rows do not have it; empty for a change of all rows.
    of_the_model: True for an error of the model, which the poses of its fit do not exclude; it is no change.
    """

    name: str
    kind: Kind
    value: float
    stderr: NotNegative
    unit: str
    chance: Share
    rivals: tuple[str, ...]
    shares: tuple[Share, ...] = ()
    rows: tuple[int, ...] = ()
    of_the_model: bool = False

    @property
    def of_the_machine(self) -> bool:
        """True if the machine has changed, not the set-up, and not what is known of the machine."""
        return self.kind != SET_UP and not self.of_the_model

    @property
    def divides(self) -> bool:
        """True if the rows were measured with two values of a constant of the machine or its load."""
        return bool(self.rows) and self.kind != SET_UP


@dataclass(frozen=True)
class Visible:
    """Smallest detectable change of a joint zero, in `unit`; None if the registration absorbs all such changes."""

    joint: str
    unit: str
    size: NotNegative | None


def changes(
    found: Recheck, tried: Stack, significance: float = SIGNIFICANCE
) -> tuple[float, tuple[NamedChange, ...], Recheck]:
    """Return the log posterior probability of the significant changes of a machine, nats, the changes, and the residual
    without all of them.

    A displaced frame includes smaller changes, as of a joint zero or the tool. If a displaced frame is selected, the
    changes are selected again without frames, and the more probable of both results is returned.
    """
    every = np.ones(len(tried.changes), dtype=bool)
    result, frames = _selected(found, tried, every, significance), {c.name for c in tried.changes if c.of_a_frame}
    if frames.isdisjoint(change.name for change in result[1]):
        return result
    return max(result, _selected(found, tried, ~tried.frames, significance), key=lambda one: one[0])


def _selected(
    found: Recheck, tried: Stack, offered: Mask, significance: float
) -> tuple[float, tuple[NamedChange, ...], Recheck]:
    """Select the significant changes of a machine, the most probable first, each given earlier changes; return the log
    posterior probability of all of them, nats, the changes with the sizes of a common fit, and the residual without
    them.

    Changes that the poses do not distinguish count as one, named after the part that a repairer checks first; a change
    of all rows is preferred.

    The chance of a change is that of its F ratio over its share of the significance level (weighted Bonferroni). A
    change that fits an outlier is omitted. If the set-up drifts along the rows, a general slow drift is removed too; a
    change that the slow drift explains as well counts as set-up. At most one frame is displaced, as by a crash.
    """
    out, taken, kinds = list[NamedChange](), list[PossibleChange](), list(SHARES)
    compared = Compared.to(found, tried)
    while offered.any() and len(out) < MOST and compared.left.degrees >= LEAST_FREEDOM:
        left, scores = compared.left, compared.explained
        chances, (shares, credible) = compared.chances, _posterior(compared, offered)
        order = [k for k in np.argsort(-shares).tolist() if offered[k]]
        able = [k for k in order if chances[k] < significance]
        best = next((k for k in able if not compared.change(k).fits_an_outlier(left)), None)
        if best is None:
            break
        part = compared.of(compared.change(best).part_of(left.z))
        alike = np.flatnonzero(offered & (part > scores[best] - AS_LIKELY)).tolist()
        less = np.round(-shares, 9).tolist()
        alike.sort(key=lambda k: (bool(tried.changes[k].rows), kinds.index(tried.changes[k].kind), less[k]))
        best = next(k for k in alike if k in able and not compared.change(k).fits_an_outlier(left))
        chosen, likely = compared.change(best), {*alike, *credible.tolist()} - {best}
        rivals = [k for k in order if k in likely]
        named = tuple(tried.changes[k].name for k in rivals), tuple(shares[[best, *rivals]].tolist())
        size, chance = chosen.fitted(left.z), float(chances[best])
        out.append(NamedChange(chosen.name, chosen.kind, *size, chosen.unit, chance, *named, chosen.rows))
        compared = compared.given(left.without(_explained_columns(chosen, left)))
        taken.append(tried.changes[best])
        if chosen.of_a_frame:
            offered = offered & ~tried.frames
    left = _without_chance_changes(found, out, taken, compared.left, significance)
    nats = float(log_likelihood(found, np.array(found.chi_square - left.chi_square)))
    nats += sum(c.log_share - 0.5 * c.columns.shape[1] * float(np.log(found.degrees)) for c in taken)
    return nats, tuple(_resized(found, out, taken)), left


def _without_chance_changes(
    found: Recheck, named: list[NamedChange], chosen: list[PossibleChange], left: Recheck, significance: float
) -> Recheck:
    """Delete the identified changes that noise larger than that of the fit explains, and return the residual without
    the others.

    If all changes leave a significant residual, σ of the fit is too small for the later measurement. Then the test of
    each change, given the others, takes the noise from the remaining residual; the least significant is deleted first.
    """
    while chosen and left.chance < significance:
        spans = [_explained_columns(change, found) for change in chosen]
        others = [
            found.without(np.hstack([found.basis[:, :0], *spans[:k], *spans[k + 1 :]])) for k in range(len(spans))
        ]
        each = zip(chosen, others, strict=True)
        chances = [c.corrected(c.beside(rest).log_chance_beside(left, rest.z)) for c, rest in each]
        worst = int(np.argmax(chances))
        if chances[worst] < significance:
            break
        left = others[worst]
        del named[worst], chosen[worst]
    return left


def _explained_columns(change: PossibleChange, left: Recheck) -> Array:
    """Return the columns of an identified change; those of a drifting set-up include a general slow drift."""
    return np.hstack([change.columns, wander(left)]) if change.kind == SET_UP else change.columns


def _resized(found: Recheck, named: Sequence[NamedChange], chosen: Sequence[PossibleChange]) -> Iterator[NamedChange]:
    """Yield identified changes with the sizes of one common fit of all changes of the machine."""
    spans = [_explained_columns(c, found) for c in chosen]
    for change, own in zip(named, chosen, strict=True):
        others = [span for span, c in zip(spans, chosen, strict=True) if c is not own]
        rest = found.without(np.hstack(others)) if others else found
        alone = own.beside(rest)
        value, stderr = alone.fitted(rest.z) if alone.columns.any() else (change.value, change.stderr)
        yield replace(change, value=value, stderr=stderr)


def suspected(found: Recheck, tried: Stack) -> PossibleChange | None:
    """Return the most probable change of all rows if a single change is more probable than none; prior probability one
    half."""
    nats = Compared.to(found, tried).evidence - log_likelihood(found, np.zeros(1))
    nats[[bool(change.rows) for change in tried.changes]] = -np.inf
    return tried.changes[int(np.argmax(nats))] if np.logaddexp.reduce(nats) > 0.0 else None


def _posterior(compared: Compared, offered: Mask) -> tuple[Array, IntArray]:
    """Return the posterior probability of each offered change as the only one, and the indices of the 95 % credible
    set."""
    nats = np.where(offered, compared.evidence, -np.inf)
    shares = np.exp(nats - nats.max())
    shares /= shares.sum()
    order = np.argsort(-shares)
    return shares, order[: int(np.searchsorted(np.cumsum(shares[order]), COVERAGE)) + 1]


def visible(found: Recheck, tried: Sequence[PossibleChange], significance: float = SIGNIFICANCE) -> tuple[Visible, ...]:
    """Return the smallest change of each joint zero that the measured poses detect with probability POWER (0.9)."""
    zeros = {h.name: h for h in tried if h.kind == "zero"}
    out = []
    for joint in found.session.saved.mechanism.joints:
        zero, size = zeros.get(zero_of(joint.name)), None
        if zero is not None:
            needed = special.ndtri(POWER) - special.ndtri(0.5 * significance * zero.share)
            least = float(needed / np.linalg.norm(zero.columns))
            size = least if least < LARGEST else None
        out.append(Visible(joint.name, "rad" if joint.kind == "revolute" else "m", size))
    return tuple(out)
