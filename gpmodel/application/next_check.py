"""Check a machine against its model pose by pose: select the next pose to measure, and decide when to stop.

With n poses, each of the two tests of a model has the significance level α · 6 / (π² k²), k = n - 5, α = FALSE_ALARM.
All tests together report a change for at most one unchanged machine in twenty (union bound, Σ 1/k² = π²/6). A check
ends when a change is identified, or when any change of a joint zero, the tool, the geometry or the size of an effect
that moves the tool by more than a limit would be significant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from gpmodel.application.changed_model import motions
from gpmodel.application.exports.sample import measured_table
from gpmodel.application.model_file import SavedModel
from gpmodel.application.named_changes import POWER
from gpmodel.application.possible_changes import Kind, PossibleChange
from gpmodel.application.verify import Verified, verified
from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.model.error_model import Poses, prepare
from gpmodel.numerics import rank
from gpmodel.planning.poses import spread_among
from gpmodel.table.blocks import sharing
from gpmodel.table.dataset import Dataset

LAST = 20
"""Number of poses of the last test whose reported change remains reported. Later tests have a level below 0.0001."""
EXCLUDED: tuple[Kind, ...] = ("zero", "tool", "size", "geometry")
"""Kinds of change that a check has to exclude before it confirms the model of a machine."""
FALSE_ALARM = 0.05
"""Probability that the check of an unchanged machine ends with a change, over any number of poses."""
FIRST = 6
"""Number of different poses before the first test. With one wrong pose, five remain for registration and tool."""
SEEN = 1e-6
"""Least share of a joint zero's displacement that registration does not absorb. With a smaller share, the poses do not
determine the joint zero."""
SAME = 1e-4
"""Largest difference of joint values of one pose, rad or m."""


@dataclass(frozen=True)
class HiddenChange:
    """A possible change of a machine that its check may not have detected.

    moves: largest displacement of the tool by the change, m, RMS over the poses, without the part that registration
    absorbs.
    """

    name: str
    moves: float


def significance(poses: int) -> float:
    """Return the significance level of each of the two tests of a check for a number of poses."""
    look = max(poses - FIRST + 1, 1)
    return 0.5 * FALSE_ALARM * 6.0 / (math.pi * look) ** 2


def level(saved: SavedModel, dataset: Dataset) -> float:
    """Return the significance level of a check's present test: that of the first test that reported a change, if any.

    Earlier tests used the first 6, 7, ... different poses. A change that a test reports remains reported as long as it
    is significant at the level of that test, which does not raise the probability of a false alarm.
    """
    pose_id = sharing(dataset)
    starts = np.sort(np.unique(pose_id, return_index=True)[1])
    for count, end in enumerate(starts[FIRST:LAST].tolist(), FIRST):
        try:
            if verified(saved, dataset.subset(np.arange(end)), significance(count)).verdict != "holds":
                return significance(count)
        except InputError:
            continue
    return significance(len(starts))


def _excluded(change: PossibleChange) -> bool:
    return change.kind in EXCLUDED and not change.of_a_frame and not change.rows


@dataclass(frozen=True)
class Pool:
    """Candidate poses of a check: the poses of the model's fit, which the arm can reach.

    found: result of the check on the measured poses; None if they are too few for a test.
    """

    saved: SavedModel
    found: Verified | None
    poses: Poses

    @staticmethod
    def of(saved: SavedModel, found: Verified | None = None) -> "Pool":
        """Return the candidate poses; raise InputError if the model does not contain the table of its fit."""
        data = measured_table(saved)
        if found is not None:
            there = found.session.poses.dataset
            here = {name: np.full(len(data), there.label(name)[0]) for name in ("setup", "tool")}
            data = replace(data, labels={**data.labels, **here})
        return Pool(saved, found, prepare(saved.mechanism, data))

    @property
    def q(self) -> Array:
        """Joint values of the candidate poses, rad and m."""
        return self.poses.dataset.q

    def not_among(self, taken: Array) -> IntArray:
        """Return the indices of the candidate poses that are not in `taken`, or of all poses if `taken` has all."""
        there = np.array([len(taken) > 0 and (np.abs(taken - one) < SAME).all(axis=1).any() for one in self.q])
        return np.flatnonzero(~there) if not there.all() else np.arange(len(self.q))

    @cached_property
    def _tried(self) -> list[PossibleChange]:
        """Changes of the machine, of one part each, that a check has to exclude before it confirms the model."""
        return [] if self.found is None else [c for c in self.found.tried if _excluded(c)]

    def reads(self, change: PossibleChange) -> bool:
        """Return whether the candidate poses have all inputs (columns) of a possible change."""
        assert self.found is not None
        inputs = {name for effect in change.effects for name in effect.inputs}
        return inputs & set(self.found.session.poses.states.columns) <= set(self.poses.states.columns)

    def _motions(self, changes: Sequence[PossibleChange], poses: Poses) -> tuple[Array, Array]:
        assert self.found is not None
        return motions(self.found.near.session, self.found.near.problem, changes, poses)

    def unseen(self, level: float, limit: float) -> tuple[HiddenChange, ...]:
        """Return the possible changes that could move the tool by more than `limit`, m, without being detected.

        level: significance level of the test for a change.
        """
        levers = _levers(*self._motions(self._tried, self.poses))
        share = np.concatenate([np.full(c.columns.shape[1], c.share) for c in self._tried])
        seen = np.concatenate([np.linalg.norm(c.columns, axis=0) for c in self._tried])
        moves = (special.ndtri(POWER) - special.ndtri(0.5 * level * share)) * levers / seen
        names = [change.name for change in self._tried for _ in range(change.columns.shape[1])]
        found = {n: float(m) for n, m in sorted(zip(names, moves, strict=True), key=lambda one: one[1]) if m > limit}
        return tuple(HiddenChange(name, moved) for name, moved in found.items())

    def next(self, taken: Array) -> Array:
        """Return the joint values of the next pose to measure, which is not among the poses `taken`.

        The pose maximises the information on the suspected (else the least determined) change, relative to the tool's
        displacement. Before the first test, the pose farthest from `taken` is returned.
        """
        left = self.not_among(taken)
        if self.found is None:
            others = taken if len(taken) else None
            return np.asarray(self.q[left[spread_among(self.saved.mechanism, self.q[left], 1, others)[0]]])
        session, suspect = self.found.session, self.found.suspect
        changes = self._tried if suspect is None or not self.reads(suspect) else [suspect]
        there = self._motions(changes, self.poses)
        able = (levers := _levers(*there)) > 0.0
        have = self._motions(changes, session.poses.subset(np.flatnonzero(session.use)))
        ahead = [[np.concatenate([h, c[[k]]]) for h, c in zip(have, there, strict=True)] for k in left]
        seen = np.array([_information(*one) for one in ahead])[:, able] / levers[able] ** 2
        return np.asarray(self.q[left[int(np.argmax(seen.min(axis=1, initial=np.inf)))]])


def _levers(placed: Array, moves: Array) -> Array:
    """Return the RMS displacement of the tool, m, by each parameter of a change; zero if registration absorbs it."""
    left, alone = _information(placed, moves), np.sum(moves**2, axis=(0, 1))
    return np.asarray(np.sqrt(np.where(left > SEEN * alone, left, 0.0) / len(placed)))


def _information(placed: Array, moves: Array) -> Array:
    """Return the sum of squared displacements by each parameter, after the registration is projected out."""
    placed, moves = (part.reshape(-1, part.shape[2]) for part in (placed, moves))
    return np.asarray(np.sum(rank.remove(rank.orthonormal(placed), moves) ** 2, axis=0))
