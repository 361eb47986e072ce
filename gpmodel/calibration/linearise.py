"""Linearise the measurements at one point: residuals and derivatives with respect to every parameter, weighted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.start import placement_columns
from gpmodel.calibration.unmeasured_joints import (
    TRUNCATION,
    Complement,
    complement,
    free_joints,
    joint_columns,
    observable,
    prior_sigmas,
    solve_joints,
    without_eliminated,
)
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Mechanism, places
from gpmodel.model.effect import REGISTRATION, Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe
from gpmodel.model.observation import Weights
from gpmodel.model.observed import Observed
from gpmodel.numerics import rank as ident

LEAST_ERROR = 1e-6
"""Smallest error of approximate joint values, in units of their prior standard deviation: 3.6 milliarcseconds."""
LEAST_SIGMA = 1e-12
"""Smallest standard deviation of the noise, m: below the rounding of every table."""
ROUNDING = 1e-14
"""Fisher information added to every parameter to stabilise an eigenvalue problem, which has information 1."""


@dataclass(frozen=True)
class JointReadings:
    """Linear equations for approximate joint values in the table, in units of their prior standard deviations.

    rows, off: left and right side of the equations, zero along joint directions that no pose determines.
    determined: number of joint directions that the measurements determine.
    """

    rows: Array
    off: Array
    determined: int

    def error(self, used: int = 0) -> float:
        """Return the RMS error τ of approximate joint values, less `used` degrees of freedom."""
        return max(float(np.sqrt(np.sum(self.off**2) / max(self.determined - used, 1))), LEAST_ERROR)

    def informative(self, informed: Array, sigma: float) -> Array:
        """Return combinations of approximate joint values that determine some unknown better than the measurements do.

        informed: rows C of measurements and priors, each with standard deviation σ = `sigma`. With R the rows of the
        joint values, τ their error and v the generalised eigenvectors of RᵀR / τ² and RᵀR / τ² + CᵀC / σ² whose
        eigenvalue exceeds one half, the combinations are R v, scaled to unit length.
        """
        told, read = informed / max(sigma, LEAST_SIGMA), self.rows / self.error()
        scale = np.sqrt(np.sum(told**2, axis=0) + np.sum(read**2, axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        told, read = told / scale, read / scale
        inner = read.T @ read
        both = inner + told.T @ told + ROUNDING * np.eye(len(scale))
        share, vectors = linalg.eigh(inner, both, check_finite=False)
        more = share > 0.5
        return np.asarray(read @ vectors[:, more] / np.sqrt(share[more]))


def joint_readings(
    mechanism: Mechanism, observed: Observed, off: Array, columns: Array, weights: Array
) -> JointReadings:
    """Return the linear equations for the approximate joint values at every pose.

    off: joint values of the table minus joint values solved from measurements, rad, m. columns: derivatives C of the
    measurements with respect to all parameters, weighted. weights: weight of each measurement, zero if the measurement
    is missing or not used.

    U S Vᵀ are the weighted sensitivities of one pose to its unmeasured joints, in units of `prior_sigmas`. A step of
    the parameters moves the best-fitting joint values by -V S⁺ Uᵀ C step. The joint values in the table differ from the
    solved values by errors ~ N(0, τ²), so that

        R · step ≈ q_table - q_solved        R = -V S⁺ Uᵀ C, ± τ along the directions of V that the pose determines

    Joint values are used only for unknowns that the measurements determine less well, such as the rotation of a ball
    about its centre. τ is estimated from the differences between the solved joint values and the table.
    """
    free, sigma = list(free_joints(mechanism)), prior_sigmas(mechanism)
    u, s, vt = np.linalg.svd(joint_columns(mechanism, observed) * weights[:, :, None] * sigma, full_matrices=False)
    shown = s > TRUNCATION * np.maximum(s[:, :1], 1e-300)
    inverse = np.where(shown, 1.0 / np.where(shown, s, 1.0), 0.0)
    moved = -np.einsum("nkj,nk,nik,nip->njp", vt, inverse, u, columns, optimize=True)
    seen = np.einsum("nki,nk,nkj,nj->ni", vt, shown, vt, off[:, free] / sigma, optimize=True)
    return JointReadings(moved.reshape(-1, columns.shape[2]), seen.ravel(), int(shown.sum()))


@dataclass(frozen=True)
class Linearised:
    """Linearised least-squares problem: columns · step ≈ residual, in metres; one row per measured component.

    The first `placement` columns are registration, tool and ends of distances; further columns are the model's effects.
    pose_of_row: pose index of each row. placement_names: names of the first `placement` columns.
    observed: predicted measurements of all poses.
    poses: table of the poses, with solved values of unmeasured joints.
    sizes: norms of the weighted columns before elimination of unmeasured joints.
    weights: weight by pose and component, positive if measured; m per unit.
    equal: matrices (poses, 3, 3) that combine the coordinates of each position so that their noise is equal; None if
    the noise does not depend on the direction.
    reduced: rows after elimination of unmeasured joints; None if every joint is measured.
    ratio: noise over the prior standard deviation of a constant, 1/m; None if noise or deviation is unknown.
    """

    columns: Array
    residual: Array
    pose_of_row: IntArray
    placement: int
    placement_names: tuple[str, ...]
    observed: Observed
    poses: Poses
    sizes: Array
    weights: Array
    equal: Array | None = None
    reduced: "Reduction | None" = None
    ratio: float | None = None

    def free(self, kept: Mask) -> Mask:
        """Return a mask of the columns of registration and tool, and of the fitted effects `kept`."""
        return np.concatenate([np.ones(self.placement, dtype=bool), kept])

    def coordinates(self, pose: int, components: IntArray) -> Array:
        """Return the matrix that turns the rows of one pose, of the given components, into measured components.

        The matrix is L for coordinates whose rows are multiplied by L⁻¹, and the unit matrix for other components.
        """
        out, own = np.eye(len(components)), components < 3
        if self.equal is not None:
            at = components[own]
            out[np.ix_(own, own)] = np.linalg.inv(self.equal[pose][np.ix_(at, at)])
        return out

    @property
    def rigid(self) -> Mask:
        """Mask of the columns of registrations and tools among the columns before the effects."""
        return np.array([n.startswith(("registration", "tool")) for n in self.placement_names], dtype=bool)

    def derivatives(self, effects: Sequence[Effect], model: ErrorModel) -> Array:
        """Return the weighted derivatives of the measured rows with respect to the coefficient of each effect."""
        if self.reduced is not None:
            return self.weigh(effect_columns(tuple(effects), model, self.poses, self.observed))
        out = np.zeros((len(effects), len(self.residual)))
        return self.add_effects(out, effects, model).T

    def add_effects(self, out: Array, effects: Sequence[Effect], model: ErrorModel) -> Array:
        """Add the weighted derivatives of the measured rows with respect to each effect to `out`, one line per effect;
        return `out`.

        The derivatives equal those of `effect_columns`; memory is used for one effect at a time.
        """
        pose = np.nonzero(self.weights > 0)[0]
        reach: dict[int, Array] = {}
        for k, slot, axis, shape in _shaped(effects, model, self.poses, self.observed):
            if slot not in reach:
                reach[slot] = np.ascontiguousarray(self.weigh(self.observed.sensitivity(slot)).T)
            out[k] += reach[slot][axis] * shape[pose]
        return out

    def effect_rows(self, effects: Sequence[Effect], model: ErrorModel) -> Array:
        """Return `derivatives`. For errors of the instrument, the part that registrations and tools absorb is projected
        out."""
        rows = self.derivatives(effects, model)
        if own := [k for k, effect in enumerate(effects) if effect.of_the_instrument]:
            rigid = ident.orthonormal(self.columns[:, : self.placement][:, self.rigid])
            sizes = np.linalg.norm(rows[:, own], axis=0)
            rows[:, own] = without_eliminated(ident.remove(rigid, rows[:, own]), sizes)
        return rows

    def weigh(self, values: Array) -> Array:
        """Return values by pose and component as rows weighted like the residual.

        Columns that unmeasured joints absorb become zero.
        """
        shape = (*self.weights.shape, *([1] * (values.ndim - 2)))
        if self.reduced is not None:
            weighted = values * self.reduced.weights.reshape(shape)
            return without_eliminated(self.reduced.complement.rows(weighted), np.linalg.norm(weighted, axis=(0, 1)))
        rows = self.weights > 0
        if self.equal is None:
            return np.asarray(values[rows] * self.weights[rows].reshape(-1, *shape[2:]))
        weighted = np.where(rows.reshape(shape), values, 0.0) * self.weights.reshape(shape)
        weighted[:, :3] = np.einsum("nij,nj...->ni...", self.equal, weighted[:, :3])
        return np.asarray(weighted[rows])


@dataclass(frozen=True)
class Reduction:
    """Rows that remain after elimination of unmeasured joints.

    complement: directions of the measurements that unmeasured joints do not move.
    weights: weights by pose and component before elimination.
    readings: linear equations for the approximate joint values of unmeasured joints.
    """

    complement: Complement
    weights: Array
    readings: JointReadings


def effect_columns(effects: tuple[Effect, ...], model: ErrorModel, poses: Poses, observed: Observed) -> Array:
    """Return the derivatives (poses, components, effects) of the measurements with respect to the effects'
    coefficients."""
    out = np.zeros((len(effects), len(poses), observed.components))
    for k, slot, axis, shape in _shaped(effects, model, poses, observed):
        out[k] += observed.sensitivity(slot)[:, :, axis] * shape[:, None]
    return np.moveaxis(out, 0, 2)


def _shaped(
    effects: Sequence[Effect], model: ErrorModel, poses: Poses, observed: Observed
) -> Iterator[tuple[int, int, int, Array]]:
    """Yield every term of the effects: indices of effect, frame and axis, and weight times basis function at each pose.

    Next to an effect's terms follow, with a negative sign, its rigid motions that registrations and tools absorb.
    """
    known = places(model.mechanism)
    by_instrument = any(INSTRUMENT in effect.slots for effect in effects)
    seen = poses.states.seen_at(observed.tip[:, :3, 3]) if by_instrument else poses.states
    for k, effect in enumerate(effects):
        for term in effect.terms:
            states = seen if term.slot == INSTRUMENT else poses.states
            yield k, known.index(term.slot), AXES.index(term.axis), term.weight * states.value(term.basis)
        for rigid in effect.taken_up:
            at = known.index(INSTRUMENT) + (rigid.of != REGISTRATION)
            here = (poses.dataset.label(rigid.of) == rigid.label).astype(float)
            for axis, size in enumerate(rigid.twist):
                if size != 0.0:
                    yield k, at, axis, -size * here


@dataclass(frozen=True)
class Weighting:
    """Weights of measurements in a fit.

    kinds: length, m, that counts as one unit of each kind of measurement. use: mask of the fitted poses.
    noise_shape: covariance (3, 3) of the coordinates of a position relative to their mean variance; None: equal noise.
    """

    kinds: Weights
    use: Mask
    noise_shape: Array | None = None


def linearise(model: ErrorModel, poses: Poses, theta: Array, placement: Placement, weighting: Weighting) -> Linearised:
    """Linearise the weighted measurements at given parameter values, unmeasured joints eliminated."""
    table = poses.dataset.q
    poses = solve_joints(model, poses, theta, placement, weighting.kinds)
    observed = observe(model, poses, theta, placement)
    if not free_joints(model.mechanism):
        return linearise_about(observed, model, poses, placement, weighting)
    residual, weights = _weighted(observed, poses, weighting)
    blocks, names = placement_columns(poses, observed, placement)
    blocks.append(effect_columns(model.effects, model, poses, observed))
    columns = np.concatenate(blocks, axis=2)
    dense = _Dense(columns, residual, weights, tuple(names), table)
    return _eliminated(model, placement, poses, observed, dense)


def linearise_about(
    observed: Observed, model: ErrorModel, poses: Poses, placement: Placement, weighting: Weighting
) -> Linearised:
    """Linearise the measurements about given predictions `observed`, for a mechanism whose joints are all measured."""
    residual, weights = _weighted(observed, poses, weighting)
    blocks, names = placement_columns(poses, observed, placement)
    rows, count = weights > 0, len(names)
    columns = np.zeros((count + len(model.effects), int(rows.sum()))).T
    problem = Linearised(
        columns=columns,
        residual=columns[:, 0],
        pose_of_row=np.nonzero(rows)[0],
        placement=count,
        placement_names=tuple(names),
        observed=observed,
        poses=poses,
        sizes=np.zeros(len(columns.T)),
        weights=weights,
        equal=equal_noise(weighting.noise_shape, weights),
    )
    columns[:, :count] = problem.weigh(np.concatenate(blocks, axis=2))
    problem.add_effects(columns.T[count:], model.effects, model)
    sizes = np.sqrt(np.einsum("km,km->k", columns.T, columns.T))
    return replace(problem, residual=problem.weigh(residual), sizes=sizes)


def equal_noise(noise_shape: Array | None, weights: Array) -> Array | None:
    """Return matrices L⁻¹ (poses, 3, 3), L Lᵀ the covariance of the measured coordinates of each position; None for
    equal noise.

    noise_shape: covariance of all three coordinates. weights: weights by pose and component, zero if unmeasured.
    """
    if noise_shape is None:
        return None
    out = np.zeros((len(weights), 3, 3))
    patterns, of = np.unique(weights[:, :3] > 0, axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        at = np.flatnonzero(pattern)
        out[np.ix_(of.reshape(-1) == k, at, at)] = np.linalg.inv(np.linalg.cholesky(noise_shape[np.ix_(at, at)]))
    return out


def _weighted(observed: Observed, poses: Poses, weighting: Weighting) -> tuple[Array, Array]:
    """Return measured minus predicted values, and their weights, 0 if not measured, by pose and component."""
    residual = measured_minus(observed, poses.dataset)
    return residual, np.isfinite(residual) * weighting.use[:, None].astype(float) * observed.scales(weighting.kinds)


def residual_at(problem: Linearised, model: ErrorModel, theta: Array, placement: Placement) -> Linearised:
    """Return the linear problem with the residual at the values `theta`, `placement`; all joints must be measured."""
    observed = observe(model, problem.poses, theta, placement)
    residual = problem.weigh(measured_minus(observed, problem.poses.dataset))
    return replace(problem, residual=residual, observed=observed)


@dataclass(frozen=True)
class _Dense:
    """Arrays of all poses before elimination of unmeasured joints.

    columns: columns of registration, tool and effects. residual, weights: by pose and component. names: names of the
    columns of registration and tool. table: joint values as given in the table, rad and m.
    """

    columns: Array
    residual: Array
    weights: Array
    names: tuple[str, ...]
    table: Array


def _eliminated(model: ErrorModel, placement: Placement, poses: Poses, observed: Observed, dense: _Dense) -> Linearised:
    """Eliminate the unmeasured joints of each pose from the linear problem."""
    weights, count = dense.weights, len(dense.names)
    measured = weights > 0
    joints = joint_columns(model.mechanism, observed)
    left = complement(joints * weights[:, :, None], measured)
    weighted = dense.columns * weights[:, :, None]
    sizes = np.linalg.norm(weighted, axis=(0, 1))
    rows = without_eliminated(left.rows(weighted), sizes)
    bare = observe(ErrorModel(model.mechanism, ()), poses, np.zeros(0), placement)
    nominal = np.concatenate(placement_columns(poses, bare, placement)[0], axis=2) * weights[:, :, None]
    rest = complement(joint_columns(model.mechanism, bare) * weights[:, :, None], measured).rows(nominal)
    rows[:, :count] = observable(left.rows(weighted[:, :, :count]), rest, sizes[:count])
    readings = joint_readings(model.mechanism, observed, dense.table - poses.dataset.q, weighted, weights)
    return Linearised(
        columns=rows,
        residual=left.rows(np.where(measured, dense.residual, 0.0) * weights),
        pose_of_row=np.nonzero(left.keep)[0],
        placement=count,
        placement_names=dense.names,
        observed=observed,
        poses=poses,
        sizes=sizes,
        weights=left.keep.astype(float),
        reduced=Reduction(left, weights, readings),
    )
