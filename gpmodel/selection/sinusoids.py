"""Propose sinusoids of the joint angles for the residual of a model, at any frequency of a grid.

The columns of a sinusoid are x = r ∘ sin(rate (q - start)) and r ∘ cos(rate (q - start)), where r is the sensitivity
of each measured row to the joint angle q, times the joint's load if the amplitude is proportional to the load. Inner
products with x are sums over poses, so that no column is formed for each frequency. Repeats of a pose have one angle.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from gpmodel.arrays import Array
from gpmodel.evidence.score import diagonalised
from gpmodel.evolution.variances import best
from gpmodel.families.catalogue import Family, Offer
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.formula.expression import DIGITS
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.states import States
from gpmodel.selection.group import CAP, Group, Shapes, group_of
from gpmodel.selection.posterior import Active
from gpmodel.selection.sparse_bayes import reestimate

AT_ONCE = 500_000
"""Largest number of sine values computed at once, 4 MB."""

MOST_WAVES = 12
"""Largest number of sinusoids proposed at once: two for each of six joints."""

ROUNDING = 0.5
"""Largest loss of log evidence, nats, by rounding a sinusoid's frequency to fewer digits: one standard deviation."""

REFINEMENTS = 30
"""Largest number of iterations to find the sinusoid's frequency of largest gain."""


