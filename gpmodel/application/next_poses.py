"""Value of further poses for a fitted model: precision of its effects, and discrimination from alternatives.

The latter is T-optimality for models that are linear in what they do not share: Atkinson and Fedorov (1975).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.application.exports.sample import at_joint_values, measured_table
from gpmodel.application.model_file import SavedModel
from gpmodel.application.predict import point_columns
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.unmeasured_joints import what_is_left
from gpmodel.families import catalogue
from gpmodel.mechanism.protocol import closed
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, closing, observe, prepare
from gpmodel.planning.design import Question, Variance
from gpmodel.planning.poses import over_the_pool
from gpmodel.table.dataset import Dataset

BUILT = 1e-3
"""Prior standard deviation of a geometric error, metres or radians."""

LITTLE = 1e-9
"""Least information of the measured poses on an unknown, as a fraction of that of all candidate poses. Less counts as
none."""


@dataclass(frozen=True)
class Questioned:
    """A finding by its name: the indices of its effects in the model, and its rivals' names, effects, and odds that the
    finding is the cause and not they."""

    name: str
    effects: IntArray
    rivals: tuple[tuple[str, tuple[Effect, ...], float], ...] = ()


def closing_pool(saved: SavedModel | None, pool: Array) -> Array:
    """Keep the joint values (P, n) at which the loops of a mechanism close with its errors; all without a model.

    Raises InputError where the model of closed loops does not hold its table.
    """
    if saved is None or not closed(saved.mechanism):
        return pool
    data = at_joint_values(measured_table(saved), pool, np.random.default_rng(0))
    return pool[closing(saved.model, data, saved.theta)]


@dataclass(frozen=True)
class Outlook:
    """A fitted model, its measured poses and a pool (P, n) of joint values to choose from."""

    saved: SavedModel
    measured: Poses
    pool: Poses

    @classmethod
    def over(cls, saved: SavedModel, pool: Array, rng: np.random.Generator) -> "Outlook":
        """The pool; what poses have besides joint values is as in random rows of the measured table.

        Raises InputError where the model does not hold its table.
        """
        data = measured_table(saved)
        ready = (prepare(saved.mechanism, rows) for rows in (data, at_joint_values(data, pool, rng)))
        return cls(saved, *ready)

    def of_the_point(self, at: Poses | None = None) -> Question:
        """Pose the question of the predicted point: its variance over the pool, or the poses `at`, m²; I-optimal."""
        here, there = self._columns(self.measured), self._columns(self.pool)
        over = there if at is None else self._columns(at)
        return _question(here, there, self.saved.sigma**2 * over_the_pool(over), self._believed)

    def poses_of(self, targets: Dataset, rng: np.random.Generator) -> Poses:
        """Return the poses of a task; what its table does not have is as in random rows of the measured table."""
        like = at_joint_values(self.measured.dataset, targets.q, rng)
        extras = {**like.extras, **{name: v for name, v in targets.extras.items() if name in like.extras}}
        payload = targets.payload if targets.payload_given else like.payload
        return prepare(self.saved.mechanism, replace(like, extras=extras, payload=payload))

    def of_finding(self, finding: Questioned) -> Question:
        """Pose the question of a finding: RMS displacement of the measured points by its standard error, relative to
        the finding's.
        """
        here, there = self._columns(self.measured), self._columns(self.pool)
        own = len(self.saved.covariance.placement) + finding.effects
        theta, moves = self.saved.theta[finding.effects], over_the_pool(here[:, :, own])
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[np.ix_(own, own)] = moves / (theta @ moves @ theta)
        return _question(here, there, weight, self._believed)

    def of_more(self, effects: tuple[Effect, ...]) -> Question:
        """Pose the question of effects outside the model: mean square displacement over the pool, m², by their
        standard errors.
        """
        here, there = (self._columns(poses, effects) for poses in (self.measured, self.pool))
        own = np.arange(there.shape[2] - len(effects), there.shape[2])
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[np.ix_(own, own)] = self.saved.sigma**2 * over_the_pool(there[:, :, own])
        believed = np.concatenate([self._believed, np.zeros(len(effects))])
        return _question(here, there, weight, believed)

    def beside(self, finding: Questioned, rival: tuple[Effect, ...]) -> Question:
        """Pose the question of a finding's amplitude, in its fitted shape, given an alternative: 1 / σ is their
        separation in standard errors.
        """
        here, there = (self._amplitude_last(poses, finding, rival) for poses in (self.measured, self.pool))
        weight = np.zeros((there.shape[2], there.shape[2]))
        weight[-1, -1] = 1.0
        own = len(self.saved.covariance.placement) + finding.effects
        believed = np.concatenate([np.delete(self._believed, own), np.zeros(len(rival) + 1)])
        return _question(here, there, weight, believed)

    @property
    def _believed(self) -> Array:
        """Prior precision 1 / σ² of each unknown (P + E,).

        Geometry that the measured poses may not determine is bounded by BUILT.
        """
        effects = self.saved.model.effects
        priors = np.array([min(e.prior, BUILT) if e.constant else e.prior for e in effects])
        return np.concatenate([np.zeros(len(self.saved.covariance.placement)), 1.0 / priors**2])

    def _amplitude_last(self, poses: Poses, finding: Questioned, rival: tuple[Effect, ...]) -> Array:
        """Columns of everything but the finding, of the rival, and of the finding as it was fitted."""
        columns = self._columns(poses, rival)
        at = len(self.saved.covariance.placement) + finding.effects
        shape = columns[:, :, at] @ self.saved.theta[finding.effects]
        return np.concatenate([np.delete(columns, at, axis=2), shape[:, :, None]], axis=2)

    @cached_property
    def candidates(self) -> dict[str, tuple[Effect, ...]]:
        """Effects of every candidate of the catalogue on the measured poses, by its name."""
        pool = catalogue.candidates(self.saved.mechanism, self.measured.states)
        return {candidate.name: candidate.effects for candidate in pool}

    def _columns(self, poses: Poses, more: tuple[Effect, ...] = ()) -> Array:
        """Columns (N, 3, K) of registration, tool, every effect and `more`, over σ of a coordinate, less what joints
        that are not measured absorb."""
        saved = self.saved
        observed = observe(saved.model, poses, saved.theta, saved.placement)
        columns = point_columns(saved, poses, observed, more) / saved.sigma
        return what_is_left(saved.mechanism, observed, np.ones(columns.shape[:2], dtype=bool), columns)


def _question(here: Array, there: Array, weight: Array, believed: Array) -> Question:
    """Scale the unknowns by their information and build the question from columns at the measured poses and over the
    pool.
    """
    known, may_tell = np.einsum("pij,pik->jk", here, here) + np.diag(believed), np.einsum("pij,pij->j", there, there)
    scale = np.sqrt(np.maximum(np.diag(known), LITTLE * may_tell))
    scale[scale == 0.0] = 1.0
    return Question(there / scale, known / np.outer(scale, scale), Variance(weight / np.outer(scale, scale)))
