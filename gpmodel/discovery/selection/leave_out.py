"""What the model predicts of bundles of repeats it was not fitted to, in closed form."""

from collections.abc import Iterable

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.selection.refit import Refit, normal


def left_out(fit: Refit, bundle: IntArray, without: Iterable[str] = ()) -> Array:
    """Squared error (N,), m², of each pose predicted from all bundles but its own; NaN for poses not in use.

    With H = X (XᵀX + P)⁻¹ Xᵀ and e the residual of the linear fit, the rows of bundle b left out miss by
    (I - H_bb)⁻¹ e_b. without: names of effects taken out of the model; variances are those of the whole.
    Source: Cook and Weisberg (1982), 2.2.
    """
    problem, noise, model = fit.problem, fit.whitening, fit.point.model
    gone = set(without)
    stays = np.array([e.name not in gone for e in model.effects], dtype=bool)
    free = np.concatenate([np.ones(problem.placement, dtype=bool), stays])
    prior = np.array([e.prior for e in model.effects])
    system = normal(problem, noise, prior, fit.sigma, free)
    total = problem.residual + problem.columns[:, problem.placement :] @ fit.point.theta
    target = noise.whiten(total)
    root = linalg.cholesky(system.inner, lower=True, check_finite=False)
    half = linalg.solve_triangular(root, system.columns.T, lower=True, check_finite=False).T
    missed = target - half @ (half.T @ target)
    of_row = bundle[problem.pose_of_row]
    order = np.argsort(of_row, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(of_row[order])) + 1):
        own = half[rows]
        missed[rows] = linalg.solve(np.eye(len(rows)) - own @ own.T, missed[rows], assume_a="pos")
    squared = np.bincount(problem.pose_of_row, noise.restored(missed) ** 2, minlength=len(bundle))
    return np.where(fit.point.use, squared, np.nan)
