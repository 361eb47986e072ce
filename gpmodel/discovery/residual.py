"""What the residual says of a candidate: one projection, a description length, and the chance of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauss_newton import Calibration, beliefs
from gpmodel.calibration.linearise import Linearised, effect_columns, linearise
from gpmodel.evolution.constants import LARGEST
from gpmodel.evolution.projection import Targets
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import ONE
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import Site
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import MANY_COLUMNS, factored, solve
from gpmodel.table.split import folds

OUTLIER_SIGMAS = 6.0
MINIMUM_UNIQUE = 0.02
CHUNK = 256


@dataclass(frozen=True)
class Score:
    """gain: share of the residual energy removed; nats: description length saved; share: unique part of the column."""

    gain: float
    nats: float
    share: float


@dataclass(frozen=True)
class Evidence:
    """The training residual of a calibration with everything the model already explains projected out.

    Effects with priors are rows too, θ σ / prior = 0, below the M measured ones: what they explain is taken out as
    far as their priors let them, no further. enabled: (M + B, K) orthonormal columns of the model. residual: (M + B,).
    system, target: the columns (M + B, K') and right side these came from.
    drawn_in: (N,) poses whose residual was shortened.
    """

    calibration: Calibration
    poses: Poses
    problem: Linearised
    system: Array
    target: Array
    enabled: Array
    residual: Array
    fold_of_row: IntArray
    drawn_in: Mask

    @property
    def measured(self) -> int:
        """M, rows that were measured."""
        return len(self.fold_of_row)

    @property
    def energy(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def freedom(self) -> int:
        return max(len(self.residual) - self.enabled.shape[1], 1)

    @cached_property
    def rms(self) -> float:
        """3-D RMS of the residual, m."""
        return float(np.linalg.norm(self.residual[: self.measured]) / np.sqrt(len(np.unique(self.problem.pose_of_row))))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Weighted columns (M, E) of any effects at these poses."""
        blocks = effect_columns(tuple(effects), self.calibration.model, self.poses, self.problem.observed)
        return self.problem.weigh(blocks)

    def projected(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns (M + B, E) less what is enabled, and the share (E,) of each left; zero where past numbers."""
        with np.errstate(all="ignore"):
            columns = self.columns(effects)
        columns[:, ~(np.abs(columns) < LARGEST).all(axis=0)] = 0.0
        norms = np.linalg.norm(columns, axis=0)
        alive = norms > ident.NEGLIGIBLE * 1e-3
        padded = np.zeros((len(self.residual), len(norms)))
        padded[: self.measured] = columns / np.where(alive, norms, 1.0)
        left = ident.remove(self.enabled, padded) * alive
        return left, np.linalg.norm(left, axis=0)

    def poses_at_work(self, effects: Sequence[Effect]) -> Array:
        """At how many poses each effect (E,) says what nothing enabled says: (Σ e)² / Σ e², e its energy per pose.

        One where all of it sits at a single pose, N where all poses share alike.
        """
        left = self.projected(effects)[0][: self.measured] ** 2
        energy = np.zeros((len(self.poses), left.shape[1]))
        np.add.at(energy, self.problem.pose_of_row, left)
        return energy.sum(axis=0) ** 2 / np.maximum(np.sum(energy**2, axis=0), 1e-300)

    def beside(self, effects: Sequence[Effect]) -> "Evidence":
        """The evidence when these effects, without priors, are in the model as well."""
        left, _ = self.projected(effects)
        span = ident.orthonormal(left)
        extra = np.zeros((len(self.target), len(effects)))
        extra[: self.measured] = self.columns(effects)
        scale = np.linalg.norm(extra, axis=0)
        system = np.hstack([self.system, extra / np.where(scale > 0, scale, 1.0)])
        residual = ident.remove(span, self.residual)
        return replace(self, system=system, enabled=np.hstack([self.enabled, span]), residual=residual)

    def nats(self, gain: float | Array, unknowns: int, cost: float) -> float | Array:
        """Description length saved: dof/2 · (-ln(1 - gain)) - unknowns/2 · ln M - cost. Source: Rissanen (1978)."""
        saved = -0.5 * self.freedom * np.log1p(-np.minimum(gain, 1 - 1e-12))
        return saved - 0.5 * unknowns * np.log(self.measured) - cost

    def scores(self, pool: Sequence[Candidate], residuals: Array | None = None) -> tuple[list[Score], Array]:
        """Score of every candidate, and the best nats (T,) that any of them reaches on `residuals` (M + B, T)."""
        trials = np.zeros((len(self.residual), 0)) if residuals is None else residuals
        energies = np.sum(trials**2, axis=0)
        best = np.full(trials.shape[1], -np.inf)
        out: list[Score] = []
        for start in range(0, len(pool), CHUNK):
            part = pool[start : start + CHUNK]
            left, shares = self.projected([e for c in part for e in c.effects])
            at = 0
            for candidate in part:
                k = len(candidate.effects)
                span, share = left[:, at : at + k], shares[at : at + k]
                at += k
                if share.max() < MINIMUM_UNIQUE:
                    out.append(Score(0.0, -np.inf, float(share.max())))
                    continue
                if np.isfinite(candidate.effects[0].prior):
                    score, chance_nats = self._believed(candidate, span, trials, energies)
                    out.append(Score(*score, float(share.min())))
                    best = np.maximum(best, chance_nats)
                    continue
                q = ident.orthonormal(span) if k > 1 else span / share
                gain = float(np.sum((q.T @ self.residual) ** 2) / self.energy)
                out.append(Score(gain, float(self.nats(gain, k, candidate.cost)), float(share.min())))
                gains = np.sum((q.T @ trials) ** 2, axis=0) / energies
                best = np.maximum(best, self.nats(gains, k, candidate.cost))
        return out, best

    def _believed(
        self, candidate: Candidate, span: Array, trials: Array, energies: Array
    ) -> tuple[tuple[float, float], Array]:
        """Gain and nats of effects with priors, by their marginal likelihood: the priors pay for the unknowns.

        With columns times priors U s Vᵀ and f = s² / (s² + σ²):  E = r·r - Σ f (u·r)²,
        nats = dof/2 ln(r·r / E) - ½ Σ ln(1 + s²/σ²) - cost. Source: MacKay (1992), evidence.
        """
        norms = np.linalg.norm(self.columns(candidate.effects), axis=0)
        prior = np.array([e.prior for e in candidate.effects])
        weighted = span * norms * prior
        squares, turn = linalg.eigh(weighted.T @ weighted)
        s = np.sqrt(np.maximum(squares, 1e-12 * squares[-1]))
        u = weighted @ (turn / s)

        def evidence(parts: Array, energy: Array, sigma2: Array) -> tuple[Array, Array]:
            factor = s[:, None] ** 2 / (s[:, None] ** 2 + sigma2)
            left = energy - np.sum(factor * parts, axis=0)
            volume = 0.5 * np.sum(np.log1p(s[:, None] ** 2 / sigma2), axis=0)
            return left, 0.5 * self.freedom * np.log(energy / left) - volume - candidate.cost

        own, energy = (u.T @ self.residual[:, None]) ** 2, np.array([self.energy])
        left, nats = evidence(own, energy, energy / self.freedom)
        for _ in range(5):
            left, nats = evidence(own, energy, left / self.freedom)
        by_chance = evidence((u.T @ trials) ** 2, energies, energies / self.freedom)[1]
        return (float(1 - left[0] / self.energy), float(nats[0])), by_chance

    def shuffled(self, rng: np.random.Generator, count: int) -> Array:
        """Residuals (M + B, count) permuted over the poses, then projected again: what chance looks like."""
        out = np.repeat(self.residual[:, None], count, axis=1)
        blocks = self._blocks()
        for b in range(count):
            turned = blocks[rng.permutation(len(blocks))]
            rows = turned[self.problem.weights > 0]
            out[: self.measured, b] = np.where(np.isfinite(rows), rows, 0.0)
        return ident.remove(self.enabled, out)

    def _blocks(self) -> Array:
        blocks = np.zeros(self.problem.weights.shape)
        blocks[self.problem.weights > 0] = self.residual[: self.measured]
        return blocks

    def _belief(self, effects: Sequence[Effect]) -> Array:
        """σ / prior (E,) of each effect, zero without one."""
        sigma = np.sqrt(self.energy / self.freedom)
        return np.array([sigma / e.prior for e in effects])

    def targets(self, sites: Sequence[Site], rows: IntArray) -> Targets:
        """The same problem for the GP, at some poses: weight, cross and pull of every site, energy in proportion."""
        effects = [site.effect("", ONE, "") for site in sites]
        columns = self.columns(effects)
        weight = self._by_pose(columns**2, rows)
        enabled = self.enabled[: self.measured]
        cross = np.stack([_compact(self._by_pose(columns[:, [s]] * enabled, rows)) for s in range(len(sites))])
        alive = weight.sum(axis=1) > 1e-12
        names = tuple(site.name for site in sites)
        blank = Targets(
            weight * alive[:, None], cross, np.zeros(weight.shape), 0.0, names,
            int(len(self.residual) * len(rows) / len(self.poses)), MINIMUM_UNIQUE**2,
        )  # fmt: skip
        return self.aimed(blank, sites, rows, self.residual)

    def aimed(self, targets: Targets, sites: Sequence[Site], rows: IntArray, residual: Array) -> Targets:
        """The targets of another residual (M + B,) at the same poses."""
        columns = self.columns([site.effect("", ONE, "") for site in sites])
        pull = self._by_pose(columns * residual[: self.measured, None], rows)
        share = len(rows) / len(self.poses)
        return replace(targets, pull=pull, energy=float(residual @ residual) * share)

    def _by_pose(self, values: Array, rows: IntArray) -> Array:
        """Sums (C, len(rows)) of the values (M, C) of each of some poses."""
        out = np.zeros((len(self.poses), values.shape[1]))
        present, first = np.unique(self.problem.pose_of_row, return_index=True)
        out[present] = np.add.reduceat(values, first, axis=0)
        return out[rows].T

    def cross_validated(self, effects: Sequence[Effect]) -> tuple[float, Array, Array]:
        """3-D RMS (m) and squared error per pose (N,) with these effects, refitted in every fold; the coefficients
        (folds, E) of each fold."""
        extra = self.columns(effects)
        scale = np.linalg.norm(extra, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        extra, belief = extra / scale, self._belief(effects) / scale
        refit = self._updated if self.system.shape[1] + extra.shape[1] >= MANY_COLUMNS else self._refitted
        per_pose = np.zeros(len(self.poses))
        coefficients = []
        for k, fold in enumerate(np.unique(self.fold_of_row)):
            test = self.fold_of_row == fold
            old, new = refit(k, test, extra, belief)
            miss = self.target[: self.measured][test] - self.system[: self.measured][test] @ old - extra[test] @ new
            np.add.at(per_pose, self.problem.pose_of_row[test], miss**2)
            coefficients.append(new / scale)
        return float(np.sqrt(per_pose.mean())), per_pose, np.array(coefficients)

    def better_by(self, effects: Sequence[Effect], others: Sequence[Effect] = ()) -> float:
        """Standard deviations by which effects predict better than others, pose by pose in cross-validation."""
        return deviations(self.cross_validated(others)[1] - self.cross_validated(effects)[1])

    def _refitted(self, k: int, test: Mask, extra: Array, belief: Array) -> tuple[Array, Array]:
        """Coefficients of the system and of the extra columns, solved together without the tested rows."""
        count = self.system.shape[1]
        keep = np.concatenate([~test, np.ones(len(self.target) - self.measured, dtype=bool)])
        padded = np.vstack([extra, np.zeros((len(self.target) - self.measured, extra.shape[1]))])
        rows = np.hstack([np.zeros((len(belief), count)), np.diag(belief)])[belief > 0]
        system = np.vstack([np.hstack([self.system, padded])[keep], rows])
        solved = solve(system, np.concatenate([self.target[keep], np.zeros(len(rows))]))
        return solved[:count], solved[count:]

    def _updated(self, k: int, test: Mask, extra: Array, belief: Array) -> tuple[Array, Array]:
        """The same from each fold's factored normal equations, by block elimination of the extra columns."""
        factor, base = self._folded[k]
        top, right = self.system[: self.measured][~test], self.target[: self.measured][~test]
        between = top.T @ extra[~test]
        solved = linalg.cho_solve(factor, between, check_finite=False)
        inner = extra[~test].T @ extra[~test] + np.diag(belief**2) - between.T @ solved
        new = linalg.lstsq(inner, extra[~test].T @ right - between.T @ base, cond=1e-12)[0]
        return base - solved @ new, new

    @cached_property
    def _folded(self) -> list[tuple[tuple[Array, bool], Array]]:
        """For every fold: the factored normal equations of the system without it, and their solution."""
        gram, pull = self.system.T @ self.system, self.system.T @ self.target
        out = []
        for fold in np.unique(self.fold_of_row):
            test = np.flatnonzero(self.fold_of_row == fold)
            part, right = self.system[test], self.target[test]
            factor = factored(gram - part.T @ part)
            out.append((factor, linalg.cho_solve(factor, pull - part.T @ right, check_finite=False)))
        return out


def deviations(gain: Array) -> float:
    """The mean of a gain (N,) in standard deviations of that mean; 0 where all are equal."""
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    return float(gain.mean()) / spread if spread > 0 else 0.0


def _compact(cross: Array) -> Array:
    """Rows (min(K, N), N) with the same BᵀB as `cross` (K, N)."""
    return (
        cross if len(cross) <= cross.shape[1] else linalg.qr(cross, mode="r", check_finite=False)[0][: cross.shape[1]]
    )


def gather(
    calibration: Calibration, poses: Poses, seed: int, without: Sequence[Effect] = (), trusted: Mask | None = None
) -> Evidence:
    """The projected problem at a calibration, with every pose in it; far-out poses are drawn in, not dropped.

    without: effects of the model whose part is given back to the residual, as if they were not in it. A pose whose
    error exceeds median + 6 · 1.4826 MAD has its residual shortened to that length.
    """
    use = np.ones(len(poses), dtype=bool)
    problem = linearise(calibration.model, poses, calibration.theta, calibration.placement, calibration.lever, use)
    squared = np.zeros(len(poses))
    np.add.at(squared, problem.pose_of_row, problem.residual**2)
    length = np.sqrt(squared)
    middle = np.median(length)
    limit = middle + OUTLIER_SIGMAS * 1.4826 * float(np.median(np.abs(length - middle)))
    shrink = np.minimum(1.0, limit / np.maximum(length, 1e-12))
    if trusted is not None:
        shrink[trusted] = 1.0
    returned = np.isin([e.name for e in calibration.model.effects], [e.name for e in without])
    shortened = problem.residual * shrink[problem.pose_of_row]
    shortened = shortened + problem.columns[:, problem.placement :][:, returned] @ calibration.theta[returned]
    kept = calibration.kept & ~returned
    free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
    belief, pull = beliefs(calibration.model, calibration.theta, problem, kept)
    system, target = np.vstack([problem.columns[:, free], belief[:, free]]), np.concatenate([shortened, pull])
    scale = np.linalg.norm(system, axis=0)
    system /= np.where(scale > 0, scale, 1.0)
    enabled = _spanned(system, np.any(belief[:, free] != 0, axis=0))
    residual = ident.remove(enabled, target)
    fold = folds(poses.dataset, 10, np.random.default_rng(seed))[problem.pose_of_row]
    return Evidence(calibration, problem.poses, problem, system, target, enabled, residual, fold, shrink < 1.0)


def _spanned(system: Array, believed: Mask) -> Array:
    """Orthonormal basis of unit columns (M + B, K): those without priors decided by rank, the believed by Cholesky."""
    plain = ident.orthonormal(system[:, ~believed])
    if not believed.any():
        return plain
    rest = ident.remove(plain, system[:, believed])
    upper, _ = factored(rest.T @ rest)
    return np.hstack([plain, linalg.solve_triangular(upper, rest.T, trans="T", check_finite=False).T])
