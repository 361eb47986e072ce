"""Divide the rows of a later session between two values of one constant, if the rows were measured with two values.

Rows i with residual r_i have the value a or a + b of a constant with the derivatives C:

    r_i = F_i ρ + C_i (a + g_i b) + noise,   g_i in {0, 1}

Examples are two tools, two loads, a joint with play between two zeros, and a moved instrument.
The division g of the rows alternates between least squares for ρ, a, b and the better value for each row
(classification EM; Celeux and Govaert 1992), from several initial divisions, or one value follows the other. The
division of n rows costs n ln 2 nats, and ln 2n nats if one value follows the other. The alternative is a constant with
a normally distributed value in each row.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

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
from gpmodel.application.recheck import Recheck, recheck, settled
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.formula.expression import Basis, Columns
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Term, effect_at

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
    """

    found: Recheck
    changes: tuple[PossibleChange, ...]
    scattered: bool


def divided(near: Recheck, known: Sequence[PossibleChange] = ()) -> Division | None:
    """Return the most probable division of the rows of a later session between two values of a constant; None if a
    value has too few rows.

    near: residuals of the session. known: changes of the machine that all rows have.
    """
    every = np.ones(len(near.session.use), dtype=bool)
    whole = recheck(replace(near.session, use=every))
    if len(every) < 2 * len(AXES):
        return None
    offered = [*constants(whole), _registration(whole)]
    session, columns = with_changes(whole.session, whole.problem, known)
    problem = session.problem
    fixed = np.hstack([problem.columns[:, session.anew(problem)], problem.columns @ columns])
    sigma = whole.spread.sigma * np.sqrt(1.0 + np.mean(np.sum((whole.spread.u * whole.spread.s) ** 2, axis=1)))
    left, pose, best, found = problem.residual / sigma, problem.pose_of_row, -np.inf, None
    for change in offered:
        rows = _Rows.of(np.hstack([fixed, change.columns]), change.columns, left, pose)
        nats, second = rows.best(whole.freedom)
        nats -= 0.5 * rows.size * np.log(rows.count)
        nats += np.log(SHARES[change.kind] / sum(other.kind == change.kind for other in offered))
        if nats > best:
            best, found = nats, (change, rows, second)
    if found is None:
        return None
    own, rows, second = found
    judged, changes = _judgeable(near, [*known, own, _in_rows(own, whole, second)], second)
    return Division(judged, changes, rows.scattered(second)) if changes else None


def _judgeable(
    near: Recheck, changes: Sequence[PossibleChange], second: Mask
) -> tuple[Recheck, tuple[PossibleChange, ...]]:
    """Exclude the outliers of the model with the changes and two values, and offer two values of every constant that
    the rows of either value determine without any one of them.

    The model has the value of either part of the rows. If the registration absorbs a constant of all rows, the value of
    the smaller part differs.
    """
    session = with_changes(near.session, near.problem, changes)[0]
    names = frozenset(effect.name for change in changes for effect in change.effects)
    start = session.saved.placement if session.tool else None
    use = settled(session.saved, session.poses.dataset, start, names).use
    own = near if (use == near.session.use).all() else recheck(replace(near.session, use=use))
    second = second if _in_sequence(second) or 2 * second.sum() <= len(second) else ~second
    counts = np.bincount(own.problem.pose_of_row, minlength=len(use))
    most = min(int(counts[part].sum() - counts[part].max()) for part in (second, ~second))
    offered = [change for change in (*constants(own), _registration(own)) if change.columns.shape[1] <= most]
    either = {change.name for change in with_shares(own, offered)} if offered else set[str]()
    raw = [_in_rows(change, own, second) for change in offered]
    raw += [_in_rows(change, own, ~second) for change in offered if change.name in either]
    return own, tuple(replace(c, division=_price(second)) for c in with_shares(own, raw)) if raw else ()


def _registration(found: Recheck) -> PossibleChange:
    """Return a motion of the instrument or of the machine's stand, along and about all axes."""
    effects = tuple(effect_at(f"set-up {axis}", STANDING, axis) for axis in AXES)
    columns = found.rows_of(effects)
    return PossibleChange("set-up", SET_UP, "m", columns, effects=effects)


def _in_rows(change: PossibleChange, found: Recheck, second: Mask) -> PossibleChange:
    """Return the change of a constant in the rows `second` only."""
    rows = tuple(found.session.poses.dataset.row[second].tolist())
    effects = tuple(
        replace(e, name=f"{e.name} in {len(rows)} rows", terms=tuple(_term_in_rows(t, rows) for t in e.terms))
        for e in change.effects
    )
    columns = found.rows_of(effects)
    return replace(change, name=_title(change.name, found, second), columns=columns, effects=effects, rows=rows)


def _term_in_rows(term: Term, rows: tuple[int, ...]) -> Term:
    return replace(term, basis=InRows(term.basis, rows))


def _title(name: str, found: Recheck, second: Mask) -> str:
    """Return the name of a constant with the rows of its second value."""
    rows = found.session.poses.dataset.row
    if not _in_sequence(second):
        return f"{name} in {np.count_nonzero(second)} rows ({wording.some(rows[second].tolist())})"
    last = rows[np.flatnonzero(np.diff(second))[0]]
    return f"{name} after row {last}" if second[-1] else f"{name} up to row {last}"


def _price(second: Mask) -> float:
    """Return the logarithm of the number of possible divisions of the rows, nats."""
    return float(np.log(2.0 * len(second)) if _in_sequence(second) else len(second) * np.log(2.0))


def _in_sequence(second: Mask) -> bool:
    return bool(np.count_nonzero(np.diff(second)) == 1)


