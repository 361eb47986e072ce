"""Optimal experimental designs: selection of measurement poses from a pool of candidates.

A pose adds JᵀJ to the information M of the unknowns. J has the derivatives of the pose's three coordinates with respect
to the unknowns, over the standard deviation of a coordinate. M⁻¹ is the covariance of the unknowns. Sources: Fedorov
(1972); Pukelsheim (1993); Atkinson and Fedorov (1975).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from scipy import linalg
from scipy.special import ndtri

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import random_poses, ranges
from gpmodel.mechanism.protocol import CollisionShape, Mechanism, closed, unwrapped
from gpmodel.numerics.interval import COVERAGE
from gpmodel.numerics.se3 import chain

MARGIN = 0.02
"""Fraction of a joint's range that random poses avoid near the joint limits, half at each limit."""

ATTEMPTS = 50
"""Number of random poses drawn for each wanted pose, before an error reports that too few poses are possible."""


@dataclass(frozen=True)
class Sight:
    """Line of sight between an instrument and a reflector.

    instrument: position (3,) in the root frame, m.
    normal: axis (3,) of the reflector's acceptance cone in the measured frame.
    cone: half-angle of the acceptance cone, rad.
    """

    instrument: Array
    normal: Array
    cone: float


@dataclass(frozen=True)
class Constraints:
    """Constraints that every selected measurement pose has to meet.

    box: smallest and largest coordinates of the tool point in the root frame, (2, 3), m.
    tool: tool point (3,) in the measured frame, m.
    sight: line of sight to the instrument; None for no constraint.
    collisions: True to exclude poses in which the arm collides with itself, if the shape of the arm is known.
    measured: joint values (poses, joints), whose range limits the joints without joint limits.
    """

    box: Array = field(default_factory=lambda: np.array([[-np.inf] * 3, [np.inf] * 3]))
    tool: Array = field(default_factory=lambda: np.zeros(3))
    sight: Sight | None = None
    collisions: bool = True
    measured: Array | None = None

    def failures(self, mechanism: Mechanism, q: Array) -> dict[str, Mask]:
        """Return {constraint: mask of the poses that violate the constraint} for poses q (poses, joints)."""
        frames = chain(mechanism.transforms(q))[-1]
        points = frames[:, :3, :3] @ self.tool + frames[:, :3, 3]
        found: dict[str, Mask] = {"outside the box": ((points < self.box[0]) | (points > self.box[1])).any(axis=1)}
        bare = unwrapped(mechanism)
        body = bare if self.collisions and isinstance(bare, CollisionShape) else None
        if self.sight is not None:
            beam = self.sight.instrument - points
            facing = np.einsum("ni,ni->n", frames[:, :3, :3] @ _unit(self.sight.normal), _unit(beam))
            found["turned away from the instrument"] = facing < np.cos(self.sight.cone)
        good = np.flatnonzero(~np.any(list(found.values()), axis=0))
        hidden, meets = np.zeros(len(q), dtype=bool), np.zeros(len(q), dtype=bool)
        if body is not None and len(good):
            meets[good] = body.collides(q[good])
            if self.sight is not None:
                hidden[good] = body.hides(q[good], points[good], self.sight.instrument)
        return found | {"in collision with itself": meets, "hidden from the instrument": hidden}


def has_collision_shape(mechanism: Mechanism) -> bool:
    """Return True if the mechanism has a shape for collision tests."""
    bare = unwrapped(mechanism)
    return isinstance(bare, CollisionShape) and bare.has_shape


