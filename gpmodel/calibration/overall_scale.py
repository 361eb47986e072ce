"""Scale of a mechanism that touches and relative measurements leave undetermined.

If all lengths of a mechanism, its tool and the positions of the touched bodies are scaled by one factor, no touch
changes. If touches alone are measured, the calibration nearest to the nominal geometry is selected. A bar, a ball of
known diameter, an artefact or measured coordinates determine the scale.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.start import placement_columns
from gpmodel.model.error_model import ErrorModel, Placement, observe
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, Orientation, Point
from gpmodel.model.touches import Touches
from gpmodel.numerics import rank as ident

LIMIT = 5000.0
"""Condition limit if no measurement determines the scale. Nearly redundant combinations of constants are then held near
nominal values by their prior. With a lower limit, nearly redundant combinations would be dropped."""

TOLERANCE = 1e-3
"""Largest prior standard deviation of a constant that no measurement determines, m or rad. Makers state 0.5 to 2 mm and
mrad for links and joint zeros. With a prior of ten times TOLERANCE, touches of a two-armed robot made it 8 % larger.
With half or double the prior standard deviation, the constants that the measurements determine do not change."""
LEAST, MOST, GRID = 3e-5, 3e-2, 60
"""Grid of the standard deviation of constants about their nominal values, m and rad: smallest (machined parts), largest
(lost joint zeros), and number of values."""
SMALLEST = 1e-4
"""Smallest share of noise in the measurements: rounding of coordinates in mm to 0.01 µm."""


def shows_size(kind: Observation) -> bool:
    """Return whether an instrument measures a known length, which determines the scale of the robot."""
    if isinstance(kind, Touches):
        known = (
            f.frame[:3, 3].any() or (f.surface == "on_sphere" and f.radius > 0) for b in kind.bodies for f in b.features
        )
        return any(known)
    return not isinstance(kind, Inclination | Orientation)


def scale_unobservable(problem: Linearised) -> bool:
    """Return whether no measurement determines the scale of the mechanism."""
    kinds = [kind for kind in problem.observed.kinds if kind.readings.any()]
    return bool(kinds) and problem.reduced is None and not any(map(shows_size, kinds))


def without_positions(problem: Linearised) -> bool:
    """Return whether no measurement is a position in the frame of an instrument.

    Touches, bars, cameras and inclinometers measure parts of a mechanism relative to each other, and orientations show
    no length. Relative measurements determine much of the geometry weakly or not at all.
    """
    return problem.reduced is None and without_frame(problem.observed.kinds)


def without_frame(kinds: Sequence[Observation]) -> bool:
    """Return whether there are measurements, but no measured position in the frame of an instrument.

    A gauge that measures one or two coordinates of all points measures no position.
    """
    read = [kind for kind in kinds if kind.readings.any()]
    return bool(read) and not any(isinstance(kind, Point) and kind.readings.any(axis=0).all() for kind in read)


def scale_similarity(model: ErrorModel, problem: Linearised) -> Array:
    """Return the similarity of each effect to a uniform scaling of the mechanism: |cosine| of the displacements.

    Displacements of the tool point over the poses are compared, after rigid motions of the root and the tool are
    projected out.
    """
    count = len(problem.poses)
    bare = replace(problem.observed, kinds=(Point(np.zeros((count, 3))),))
    rows = (3 * count, -1)
    placed = (bare.tool_sensitivity()[:, :, :3], bare.registration_sensitivity(np.zeros(3)))
    taken = ident.orthonormal(np.hstack([part.reshape(rows) for part in placed]))
    moved = ident.remove(taken, effect_columns(model.effects, model, problem.poses, bare).reshape(rows))
    grown = ident.remove(taken, problem.observed.tip[:, :3, 3].reshape(-1, 1))[:, 0]
    size = np.linalg.norm(moved, axis=0) * np.linalg.norm(grown)
    return np.abs(moved.T @ grown) / np.where(size > 0, size, np.inf)


def equivalent_changes(
    model: ErrorModel, problem: Linearised, placement: Placement, held: IntArray, others: IntArray
) -> tuple[Array, Array]:
    """Compute the changes of the effects `held` that are equivalent to one unit of each of the effects `others`.

    A second result is the changes of `held` per unit of uniform scaling. Effects are equivalent if they move the tool
    point of the nominal mechanism equally over the poses, up to rigid motions of the root and the tool.
    """
    placed, moved, tip = _of_the_tool_point(model, problem, placement, (*held, *others))
    columns = np.hstack([placed, moved[:, : len(held)]])
    scale = np.linalg.norm(columns, axis=0)
    scale[scale < ident.NEGLIGIBLE] = np.inf
    asked = np.hstack([moved[:, len(held) :], tip])
    found = (np.linalg.lstsq(columns / scale, asked, rcond=1e-9)[0] / scale[:, None])[placed.shape[1] :]
    return found[:, :-1], found[:, -1]


def _of_the_tool_point(
    model: ErrorModel, problem: Linearised, placement: Placement, effects: Sequence[int]
) -> tuple[Array, Array, Array]:
    """Return the displacements of the nominal tool point by rigid motions and by effects, and the tool point, m."""
    count = len(problem.poses)
    nominal = observe(ErrorModel(model.mechanism, ()), problem.poses, np.zeros(0), placement)
    bare = replace(nominal, kinds=(Point(np.zeros((count, 3))),))
    rows = (3 * count, -1)
    placed = np.concatenate(placement_columns(problem.poses, bare, placement)[0], axis=2).reshape(rows)
    moved = effect_columns(tuple(model.effects[i] for i in effects), model, problem.poses, bare).reshape(rows)
    return placed, moved, nominal.tip[:, :3, 3].reshape(rows)


def unrepresented_constants(model: ErrorModel, problem: Linearised, placement: Placement, kept: Mask) -> Mask:
    """Return a mask of dropped constants that displace the tool point as no fitted constant or rigid motion does.

    The measurements are insensitive to the masked constants: an inclinometer shows no length and nothing beyond its
    link. The mask is empty if a position is measured in the frame of an instrument.
    """
    out = np.zeros(len(model.effects), dtype=bool)
    fitted = np.flatnonzero(kept & nominal_constants(model))
    others = np.flatnonzero(~kept & nominal_constants(model))
    if not without_positions(problem) or not len(others):
        return out
    placed, moved, _ = _of_the_tool_point(model, problem, placement, (*fitted, *others))
    own, sizes = moved[:, len(fitted) :], np.linalg.norm(moved[:, len(fitted) :], axis=0)
    left = ident.remove(ident.orthonormal(np.hstack([placed, moved[:, : len(fitted)]])), own)
    out[others] = np.linalg.norm(left, axis=0) > ident.NEGLIGIBLE * sizes
    return out


def nominal_constants(model: ErrorModel) -> Mask:
    """Return a mask of the effects that are constants of the nominal geometry without a prior of their own."""
    return np.array([e.constant and e.prior == np.inf for e in model.effects], dtype=bool)


def spread(columns: Array, target: Array, placed: Array, most: float) -> tuple[float, float, Array]:
    """Estimate the standard deviation of the constants about their nominal values, m and rad, by Bayesian regression.

    columns: derivatives of the measurements with respect to unknowns, which are scaled to unit prior variance.
    target: measurements, m. placed: derivatives with respect to the unknowns that have no prior.
    most: upper limit of the prior standard deviation of the unknowns, m and rad.
    Returns the standard deviation, the RMS residual, m, and orthonormal combinations that the measurements determine.
    With s the singular values of the columns without their part along `placed`, the measurements have the variance σ² +
    reach² s²; the prior variance reach² and log σ are averaged over a grid, weighted by likelihood. Source: MacKay
    (1992), Bayesian Interpolation.
    """
    taken = ident.orthonormal(placed)
    left, values = ident.remove(taken, columns), ident.remove(taken, target)
    u, s, _ = linalg.svd(left, full_matrices=False, lapack_driver="gesvd")  # gesdd does not always converge
    along = (u.T @ values) ** 2
    rest = max(float(values @ values - along.sum()), 0.0)
    count = max(len(values) - taken.shape[1] - len(s), 0)
    squared = np.geomspace(LEAST, most, GRID)[:, None, None] ** 2
    total = np.sqrt((values @ values) / len(values)) + ident.NEGLIGIBLE * 1e-3
    noise = np.geomspace(max(SMALLEST * total, np.sqrt(rest / len(values))), total, GRID)[:, None] ** 2
    variance = noise + squared * s**2
    cost = 0.5 * (rest / noise + count * np.log(noise))[None, :, 0] + 0.5 * (along / variance + np.log(variance)).sum(2)
    likely = np.exp(cost.min() - cost) / np.exp(cost.min() - cost).sum()
    reach = np.sqrt(likely.sum(axis=1) @ squared[:, 0, 0])
    sigma = np.exp(0.5 * likely.sum(axis=0) @ np.log(noise[:, 0]))
    fitted = np.hstack([taken, u[:, reach * s > sigma]])
    left_rms = sigma * np.sqrt(max(len(values) - fitted.shape[1], 1) / len(values))
    return float(reach), float(left_rms), fitted
