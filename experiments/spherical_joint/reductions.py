"""Select identifiable parameters among the thirty, by SVD and by index order.

Columns are of position only, scaled to unit norm. Parameters that coincide with a joint angle (10, 17, 24) are no
candidates. Source: Robertson (2003), Figure 3.15, Table 3.2.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.spherical_joint.rig import Rig
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.unmeasured_joints import sphere_flaw
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.numerics import rank as ident
from gpmodel.planning.poses import spread_poses
from joints import spherical_joint
from joints.budget import thesis_columns
from joints.passive_joint import THESIS_PARAMETERS, PassiveJoint, parameter

MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-13


@dataclass(frozen=True)
class SphereFit:
    """centre: (3,) m. radius: m. residual: (N,) measured minus fitted radius, m. sigma: m, of one radial residual.

    covariance: (4, 4) of centre and radius, m². status: converged or stalled; reason says why.
    """

    centre: Array
    radius: float
    residual: Array
    sigma: float
    covariance: Array
    iterations: int
    status: str
    reason: str

    @property
    def stderr(self) -> Array:
        """Standard deviations (4,) of the centre's coordinates and the radius, m."""
        return np.sqrt(np.diag(self.covariance))


def algebraic_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of |p|² = 2 p·c + (R² - |c|²) by linear least squares on points (N, 3), m."""
    middle = points.mean(axis=0)
    shifted = points - middle
    system = np.column_stack([2 * shifted, np.ones(len(points))])
    solution = np.linalg.lstsq(system, np.sum(shifted**2, axis=1), rcond=None)[0]
    return solution[:3] + middle, float(np.sqrt(solution[3] + solution[:3] @ solution[:3]))


def fit_sphere(points: Array, where: str = "points") -> SphereFit:
    """The sphere nearest to points (N, 3) in radial distance, m, by Gauss-Newton.

    Raises InputError where the points determine none: fewer than 4, alike, in one plane, or not finite.

        ε_i = R - |p_i - c|,   F(c, R) = min Σ ε_i²

    Source: Robertson (2003), Figure 3.12; the start is linear in c and R² - |c|² (Coope 1993).
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{where}: points of shape {points.shape}; expected finite x, y and z in every row")
    if flaw := sphere_flaw(points, where):
        raise InputError(flaw)
    centre, radius = algebraic_sphere(points)
    status, reason = "stalled", f"not converged after {MAX_ITERATIONS} iterations"
    iterations = 0
    while iterations < MAX_ITERATIONS and status == "stalled":
        iterations += 1
        rays = points - centre
        lengths = np.linalg.norm(rays, axis=1)
        columns = np.column_stack([rays / lengths[:, None], np.ones(len(points))])
        step = np.linalg.lstsq(columns, lengths - radius, rcond=None)[0]
        centre, radius = centre + step[:3], radius + float(step[3])
        if np.abs(step).max() < STEP_TOLERANCE * max(radius, 1.0):
            status, reason = "converged", "the last step moved neither centre nor radius"
    residual = np.linalg.norm(points - centre, axis=1) - radius
    sigma = float(np.sqrt(np.sum(residual**2) / max(len(points) - 4, 1)))
    covariance = sigma**2 * np.linalg.pinv(columns.T @ columns)
    return SphereFit(centre, radius, residual, sigma, covariance, iterations, status, reason)


CONDITION_LIMIT = 50.0
REQUIRED = (1, 2, 3, 4, 5, 6, 25, 26, 27)
COINCIDENT = (10, 17, 24)
NEW = 1e-3


@dataclass(frozen=True)
class Reduction:
    """kept: thesis indices. condition: of their scaled columns. explained: dropped index -> kept ones it repeats."""

    kept: tuple[int, ...]
    condition: float
    explained: dict[int, tuple[int, ...]]


def condition_number(columns: Array) -> float:
    """Largest over smallest singular value of columns scaled to unit norm; infinite with a zero column."""
    norms = np.linalg.norm(columns, axis=0)
    if not columns.size or norms.min() <= ident.NEGLIGIBLE:
        return np.inf
    s = np.linalg.svd(columns / norms, compute_uv=False)
    return float(s[0] / s[-1]) if s[-1] > 0 else np.inf


