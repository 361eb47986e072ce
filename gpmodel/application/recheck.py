"""Residuals of a saved model on later poses, whitened so that they are standard normal if the model holds.

With r the measured minus predicted coordinates, F the columns that every session fits again (such as registration), K
the columns of tool and effects, whose values have covariance Σ, and σ the noise of a coordinate:

    r = F ρ + K δ + e,   δ ~ N(0, Σ),   e ~ N(0, σ² I),   V = σ² I + K Σ Kᵀ,   z = Q V^(-1/2) r

If the noise depends on the direction, with the covariance σ² Ω of a position, its coordinates are first multiplied by
Ω^(-1/2). Q projects out the span of V^(-1/2) F. If the model is valid, |z|² is chi-square distributed with M - rank F
degrees of freedom. Since σ is an estimate with ν degrees of freedom, |z|² over its degrees has an F distribution.
Source: Rao (1973), chapter 4a.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.application.extrapolation import extrapolated, rows_of_the_fit
from gpmodel.application.kinematics import REACHED, matched_with_readings, tips, with_model_labels
from gpmodel.application.model_file import SavedModel
from gpmodel.application.predict import batches
from gpmodel.application.usable import check_finite
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.directions import shape_of
from gpmodel.calibration.gauss_newton import without_outliers
from gpmodel.calibration.linearise import Linearised, Weighting, linearise
from gpmodel.calibration.noise import Whitening, blocks_of
from gpmodel.calibration.start import placement_after
from gpmodel.calibration.undeclared import has_functions, uncertain_functions
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Placement, Poses, observe, pose_error, prepare
from gpmodel.model.observation import Observation, observations
from gpmodel.model.observed import Observed
from gpmodel.numerics import rank, se3
from gpmodel.numerics.interval import chance_of_less, chance_of_ratio
from gpmodel.table.blocks import different_poses, sharing
from gpmodel.table.dataset import Dataset

PASSES = 8
"""Largest number of Gauss-Newton steps for a later registration; steps exclude outliers; three steps suffice."""
LEAST_STEP = 1e-12
"""Largest motion of a predicted point, m, in the last Gauss-Newton step. Steps converge quadratically, so that the next
step would be below rounding error; a limit of 1e-8 m would do."""


@dataclass(frozen=True)
class Session:
    """A fitted model with the registration of a later session.

    use: mask of the poses without outliers. fitted: registration and tool of the session of the fit.
    tool: True if the tool point of every tool is fitted again.
    noise_shape: covariance of the coordinates of a position relative to the noise σ²; None for equal noise.
    """

    saved: SavedModel
    poses: Poses
    use: Mask
    fitted: Placement
    noise_shape: Array | None
    tool: bool = False

    @property
    def problem(self) -> Linearised:
        """Linearised measurements of the later poses in registration, tool and all effects, without outliers."""
        saved, weighting = self.saved, Weighting(self.saved.weights, self.use, self.noise_shape)
        return linearise(saved.model, self.poses, saved.theta, saved.placement, weighting)

    @property
    def observed(self) -> Observed:
        """Predicted measurements of every pose of the later session."""
        return observe(self.saved.model, self.poses, self.saved.theta, self.saved.placement)

    @property
    def errors(self) -> Array:
        """3-D distance between measured and predicted point of each later pose, m, also of outliers."""
        return pose_error(self.observed, self.poses.dataset, self.saved.weights)

    def without_outliers(self) -> "Session":
        """Return the session with all poses in use but the outliers of the model."""
        everything = np.ones(len(self.poses), dtype=bool)
        use = without_outliers(self.observed, self.poses.dataset, everything, self.saved.weights)
        return replace(self, use=use)

    def anew(self, problem: Linearised) -> Mask:
        """Return a mask of the columns (parameters) that the later session fits.

        A later session fits registration and stationary objects, and with the tools also the objects on links. Effects
        and lenses keep the model's values.
        """
        kept = () if self.tool else self.saved.placement.tool
        held = {f"{f'tool {label}'.rstrip()} {axis}" for label in kept for axis in AXES}
        for kind, key in kept_by(self.saved, self.poses.dataset):
            held |= {f"{key} {own}" for own in kind.own[key]}
        free = [name not in held or (self.tool and not name.startswith("lens ")) for name in problem.placement_names]
        return np.array(free + [False] * (problem.columns.shape[1] - len(free)), dtype=bool)

    def moved(self, problem: Linearised, step: Array) -> "Session":
        """Return the later session after a step of registration and tool, m and rad, and of the effects."""
        placement = placement_after(problem.observed, self.saved.placement, step[: problem.placement])
        theta = self.saved.theta + step[problem.placement :]
        return replace(self, saved=replace(self.saved, placement=placement, theta=theta))


def kept_by(saved: SavedModel, dataset: Dataset) -> list[tuple[Observation, str]]:
    """Return, by instrument of a dataset, the unknowns that persist between sessions and are in the model."""
    known, there = set(saved.covariance.placement), saved.placement.anchors
    return [
        (kind, key)
        for kind in observations(dataset)
        for key in kind.kept
        if key in there and all(f"{key} {own}" in known for own in kind.own[key])
    ]


def _noise_shape(saved: SavedModel, dataset: Dataset) -> Array | None:
    """Return the covariance of a position's coordinates relative to the noise σ², by which the model was fitted or else
    by its residuals; None if the noise is equal, or a later table `dataset` has another kind of measurement."""
    fit = rows_of_the_fit(saved, saved.placement)
    if saved.noise_shape is not None or fit is None or fit.observed.kinds[0].name != observations(dataset)[0].name:
        return saved.noise_shape
    return shape_of(fit)


def settled(saved: SavedModel, dataset: Dataset, whole: SavedModel | None = None) -> Session:
    """Fit the registration of later poses to a model; its other parameters are unchanged.

    saved: model of effects that apply later. whole: the model with all effects of its fit, if not `saved`. Raises
    InputError as `matched_with_readings`, for an unknown tool, and for fewer than three poses of a set-up.
    """
    fitted, setups = saved.placement, dict.fromkeys(dataset.label("setup").tolist(), np.eye(4))
    whole = whole or saved
    saved = replace(saved, placement=replace(saved.placement, registration=setups))
    dataset = matched_with_readings(saved, dataset)
    poses = prepare(saved.mechanism, dataset)
    check_finite(saved, poses)
    use = np.ones(len(dataset), dtype=bool)
    return refitted(Session(_placed(saved, dataset), poses, use, fitted, _noise_shape(whole, dataset)))


def refitted(session: Session, effects: frozenset[str] = frozenset()) -> Session:
    """Fit the parameters of a later session, at first to all poses, by Gauss-Newton steps that exclude outliers.

    effects: names of the effects that are fitted too.
    """
    fitted = [effect.name in effects for effect in session.saved.model.effects]
    session = replace(session, use=np.ones(len(session.use), dtype=bool))
    for _ in range(PASSES):
        problem, before = session.problem, session.use
        free, step = session.anew(problem), np.zeros(problem.columns.shape[1])
        free[problem.placement :] = fitted
        step[free] = np.linalg.lstsq(problem.columns[:, free], problem.residual, rcond=1e-12)[0]
        session = session.moved(problem, step).without_outliers()
        if (session.use == before).all() and np.abs(problem.columns @ step).max() < LEAST_STEP:
            break
    return session


def _placed(saved: SavedModel, dataset: Dataset) -> SavedModel:
    """Return the model with an initial registration, by Kabsch's method from predicted points."""
    root = tips(saved, dataset, nominal=False)[1].tip
    measured = np.isfinite(dataset.position).all(axis=1)
    registration = dict(saved.placement.registration)
    for name in registration if measured.any() else ():
        rows = measured & (dataset.label("setup") == name)
        if rows.sum() < 3:
            where = f"{dataset.source}, setup '{name}'" if name else dataset.source
            raise InputError(f"{where}: {rows.sum()} poses with x, y and z; registration needs at least 3")
        registration[name] = se3.frame(*se3.fit_rotation(root[rows, :3, 3], dataset.position[rows]))
    kept = {key: saved.placement.anchors[key] for _, key in kept_by(saved, dataset)}
    return replace(saved, placement=Placement(registration, saved.placement.tool, kept))


