"""Find the row from which a table is of another machine: every constant changes there, and nothing simpler does.

r = F θ + g_n C d + noise, with the residual r of the standard model in pose n, its columns F = C, and the step g_n of
the rows. Models are compared by their evidence, with normal priors of d and the most probable noise.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.result import Calibration, problem_at, resolved
from gpmodel.formula.expression import ONE
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.table.blocks import different_poses
from gpmodel.table.dataset import Dataset

PLACED_ANEW, BUILT_ANEW = 1e-2, 1e-3
"""Prior standard deviations of the difference of two registrations and tools, and of two geometric constants, m or rad:
machines are built to a millimetre. Half or double changes the evidence of 45 constants by at most 31 nats."""
NOISES = np.geomspace(0.02, 1.0, 25)
"""Standard deviations of the noise that are compared, relative to the residual of the standard model."""
PLACES, SURPLUS = 60, 1.5
"""Number of evenly spaced rows that are tried first, and least number of values of each machine per constant: fewer
values fit any errors."""
WIDTHS, RATES = (0.15, 0.3, 0.6, 1.2), (0.05, 0.1, 0.2, 0.4)
"""Durations of gradual changes, and time constants of exponential changes, as shares of the rows."""
SLIPS = 3
"""Largest number of joint zeros that change at one row on one machine, as by a collision."""
CLEARLY = 30.0
"""Log evidence, nats, by which two machines exceed every simpler explanation. The prior is worth as much."""
MAJORITY = 0.5
"""Largest variance of the residual with two machines, relative to that of the best simpler explanation. Half or double
changes the verdict on none of 24 simulated tables of two machines and 216 of one."""
ROUNDING = 1e-12
"""Relative eigenvalue below which a combination of changes is rounding error."""


def two_machines(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Yield an error if all rows from one row on are of another machine than the rows before.

    fit: fit of the standard model to the poses. Simpler explanations are: none; set-up, tool and up to three joint
    zeros that change at the row; constants that change gradually with the rows, by a ramp, a parabola or an
    exponential; constants that depend on a joint value, the payload or another column, by a parabola.
    """
    problem = problem_at(fit, resolved(fit, poses))
    if problem.reduced is not None or len(problem.residual) < 2.0 * SURPLUS * problem.columns.shape[1]:
        return
    zeros = [drive_effect(joint.name, joint, ONE) for joint in fit.model.mechanism.joints]
    rows, use = _sound(_Stepped.of(problem, problem.effect_rows(zeros, fit.model)), fit)
    at, model = rows.best_place()
    share = different_poses(poses.dataset) / len(poses)

    def clearly_better_than(other: _Model) -> bool:
        return (model.nats - other.nats) * share > CLEARLY and model.sigma**2 < MAJORITY * other.sigma**2

    nothing = rows.evidence(rows.columns[:, :0], rows.prior[:0])
    if not clearly_better_than(nothing):
        return  # the best simpler explanation has at least its evidence, and at most its noise
    by_columns = rows.by_columns(_columns(poses.dataset.subset(np.flatnonzero(use))))
    best = max((nothing, *rows.changes_at(at), *rows.gradual(at), *by_columns), key=lambda one: one.nats)
    if clearly_better_than(best):
        yield (
            f"from row {poses.dataset.row[use][at]} on, the table is of another machine or state: with separate "
            f"constants from there on, the residual of the standard model is {1e3 * model.sigma:.2g} mm instead of "
            f"{1e3 * nothing.sigma:.2g}, and {1e3 * best.sigma:.2g} with the best other change (a moved set-up, "
            "another tool, moved joint zeros, a drift, an effect of a column); expected one machine: split the table"
        )


@dataclass(frozen=True)
class _Model:
    """Log evidence, nats, noise of a measured coordinate, m, and residual of a model, m."""

    nats: float
    sigma: float
    left: Array