def reduce_in_order(columns: Array, required: Sequence[int] = REQUIRED) -> Reduction:
    """Keep, in the order required first and then by index, what the columns before do not explain.

    A column is new when more than NEW of its scaled length is left after removing the kept ones. Deterministic.
    """
    order = [*required, *(p.index for p in THESIS_PARAMETERS if p.index not in (*required, *COINCIDENT))]
    kept: list[int] = []
    for index in order:
        column = columns[:, [index - 1]]
        norm = float(np.linalg.norm(column))
        if norm <= ident.NEGLIGIBLE:
            continue
        if np.linalg.norm(ident.remove(ident.orthonormal(_take(columns, kept)), column / norm)) > NEW:
            kept.append(index)
    return _reduction(columns, sorted(kept))


def reduce_by_svd(
    columns: Array, rng: np.random.Generator, limit: float = CONDITION_LIMIT, required: Sequence[int] = REQUIRED
) -> Reduction:
    """Drop one parameter at a time until the condition number is under `limit`: the thesis' procedure.

    Each time the right singular vector of the smallest singular value is read: of the parameters that may go and weigh
    in it as much as the heaviest (within 10 %), one drawn by `rng` goes. Raises InputError where only required
    parameters are left above the limit.
    """
    norms = np.linalg.norm(columns, axis=0)
    alive = [p.index for p in THESIS_PARAMETERS if norms[p.index - 1] > ident.NEGLIGIBLE]
    kept = [i for i in alive if i not in COINCIDENT]
    while condition_number(_take(columns, kept)) > limit:
        scaled = _take(columns, kept) / norms[[i - 1 for i in kept]]
        weakest = np.abs(np.linalg.svd(scaled, full_matrices=False)[2][-1])
        weakest[[i in required for i in kept]] = 0.0
        if weakest.max(initial=0.0) < 1e-6:
            raise InputError(
                f"condition limit {limit:g}: the base and the tooling ball alone exceed it; expected a tooling ball "
                f"farther off the yaw axis, more varied poses or a higher limit"
            )
        near = np.flatnonzero(weakest > 0.9 * weakest.max())
        kept.pop(int(rng.choice(near)))
    return _reduction(columns, kept)


def _take(columns: Array, indices: Sequence[int]) -> Array:
    return columns[:, [i - 1 for i in indices]]


def _reduction(columns: Array, kept: Sequence[int]) -> Reduction:
    explained = {}
    basis = _take(columns, kept)
    norms = np.linalg.norm(basis, axis=0)
    for p in THESIS_PARAMETERS:
        column = columns[:, p.index - 1]
        size = np.linalg.norm(column)
        if p.index not in kept and size > ident.NEGLIGIBLE:
            weights = np.linalg.lstsq(basis / norms, column / size, rcond=None)[0]
            explained[p.index] = tuple(i for i, w in zip(kept, weights, strict=True) if abs(w) > 0.05)
    return Reduction(tuple(kept), condition_number(basis), explained)


def most_common_reduction(
    joint: PassiveJoint,
    rng: np.random.Generator,
    *,
    trials: int = 20,
    poses: int = 100,
    limit: float = CONDITION_LIMIT,
    required: Sequence[int] = REQUIRED,
) -> tuple[Reduction, Counter[tuple[int, ...]]]:
    """The most frequent answer of the SVD reduction over fresh pose sets, and how often each answer came."""
    found = [
        reduce_by_svd(thesis_columns(joint, spread_poses(joint, poses, rng)), rng, limit, required)
        for _ in range(trials)
    ]
    counts = Counter(r.kept for r in found)
    best = counts.most_common(1)[0][0]
    return min((r for r in found if r.kept == best), key=lambda r: r.condition), counts