@dataclass(frozen=True)
class Spectrum:
    """Inner products of the rows of a model with sinusoids of a joint angle, for any frequency of a grid.

    angle: joint angle of each pose minus the start of the grid, rad.
    energy: sum of r² over the rows of each pose; r: sensitivity of a measured row to the joint angle.
    sums: sum of sensitivity times each projected-out column over the rows of each pose.
    rhs: sum of sensitivity times each target's residual over the rows of each pose.
    sigma2: variance of the noise.
    """

    grid: FrequencyGrid
    angle: Array
    energy: Array
    sums: Array
    rhs: Array
    sigma2: float

    def at(self, rates: Array) -> tuple[Array, Array]:
        """Compute XᵀC⁻¹X and XᵀC⁻¹y of the columns X, sine and cosine, at each rate. C: covariance of the target y."""
        turn = rates[:, None] * self.angle
        waves = np.sin(turn), np.cos(turn)
        taken = [w @ self.sums for w in waves]
        inner = np.empty((len(rates), 2, 2))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            inner[:, i, j] = (waves[i] * waves[j]) @ self.energy - np.sum(taken[i] * taken[j], axis=1)
        inner[:, 1, 0] = inner[:, 0, 1]
        return inner / self.sigma2, np.stack([w @ self.rhs for w in waves], axis=1) / self.sigma2

    def bound(self) -> Array:
        """Compute an upper bound of the gain, nats, of a sinusoid at every frequency of the grid, for every target."""
        rates = self.grid.rates
        parts = np.array_split(rates, -(-rates.size * len(self.angle) // AT_ONCE))
        return np.concatenate([_bound(*self.at(part)) for part in parts])

    def gain(self, rate: float) -> float:
        """Compute the gain, nats, of the sinusoid of one frequency at its best prior variance, on the first target."""
        inner, rhs = self.at(np.array([rate]))
        return float(best(*diagonalised(inner, rhs[:, :, 0]), np.array([CAP]))[0][0])


def _bound(inner: Array, rhs: Array) -> Array:
    a, b, d = inner[:, 0, 0, None], inner[:, 0, 1, None], inner[:, 1, 1, None]
    # a sinusoid that the model explains up to rounding has no gain
    free = a * d - b * b
    lost = free <= 1e-9 * np.maximum(a, d) ** 2
    q = rhs[:, 0], rhs[:, 1]
    top = d * q[0] ** 2 - 2 * b * q[0] * q[1] + a * q[1] ** 2
    return np.where(lost, 0.0, 0.5 * top / np.where(lost, 1.0, free))


def spectrum(active: Active, grid: FrequencyGrid, targets: Array) -> Spectrum:
    """Form the inner products of targets with sinusoids, given a model. targets: whitened, without registration."""
    rows = active.pool.rows
    reach = sum(w * rows.sensitivity((slot, axis)) for slot, axis, w in grid.joint.drive)
    if grid.load:
        reach = reach * rows.shapes.states[grid.load][rows.pose_of_row]
    reach = rows.whitening.whiten(np.asarray(reach))[:, None]
    left = targets - active.spanned @ (active.spanned.T @ targets)
    taken = np.hstack([rows.placement, active.spanned])
    angle = rows.shapes.states[grid.joint.name][rows.present] - grid.start
    energy = rows.totals(reach**2)[:, 0]
    return Spectrum(grid, angle, energy, rows.totals(reach * taken), rows.totals(reach * left), active.sigma2)


def sinusoid_null(active: Active, grids: Sequence[FrequencyGrid], targets: Array) -> Array:
    """Compute the largest gain minus description penalty, nats, of any sinusoid on each column of `targets`."""
    found = np.full(targets.shape[1], -np.inf)
    for grid in grids:
        there = spectrum(active, grid, targets)
        rates = grid.rates[np.argmax(there.bound(), axis=0)]
        inner, rhs = there.at(rates)
        own = rhs[np.arange(len(rates)), :, np.arange(len(rates))]
        net = best(*diagonalised(inner, own), np.full(len(rates), CAP))[0] - grid.template.cost
        found = np.maximum(found, net)
    return found


def propose_sinusoids(active: Active, grids: Sequence[FrequencyGrid]) -> list[Group]:
    """Return the sinusoids of largest net gain given a model, the best first, each given the preceding sinusoids.

    The best sinusoid of a joint is computed again only if it could be the next. Source: Minoux (1978).
    """
    rows, found, fresh = active.pool.rows, list[Group](), set[int]()
    names = {g.name for g in active.pool.groups}
    peaks = [(np.inf, 0.0)] * len(grids)
    there: dict[int, Spectrum] = {}
    while grids and len(found) < MOST_WAVES:
        k = max(range(len(grids)), key=lambda k: peaks[k][0])
        if peaks[k][0] < active.criteria.minimum_nats:
            break
        if k not in fresh:
            there[k] = spectrum(active, grids[k], rows.target[:, None])
            rate, gain = _peak(there[k])
            peaks[k] = gain - grids[k].template.cost, rate
            fresh.add(k)
            continue
        net, rate = peaks[k]
        group = _written(there[k], rate, net + grids[k].template.cost, rows.shapes)
        if group is None or group.name in names:
            break
        found.append(group)
        names.add(group.name)
        active, fresh = reestimate(active.beside(group, 1e-10)), set()
    return found


def _peak(there: Spectrum) -> tuple[float, float]:
    """Return the frequency of largest gain between the neighbours of the best grid frequency, and its gain, nats."""
    rates = there.grid.rates
    bound = there.bound()[:, 0]
    k = int(np.argmax(bound))
    if bound[k] < there.grid.template.cost:
        return float(rates[k]), float(bound[k])
    found = minimize_scalar(
        lambda rate: -there.gain(float(rate)),
        bounds=(max(rates[k] - there.grid.step, 0.5 * rates[k]), rates[k] + there.grid.step),
        method="bounded", options={"maxiter": REFINEMENTS, "xatol": 1e-6 * rates[k]},
    )  # fmt: skip
    return float(found.x), -float(found.fun)


def _written(there: Spectrum, rate: float, gain: float, shapes: Shapes) -> Group | None:
    """Return a sinusoid as a group of effects, its frequency written with as few digits as the data determine."""
    grid = there.grid
    for digits in range(1, DIGITS):
        value = float(f"{grid.value(rate):.{digits}g}")
        near = grid.value(value)
        if abs(near - rate) < grid.step and there.gain(near) > gain - ROUNDING:
            return group_of(grid.at(rate, digits), shapes)
    return group_of(grid.at(rate), shapes)


def grids_of(offers: Iterable[Offer], mechanism: Mechanism, states: States) -> list[FrequencyGrid]:
    """Return the frequency grids of the sinusoids in some families of the catalogue."""
    return [grid for o in offers if isinstance(o, Family) for grid in o.grids(mechanism, states)]