def errors_at(session: Session, dataset: Dataset) -> Array:
    """Return the 3-D distance, m, of points of a table from a model's predictions, in a session's registration.

    Raises InputError for an unknown set-up or tool, or an input that is missing or in another unit.
    """
    saved = session.saved
    poses, parts = prepare(saved.mechanism, with_model_labels(saved, dataset)), []
    for rows in batches(len(poses)):
        part = poses.subset(rows)
        parts.append(pose_error(observe(saved.model, part, saved.theta, saved.placement), part.dataset, saved.weights))
    return np.concatenate(parts)


NORMAL = 3.0
"""Kurtosis of a normal distribution (fourth moment over squared variance)."""
LEAST_POSES, LEAST_FREEDOM = 4, 6
"""Least number of different poses and of degrees of freedom to test a model: those of four registered points."""


@dataclass(frozen=True)
class Spread:
    """Covariance V = σ² (I + U s² Uᵀ), σ noise, U orthonormal. Repeats of a pose are averaged to one row."""

    sigma: float
    u: Array
    s: Array

    def whiten(self, values: Array) -> Array:
        """Return values whitened by the inverse root of the covariance V."""
        factor = (1.0 - 1.0 / np.sqrt(1.0 + self.s**2)).reshape(-1, *[1] * (values.ndim - 1))
        return (values - self.u @ (factor * (self.u.T @ values))) / self.sigma


