"""The size of a mechanism: touches of surfaces and points at unknown places fit one twice as large as well.

All lengths of a mechanism, its tool and the places of what it touches can grow alike without moving a gap: the fit is
that whose lengths are nearest to the description (gpmodel.calibration.priors.DRAWN_REACH). A bar, a ball of known
diameter, an artefact or a point in metres shows size.
"""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, Orientation, Point
from gpmodel.model.touches import Touches
from gpmodel.numerics import rank as ident

LIMIT = 200.0
"""Condition limit at most where size does not show: what the errors of a description leave of it is under 1 / 500."""


def shows_size(kind: Observation) -> bool:
    """Whether readings of a kind hold a length that is known."""
    if isinstance(kind, Touches):
        known = (
            f.frame[:3, 3].any() or (f.surface == "on_sphere" and f.radius > 0) for b in kind.bodies for f in b.features
        )
        return any(known)
    return not isinstance(kind, Inclination | Orientation)


def size_hidden(problem: Linearised) -> bool:
    """Whether no reading of a fit shows how large the mechanism is; a sliding joint does, whose motion is known."""
    kinds = [kind for kind in problem.observed.kinds if kind.readings.any()]
    return bool(kinds) and problem.left is None and not any(map(shows_size, kinds))


def share_of_size(model: ErrorModel, problem: Linearised) -> Array:
    """How much (E,) of what each effect moves the tool point by is growth: the cosine between both over the poses, less
    what placing and turning the root and the tool do."""
    count = len(problem.poses)
    bare = replace(problem.observed, kinds=(Point(np.zeros((count, 3))),))
    rows = (3 * count, -1)
    placed = (bare.tool_sensitivity()[:, :, :3], bare.registration_sensitivity(np.zeros(3)))
    taken = ident.orthonormal(np.hstack([part.reshape(rows) for part in placed]))
    moved = ident.remove(taken, effect_columns(model.effects, model, problem.poses, bare).reshape(rows))
    grown = ident.remove(taken, problem.observed.tip[:, :3, 3].reshape(-1, 1))[:, 0]
    size = np.linalg.norm(moved, axis=0) * np.linalg.norm(grown)
    return np.abs(moved.T @ grown) / np.where(size > 0, size, np.inf)
