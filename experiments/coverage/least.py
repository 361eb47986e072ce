"""Width of the printed intervals relative to the Cramér-Rao bound for known model and noise.

Least variances: diag (Cᵀ Σ⁻¹ C + Λ)⁻¹ with the true covariance Σ of the readings, C what every unknown does to them
and Λ the little that is believed beforehand; of Student's t with f degrees and scale s the information of a reading is
(f + 1) / (f + 3) / s². Readings that failed are left out, as an oracle would. Source: Cramér and Rao.
"""

from __future__ import annotations

import numpy as np

from experiments.blind.case import Case
from experiments.blind.robot import Sheet
from gpmodel.calibration.priors import GEOMETRY_REACH, TOOL_REACH
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.model.error_model import Poses

STUDENT = 3.0
"""Degrees of freedom of the simulator's heavy tails, whose scale is its noise over the root of them."""


def least(fit: Calibration, poses: Poses, case: Case, sheet: Sheet) -> np.ndarray:
    """Covariance (K, K) of registration, tool and effects, zero where not held, of an efficient estimate."""
    problem = problem_at(fit, poses)
    free = np.concatenate([np.ones(problem.placement, dtype=bool), fit.kept])
    columns = problem.columns[:, free].reshape(len(poses), 3, -1)
    good = np.setdiff1d(np.arange(len(poses)), sheet.outliers)
    information = sum(
        columns[good, axis].T @ np.linalg.solve(covariance(case, sheet)[np.ix_(good, good)], columns[good, axis])
        for axis in range(3)
    )
    believed = np.where(np.arange(problem.columns.shape[1]) < problem.placement, np.inf, GEOMETRY_REACH)
    believed[[k for k, n in enumerate(problem.placement_names) if n.startswith("tool T")]] = TOOL_REACH
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = np.linalg.inv(information + np.diag(believed[free] ** -2.0))
    return out


def covariance(case: Case, sheet: Sheet) -> np.ndarray:
    """(N, N) of one coordinate of the readings, m²."""
    distance = np.linalg.norm(sheet.clean, axis=1)
    own = np.full(len(distance), case.noise_mm**2)
    if case.noise == "distance":
        own = own * (distance / distance.mean()) ** 2
    if case.noise == "student":
        own = own / STUDENT * (STUDENT + 3.0) / (STUDENT + 1.0)
    out = np.diag(own) + case.shared_mm**2 * (sheet.pose[:, None] == sheet.pose)
    if case.walk_mm:
        walk = np.minimum.outer(np.arange(len(own)), np.arange(len(own))) + 1.0
        centred = walk - walk.mean(axis=0) - walk.mean(axis=1)[:, None] + walk.mean()
        out += case.walk_mm**2 / 3.0 * centred / np.trace(centred) * len(own)
    return 1e-6 * out
