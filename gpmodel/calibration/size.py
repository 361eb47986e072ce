"""The size of a mechanism: touches of surfaces and points at unknown places fit one twice as large as well.

All lengths of a mechanism, its tool and the places of what it touches can grow alike without moving a gap: the fit is
that whose constants, all of them, are nearest to the description. A bar, a ball of known diameter, an artefact or a
point in metres shows size.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.start import placement_columns
from gpmodel.model.error_model import ErrorModel, Placement, observe
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, Orientation, Point
from gpmodel.model.touches import Touches
from gpmodel.numerics import rank as ident

LIMIT = 5000.0
"""Condition limit where size does not show: what is nearly a combination of others is held by belief alone, and a limit
that drops it would not be that belief."""

TOLERANCE = 1e-3
"""Metres or radians: what makers state of links and zeros (0.5 to 2 mm and mrad), the most that a constant is believed
to be off where no reading shows it. With ten times as much, touches of a two-armed robot made it 8 % larger. Of half or
twice as much the constants that are shown do not change."""
LEAST, MOST, GRID = 3e-5, 3e-2, 60
"""m and rad that the constants of a description appear to be off, at least and at most: machined, or with joint zeros
that were lost; and how many between are weighed."""
SMALLEST = 1e-4
"""Share of the readings that may be noise at least: rounding of a hundredth of a micrometre in millimetres."""


def shows_size(kind: Observation) -> bool:
    """Return whether readings of a kind contain a known length."""
    if isinstance(kind, Touches):
        known = (
            f.frame[:3, 3].any() or (f.surface == "on_sphere" and f.radius > 0) for b in kind.bodies for f in b.features
        )
        return any(known)
    return not isinstance(kind, Inclination | Orientation)


def size_hidden(problem: Linearised) -> bool:
    """Return whether no reading of a fit determines the scale of the mechanism; a sliding joint does, by its known
    motion.
    """
    kinds = [kind for kind in problem.observed.kinds if kind.readings.any()]
    return bool(kinds) and problem.left is None and not any(map(shows_size, kinds))


def relative(problem: Linearised) -> bool:
    """Return whether no reading of a fit is in the frame of an instrument.

    Touches, bars, cameras and inclinometers measure parts of a mechanism relative to each other. They determine much
    of its geometry weakly or not at all.
    """
    return problem.left is None and without_frame(problem.observed.kinds)


def without_frame(kinds: Sequence[Observation]) -> bool:
    """Return whether there are readings, none of them in the frame of an instrument."""
    read = [kind for kind in kinds if kind.readings.any()]
    return bool(read) and not any(kind.absolute for kind in read)


def share_of_size(model: ErrorModel, problem: Linearised) -> Array:
    """Return the share (E,) of each effect's displacement of the tool point that is growth: their cosine over the
    poses.

    Displacements by placing and turning the root and the tool are projected out.
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


def standing_for(
    model: ErrorModel, problem: Linearised, placement: Placement, held: IntArray, others: IntArray
) -> tuple[Array, Array]:
    """Return the change of the held effects (H,) equivalent to the others (O,): (H, O), unknowns per unknown; and to
    growth (H,), unknowns per growth.

    All by how they move the tool point of the nominal mechanism over the poses, less what placing and turning the root
    and the tool do: readings that do not show size would not say how much of it an effect is.
    """
    count = len(problem.poses)
    nominal = observe(ErrorModel(model.mechanism, ()), problem.poses, np.zeros(0), placement)
    bare = replace(nominal, kinds=(Point(np.zeros((count, 3))),))
    rows = (3 * count, -1)
    placed = np.concatenate(placement_columns(problem.poses, bare, placement)[0], axis=2).reshape(rows)
    effects = tuple(model.effects[i] for i in (*held, *others))
    moved = effect_columns(effects, model, problem.poses, bare).reshape(rows)
    columns = np.hstack([placed, moved[:, : len(held)]])
    scale = np.linalg.norm(columns, axis=0)
    scale[scale < ident.NEGLIGIBLE] = np.inf
    asked = np.hstack([moved[:, len(held) :], nominal.tip[:, :3, 3].reshape(rows)])
    found = (np.linalg.lstsq(columns / scale, asked, rcond=1e-9)[0] / scale[:, None])[placed.shape[1] :]
    return found[:, :-1], found[:, -1]


def spread(columns: Array, target: Array, placed: Array, most: float) -> tuple[float, float, Array]:
    """Estimate the error of the constants of a description, m and rad, from the readings they explain.

    Returns also the RMS of the residual, m, and orthonormal columns (M, K) of the constants and of free unknowns.

    columns: (M, H) per unknown of unit variance before measuring. target: (M,). placed: (M, P) of what is free.
    most: largest of the former, m and rad.

    Readings along the singular values s of what is left of the columns have the variance σ² + reach² s²; reach²
    and log σ are averaged over their likelihood on a grid. Source: MacKay (1992), Bayesian Interpolation.
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
