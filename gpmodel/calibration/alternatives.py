"""Find alternatives to constants of the standard model: catalogue effects whose motion a constant may absorb."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.priors import GEOMETRY_REACH, prior_rows
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.errors import LISTED
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import INSTRUMENT, Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, closing, observe, prepare
from gpmodel.model.states import measured_torques
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import LeaveOneOut
from gpmodel.wording import measured


@dataclass(frozen=True)
class FittedColumns:
    """Weighted columns of a fitted model at given poses: columns of registration and tool, then columns of effects."""

    calibration: Calibration
    problem: Linearised

    @classmethod
    def at(cls, calibration: Calibration, poses: Poses) -> "FittedColumns":
        """Linearise a fitted model at poses of known set-ups and tools."""
        return cls(calibration, problem_at(calibration, poses))

    @property
    def columns(self) -> Array:
        """Weighted derivatives of the measurements with respect to registration, tool and effects."""
        return self.problem.columns

    @property
    def first(self) -> int:
        """Index of the column of the first effect in `columns`; columns of registration and tool precede it."""
        return self.problem.placement

    @property
    def free(self) -> Mask:
        """Mask of the columns of registration, tool and fitted effects."""
        return self.problem.free(self.calibration.free)

    @cached_property
    def orthogonal(self) -> LeaveOneOut:
        """Part of each fitted parameter's column of derivatives that the columns of the other fitted parameters do not
        explain, with priors as rows after the rows of measurements."""
        fit = self.calibration
        loose = fit.free & np.array([not effect.constant for effect in fit.model.effects], dtype=bool)
        priors, _ = prior_rows(fit.model, fit.theta, self.problem, loose)
        return LeaveOneOut.of(np.vstack([self.columns[:, self.free], priors[:, self.free]]))

    def over_all_rows(self, values: Array) -> Array:
        """Append to values of the measurements one zero for each prior row."""
        return np.vstack([values, np.zeros((len(self.orthogonal.u) - len(values), values.shape[1]))])

    def position(self, k: int) -> int:
        """Return the index of the column of effect `k` (an index from 0) among the fitted columns."""
        return self.first + int(np.sum(self.calibration.free[:k]))

    def columns_of(self, candidate: Candidate) -> Array:
        """Return the weighted derivatives of the measurements with respect to a candidate's effects."""
        return self.problem.effect_rows(candidate.effects, self.calibration.model)

    def difference(self, k: int, candidate: Candidate, sizes: Array) -> Array:
        """Return the displacement of the measurements by effect number `k` minus the displacement by a candidate effect
        with the coefficients `sizes`."""
        constant = self.calibration.theta[k] * self.columns[:, self.first + k]
        return np.asarray(constant - self.columns_of(candidate) @ sizes)


SIGNIFICANT = 3.0
"""Least size of a geometric constant, in standard errors, for which alternative causes are sought."""

TOLD_APART = 2.0
"""Distance of the displacements of two effects over all poses, in standard deviations of the noise, below which the
effects are indistinguishable."""

PLAUSIBLE = 3.0
"""Largest plausible coefficient of a candidate effect, in standard deviations of its prior."""

UNKNOWNS = 2
"""Largest number of unknowns of an alternative cause. A smooth term with more unknowns imitates every constant."""

VISIBLE = 0.05
"""Least part of a candidate's motion that the model does not absorb, for the candidate to be an alternative cause."""

POOL = 400
SHOWN = 4
"""Number of random poses within the joint limits, and of reported poses, where two explanations differ most."""


AT_ONCE = 50
"""Number of candidate effects in memory at once; a candidate needs megabytes with thousands of poses."""

ROW = "row"
"""Input of effects that depend on the row number of the table."""


@dataclass(frozen=True)
class Alternative:
    """A constant of the standard model, and an alternative explanation of its fitted value.

    value: value of the constant, in `unit`.
    sizes: coefficients with which the candidate's effects displace the measurements like the constant.
    moves: RMS displacement, m, of the measured point by the candidate.
    distance: distance of the two displacements over all poses, in standard deviations of the noise.
    poses: joint values, rad and m, where the two explanations differ most. difference: distance at `poses`, m.
    session_inputs: inputs of the candidate that joint values do not determine; `poses` is then empty.
    """

    constant: str
    value: float
    unit: str
    candidate: Candidate
    sizes: Array
    moves: float
    distance: float
    poses: Array
    difference: Array
    session_inputs: tuple[str, ...]

    @property
    def plausible(self) -> bool:
        """True if every coefficient of the candidate is within three standard deviations of its prior."""
        return all(abs(v) <= PLAUSIBLE * e.prior for v, e in zip(self.sizes, self.candidate.effects, strict=True))

    @property
    def amplitude(self) -> float:
        """Root of the sum of squares of a candidate's coefficients; the amplitude of a pair of sine and cosine."""
        return float(np.linalg.norm(self.sizes))

    def words(self, kinds: Sequence[str]) -> str:
        """State in one sentence which effect could replace a constant, and the poses that would separate the two.

        kinds: kind of each joint (revolute or prismatic).
        """
        size, rival = measured(self.value, None, self.unit), measured(self.amplitude, None, self.candidate.unit)
        said = f"{self.constant} of {size} may instead be {self.candidate.name} of {rival}"
        if self.session_inputs:
            inputs = " and ".join(self.session_inputs)
            return f"{said}; the same poses with another {inputs} would separate the two causes"
        if self.difference.max() < ident.NEGLIGIBLE:
            return f"{said}; no joint values separate the two causes"
        factor = np.array([180.0 / np.pi if kind == "revolute" else 1e3 for kind in kinds])
        unit = " and ".join(u for kind, u in (("revolute", "deg"), ("prismatic", "mm")) if kind in kinds)
        at = "; ".join(", ".join(f"{v:.0f}" for v in factor * row) for row in self.poses)
        return f"{said}; measurements at these joint values ({unit}) separate the two causes best: {at}"


