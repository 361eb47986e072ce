"""The size of a mechanism: touches of surfaces and points at unknown places fit one twice as large as well.

All lengths of a mechanism, its tool and the places of what it touches can grow alike without moving a gap: the fit is
that whose constants, all of them, are nearest to the description. A bar, a ball of known diameter, an artefact or a
point in metres shows size.
"""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.placing import placement_columns
from gpmodel.model.error_model import ErrorModel, Placement, observe
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, Orientation, Point
from gpmodel.model.touches import Touches
from gpmodel.numerics import rank as ident

LIMIT = 5000.0
"""Condition limit where size does not show: what is nearly a combination of others is held by belief alone, and a limit
that drops it would not be that belief."""

REACHES, GRID = (3e-5, 1e-2), 60
"""m and rad that the constants of a description are off, at least and at most: machined, or put together by hand; and
how many between are weighed."""


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


def standing_for(
    model: ErrorModel, problem: Linearised, placement: Placement, held: IntArray, others: IntArray
) -> tuple[Array, Array]:
    """What the held effects (H,) do in the place of the others (O,): (H, O), unknowns per unknown; and in the place of
    growth (H,), unknowns per growth by the whole.

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


def spread(columns: Array, target: Array, placed: Array) -> float:
    """How far the constants of a description are off, m and rad, by how much of the readings they explain: columns
    (M, H) per unknown of unit variance before measuring, target (M,), placed (M, P) of what is free.

    Readings along the singular values s of what is left of the columns have the variance σ² + reach² s²; reach² is
    averaged over its likelihood on a grid. Source: MacKay (1992), Bayesian Interpolation.
    """
    taken = ident.orthonormal(placed)
    left, values = ident.remove(taken, columns), ident.remove(taken, target)
    u, s, _ = np.linalg.svd(left, full_matrices=False)
    shown = s > ident.NEGLIGIBLE * s[0]
    u, s = u[:, shown], s[shown]
    along = (u.T @ values) ** 2
    rest = max(float(values @ values - along.sum()), 0.0)
    count = len(values) - taken.shape[1]
    scale = np.sqrt(rest / max(count - len(s), 1)) + ident.NEGLIGIBLE * 1e-3
    squared = np.geomspace(*REACHES, GRID) ** 2
    variance = 1.0 + squared[:, None] * (s / scale) ** 2
    cost = 0.5 * (count * np.log(rest + (along / variance).sum(axis=1)) + np.log(variance).sum(axis=1))
    likely = np.exp(cost.min() - cost)
    return float(np.sqrt(likely @ squared / likely.sum()))
