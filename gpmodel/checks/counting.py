"""Counts of measured values and of unknowns."""

from dataclasses import replace

import numpy as np

from gpmodel.calibration.nominal import CONDITION_LIMIT, linearised_at_nominal
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.effect import Effect
from gpmodel.model.observation import observations
from gpmodel.numerics import rank as ident
from gpmodel.table.dataset import Dataset, unmeasured

RANK_POSES = 60
"""Random poses that a rank is read from: 180 values, several times the unknowns of a long arm."""


def measured_values(data: Dataset) -> int:
    """Count the measured values."""
    return sum(int(kind.readings.sum()) for kind in observations(data))


def unknowns(mechanism: Mechanism, data: Dataset, effects: tuple[Effect, ...]) -> int:
    """Count the unknowns: registration, tool, anchors and constant effects.

    Counts combinations that well spread poses can distinguish: rank at the nominal geometry over random poses within
    the limits.
    """
    many = unmeasured(data.joints, random_poses(mechanism, RANK_POSES, np.random.default_rng(0)))
    nothing, something = many.position, np.zeros((RANK_POSES, 3))
    kinds = replace(
        many,
        position=something if np.isfinite(data.position).any() else nothing,
        rotation=something if data.has_rotation else nothing,
        distances={name: np.full(RANK_POSES, 1.0 + i) for i, name in enumerate(data.distances)},
    )
    problem = linearised_at_nominal(mechanism, tuple(e for e in effects if e.constant), kinds)
    placed, columns = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    kept = ident.rank(placed, columns).kept(CONDITION_LIMIT)
    setups, tools = len(data.codes("setup")[0]), len(data.codes("tool")[0])
    absolute = bool(np.isfinite(data.position).any() or data.has_rotation)
    more = 6 * (setups - 1) * absolute + (6 if data.has_rotation else 3) * (tools - 1)
    own = sum(len(names) for kind in observations(data)[2 + len(data.distances) :] for names in kind.own.values())
    return int(ident.orthonormal(placed).shape[1] + len(kept) + more + own)
