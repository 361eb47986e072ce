"""The residual as genetic programming sees it: the sensitivity, the model's columns and the pull at every site."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.residual import Residual
from gpmodel.evolution.projection import Targets
from gpmodel.formula.expression import ONE
from gpmodel.model.sites import Site


def targets(residual: Residual, sites: Sequence[Site], rows: IntArray) -> Targets:
    """The residual seen from sites at some poses: weight, cross and pull of every site, energy in proportion."""
    columns = _columns(residual, sites)
    weight = _by_pose(residual, columns**2, rows)
    enabled = residual.span.basis[: residual.measured]
    cross = np.stack([_compact(_by_pose(residual, columns[:, [s]] * enabled, rows)) for s in range(len(sites))])
    alive = weight.sum(axis=1) > 1e-12
    samples = int(len(residual.values) * len(rows) / len(residual.poses))
    blank = Targets(
        weight * alive[:, None], cross, np.zeros(weight.shape), 0.0, tuple(site.name for site in sites), samples,
        residual.criteria.scored_share**2,
    )  # fmt: skip
    return aimed(blank, residual, sites, rows, residual.values)


def aimed(blank: Targets, residual: Residual, sites: Sequence[Site], rows: IntArray, values: Array) -> Targets:
    """The targets with other residual values (M + B,)."""
    pull = _by_pose(residual, _columns(residual, sites) * values[: residual.measured, None], rows)
    return replace(blank, pull=pull, energy=float(values @ values) * len(rows) / len(residual.poses))


def _columns(residual: Residual, sites: Sequence[Site]) -> Array:
    return residual.columns([site.effect("", ONE, "") for site in sites])


def _by_pose(residual: Residual, values: Array, rows: IntArray) -> Array:
    """Sums (C, len(rows)) of the values (M, C) of each of some poses."""
    out = np.zeros((len(residual.poses), values.shape[1]))
    present, first = np.unique(residual.problem.pose_of_row, return_index=True)
    out[present] = np.add.reduceat(values, first, axis=0)
    return out[rows].T


def _compact(cross: Array) -> Array:
    """Rows (min(K, N), N) with the same BᵀB as `cross` (K, N)."""
    few = len(cross) <= cross.shape[1]
    return cross if few else linalg.qr(cross, mode="r", check_finite=False)[0][: cross.shape[1]]