def candidates(
    mechanism: Mechanism,
    count: int,
    rng: np.random.Generator,
    reach: Constraints | None = None,
    least: int | None = None,
) -> Array:
    """Draw at most `count` random rows of joint values inside the joint limits that meet all constraints.

    Raises InputError with the constraint that excludes most poses if fewer than `least` are found, by default `count`.
    """
    reach = reach or Constraints()
    middle = np.mean(ranges(mechanism, reach.measured), axis=0)
    chosen: list[Array] = []
    found, tried, failed = 0, 0, dict[str, int]()
    while found < count and tried < ATTEMPTS * count:
        q = middle + (1.0 - MARGIN) * (random_poses(mechanism, count, rng, reach.measured) - middle)
        if loops := closed(mechanism):
            q = q[loops.closes(q)]
        failures = reach.failures(mechanism, q)
        keep = ~np.any(list(failures.values()), axis=0)
        failed = {name: failed.get(name, 0) + int(bad.sum()) for name, bad in failures.items()}
        chosen.append(q[keep])
        found, tried = found + int(keep.sum()), tried + count
    if found < (count if least is None else least):
        worst = max(failed, key=lambda name: failed[name])
        raise InputError(
            f"{found} of {tried} random poses of {mechanism.name} are feasible, {failed[worst]} are {worst}; "
            "expected a wider box, cone or range"
        )
    return np.vstack(chosen)[:count]


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


EXCHANGES = 200
"""Largest number of exchanges of a selected measurement pose for another pose."""

TRIED = 10
"""Number of poses tried in an exchange of measurement poses: those with the largest gain when added."""

ENOUGH = 1e-6
"""Least improvement of the logarithm of the design criterion by an exchange of two poses."""

DETERMINED = 1e-12
"""Least eigenvalue of the information matrix, scaled to a unit diagonal, at which all unknowns are determined. The
geometry's prior weighs as little as a millionth of a measurement."""

LITTLE = 1e-6
"""Information added to every unknown so that the information matrix is regular: a millionth of one pose."""

SHORTLIST = 60
"""Number of candidate poses for which the smallest eigenvalue of the information matrix is computed exactly: the poses
with most information on its eigenvector."""


class Criterion(Protocol):
    """Criterion of an experimental design; smaller is better."""

    def value(self, information: Array) -> float:
        """Return the logarithm of the criterion for an information matrix of the unknowns."""

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Return the improvement of the criterion by adding (sign 1) or removing (-1) each pose of `columns`."""


@dataclass(frozen=True)
class DOptimal:
    """D-optimality: minimise the volume of the confidence region of the unknowns, -log det of their information."""

    def value(self, information: Array) -> float:
        return -float(np.linalg.slogdet(information)[1])

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Return log det (I ± J M⁻¹ Jᵀ) of each pose: information M of the design, derivatives J of the pose."""
        return np.asarray(np.linalg.slogdet(_inner(linalg.inv(information), columns, sign))[1])


@dataclass(frozen=True)
class EOptimal:
    """E-optimality: minimise the variance of the least determined combination of unknowns."""

    def value(self, information: Array) -> float:
        return -float(np.log(max(np.linalg.eigvalsh(information)[0], 1e-300)))

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Return the change of the log smallest eigenvalue by each pose: exact for SHORTLIST poses, -inf for others."""
        values, vectors = np.linalg.eigh(information)
        told = np.sum((columns @ vectors[:, 0]) ** 2, axis=1)
        near = np.argsort(-sign * told)[:SHORTLIST]
        moved = information + sign * np.swapaxes(columns[near], 1, 2) @ columns[near]
        out = np.full(len(columns), -np.inf)
        out[near] = np.log(np.maximum(np.linalg.eigvalsh(moved)[:, 0], 1e-300) / max(values[0], 1e-300))
        return out


@dataclass(frozen=True)
class LOptimal:
    """I-, c- and L-optimality: minimise the variance trace(weight M⁻¹) of a prediction, M the information matrix."""

    weight: Array

    def value(self, information: Array) -> float:
        return float(np.log(np.trace(linalg.solve(information, self.weight, assume_a="pos"))))

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Return -log of the ratio of the predicted variance after and before each pose is added or removed."""
        inverse = linalg.inv(information)
        through = columns @ inverse
        inner = _inner(inverse, columns, sign)
        moved = np.linalg.solve(inner, through @ self.weight @ np.swapaxes(through, 1, 2))
        whole = np.trace(inverse @ self.weight)
        left: Array = 1.0 - sign * np.trace(moved, axis1=1, axis2=2) / whole
        return -np.log(np.maximum(left, 1e-300))


