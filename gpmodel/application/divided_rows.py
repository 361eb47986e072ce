"""Divide the rows of a later session between two values of one constant, if the rows were measured with two values.

Rows i with residual r_i have the value a or a + b of a constant with the derivatives C:

    r_i = F_i ρ + C_i (a + g_i b) + noise,   g_i in {0, 1}

Examples are two tools, two loads, a joint with play between two zeros, and a moved instrument.
The division g of the rows alternates between least squares for ρ, a, b and the better value for each row
(classification EM; Celeux and Govaert 1992), from several initial divisions, alone or with a price of every switch
between neighbouring rows. The description of the division has a price. The alternative is a constant with a normally
distributed value in each row.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from gpmodel import wording
from gpmodel.application.changed_model import with_changes
from gpmodel.application.possible_changes import (
    SET_UP,
    SHARES,
    STANDING,
    PossibleChange,
    constants,
    student,
    with_shares,
)
from gpmodel.application.recheck import Recheck, recheck, refitted
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.formula.expression import Basis, Columns
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Term, effect_at
from gpmodel.numerics import rank

MOST_STEPS = 50
"""Largest number of steps of one division. A division of 400 rows converges in less than ten."""
SCATTERS = np.geomspace(0.05, 2.0, 20)
"""Standard deviations of a constant that differs in each row, relative to the difference of two values. Two equally
frequent values have the standard deviation 0.5; beyond the ends of the range the likelihood falls."""
MOST_PLACES = 200
"""Largest number of evenly spaced rows after which a change is tested, and of initial divisions along one axis."""


@dataclass(frozen=True)
class InRows:
    """Basis function `of`, with the value zero outside the table's rows `rows`."""

    of: Basis
    rows: tuple[int, ...]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs of the basis function, and the row."""
        return (*self.of.inputs, "row")

    def __call__(self, states: Columns) -> Array:
        """Return the values of the basis function at the poses `states`."""
        return np.asarray(self.of(states) * np.isin(states["row"], self.rows))

    def __str__(self) -> str:
        return f"({self.of}) in {len(self.rows)} rows"


@dataclass(frozen=True)
class Division:
    """Later session whose rows divide between two values of a constant.

    found: residuals without the outliers of a model with both values.
    changes: changes of each constant in the rows of one value, with their shares.
    scattered: True if a normally distributed value in each row is more probable than two values.
    most: largest number of parameters that the rows of either value determine without any one of them.
    """

    found: Recheck
    changes: tuple[PossibleChange, ...]
    scattered: bool
    most: int

    def determines(self, names: Collection[str]) -> bool:
        """Return whether the rows of either value determine the named changes together, without any one of them."""
        widths = [change.columns.shape[1] for change in self.changes if change.name in names]
        return int(sum(widths)) <= self.most


def divided(near: Recheck, known: Sequence[PossibleChange] = ()) -> Division | None:
    """Return the most probable division of the rows of a later session between two values of a constant; None if a
    value has too few rows.

    near: residuals of the session. known: changes of the machine that all rows have.
    """
    every = np.ones(len(near.session.use), dtype=bool)
    if len(every) < 2 * len(AXES):
        return None
    whole = _WithConstants.of(near if near.session.use.all() else recheck(replace(near.session, use=every)))
    found = whole.found
    session, columns = with_changes(found.session, found.problem, known)
    problem = session.problem
    fixed = rank.orthonormal(np.hstack([problem.columns[:, session.anew(problem)], problem.columns @ columns]))
    sigma = found.spread.sigma * np.sqrt(1.0 + np.mean(np.sum((found.spread.u * found.spread.s) ** 2, axis=1)))
    left, pose, best, own = problem.residual / sigma, problem.pose_of_row, -np.inf, None
    for change in whole.constants:
        rows = _Rows.of(fixed, change.columns, left, pose)
        nats, second = rows.best(found.freedom)
        nats -= 0.5 * rows.size * np.log(rows.count)
        nats += np.log(SHARES[change.kind] / sum(other.kind == change.kind for other in whole.constants))
        if nats > best:
            best, own = nats, (change, rows, second)
    if own is None:
        return None
    constant, rows, second = own
    judged, changes, most = _judgeable(near, whole, [*known, constant, _in_rows(constant, found, second)], second)
    return Division(judged, changes, rows.scattered(second), most) if changes else None


@dataclass(frozen=True)
class _WithConstants:
    """Residuals, and the changes of one constant that could have two values."""

    found: Recheck
    constants: tuple[PossibleChange, ...]

    @classmethod
    def of(cls, found: Recheck) -> "_WithConstants":
        """Return residuals with the changes of all constants."""
        effects = tuple(effect_at(f"set-up {axis}", STANDING, axis) for axis in AXES)
        set_up = PossibleChange("set-up", SET_UP, "m", found.rows_of(effects), effects=effects)
        return cls(found, (*constants(found), set_up))


def _judgeable(
    near: Recheck, whole: _WithConstants, changes: Sequence[PossibleChange], second: Mask
) -> tuple[Recheck, tuple[PossibleChange, ...], int]:
    """Exclude the outliers of the model with the changes and two values, and offer two values of every constant that
    the rows of either value determine without any one of them. Return also how many parameters they determine so.

    whole: residuals of all rows. The model has the value of either part of the rows. If the registration absorbs a
    constant of all rows, the later value differs, or that of the smaller part.
    """
    session = with_changes(near.session, near.problem, changes)[0]
    use = refitted(session, frozenset(effect.name for change in changes for effect in change.effects)).use
    if (use != whole.found.session.use).any():
        same = (use == near.session.use).all()
        whole = _WithConstants.of(near if same else recheck(replace(near.session, use=use)))
    own = whole.found
    second = second if (second[-1] if _in_sequence(second) else 2 * second.sum() <= len(second)) else ~second
    counts = np.bincount(own.problem.pose_of_row, minlength=len(use))
    most = min(int(counts[part].sum() - counts[part].max()) for part in (second, ~second))
    offered = [change for change in whole.constants if change.columns.shape[1] <= most]
    either = {change.name for change in with_shares(own, offered)} if offered else set[str]()
    raw = [_in_rows(change, own, second) for change in offered]
    raw += [_in_rows(change, own, ~second) for change in offered if change.name in either]
    price = float(_price(second))
    return own, tuple(replace(c, division=price) for c in with_shares(own, raw)) if raw else (), most


def _in_rows(change: PossibleChange, found: Recheck, second: Mask) -> PossibleChange:
    """Return the change of a constant in the rows `second` only."""
    rows = tuple(found.session.poses.dataset.row[second].tolist())
    effects = tuple(
        replace(e, name=f"{e.name} in {len(rows)} rows", terms=tuple(_term_in_rows(t, rows) for t in e.terms))
        for e in change.effects
    )
    columns = np.where(second[found.problem.pose_of_row, None], change.columns, 0.0)
    return replace(change, name=_title(change.name, found, second), columns=columns, effects=effects, rows=rows)


def _term_in_rows(term: Term, rows: tuple[int, ...]) -> Term:
    return replace(term, basis=InRows(term.basis, rows))


def _title(name: str, found: Recheck, second: Mask) -> str:
    """Return the name of a constant with the rows of its second value."""
    rows = found.session.poses.dataset.row
    if not _in_sequence(second):
        listed = wording.some(wording.ranges(rows[second].tolist()))
        return f"{name} in {np.count_nonzero(second)} rows ({listed})"
    last = rows[np.flatnonzero(np.diff(second))[0]]
    return f"{name} after row {last}" if second[-1] else f"{name} up to row {last}"


def _price(second: Mask) -> Array:
    """Return the price of divisions (..., rows) of n rows, nats: the shorter of two descriptions, and ln 2 for which.

    The list of m rows with the second value: ln(n + 1) + ln C(n, m), from an equally likely share of the second value.
    The list of k switches between neighbouring rows: ln(k (k + 1)) + ln C(n - 1, k) (Rissanen 1983).
    """
    count, own, switches = second.shape[-1], second.sum(axis=-1), np.count_nonzero(np.diff(second), axis=-1)
    separate = np.log(count + 1.0) + _log_choose(count, own)
    runs = np.log(np.maximum(switches * (switches + 1.0), 2.0)) + _log_choose(count - 1, switches)
    return np.asarray(np.log(2.0) + np.minimum(separate, runs))


def _log_choose(count: int, own: IntArray) -> Array:
    return np.asarray(special.gammaln(count + 1.0) - special.gammaln(own + 1.0) - special.gammaln(count - own + 1.0))


def _in_sequence(second: Mask) -> Mask:
    return np.asarray(np.count_nonzero(np.diff(second), axis=-1) == 1)


@dataclass(frozen=True)
class _Rows:
    """Products of the columns of one constant in each pose.

    With F_n the rows of pose n of an orthonormal basis of all columns but b, C_n those of the constant, and r_n the
    residual of the fit with one value: inner = C_nᵀ [F_n, C_n, r_n], (poses, size, columns). The residual is in units
    of its standard deviation if the model holds. squares: rᵀ r. size: number of parameters of the constant. count:
    number of measurements.
    """

    inner: Array
    squares: float
    size: int
    count: int

    @classmethod
    def of(cls, fixed: Array, constant: Array, residual: Array, pose: IntArray) -> "_Rows":
        """Return the products of a constant. fixed: orthonormal basis of the other columns."""
        constant = constant / np.maximum(np.linalg.norm(constant, axis=0), np.finfo(float).tiny)
        basis = np.hstack([fixed, rank.orthonormal(rank.remove(fixed, constant))])
        left = rank.remove(basis, residual)
        columns = np.column_stack([basis, constant, left])
        starts, counts = np.unique(pose, return_index=True, return_counts=True)[1:]
        padded = np.zeros((int(pose.max()) + 1, int(counts.max()), columns.shape[1]))
        padded[pose, np.arange(len(pose)) - np.repeat(starts, counts)] = columns
        size = constant.shape[1]
        inner = np.swapaxes(padded[:, :, -1 - size : -1], 1, 2) @ padded
        return cls(inner, float(left @ left), size, len(left))

    @property
    def own(self) -> slice:
        """Columns of the constant."""
        return slice(-1 - self.size, -1)

    @property
    def fewest(self) -> int:
        """Least number of rows of a value, so that it is determined without any one of them."""
        return 1 + -(-self.size * len(self.inner) // self.count)

    def fitted(self, second: Mask) -> tuple[Array, Array, Array]:
        """Return for each division (divisions, poses) the sum of squares, that of each pose with the second value minus
        that with the first, and the difference of the values.

        With P = Σ C_nᵀ F_n and S = Σ C_nᵀ C_n - P Pᵀ over the second rows, the difference of the values is
        b = S⁺ Σ C_nᵀ r_n.
        """
        every = self.inner.reshape(len(self.inner), -1)
        part = (second.astype(float) @ every).reshape(-1, *self.inner.shape[1:])
        fixed, right = part[:, :, : -1 - self.size], part[:, :, -1]
        normal = part[:, :, self.own] - fixed @ np.swapaxes(fixed, 1, 2)
        eigenvalues, vectors = np.linalg.eigh(normal)
        inverse = np.divide(1.0, eigenvalues, out=np.zeros_like(eigenvalues), where=eigenvalues > 1e-11)
        turned = np.einsum("sji,sj->si", vectors, right)
        values = np.einsum("sij,sj->si", vectors, inverse * turned)
        absorbed = np.einsum("sij,si->sj", fixed, values)
        weights = np.concatenate([-2.0 * absorbed, values, np.full((len(part), 1), -2.0)], axis=1)
        more = (values[:, :, None] * weights[:, None, :]).reshape(len(part), -1) @ every.T
        return self.squares - np.sum(inverse * turned**2, axis=1), more, values

    def best(self, freedom: float) -> tuple[float, Mask]:
        """Return the largest log likelihood of a division less its price, nats, and the division.

        freedom: degrees of freedom of the noise.
        """
        n = len(self.inner)
        places = np.arange(self.fewest, n - self.fewest + 1, max(1, n // MOST_PLACES))
        if not len(places):
            return -np.inf, np.ones(n, dtype=bool)
        once, starts = np.arange(n) >= places[:, None], self._starts(places)
        first = once[[int(np.argmin(self.fitted(once)[0]))]]
        tried = np.concatenate(
            [once, self._alternated(starts), self._alternated(np.vstack([first, starts]), runs=True)]
        )
        nats = student(np.maximum(self.fitted(tried)[0], 0.0), self.count, freedom)
        few = np.minimum(tried.sum(axis=1), n - tried.sum(axis=1)) < self.fewest
        nats = np.where(few, -np.inf, nats - _price(tried))
        at = int(np.argmax(nats))
        return float(nats[at]), tried[at]

    def scattered(self, second: Mask) -> bool:
        """Return whether a normal value in each row is more probable than the two values of a division.

        With the standard deviation τ along the difference, and with h and g the residual's product with the difference
        and the difference's square in a row, the log likelihood gains Σ (τ² h² / (1 + τ² g) - ln(1 + τ² g)) / 2.
        """
        total, _, difference = self.fitted(second[None])
        both = 0.5 * (self.squares - float(total[0])) - float(_price(second))
        along = self.inner[:, :, -1] @ difference[0]
        square = np.einsum("i,nij,j->n", difference[0], self.inner[:, :, self.own], difference[0])
        more = 1.0 + SCATTERS[:, None] ** 2 * square
        each = 0.5 * np.sum(SCATTERS[:, None] ** 2 * along**2 / more - np.log(more), axis=1)
        return bool(each.max() > both)

    def _starts(self, places: IntArray) -> Mask:
        """Return initial divisions: the best of those by each principal axis of the poses' own values."""
        lever = np.sqrt(np.trace(self.inner[:, :, self.own], axis1=1, axis2=2))
        pull = self.inner[:, :, -1] / np.maximum(lever, np.finfo(float).tiny)[:, None]
        starts = []
        for axis in np.linalg.svd(pull - np.median(pull, axis=0), full_matrices=False)[2]:
            order = np.argsort(np.argsort(pull @ axis))
            tried = order >= places[:, None]
            starts.append(tried[int(np.argmin(self.fitted(tried)[0]))])
        return np.stack(starts)

    def _alternated(self, second: Mask, runs: bool = False) -> Mask:
        """Alternate between least squares and the better value of each pose, with a price of every switch between
        neighbouring poses if the values form `runs`: ln n nats."""
        for _ in range(MOST_STEPS):
            total, more, _ = self.fitted(second)
            better = more < 0.0
            if runs:
                switch = 2.0 * np.log(second.shape[1]) * np.maximum(total / self.count, 1.0)
                better = np.stack([_in_runs(*one) for one in zip(more.tolist(), switch.tolist(), strict=True)])
            if (better == second).all():
                break
            second = better
        return second


def _in_runs(more: Sequence[float], switch: float) -> Mask:
    """Return the division with the least sum of `more` over the second rows and of `switch` over the changes of value
    between neighbouring rows (Viterbi 1967)."""
    first, second, before = 0.0, 0.0, list[tuple[bool, bool]]()
    for own in more:
        before.append((second + switch < first, first + switch < second))
        first, second = min(first, second + switch), min(second, first + switch) + own
    at, out = second < first, list[bool]()
    for switched in reversed(before):
        out.append(at)
        at ^= switched[at]
    return np.array(out[::-1], dtype=bool)