@dataclass(frozen=True)
class Recheck:
    """Whitened residuals of a later session.

    z: whitened residual. basis: orthonormal basis of the columns that are projected out of z.
    pose_id: label of every pose, equal for repeats. pose: pose index of every row.
    freedom: degrees of freedom of the noise σ.
    anew: names of the parameters that the session fits.
    """

    session: Session
    problem: Linearised
    blocks: Whitening
    spread: Spread
    z: Array
    basis: Array
    pose_id: IntArray
    pose: IntArray
    freedom: float
    anew: tuple[str, ...]

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the chi-square |z|² of the whitened residual z."""
        return len(self.z) - int(self.basis.shape[1])

    @property
    def chi_square(self) -> float:
        """Chi-square statistic |z|² of the whitened residual z."""
        return float(self.z @ self.z)

    @property
    def chance(self) -> float:
        """Probability of a chi-square at least as large as |z|² if the model is valid."""
        return chance_of_ratio(self.chi_square / self.degrees, *self._as_many)

    @property
    def chance_of_less(self) -> float:
        """Probability of a chi-square at most as large as |z|² if the model is valid and has the noise of the fit."""
        return chance_of_less(self.chi_square / self.degrees, *self._as_many)

    @property
    def _as_many(self) -> tuple[float, float]:
        """Effective degrees of freedom of the chi-square |z|² and of the noise σ.

        A sum of squares of errors with kurtosis κ has 2 / (κ - 1) times the degrees of freedom of normal errors (Box
        1953).
        """
        squares = self.z**2
        kurtosis = np.mean(squares**2) / max(float(np.mean(squares)) ** 2, np.finfo(float).tiny)
        share = 2.0 / (max(float(kurtosis), NORMAL) - 1.0)
        return share * self.degrees, share * self.freedom

    @cached_property
    def by_pose(self) -> tuple[Array, Array]:
        """Expected RMS 3-D error of every later pose, m, and the p-value of the actual error if the model is valid.

        The residual of the fitted registration has the covariance (I - P) V (I - P), with P the projection onto the
        columns of the registration. The expected error is NaN for excluded poses.
        """
        promised, chance = (np.full(len(self.pose_id), np.nan) for _ in range(2))
        placed = rank.orthonormal(self.blocks.means(self.problem.columns[:, self.session.anew(self.problem)]))
        left = rank.remove(placed, self.blocks.means(self.problem.residual))
        own = rank.remove(placed, self.spread.u) * self.spread.s
        turns, component = self._turns, self._component
        of_row = self.problem.pose_of_row[self.blocks.first]
        for code in np.unique(self.pose):
            rows = np.flatnonzero(self.pose == code)
            inside = np.eye(len(rows)) - placed[rows] @ placed[rows].T + own[rows] @ own[rows].T
            covariance = self.spread.sigma**2 * inside
            root = self.problem.coordinates(of_row[rows[0]], component[rows])
            unlikely = float(left[rows] @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ left[rows])
            here = (self.pose_id == code) & self.session.use
            promised[here] = np.sqrt(np.sum(np.diag(root @ covariance @ root.T)[~turns[rows]]))
            chance[here] = chance_of_ratio(unlikely / len(rows), len(rows), self.freedom)
        return promised, chance

    @property
    def _turns(self) -> Mask:
        """Mask of the rows of the linear problem that are angles."""
        if self.problem.reduced is not None:
            return np.zeros(len(self.z), dtype=bool)
        return np.asarray(self.problem.observed.turns[self._component])

    @property
    def _component(self) -> IntArray:
        """Component of every row; 3, as of no position, if unmeasured joints were eliminated."""
        if self.problem.reduced is not None:
            return np.full(len(self.z), 3)
        return np.asarray(np.nonzero(self.problem.weights > 0)[1][self.blocks.first])

    def rows_of(self, effects: Sequence[Effect]) -> Array:
        """Return the weighted derivatives of the measured rows with respect to the coefficient of each effect.

        `Linearised.effect_rows` omits the part of an instrument's error that a tool absorbs; a later session keeps the
        tool of the model.
        """
        return self.problem.derivatives(effects, self.session.saved.model)

    def whitened(self, columns: Array) -> Array:
        """Return whitened columns of the linear problem, with the session's fitted columns projected out."""
        return rank.remove(self.basis, self.spread.whiten(self.blocks.means(columns)))

    def without(self, columns: Array) -> "Recheck":
        """Project further whitened columns out of the whitened residuals."""
        more = rank.orthonormal(columns)
        return replace(self, z=rank.remove(more, self.z), basis=np.hstack([self.basis, more]))


