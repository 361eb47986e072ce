"""What the standard model hides: effects of the catalogue that a constant of it could equally be."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.numerics import rank as ident
from gpmodel.wording import measured

SIGNIFICANT = 3.0
"""Standard deviations from zero at which a constant is worth a second thought."""

TOLD_APART = 2.0
"""Standard deviations by which two explanations must differ over all poses, or these poses cannot tell them apart."""

VISIBLE = 0.05
"""A candidate of which the model leaves less than this share says nothing about a constant."""

POOL = 400
SHOWN = 4
"""Random poses within the limits, and how many of them are named as those that tell most."""


@dataclass(frozen=True)
class Rival:
    """A constant of the standard model, and what its fitted value could equally be.

    value: of the constant, in its unit. sizes: (k,) of the candidate's effects that look the same at these poses.
    apart: by how many standard deviations all poses together tell the two apart. poses: (p, n) joint values where they
    differ most, and by how much, (p,) m.
    """

    constant: str
    value: float
    candidate: Candidate
    sizes: Array
    apart: float
    poses: Array
    difference: Array

    @property
    def amplitude(self) -> float:
        """Root of the sum of squares of the sizes: of a pair, sine and cosine, its amplitude."""
        return float(np.linalg.norm(self.sizes))

    @property
    def words(self) -> str:
        """One sentence, with the poses that would tell the two apart where joint values alone do."""
        unit = self.candidate.unit
        size, rival = measured(self.value, None, "m"), measured(self.amplitude, None, unit)
        said = f"{self.constant} of {size} could equally be {self.candidate.name} of {rival}"
        if not len(self.poses) or self.difference.max() < ident.NEGLIGIBLE:
            return f"{said}; joint values alone do not tell them apart"
        at = "; ".join(", ".join(f"{np.degrees(v):.0f}" for v in row) for row in self.poses)
        return f"{said}; these joint values (deg) would tell them apart best: {at}"


def rivals_of_constants(
    calibration: Calibration, poses: Poses, pool: Iterable[Candidate], seed: int = 0
) -> tuple[Rival, ...]:
    """Every significant constant that a candidate of `pool` mimics within the noise of these poses, best mimics first.

    With c the constant's column, C the candidate's, and ⊥ what the model's other columns leave: w minimises
    |θ c⊥ - C⊥ w|. The two cannot be told apart where that is below TOLD_APART σ. seed: of the poses tried.
    """
    model, theta = calibration.model, calibration.theta
    here = _Columns.at(calibration, poses)
    own = {effect.name for effect in model.effects}
    sure = [
        int(k)
        for k in np.flatnonzero(calibration.kept)
        if model.effects[k].constant and abs(theta[k]) > SIGNIFICANT * calibration.stderr[k]
    ]
    fresh = _Columns.at(calibration, _anywhere(calibration, poses, seed))
    found = []
    for candidate in (c for c in pool if not own & {effect.name for effect in c.effects}):
        shapes = here.of(candidate)
        for k in sure:
            others, constant = here.without(k), theta[k] * here.columns[:, here.first + k]
            left = ident.remove(ident.orthonormal(others), np.column_stack([constant, shapes]))
            if np.linalg.norm(left[:, 1:]) < ident.NEGLIGIBLE + VISIBLE * np.linalg.norm(shapes):
                continue
            sizes: Array = np.linalg.lstsq(left[:, 1:], left[:, 0], rcond=None)[0].astype(float)
            apart = float(np.linalg.norm(left[:, 0] - left[:, 1:] @ sizes)) / calibration.sigma
            if apart < TOLD_APART:
                others_change = np.linalg.lstsq(others, constant - shapes @ sizes, rcond=None)[0]
                told = _telling(fresh, candidate, k, theta[k], sizes, others_change)
                found.append(Rival(model.effects[k].name, float(theta[k]), candidate, sizes, apart, *told))
    return tuple(sorted(found, key=lambda rival: rival.apart))


def rivals_in_words(calibration: Calibration, poses: Poses) -> str:
    """What each significant constant of a mechanism with free joints could equally be, empty where nothing could.

    Of the catalogue's shapes over the joints' own angles: for every constant the smallest one that some poses would
    tell from it.
    """
    mechanism = calibration.model.mechanism
    if not free_joints(mechanism):
        return ""
    angles = {joint.name for joint in mechanism.joints}
    pool = [
        c for c in catalogue.candidates(mechanism, poses.states) if {i for e in c.effects for i in e.inputs} <= angles
    ]
    best: dict[str, Rival] = {}
    for rival in rivals_of_constants(calibration, poses, pool):
        known = best.get(rival.constant)
        told = rival.difference.max(initial=0.0) > calibration.sigma
        if told and (known is None or rival.amplitude < known.amplitude):
            best[rival.constant] = rival
    return " ".join(f"{rival.words}." for rival in best.values())


@dataclass(frozen=True)
class _Columns:
    """The weighted columns (M, K) of a fitted model at some poses; effects begin at `first`."""

    calibration: Calibration
    problem: Linearised

    @classmethod
    def at(cls, calibration: Calibration, poses: Poses) -> "_Columns":
        return cls(calibration, problem_at(calibration, poses))

    @property
    def columns(self) -> Array:
        return self.problem.columns

    @property
    def first(self) -> int:
        return self.problem.placement

    def without(self, k: int) -> Array:
        """All columns of the model but that of effect k, and those that were dropped."""
        kept = np.concatenate([np.ones(self.first, dtype=bool), self.calibration.kept])
        kept[self.first + k] = False
        return self.columns[:, kept]

    def of(self, candidate: Candidate) -> Array:
        """Columns (M, k) of a candidate's effects."""
        problem = self.problem
        return problem.weigh(effect_columns(candidate.effects, self.calibration.model, problem.poses, problem.observed))


def _anywhere(calibration: Calibration, poses: Poses, seed: int) -> Poses:
    """Random poses within the limits as the fitted model sees them, in the first set-up and with the first tool."""
    model = calibration.model
    q = random_poses(model.mechanism, POOL, np.random.default_rng(seed))
    at = np.zeros(POOL, dtype=np.int64)
    data = replace(poses.dataset.subset(at), q=q)
    fresh = prepare(model.mechanism, data)
    tips = observe(model, fresh, calibration.theta, calibration.placement).tips.instrument[:, :3, 3]
    return prepare(model.mechanism, replace(data, position=tips))


def _telling(
    fresh: _Columns, candidate: Candidate, k: int, value: float, sizes: Array, others_change: Array
) -> tuple[Array, Array]:
    """Joint values (p, n) at which the two explanations differ most, and by how much (p,), m."""
    joints = [joint.name for joint in fresh.calibration.model.mechanism.joints]
    if not {name for effect in candidate.effects for name in effect.inputs} <= {*joints, "x", "y", "z"}:
        return np.zeros((0, len(joints))), np.zeros(0)
    rows = value * fresh.columns[:, fresh.first + k] - fresh.of(candidate) @ sizes - fresh.without(k) @ others_change
    squares = np.bincount(fresh.problem.pose_of_row, rows**2, minlength=POOL)
    chosen = np.argsort(squares)[::-1][:SHOWN]
    return fresh.problem.poses.dataset.q[chosen], np.sqrt(squares[chosen])