@dataclass(frozen=True)
class _Rows:
    """Normal equations of each pose. inner: AᵀA of the columns A = [fixed, constant, residual], (poses, m, m).

    The residual is in units of its standard deviation if the model holds. size: number of parameters of the constant.
    count: number of measurements.
    """

    inner: Array
    size: int
    count: int

    @classmethod
    def of(cls, fixed: Array, constant: Array, residual: Array, pose: IntArray) -> "_Rows":
        """Return the normal equations of columns (rows, ...) that are scaled to unit length."""
        columns = np.hstack([fixed, constant])
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        columns = np.column_stack([columns, residual])
        starts, counts = np.unique(pose, return_index=True, return_counts=True)[1:]
        padded = np.zeros((int(pose.max()) + 1, int(counts.max()), columns.shape[1]))
        padded[pose, np.arange(len(pose)) - np.repeat(starts, counts)] = columns
        return cls(np.swapaxes(padded, 1, 2) @ padded, constant.shape[1], len(residual))

    @property
    def own(self) -> slice:
        """Columns of the constant."""
        return slice(self.inner.shape[1] - 1 - self.size, self.inner.shape[1] - 1)

    @property
    def fewest(self) -> int:
        """Least number of rows of a value, so that it is determined without any one of them."""
        return 1 + -(-self.size * len(self.inner) // self.count)

    def fitted(self, second: Mask) -> tuple[Array, Mask, Array]:
        """Return for each division (divisions, poses) the sum of squares, the division by the better value, and the
        difference of the values."""
        m, n, own = self.inner.shape[1] - 1, len(self.inner), self.own
        first, whole = slice(0, m - self.size), self.inner.sum(axis=0)
        part = (second.reshape(-1, n).astype(float) @ self.inner.reshape(n, -1)).reshape(-1, m + 1, m + 1)
        normal = np.empty((len(part), m, m))
        normal[:, first, first] = whole[first, first]
        normal[:, first, own] = part[:, first, own]
        normal[:, own, first] = part[:, own, first]
        normal[:, own, own] = part[:, own, own]
        right = np.concatenate([np.broadcast_to(whole[first, m], (len(part), m - self.size)), part[:, own, m]], axis=1)
        values = (np.linalg.pinv(normal, rcond=1e-11, hermitian=True) @ right[:, :, None])[:, :, 0]
        total = whole[m, m] - np.sum(right * values, axis=1)
        both = np.concatenate([-values, np.ones((len(part), 1))], axis=1)
        with_value = np.einsum("si,nij,sj->sn", both, self.inner, both, optimize=True)
        both[:, own] = 0.0
        without = np.einsum("si,nij,sj->sn", both, self.inner, both, optimize=True)
        return total, np.asarray(with_value < without), values[:, own]

    def best(self, freedom: float) -> tuple[float, Mask]:
        """Return the largest log likelihood of a division less its price, nats, and the division.

        freedom: degrees of freedom of the noise.
        """
        n = len(self.inner)
        places = np.arange(self.fewest, n - self.fewest + 1, max(1, n // MOST_PLACES))
        if not len(places):
            return -np.inf, np.ones(n, dtype=bool)
        tried = np.concatenate([np.arange(n) >= places[:, None], self._alternated(self._starts(places))])
        nats = student(np.maximum(self.fitted(tried)[0], 0.0), self.count, freedom)
        few = np.minimum(tried.sum(axis=1), n - tried.sum(axis=1)) < self.fewest
        nats = np.where(few, -np.inf, nats - [_price(one) for one in tried])
        at = int(np.argmax(nats))
        return float(nats[at]), tried[at]

    def scattered(self, second: Mask) -> bool:
        """Return whether a normal value in each row is more probable than the two values of a division.

        With the standard deviation τ along the difference, and with h and g the residual's product with the difference
        and the difference's square in a row, the log likelihood gains Σ (τ² h² / (1 + τ² g) - ln(1 + τ² g)) / 2.
        """
        values = self._common()
        total, _, difference = self.fitted(second[None])
        both = 0.5 * float(values @ self.inner.sum(axis=0) @ values - total[0]) - _price(second)
        along = self.inner[:, self.own] @ values @ difference[0]
        square = np.einsum("i,nij,j->n", difference[0], self.inner[:, self.own, self.own], difference[0])
        more = 1.0 + SCATTERS[:, None] ** 2 * square
        each = 0.5 * np.sum(SCATTERS[:, None] ** 2 * along**2 / more - np.log(more), axis=1)
        return bool(each.max() > both)

    def _common(self) -> Array:
        """Return the weights of the columns in the residual of a fit with one value of the constant."""
        m, whole = self.inner.shape[1] - 1, self.inner.sum(axis=0)
        return np.append(-np.linalg.pinv(whole[:m, :m], rcond=1e-11, hermitian=True) @ whole[:m, m], 1.0)

    def _starts(self, places: IntArray) -> Mask:
        """Return initial divisions: the best of those by each principal axis of the poses' own values."""
        pull = self.inner[:, self.own] @ self._common()
        lever = np.sqrt(np.trace(self.inner[:, self.own, self.own], axis1=1, axis2=2))
        pull = pull / np.maximum(lever, np.finfo(float).tiny)[:, None]
        starts = []
        for axis in np.linalg.svd(pull - np.median(pull, axis=0), full_matrices=False)[2]:
            order = np.argsort(np.argsort(pull @ axis))
            tried = order >= places[:, None]
            starts.append(tried[int(np.argmin(self.fitted(tried)[0]))])
        return np.stack(starts)

    def _alternated(self, second: Mask) -> Mask:
        """Alternate between least squares and the better value of each pose."""
        for _ in range(MOST_STEPS):
            better = self.fitted(second)[1]
            if (better == second).all():
                break
            second = better
        return second