@dataclass(frozen=True)
class _Stepped:
    """Linearised standard model: columns of registration, tool and constants, and their prior standard deviations.

    zeros: columns of the joint zeros. basis: orthonormal basis of the columns. residual: residual of the fit, m. pose:
    pose index of each row. placed: masks of the columns of registrations and of tools.
    """

    columns: Array
    prior: Array
    zeros: Array
    basis: Array
    residual: Array
    pose: IntArray
    placed: tuple[Mask, Mask]

    @classmethod
    def of(cls, problem: Linearised, zeros: Array) -> "_Stepped":
        """Return the rows of all poses."""
        count = problem.columns.shape[1]
        prior = np.where(np.arange(count) < problem.placement, PLACED_ANEW, BUILT_ANEW)
        names = [*problem.placement_names, *[""] * (count - problem.placement)]
        placed = tuple(np.array([n.startswith(w) for n in names], dtype=bool) for w in ("registration", "tool"))
        basis = rank.orthonormal(problem.columns)
        left = rank.remove(basis, problem.residual)
        return cls(problem.columns, prior, zeros, basis, left, problem.pose_of_row, (placed[0], placed[1]))

    @property
    def count(self) -> int:
        """Number of poses."""
        return int(self.pose.max()) + 1

    def subset(self, use: Mask) -> "_Stepped":
        """Return the rows of the poses `use`."""
        own, number = use[self.pose], np.cumsum(use) - 1
        basis = rank.orthonormal(self.columns[own])
        left = rank.remove(basis, self.residual[own])
        return _Stepped(
            self.columns[own], self.prior, self.zeros[own], basis, left, number[self.pose[own]], self.placed
        )

    def evidence(self, columns: Array, prior: Array) -> _Model:
        """Return the evidence of further columns, with σ² the most probable of `NOISES`:

        ln p = -(Σ ln(1 + λ/σ²) + (rᵀr - Σ c² + Σ c²/(1 + λ/σ²)) / σ² + ν ln σ²) / 2

        with the eigenvalues λ and normalised products c of the columns times their prior, and ν degrees of freedom.
        """
        scaled = rank.remove(self.basis, columns) * prior
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        vectors = vectors[:, values > ROUNDING * values.max(initial=0.0)]
        values = values[values > ROUNDING * values.max(initial=0.0)]
        products, squares = vectors.T @ (scaled.T @ self.residual), float(self.residual @ self.residual)
        freedom, own = max(len(self.residual) - self.basis.shape[1], 1), products**2 / values
        noise = NOISES**2 * max(squares, np.finfo(float).tiny) / freedom
        grown = 1.0 + values / noise[:, None]
        unexplained = squares - own.sum() + np.sum(own / grown, axis=1)
        nats = -0.5 * (np.log(grown).sum(axis=1) + unexplained / noise + freedom * np.log(noise))
        k = int(np.argmax(nats))
        left = self.residual - scaled @ (vectors @ (products / (values + noise[k])))
        return _Model(float(nats[k]), float(np.sqrt(noise[k])), left)

    def changed_by(self, *shapes: Array) -> _Model:
        """Return the model in which all constants change with given functions of the pose, (poses,) each."""
        columns = [self.columns * shape[self.pose, None] for shape in shapes]
        return self.evidence(np.hstack(columns), np.tile(self.prior, len(shapes)))

    def best_place(self) -> tuple[int, _Model]:
        """Return the first pose of the second machine, and the model of two machines, of highest evidence."""
        few = int(np.ceil(SURPLUS * self.columns.shape[1] * self.count / len(self.residual)))
        step, last = max(1, self.count // PLACES), max(self.count - few, few)
        at, model = self._best_of(range(few, last + 1, step))
        return (at, model) if step == 1 else self._best_of(range(max(few, at - step), min(last, at + step) + 1))

    def _best_of(self, places: Iterable[int]) -> tuple[int, _Model]:
        models = [(at, self.changed_by(self._step(at))) for at in places]
        return max(models, key=lambda one: one[1].nats)

    def _step(self, at: int) -> Array:
        return (np.arange(self.count) >= at).astype(float)

    def changes_at(self, at: int) -> Iterator[_Model]:
        """Yield models with a change of set-up, tool, both or neither at a pose, and of up to SLIPS joint zeros."""
        late = self._step(at)[self.pose, None]
        zeros, setup, tool = late * self.zeros, *self.placed
        for some in (setup, tool, setup | tool, setup & tool):
            columns, prior = late * self.columns[:, some], self.prior[some]
            yield self.evidence(columns, prior)
            for _ in range(SLIPS):
                prior = np.append(prior, BUILT_ANEW)
                tried = [np.column_stack([columns, zero]) for zero in zeros.T]
                columns = max(tried, key=lambda each: self.evidence(each, prior).nats)
                yield self.evidence(columns, prior)

    def gradual(self, at: int) -> Iterator[_Model]:
        """Yield models in which all constants change gradually: by a ramp about a pose, parabola, or exponential."""
        share = np.arange(self.count) / max(self.count - 1, 1)
        yield from (self.changed_by(np.clip((share - share[at]) / width + 0.5, 0.0, 1.0)) for width in WIDTHS)
        yield from (self.changed_by(np.exp(-share / rate)) for rate in RATES)
        yield self.changed_by(share, share**2)

    def by_columns(self, columns: Iterable[Array]) -> Iterator[_Model]:
        """Yield models in which all constants depend on one column of a table, (poses,), by a line or a parabola."""
        for values in columns:
            if np.isfinite(values).all() and np.ptp(values) > 0:
                scaled = (values - values.min()) / np.ptp(values)
                yield self.changed_by(scaled)
                yield self.changed_by(scaled, scaled**2)


def _sound(rows: _Stepped, fit: Calibration) -> tuple[_Stepped, Mask]:
    """Exclude the outliers of the standard model, then those of two machines; return the rest and its mask of poses."""
    use = ~np.isin(np.arange(rows.count), fit.outliers)
    some = rows.subset(use)
    sizes = np.sqrt(np.bincount(some.pose, some.best_place()[1].left ** 2, some.count))
    use[use] = sizes <= outlier_limit(sizes)
    return rows.subset(use), use


def _columns(data: Dataset) -> list[Array]:
    """Return the joint values, the payload and the further columns of a table."""
    return [*data.q.T, data.payload, *data.extras.values()]