def _inner(inverse: Array, columns: Array, sign: float) -> Array:
    return np.eye(columns.shape[1]) + sign * columns @ inverse @ np.swapaxes(columns, 1, 2)


def choose(columns: Array, known: Array, count: int, goal: Criterion) -> IntArray:
    """Select `count` poses that minimise a criterion; return their indices in the pool, the most informative first.

    Poses are added greedily, then exchanged until no exchange improves the criterion, then sorted by greedy gain.
    columns: derivatives (poses, 3, unknowns) of the poses of the pool, scaled to the order of 1.
    known: information matrix of the existing measurements.
    """
    known = known + LITTLE * np.eye(len(known))
    chosen, information = _greedy(columns, known, count, np.arange(len(columns)), goal)
    for _ in range(EXCHANGES):
        swap = _swap(columns, chosen, information, goal)
        if swap is None:
            break
        enter, leave = swap
        out = columns[chosen[leave]]
        information = information + columns[enter].T @ columns[enter] - out.T @ out
        chosen[leave] = enter
    return _greedy(columns, known, count, chosen, goal)[0]


def _swap(columns: Array, chosen: IntArray, information: Array, goal: Criterion) -> tuple[int, int] | None:
    """Return a pose to add to the design and the position in `chosen` of the pose to remove, or None if no exchange
    improves the criterion."""
    gains = goal.change(information, columns, 1.0)
    gains[chosen] = -np.inf
    for enter in np.argsort(-gains)[:TRIED].tolist():
        losses = goal.change(information + columns[enter].T @ columns[enter], columns[chosen], -1.0)
        leave = int(np.argmax(losses))
        if gains[enter] + losses[leave] > ENOUGH:
            return enter, leave
    return None


def _greedy(columns: Array, known: Array, count: int, among: IntArray, goal: Criterion) -> tuple[IntArray, Array]:
    """Select poses of `among` one by one, each the best by `goal`; return also the information matrix."""
    information, left, chosen = known.copy(), list(among.tolist()), []
    for _ in range(count):
        at = left.pop(int(np.argmax(goal.change(information, columns[left], 1.0))))
        information = information + columns[at].T @ columns[at]
        chosen.append(at)
    return np.array(chosen, dtype=np.int64), information


@dataclass(frozen=True)
class Design:
    """An experimental-design problem: selection of poses from a pool.

    columns: derivatives (poses, 3, unknowns) of the coordinates, over the standard deviation of a coordinate.
    known: information matrix (unknowns, unknowns) of the existing measurements.
    criterion: criterion to minimise.
    """

    columns: Array
    known: Array
    criterion: Criterion


def best_deviation(question: Design) -> float:
    """Return the standard deviation of the predicted quantity if every pose of the pool is measured.

    Raises TypeError if the criterion is not LOptimal.
    """
    every = np.arange(len(question.columns))
    whole = replace(question, known=question.known + np.einsum("pij,pik->jk", question.columns, question.columns))
    return float(_deviations(whole, every[:0])[0])


def in_units_of(deviation: float, question: Design) -> Design:
    """Return the design problem with its variance in units of deviation².

    Raises TypeError if the criterion is not LOptimal.
    """
    if not isinstance(question.criterion, LOptimal):
        raise TypeError("the criterion must be LOptimal")
    return replace(question, criterion=LOptimal(question.criterion.weight / deviation**2))


