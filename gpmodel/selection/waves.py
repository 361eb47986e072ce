"""The worth of waves at very many rates beside a model, without a column for each; the best of them as groups.

A wave's columns are x = r ∘ sin and r ∘ cos of rate (q - start), r what the drive does to the rows (M,), so that their
products with anything are sums over the poses of shapes times what r made of it. Of poses that share a deviation the
angles are taken as one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from gpmodel.arrays import Array
from gpmodel.evidence.gain import best, rotated
from gpmodel.families.comb import Comb
from gpmodel.families.family import Family
from gpmodel.families.offer import Offer
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.states import States
from gpmodel.selection.active import Active
from gpmodel.selection.group import CAP, Group, Shapes, from_candidate
from gpmodel.selection.moves import with_optimal_variances
from gpmodel.selection.pool import GroupPool

AT_ONCE = 500_000
"""Sines worked on at once, 4 MB."""

MOST_WAVES = 12
"""Waves added in one look: two a joint."""

ROUNDING = 0.5
"""Nats that a constant written with fewer digits may cost: one standard deviation."""

MOST_DIGITS = 6
REFINEMENTS = 30
"""Significant digits of a frequency at most; steps of its refinement."""


@dataclass(frozen=True)
class Spectrum:
    """A comb beside a model: how waves of any rate meet its rows.

    angle: (P,) q - start of each pose present. energy: (P,) sums of r². sums: (P, K) of r times what is taken out of a
    wave, placement and active columns. pull: (P, T) of r times what is left of each target. sigma2: of the noise.
    """

    comb: Comb
    angle: Array
    energy: Array
    sums: Array
    pull: Array
    sigma2: float

    def at(self, rates: Array) -> tuple[Array, Array]:
        """S (F, 2, 2) and XᵀC⁻¹y (F, 2, T) of the sine and cosine at some rates."""
        turn = rates[:, None] * self.angle
        waves = np.sin(turn), np.cos(turn)
        taken = [w @ self.sums for w in waves]
        inner = np.empty((len(rates), 2, 2))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            inner[:, i, j] = (waves[i] * waves[j]) @ self.energy - np.sum(taken[i] * taken[j], axis=1)
        inner[:, 1, 0] = inner[:, 0, 1]
        return inner / self.sigma2, np.stack([w @ self.pull for w in waves], axis=1) / self.sigma2

    def bound(self) -> Array:
        """½ qᵀS⁻¹q (F, T) of every rate of the comb, above what any variance gains."""
        rates = self.comb.rates
        parts = np.array_split(rates, -(-rates.size * len(self.angle) // AT_ONCE))
        return np.concatenate([_bound(*self.at(part)) for part in parts])

    def gain(self, rate: float) -> float:
        """Nats of a wave at its best variance, on the first target."""
        inner, pull = self.at(np.array([rate]))
        return float(best(*rotated(inner, pull[:, :, 0]), np.array([CAP]))[0][0])


def _bound(inner: Array, pull: Array) -> Array:
    a, b, d = inner[:, 0, 0, None], inner[:, 0, 1, None], inner[:, 1, 1, None]
    # a wave that the model explains but for rounding gains nothing
    free = a * d - b * b
    lost = free <= 1e-9 * np.maximum(a, d) ** 2
    q = pull[:, 0], pull[:, 1]
    top = d * q[0] ** 2 - 2 * b * q[0] * q[1] + a * q[1] ** 2
    return np.where(lost, 0.0, 0.5 * top / np.where(lost, 1.0, free))


def spectrum(active: Active, comb: Comb, targets: Array) -> Spectrum:
    """A comb beside a model; targets: (M, T), whitened and cleaned."""
    rows = active.pool.rows
    reach = sum(w * rows.sensitivity((slot, axis)) for slot, axis, w in comb.joint.drive)
    reach = rows.whitening.whiten(np.asarray(reach))[:, None]
    left = targets - active.spanned @ (active.spanned.T @ targets)
    taken = np.hstack([rows.placement, active.spanned])
    angle = rows.shapes.states[comb.joint.name][rows.present] - comb.start
    energy = rows.totals(reach**2)[:, 0]
    return Spectrum(comb, angle, energy, rows.totals(reach * taken), rows.totals(reach * left), active.sigma2)


def most_by_chance(active: Active, combs: Sequence[Comb], targets: Array) -> Array:
    """The most nats (T,), costs counted, that any wave gains on each of some targets (M, T)."""
    found = np.full(targets.shape[1], -np.inf)
    for comb in combs:
        there = spectrum(active, comb, targets)
        rates = comb.rates[np.argmax(there.bound(), axis=0)]
        inner, pull = there.at(rates)
        own = pull[np.arange(len(rates)), :, np.arange(len(rates))]
        net = best(*rotated(inner, own), np.full(len(rates), CAP))[0] - comb.template.cost
        found = np.maximum(found, net)
    return found


def waves_left(active: Active, combs: Sequence[Comb]) -> list[Group]:
    """The waves that what a model leaves asks for, the worthiest first, each beside those before it.

    A joint's best wave is sought again beside the others' only once it would be the next. Source: Minoux (1978).
    """
    rows, found, fresh = active.pool.rows, list[Group](), set[int]()
    peaks = [(np.inf, 0.0)] * len(combs)
    there: dict[int, Spectrum] = {}
    while combs and len(found) < MOST_WAVES:
        k = max(range(len(combs)), key=lambda k: peaks[k][0])
        if peaks[k][0] < active.criteria.minimum_nats:
            break
        if k not in fresh:
            there[k] = spectrum(active, combs[k], rows.target[:, None])
            rate, gain = _peak(there[k])
            peaks[k] = gain - combs[k].template.cost, rate
            fresh.add(k)
            continue
        net, rate = peaks[k]
        group = _written(there[k], rate, net + combs[k].template.cost, rows.shapes)
        if group is None or group.name in {g.name for g in active.pool.groups}:
            break
        found.append(group)
        pool = GroupPool(rows, [*active.pool.groups, group], active.criteria)
        wider = Active(pool, active.variances, active.chosen, active.sigma2)
        active, fresh = with_optimal_variances(wider.added(len(pool.groups) - 1, 1e-10)), set()
    return found


def _peak(there: Spectrum) -> tuple[float, float]:
    """Rate and nats of the best wave of a comb, between the rates beside the best of its grid."""
    rates = there.comb.rates
    bound = there.bound()[:, 0]
    k = int(np.argmax(bound))
    if bound[k] < there.comb.template.cost:
        return float(rates[k]), float(bound[k])
    found = minimize_scalar(
        lambda rate: -there.gain(float(rate)),
        bounds=(max(rates[k] - there.comb.step, 0.5 * rates[k]), rates[k] + there.comb.step),
        method="bounded", options={"maxiter": REFINEMENTS, "xatol": 1e-6 * rates[k]},
    )  # fmt: skip
    return float(found.x), -float(found.fun)


def _written(there: Spectrum, rate: float, gain: float, shapes: Shapes) -> Group | None:
    """The wave of a rate with its constant in as few digits as its data tell apart."""
    comb = there.comb
    for digits in range(1, MOST_DIGITS):
        value = float(f"{comb.value(rate):.{digits}g}")
        near = comb.value(value)
        if abs(near - rate) < comb.step and there.gain(near) > gain - ROUNDING:
            return from_candidate(comb.at(rate, digits), shapes)
    return from_candidate(comb.at(rate), shapes)


def combs_of(offers: Iterable[Offer], mechanism: Mechanism, states: States) -> list[Comb]:
    """The combs of every family among what is offered."""
    return [comb for o in offers if isinstance(o, Family) for comb in o.combs(mechanism, states)]