def alternatives_of_constants(
    calibration: Calibration, poses: Poses, pool: Iterable[Candidate]
) -> tuple[Alternative, ...]:
    """Return every significant constant that a candidate of `pool` imitates within the noise, the closest first.

    The coefficients w of the candidate minimise |θ c⊥ - C⊥ w|, with the column c of the constant θ, the columns C of
    the candidate, and ⊥ the part that no other column of the model explains (smooth terms as far as their priors
    allow). Constant and candidate are indistinguishable if the minimum is below TOLD_APART = 2 times the noise. If c is
    removed too, C⊥ - ĉ ĉᵀC remains, with the unit vector ĉ along c⊥. Thus one projection of a candidate serves all
    constants; the QR triangle and ĉᵀC replace C⊥.
    """
    model, theta = calibration.model, calibration.theta
    here = FittedColumns.at(calibration, poses)
    own = {effect.name for effect in model.effects}
    sure = [
        int(k)
        for k in np.flatnonzero(calibration.free)
        if model.effects[k].constant and abs(theta[k]) > SIGNIFICANT * calibration.stderr[k]
    ]
    alone = [here.orthogonal.alone(here.position(k)) for k in sure]
    lengths = [float(np.linalg.norm(column)) for column in alone]
    units = np.array([c / max(size, ident.NEGLIGIBLE) for c, size in zip(alone, lengths, strict=True)])
    found: list[tuple[int, Candidate, Array, float]] = []
    offered = [c for c in pool if not own & {effect.name for effect in c.effects}]
    if not sure or not offered:
        return ()
    for candidate, shapes, left in _looked_at(here, offered):
        beside = np.linalg.qr(left, mode="r")
        visible = ident.NEGLIGIBLE + VISIBLE * np.linalg.norm(shapes)
        for k, size, along in zip(sure, lengths, units @ shapes, strict=True):
            seen = np.vstack([beside, along])
            if np.linalg.norm(seen) < visible:
                continue
            target = np.append(np.zeros(len(beside)), theta[k] * size)
            sizes: Array = np.linalg.lstsq(seen, target, rcond=None)[0].astype(float)
            apart = float(np.linalg.norm(target - seen @ sizes)) / calibration.sigma
            if apart < TOLD_APART:
                found.append((k, candidate, sizes, apart))
    fresh = FittedColumns.at(calibration, _anywhere(calibration, poses)) if found else here
    rivals = []
    told = _telling(here, fresh, [(k, candidate, sizes) for k, candidate, sizes, _ in found])
    for (k, candidate, sizes, apart), poses_and_sizes in zip(found, told, strict=True):
        effect, moved = model.effects[k], np.linalg.norm(here.columns_of(candidate) @ sizes) / np.sqrt(len(poses))
        at = (*poses_and_sizes, session_inputs(poses, model.mechanism, candidate.effects))
        value, moves = float(theta[k]), float(moved)
        rivals.append(Alternative(effect.name, value, effect.unit, candidate, sizes, moves, apart, *at))
    return tuple(sorted(rivals, key=lambda rival: rival.distance))


def _looked_at(here: FittedColumns, offered: Sequence[Candidate]) -> Iterator[tuple[Candidate, Array, Array]]:
    """Yield every candidate effect with its derivatives, and with the part of them that the model does not explain."""
    for first in range(0, len(offered), AT_ONCE):
        some = offered[first : first + AT_ONCE]
        columns = here.over_all_rows(np.hstack([here.columns_of(candidate) for candidate in some]))
        ends = np.cumsum([len(candidate.effects) for candidate in some])[:-1]
        left = ident.remove(here.orthogonal.u, columns)
        yield from zip(some, np.split(columns, ends, axis=1), np.split(left, ends, axis=1), strict=True)