def observable_in_words(joint: PassiveJoint, q: Array) -> str:
    """Describe the parameters that positions alone determine without known angles, at poses q (N, 3)."""
    columns = thesis_columns(joint, q, angles_known=False)
    reduction = reduce_in_order(columns, required=(1, 2, 3, 27, 15))
    offsets = [i for i in reduction.kept if i not in (1, 2, 3, 25, 26, 27)]
    named = ", ".join(f"{parameter(i).axis} of {parameter(i).frame} (index {i})" for i in offsets)
    gone = [p.index for p in THESIS_PARAMETERS if not np.any(np.abs(columns[:, p.index - 1]) > ident.NEGLIGIBLE)]
    return (
        f"With free angles every pose leaves one equation, along its radius. {len(reduction.kept)} combinations are "
        f"observable: the centre (3), the radius (1), and {named or 'no axis offset'}. "
        f"Parameters {', '.join(map(str, gone))} move the tooling ball on its sphere only: the angles absorb them."
    )


JOINT = spherical_joint()
OFFSETS = {14: -2.54e-6, 15: -25.4e-6, 19: 20.32e-6}
RIG = Rig(JOINT, parameters=OFFSETS)
MODELS = {
    "Base and TCP": (),
    "Position offset": tuple(OFFSETS),
    "All parameters": tuple(p.index for p in THESIS_PARAMETERS),
}
PITCH_OFFSET = tuple(OFFSETS).index(15)


def model(name: str) -> ErrorModel:
    return ErrorModel(JOINT, tuple(parameter(i).effect for i in MODELS[name]))


def summary(error: NDArray[np.float64]) -> dict[str, float]:
    """Mean, mean plus three standard deviations and maximum, µm."""
    micrometres = 1e6 * error
    return {
        "mean_um": float(micrometres.mean()),
        "mean_plus_3sd_um": float(micrometres.mean() + 3 * micrometres.std()),
        "max_um": float(micrometres.max()),
    }


def tables(rigs: int) -> dict[str, Any]:
    """Means over fresh rigs; the sphere against base and TCP; the offset of the pitch axis against the truth."""
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in ("Sphere fit", *MODELS)}
    differences, offsets, kept = [], [], set()
    for seed in range(rigs):
        rng = np.random.default_rng(seed)
        data = RIG.measure(RIG.poses(31, rng), rng)
        sphere, fits = fit_sphere(data.position), {}
        rows["Sphere fit"].append(summary(np.abs(sphere.residual)))
        for name in MODELS:
            fits[name] = calibrate(model(name), prepare(JOINT, data), robust=False)
            rows[name].append(summary(fits[name].error))
        base = fits["Base and TCP"].placement
        radius = np.linalg.norm(base.tool[""][:3, 3] + JOINT.tooling_ball)
        differences += [*np.abs(base.registration[""][:3, 3] - sphere.centre), abs(radius - sphere.radius)]
        offset = fits["Position offset"]
        offsets.append([offset.theta[PITCH_OFFSET], offset.stderr[PITCH_OFFSET]])
        everything = fits["All parameters"]
        kept.add(tuple(p.index for p, k in zip(THESIS_PARAMETERS, everything.free, strict=True) if k))
    found = 1e6 * np.array(offsets)
    return {
        "rigs": rigs,
        "table_3_4_largest_difference_um": 1e6 * float(max(differences)),
        "table_3_5": {
            name: {key: float(np.mean([row[key] for row in values])) for key in values[0]}
            for name, values in rows.items()
        },
        "kept_of_all_parameters": sorted(kept),
        "pitch_offset": {
            "true_um": 1e6 * OFFSETS[15],
            "mean_um": float(found[:, 0].mean()),
            "scatter_um": float(found[:, 0].std()),
            "stated_sigma_um": float(found[:, 1].mean()),
            "within_3_sigma": int((np.abs(found[:, 0] - 1e6 * OFFSETS[15]) < 3 * found[:, 1]).sum()),
        },
    }


def reduction() -> dict[str, Any]:
    rng = np.random.default_rng(0)
    q = spread_poses(JOINT, 100, rng)
    ordered, (common, counts) = reduce_in_order(thesis_columns(JOINT, q)), most_common_reduction(JOINT, rng)
    answers = {", ".join(map(str, kept)): count for kept, count in counts.most_common()}
    return {
        "in_order": {"kept": ordered.kept, "condition": ordered.condition},
        "by_svd_20_trials": {"most_common": common.kept, "condition": common.condition, "answers": answers},
        "free_angles": observable_in_words(JOINT, q),
    }
