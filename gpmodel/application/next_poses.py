"""Value of further poses for a fitted model: precision of its effects, and separation from alternative explanations.

The separation is T-optimality for models that are linear in their unshared parameters: Atkinson and Fedorov (1975).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from gpmodel.application.exports.sample import at_joint_values, measured_table
from gpmodel.application.kinematics import with_memory_columns
from gpmodel.application.model_file import SavedModel
from gpmodel.application.predict import point_columns
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.unmeasured_joints import without_joint_motion
from gpmodel.families import catalogue
from gpmodel.mechanism.protocol import closed
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, closing, observe, prepare
from gpmodel.planning.design import Design, LOptimal
from gpmodel.planning.poses import variance_root
from gpmodel.table.dataset import Dataset

BUILT = 1e-3
"""Prior standard deviation of a geometric error, m or rad."""

LITTLE = 1e-9
"""Least information of the measured poses on a parameter, relative to all candidate poses; less counts as none."""


@dataclass(frozen=True)
class Alternatives:
    """A finding and its alternative causes. effects: indices of the finding's effects in the model.

    rivals: names and effects of the alternatives, and odds of the finding against each alternative.
    """

    name: str
    effects: IntArray
    rivals: tuple[tuple[str, tuple[Effect, ...], float], ...] = ()


def closing_pool(saved: SavedModel | None, pool: Array) -> Array:
    """Return the candidate joint values at which kinematic loops close with fitted errors; all without a model.

    Raises InputError if the model of closed loops does not contain its table.
    """
    if saved is None or not closed(saved.mechanism):
        return pool
    data = at_joint_values(measured_table(saved), pool, np.random.default_rng(0))
    return pool[closing(saved.model, data, saved.theta)]


@dataclass(frozen=True)
class PlanningContext:
    """A fitted model, its measured poses, and a pool of candidate poses.

    candidates: effects of every catalogue candidate on the measured poses, by name.
    """

    saved: SavedModel
    measured: Poses
    pool: Poses
    candidates: Mapping[str, tuple[Effect, ...]]

    @classmethod
    def from_joint_values(cls, saved: SavedModel, pool: Array, rng: np.random.Generator) -> "PlanningContext":
        """Make the candidate poses from joint values. Their rows follow the last measured row; other inputs come from
        random rows of the measured table.

        Raises InputError if the model file does not contain the fitted table.
        """
        data = measured_table(saved)
        measured = prepare(saved.mechanism, data)
        candidates = {c.name: c.effects for c in catalogue.candidates(saved.mechanism, measured.states)}
        known = with_memory_columns(saved, data, chain.from_iterable(candidates.values()))
        further = replace(at_joint_values(known, pool, rng), row=np.full(len(pool), data.row.max() + 1))
        return cls(saved, measured, prepare(saved.mechanism, further), candidates)

    def point_problem(self, at: Poses | None = None) -> Design:
        """Return the experimental-design problem of the predicted point (I-optimal): its variance, m², at candidate
        poses or at the poses `at`."""
        here, there = self._columns(self.measured), self._columns(self.pool)
        over = there if at is None else self._columns(at)
        return _question(here, there, self.saved.sigma**2 * variance_root(over), self._precision)

    def task_poses(self, targets: Dataset, rng: np.random.Generator) -> Poses:
        """Return the poses of a task; inputs missing in the task's table are taken from random rows of the measured
        table."""
        like = at_joint_values(self.measured.dataset, targets.q, rng)
        extras = {**like.extras, **{name: v for name, v in targets.extras.items() if name in like.extras}}
        payload = targets.payload if targets.payload_given else like.payload
        return prepare(self.saved.mechanism, replace(like, extras=extras, payload=payload))

    def finding_problem(self, finding: Alternatives) -> Design:
        """Return the experimental-design problem of a finding: its standard error relative to its RMS displacement."""
        here, there = self._columns(self.measured), self._columns(self.pool)
        own = len(self.saved.covariance.placement) + finding.effects
        theta, moves = self.saved.theta[finding.effects], variance_root(here[:, :, own])
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[np.ix_(own, own)] = moves / (theta @ moves @ theta)
        return _question(here, there, weight, self._precision)

    def effects_problem(self, effects: tuple[Effect, ...]) -> Design:
        """Return the experimental-design problem of effects that are not in the model: mean square displacement, m²."""
        here, there = (self._columns(poses, effects) for poses in (self.measured, self.pool))
        own = np.arange(there.shape[2] - len(effects), there.shape[2])
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[np.ix_(own, own)] = self.saved.sigma**2 * variance_root(there[:, :, own])
        precision = np.concatenate([self._precision, np.zeros(len(effects))])
        return _question(here, there, weight, precision)

    def separation(self, finding: Alternatives, rival: tuple[Effect, ...]) -> Design:
        """Return the experimental-design problem of a finding's amplitude given an alternative explanation.

        With σ the standard error of the amplitude, 1 / σ is the distance of the two explanations in standard errors.
        """
        here, there = (self._amplitude_last(poses, finding, rival) for poses in (self.measured, self.pool))
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[-1, -1] = 1.0
        own = len(self.saved.covariance.placement) + finding.effects
        precision = np.concatenate([np.delete(self._precision, own), np.zeros(len(rival) + 1)])
        return _question(here, there, weight, precision)

    @property
    def _precision(self) -> Array:
        """Prior precision (one over the variance) of each parameter of the model.

        Constants that the measured poses may not determine have the prior standard deviation 1 mm or 1 mrad (BUILT).
        """
        effects = self.saved.model.effects
        priors = np.array([min(e.prior, BUILT) if e.constant else e.prior for e in effects])
        return np.concatenate([np.zeros(len(self.saved.covariance.placement)), 1.0 / priors**2])

    def _amplitude_last(self, poses: Poses, finding: Alternatives, rival: tuple[Effect, ...]) -> Array:
        """Return derivatives with respect to other parameters, the alternative, and the finding's amplitude."""
        columns = self._columns(poses, rival)
        at = len(self.saved.covariance.placement) + finding.effects
        shape = columns[:, :, at] @ self.saved.theta[finding.effects]
        return np.concatenate([np.delete(columns, at, axis=2), shape[:, :, None]], axis=2)

    def _columns(self, poses: Poses, more: tuple[Effect, ...] = ()) -> Array:
        """Return the derivatives of the coordinates with respect to registration, tool, effects and `more`, over the
        noise σ. Motions of unmeasured joints are projected out.

        """
        saved = self.saved
        observed = observe(saved.model, poses, saved.theta, saved.placement)
        columns = point_columns(saved, poses, observed, more) / saved.sigma
        return without_joint_motion(saved.mechanism, observed, np.ones(columns.shape[:2], dtype=bool), columns)


def _question(here: Array, there: Array, weight: Array, precision: Array) -> Design:
    """Return the experimental-design problem from columns at the measured and candidate poses, scaled by
    information."""
    known, may_tell = np.einsum("pij,pik->jk", here, here) + np.diag(precision), np.einsum("pij,pij->j", there, there)
    scale = np.sqrt(np.maximum(np.diag(known), LITTLE * may_tell))
    scale[scale == 0.0] = 1.0
    return Design(there / scale, known / np.outer(scale, scale), LOptimal(weight / np.outer(scale, scale)))