def closest_alternatives(calibration: Calibration, poses: Poses) -> tuple[Alternative, ...]:
    """Return the alternatives to significant constants: at most one per constant, and a limited total.

    Candidates are effects of the catalogue with at most two unknowns. For each constant the plausible candidate
    that moves the point least is selected, if other measurements could distinguish the two and its motion has the size
    of an error: more than the standard error of a mean, less than 1 cm or 10 mrad. Effects that depend on the row
    number are excluded, because a constant acts on all rows alike.
    """
    least = calibration.sigma / np.sqrt(len(poses))
    mechanism = calibration.model.mechanism
    offered = catalogue.candidates(mechanism, poses.states)
    pool = [c for c in offered if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    with threadpool_limits(limits=1, user_api="blas"):
        found = [
            rival
            for rival in alternatives_of_constants(calibration, poses, pool)
            if rival.plausible
            and least < rival.moves < GEOMETRY_REACH
            and (rival.session_inputs or rival.difference.max() > calibration.sigma)
        ]
    found.sort(key=lambda rival: rival.moves)
    best: dict[str, Alternative] = {}
    for rival in found:
        best.setdefault(rival.constant, rival)
    return tuple(best.values())[:LISTED]


def session_inputs(poses: Poses, mechanism: Mechanism, effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return the inputs of effects that joint values do not determine.

    An effect on the instrument has the input "instrument". Of other effects, the inputs other than joint values, the
    point and computed loads count.
    """
    if any(INSTRUMENT in effect.slots for effect in effects):
        return (INSTRUMENT,)
    loads = set(mechanism.loads(poses.dataset.q[:1], poses.dataset.payload[:1]))
    loads -= {f"torque_{joint}" for joint in measured_torques(mechanism, poses.dataset)}
    known, weights = {joint.name for joint in mechanism.joints} | {"x", "y", "z"} | loads, poses.states.weights
    inputs = dict.fromkeys(name for effect in effects for name in effect.inputs)
    return tuple(n for n in inputs if n not in known and not (weights and weights.column(n) is not None))


def _anywhere(calibration: Calibration, poses: Poses) -> Poses:
    """Return random poses within the joint limits, or the measured ranges without limits, with predicted positions, of
    the first set-up and tool.

    Random poses count as measured in order, for effects that depend on earlier rows. Poses at which a closed loop
    cannot close are omitted.
    """
    model = calibration.model
    q = random_poses(model.mechanism, POOL, np.random.default_rng(0), poses.dataset.q)
    at = np.zeros(POOL, dtype=np.int64)
    data = replace(poses.dataset.subset(at), q=q, observations=(), in_order=True)
    data = data.subset(closing(model, data, calibration.theta))
    fresh = prepare(model.mechanism, data)
    tips = observe(model, fresh, calibration.theta, calibration.placement).tips.instrument[:, :3, 3]
    return prepare(model.mechanism, replace(data, position=tips))


def _telling(
    here: FittedColumns, fresh: FittedColumns, found: Sequence[tuple[int, Candidate, Array]]
) -> list[tuple[Array, Array]]:
    """Return for each constant the joint values, rad and m, where its candidate differs most, and the distances, m.

    found: for each alternative the index of a constant, the candidate, and the coefficients of the candidate.
    All candidates of one constant are solved together.
    """
    mechanism, poses = fresh.calibration.model.mechanism, fresh.problem.poses
    out = [(np.zeros((0, len(mechanism.joints))), np.zeros(0))] * len(found)
    open_to_poses = [
        i for i, (_, candidate, _) in enumerate(found) if not session_inputs(poses, mechanism, candidate.effects)
    ]
    for k in sorted({found[i][0] for i in open_to_poses}):
        mine = [i for i in open_to_poses if found[i][0] == k]
        differ, rows = (
            np.column_stack([there.difference(k, found[i][1], found[i][2]) for i in mine]) for there in (here, fresh)
        )
        others = here.orthogonal.by_others(here.position(k), here.over_all_rows(differ))
        both, shared = _shared(here, fresh)
        for i, column in zip(mine, (rows - fresh.columns[:, fresh.free][:, shared] @ others[both]).T, strict=True):
            squares = np.bincount(fresh.problem.pose_of_row, column**2, minlength=len(poses))
            chosen = np.argsort(squares)[::-1][:SHOWN]
            out[i] = poses.dataset.q[chosen], np.sqrt(squares[chosen])
    return out


def _shared(here: FittedColumns, fresh: FittedColumns) -> tuple[IntArray, IntArray]:
    """Return the indices, in `here` and in `fresh`, of the fitted columns that `here` and `fresh` have in common.

    Unknowns of one table alone, such as fixed ends of distances, exist in `here` only.
    """
    names = [c.problem.placement_names for c in (here, fresh)]
    pairs = [(names[0].index(name), k) for k, name in enumerate(names[1]) if name in names[0]]
    pairs += [(here.first + k, fresh.first + k) for k in range(int(here.calibration.free.sum()))]
    both, shared = np.array(pairs).T
    return both, shared