def recheck(session: Session) -> Recheck:
    """Compute the whitened residuals of a later session; raise InputError for too few poses."""
    problem, saved = session.problem, session.saved
    pose_id = sharing(session.poses.dataset)
    blocks = blocks_of(problem, pose_id)
    free, at = session.anew(problem), in_covariance(saved, problem)
    known = ~free & (at >= 0)
    sigma = max(saved.spread, REACHED)
    rows, (functions, made_up) = blocks.means(problem.columns), _functions(session, problem)
    own = -blocks.means(made_up)
    own[:, at[known]] += rows[:, known]
    own = np.hstack([own, blocks.means(problem.effect_rows(saved.covariance.alternatives, saved.model))])
    beyond = extrapolated(saved, session.fitted, problem)
    unsure = [own @ rank.square_root(saved.covariance.predictive), blocks.means(functions), blocks.means(beyond)]
    u, s, _ = np.linalg.svd(np.hstack(unsure) / sigma, full_matrices=False)
    spread = Spread(sigma, u, s)
    placed = spread.whiten(rows[:, free])
    basis = rank.orthonormal(placed)
    z = rank.remove(basis, spread.whiten(blocks.means(problem.residual)))
    names = tuple(name for name, own in zip(problem.placement_names, free, strict=False) if own)
    pose = pose_id[problem.pose_of_row[blocks.first]]
    found = Recheck(session, problem, blocks, spread, z, basis, pose_id, pose, saved.freedom, names)
    count = different_poses(session.poses.dataset)
    if found.degrees < LEAST_FREEDOM or count < LEAST_POSES:
        raise InputError(
            f"{session.poses.dataset.source}: {count} different poses are too few to test the model after the "
            f"registration; expected at least {LEAST_POSES} poses"
        )
    return found


def _functions(session: Session, problem: Linearised) -> tuple[Array, Array]:
    """Return the effect of uncertain undeclared functions on the session's rows; empty without undeclared functions."""
    saved = session.saved
    fitted = rows_of_the_fit(saved, session.fitted) if has_functions(saved.model) else None
    if fitted is None:
        return np.zeros((len(problem.residual), 0)), np.zeros((len(problem.residual), len(saved.covariance.values)))
    return uncertain_functions(saved.model, fitted, saved.theta, problem)


def in_covariance(saved: SavedModel, problem: Linearised) -> IntArray:
    """Return for each column of the linear problem its position in the model's covariance, -1 if it has none."""
    names = saved.covariance.placement
    placed = [names.index(name) if name in names else -1 for name in problem.placement_names]
    variances = np.diag(saved.covariance.values)[len(names) :]
    effects = np.full(len(saved.model.effects), -1)
    effects[np.flatnonzero(variances)] = len(names) + np.flatnonzero(variances)
    return np.concatenate([np.array(placed, dtype=np.int64), effects]).astype(np.int64)