def choose_for_all(questions: Sequence[Design], count: int) -> IntArray:
    """Select `count` poses for several design problems; return the indices of the poses in the pool.

    Each selected pose is the most informative pose for the problem with the worst criterion so far. A single problem is
    solved by `choose`.
    """
    if len(questions) == 1:
        return choose(questions[0].columns, questions[0].known, count, questions[0].criterion)
    known = [question.known + LITTLE * np.eye(len(question.known)) for question in questions]
    left, chosen = list(range(len(questions[0].columns))), list[int]()
    for _ in range(count):
        values = [question.criterion.value(m) for question, m in zip(questions, known, strict=True)]
        worst = int(np.argmax(values))
        question = questions[worst]
        at = left.pop(int(np.argmax(question.criterion.change(known[worst], question.columns[left], 1.0))))
        known = [m + q.columns[at].T @ q.columns[at] for m, q in zip(known, questions, strict=True)]
        chosen.append(at)
    return np.array(chosen, dtype=np.int64)


def deviations(questions: Sequence[Design], order: IntArray) -> Array:
    """Return the largest predicted standard deviation of all problems after 0, 1, 2, ... of the poses `order`.

    A predicted standard deviation is NaN if an unknown is not determined.
    """
    return np.asarray(np.max([_deviations(question, order) for question in questions], axis=0))


def decided_after(question: Design, order: IntArray, odds: float) -> int | None:
    """Return the number of poses of `order` after which the true one of two causes has the probability COVERAGE.

    The number holds with probability COVERAGE, whichever cause is true, and is None if the poses do not suffice.
    odds: present ratio of the probabilities of the two causes.
    The inverse s of the predicted standard deviation is the distance of the causes in standard errors, s₀ at present.
    Poses add ln odds ~ N(d²/2, d²) for the true cause, d² = s² - s₀², to -|ln odds| at worst. Condition: d²/2 - z d ≥
    ln (COVERAGE / (1 - COVERAGE)) + |ln odds|, with z the quantile of COVERAGE.
    """
    apart = np.nan_to_num(deviations((question,), order) ** -2.0)
    z, lacking = float(ndtri(COVERAGE)), np.log(COVERAGE / (1.0 - COVERAGE)) + abs(np.log(odds))
    enough = np.flatnonzero(np.sqrt(apart - apart[0]) >= z + np.sqrt(z**2 + 2.0 * lacking))
    return int(enough[0]) if len(enough) else None


def _deviations(question: Design, order: IntArray) -> Array:
    goal = question.criterion
    if not isinstance(goal, LOptimal):
        raise TypeError("the criterion must be LOptimal")
    out, information = [], question.known.copy()
    for step in range(len(order) + 1):
        if step:
            columns = question.columns[order[step - 1]]
            information = information + columns.T @ columns
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        scaled = information / np.outer(scale, scale)
        determined = np.linalg.eigvalsh(scaled)[0] > DETERMINED
        out.append(np.trace(np.linalg.solve(scaled, goal.weight / np.outer(scale, scale))) if determined else np.nan)
    return np.array(np.sqrt(out), dtype=float)


@dataclass(frozen=True)
class Aim:
    """A purpose for which poses are selected, and the curve of precision over the number of poses.

    text: description of the purpose of the poses.
    choose: design problems that select the poses; if empty, poses are spread evenly, away from the poses `taken`.
    measure: design problems; the curve plots the largest of their predicted standard deviations.
    label: label of the curve of precision.
    factor: factor from a standard deviation to the unit of the label.
    inverse: True if the curve plots the inverse standard deviation, so that larger is better.
    pairs: {name of two causes: design problem that separates the causes, ratio of their probabilities}.
    """

    text: str
    choose: tuple[Design, ...]
    measure: tuple[Design, ...]
    label: str
    factor: float = 1.0
    inverse: bool = False
    taken: Array | None = None
    pairs: Mapping[str, tuple[Design, float]] = field(default_factory=dict)

    def to_curve_unit(self, deviation: Array) -> Array:
        """Convert standard deviations to the unit of the curve of precision, or to their inverse."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / deviation if self.inverse else self.factor * deviation)
