"""What the residual says of a candidate: one projection, a description length, and the chance of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, stats

from gpmodel import identifiability as ident
from gpmodel.basis import ONE, Basis
from gpmodel.calibration import Calibration, Linearised, effect_columns, linearise, solve
from gpmodel.catalogue import Candidate
from gpmodel.dataset import IntArray
from gpmodel.effect import Effect, Term
from gpmodel.mechanism import AXES, Array, Mechanism
from gpmodel.model import Poses
from gpmodel.projection import Targets
from gpmodel.split import folds

OUTLIER_SIGMAS = 6.0
MINIMUM_UNIQUE = 0.02
CHUNK = 256


@dataclass(frozen=True)
class Site:
    """A place where a twist may act: one axis of one slot, or the drive of a joint (several under one unknown)."""

    terms: tuple[tuple[str, str, float], ...]

    @property
    def slot(self) -> str:
        return self.terms[0][0]

    @property
    def axis(self) -> str:
        return self.terms[0][1]

    @property
    def name(self) -> str:
        return f"{self.slot} {self.axis}"

    def effect(self, name: str, basis: Basis, unit: str, family: str = "") -> Effect:
        return Effect(name, tuple(Term(slot, axis, basis, weight) for slot, axis, weight in self.terms), unit, family)


def sites_of(mechanism: Mechanism) -> tuple[Site, ...]:
    """The base, every joint (its own drive first, then the other axes of its moving side), the tool."""
    out = [Site((("base", axis, 1.0),)) for axis in AXES]
    for joint in mechanism.joints:
        out.append(Site(joint.drive))
        slot = f"{joint.name}.moving"
        out += [Site(((slot, axis, 1.0),)) for axis in AXES if axis != joint.drive[0][1]]
    out += [Site((("tool", axis, 1.0),)) for axis in AXES[:3]]
    return tuple(out)


@dataclass(frozen=True)
class Score:
    """gain: share of the residual energy removed; nats: description length saved; share: unique part of the column."""

    gain: float
    nats: float
    share: float


@dataclass(frozen=True)
class Evidence:
    """The training residual of a calibration with everything the model already explains projected out."""

    calibration: Calibration
    poses: Poses
    problem: Linearised
    enabled: Array
    residual: Array
    fold_of_row: IntArray

    @property
    def energy(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def freedom(self) -> int:
        return max(len(self.residual) - self.enabled.shape[1], 1)

    @cached_property
    def rms(self) -> float:
        """3-D RMS of the residual, m."""
        return float(np.sqrt(self.energy / len(np.unique(self.problem.pose_of_row))))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Weighted columns (M, E) of any effects at these poses."""
        blocks = effect_columns(tuple(effects), self.calibration.model, self.poses, self.problem.observed)
        return self.problem.weigh(blocks)

    def projected(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns less what is enabled, and the share (E,) of each that is left; non-finite columns are zero."""
        columns = self.columns(effects)
        columns[:, ~np.isfinite(columns).all(axis=0)] = 0.0
        norms = np.linalg.norm(columns, axis=0)
        alive = norms > ident.NEGLIGIBLE * 1e-3
        left = ident.remove(self.enabled, columns / np.where(alive, norms, 1.0)) * alive
        return left, np.linalg.norm(left, axis=0)

    def nats(self, gain: float | Array, unknowns: int, cost: float) -> float | Array:
        """Description length saved: dof/2 · (-ln(1 - gain)) - unknowns/2 · ln M - cost. Source: Rissanen (1978)."""
        saved = -0.5 * self.freedom * np.log1p(-np.minimum(gain, 1 - 1e-12))
        return saved - 0.5 * unknowns * np.log(len(self.residual)) - cost

    def scores(self, pool: Sequence[Candidate], residuals: Array | None = None) -> tuple[list[Score], Array]:
        """Score of every candidate, and the best nats (B,) that any of them reaches on `residuals` (M, B)."""
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
        u, s, _ = linalg.svd(span * norms * prior, full_matrices=False)

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
        """Residuals (M, count) permuted over the poses, then projected again: what chance looks like."""
        out = np.empty((len(self.residual), count))
        blocks = self._blocks()
        for b in range(count):
            turned = blocks[rng.permutation(len(blocks))]
            rows = turned[self.problem.weights > 0]
            out[:, b] = ident.remove(self.enabled, np.where(np.isfinite(rows), rows, 0.0))
        return out

    def _blocks(self) -> Array:
        blocks = np.zeros(self.problem.weights.shape)
        blocks[self.problem.weights > 0] = self.residual
        return blocks

    def _belief(self, effects: Sequence[Effect]) -> Array:
        """σ / prior (E,) of each effect, zero without one."""
        sigma = np.sqrt(self.energy / self.freedom)
        return np.array([sigma / e.prior for e in effects])

    def targets(self, sites: Sequence[Site], residual: Array | None = None) -> Targets:
        """The same problem for the GP: weight, cross and pull of every site."""
        r = self.residual if residual is None else residual
        n = len(self.poses)
        weight, pull = np.zeros((len(sites), n)), np.zeros((len(sites), n))
        cross = np.zeros((len(sites), self.enabled.shape[1], n))
        effects = [site.effect("", ONE, "") for site in sites]
        columns = self.columns(effects)
        for s in range(len(sites)):
            column = columns[:, s]
            np.add.at(weight[s], self.problem.pose_of_row, column**2)
            np.add.at(pull[s], self.problem.pose_of_row, column * r)
            np.add.at(cross[s].T, self.problem.pose_of_row, column[:, None] * self.enabled)
        alive = weight.sum(axis=1) > 1e-12
        names = tuple(site.name for site in sites)
        return Targets(weight * alive[:, None], cross, pull, float(r @ r), names, len(r), MINIMUM_UNIQUE**2)

    def cross_validated(self, effects: Sequence[Effect]) -> tuple[float, Array, Array]:
        """3-D RMS (m) and squared error per pose (N,) with these effects, refitted in every fold; the coefficients
        (folds, E) of each fold."""
        free = np.concatenate([np.ones(self.problem.placement, dtype=bool), self.calibration.kept])
        extra = self.columns(effects)
        columns = np.hstack([self.problem.columns[:, free], extra])
        scale = np.linalg.norm(columns, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        belief = np.concatenate(
            [self._belief(self.calibration.model.effects)[self.calibration.kept], self._belief(effects)]
        )
        rows = np.diag(np.concatenate([np.zeros(self.problem.placement), belief]) / scale)
        rows = rows[rows.any(axis=1)]
        per_pose = np.zeros(len(self.poses))
        coefficients = []
        for fold in np.unique(self.fold_of_row):
            test = self.fold_of_row == fold
            system = np.vstack([columns[~test] / scale, rows])
            target = np.concatenate([self.residual[~test], np.zeros(len(rows))])
            solved = solve(system, target)
            miss = self.residual[test] - columns[test] / scale @ solved
            np.add.at(per_pose, self.problem.pose_of_row[test], miss**2)
            coefficients.append((solved / scale)[columns.shape[1] - extra.shape[1] :])
        return float(np.sqrt(per_pose.mean())), per_pose, np.array(coefficients)


def gather(calibration: Calibration, poses: Poses, seed: int) -> Evidence:
    """The projected problem at a calibration, with every pose in it; far-out poses are drawn in, not dropped.

    A pose whose error exceeds median + 6 · 1.4826 MAD has its residual shortened to that length.
    """
    use = np.ones(len(poses), dtype=bool)
    problem = linearise(calibration.model, poses, calibration.theta, calibration.placement, calibration.lever, use)
    squared = np.zeros(len(poses))
    np.add.at(squared, problem.pose_of_row, problem.residual**2)
    length = np.sqrt(squared)
    middle = np.median(length)
    limit = middle + OUTLIER_SIGMAS * 1.4826 * float(np.median(np.abs(length - middle)))
    shrink = np.minimum(1.0, limit / np.maximum(length, 1e-12))
    free = np.concatenate([np.ones(problem.placement, dtype=bool), calibration.kept])
    enabled = ident.orthonormal(problem.columns[:, free])
    residual = ident.remove(enabled, problem.residual * shrink[problem.pose_of_row])
    fold = folds(poses.dataset, 10, np.random.default_rng(seed))[problem.pose_of_row]
    return Evidence(calibration, problem.poses, problem, enabled, residual, fold)


def chance(value: float, null: Array) -> float:
    """Probability of reaching `value` by chance from null maxima: the larger of rank count and Gumbel tail.

    The Gumbel law of maxima is fitted by moments: β = s √6 / π, μ = mean - 0.5772 β.
    """
    if len(null) == 0:
        return 1.0
    finite = null[np.isfinite(null)]
    if len(finite) < 3:
        return 0.5
    rank = (1 + np.sum(finite >= value)) / (len(finite) + 1)
    beta = max(float(np.std(finite, ddof=1)) * np.sqrt(6) / np.pi, 1e-6)
    tail = float(stats.gumbel_r.sf(value, finite.mean() - 0.5772 * beta, beta))
    return tail if np.sum(finite >= value) == 0 else float(max(rank, tail))


def canonical_correlation(first: Array, second: Array) -> float:
    """Smallest share in which the span of `first` (M, a) lies inside the span of `second` (M, b)."""
    inside = ident.orthonormal(second).T @ ident.orthonormal(first)
    return float(np.linalg.svd(inside, compute_uv=False).min()) if inside.size else 0.0
