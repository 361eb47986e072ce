"""Choosing measurements by what they tell: optimal designs over a pool of candidate poses.

A pose adds JᵀJ to the information M of the unknowns, J (3, K) their columns over the standard deviation of a
coordinate; M⁻¹ is then their covariance. Sources: Fedorov (1972); Pukelsheim (1993); Atkinson and Fedorov (1975).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from scipy import linalg
from scipy.special import ndtri

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import joint_range, random_poses
from gpmodel.mechanism.protocol import Collides, Mechanism, bare_of, closed
from gpmodel.numerics.interval import COVERAGE
from gpmodel.numerics.se3 import chain

MARGIN = 0.02
"""Share of a joint's range that poses keep free at each limit."""

ATTEMPTS = 50
"""Random poses tried for each wanted one before an error says that there are too few."""


@dataclass(frozen=True)
class Sight:
    """The instrument at (3,), m, in the root frame. The target reflects into a cone of half-angle `cone`, rad, about
    `normal` (3,) in the measured frame."""

    instrument: Array
    normal: Array
    cone: float


@dataclass(frozen=True)
class Reach:
    """box: (2, 3), m, lowest and highest tool point in the root frame. tool: (3,), m, tool point in the measured frame.
    sight: of the instrument, where it matters. collisions: whether poses in which the arm meets itself are left out,
    where its geometry is known."""

    box: Array = field(default_factory=lambda: np.array([[-np.inf] * 3, [np.inf] * 3]))
    tool: Array = field(default_factory=lambda: np.zeros(3))
    sight: Sight | None = None
    collisions: bool = True

    def failures(self, mechanism: Mechanism, q: Array) -> dict[str, Mask]:
        """Return the violated constraints of poses q (N, n), by name, each (N,)."""
        frames = chain(mechanism.transforms(q))[-1]
        points = frames[:, :3, :3] @ self.tool + frames[:, :3, 3]
        found: dict[str, Mask] = {"outside the box": ((points < self.box[0]) | (points > self.box[1])).any(axis=1)}
        bare = bare_of(mechanism)
        body = bare if self.collisions and isinstance(bare, Collides) else None
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


def knows_its_shape(mechanism: Mechanism) -> bool:
    """Return whether the mechanism has a shape for collision tests."""
    bare = bare_of(mechanism)
    return isinstance(bare, Collides) and bare.has_shape


def candidates(mechanism: Mechanism, count: int, rng: np.random.Generator, reach: Reach | None = None) -> Array:
    """Random joint values (count, n) a little inside the limits, within reach.

    Raises InputError that says what forbids most of them where fewer are found.
    """
    reach = reach or Reach()
    middle = np.array([sum(joint_range(j)) / 2 for j in mechanism.joints])
    chosen: list[Array] = []
    found, tried, failed = 0, 0, dict[str, int]()
    while found < count and tried < ATTEMPTS * count:
        q = middle + (1.0 - MARGIN) * (random_poses(mechanism, count, rng) - middle)
        if loops := closed(mechanism):
            q = q[loops.closes(q)]
        failures = reach.failures(mechanism, q)
        keep = ~np.any(list(failures.values()), axis=0)
        failed = {name: failed.get(name, 0) + int(bad.sum()) for name, bad in failures.items()}
        chosen.append(q[keep])
        found, tried = found + int(keep.sum()), tried + count
    if found < count:
        worst = max(failed, key=lambda name: failed[name])
        raise InputError(
            f"{found} of {tried} random poses of {mechanism.name} can be taken, {failed[worst]} are {worst}; "
            "expected a wider box, cone or range"
        )
    return np.vstack(chosen)[:count]


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


EXCHANGES = 200
"""Largest number of exchanges of a chosen pose for another."""

TRIED = 10
"""Poses tried for an exchange, those that gain most on entering."""

ENOUGH = 1e-6
"""Least improvement of the logarithm of the criterion by an exchange."""

DETERMINED = 1e-12
"""Least eigenvalue of M scaled to a unit diagonal. With a smaller one some unknown is not determined. The prior on
geometry counts a millionth of a measurement."""

LITTLE = 1e-6
"""Information added on every unknown, so that M is regular: a millionth of that of one pose."""

SHORTLIST = 60
"""Candidate poses for which the smallest eigenvalue is computed exactly: those with most information on its
eigenvector."""


class Goal(Protocol):
    """Goal of a design: smaller is better."""

    def value(self, information: Array) -> float:
        """The logarithm of what is to be small, of M (K, K)."""

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Return the gain (N,) of adding (sign 1) each of N poses with columns (N, 3, K), or of removing it (-1)."""


@dataclass(frozen=True)
class Determinant:
    """D-optimal: the volume of the unknowns' confidence region, -log det M."""

    def value(self, information: Array) -> float:
        """-log det M."""
        return -float(np.linalg.slogdet(information)[1])

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """log det (I ± J M⁻¹ Jᵀ)."""
        return np.asarray(np.linalg.slogdet(_inner(linalg.inv(information), columns, sign))[1])


@dataclass(frozen=True)
class Smallest:
    """E-optimal: the worst determined combination of unknowns, -log of the smallest eigenvalue of M."""

    def value(self, information: Array) -> float:
        """-log λ_min."""
        return -float(np.log(max(np.linalg.eigvalsh(information)[0], 1e-300)))

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """Change of log λ_min, exact for the poses with most (or least) information on its eigenvector."""
        values, vectors = np.linalg.eigh(information)
        told = np.sum((columns @ vectors[:, 0]) ** 2, axis=1)
        near = np.argsort(-sign * told)[:SHORTLIST]
        moved = information + sign * np.swapaxes(columns[near], 1, 2) @ columns[near]
        out = np.full(len(columns), -np.inf)
        out[near] = np.log(np.maximum(np.linalg.eigvalsh(moved)[:, 0], 1e-300) / max(values[0], 1e-300))
        return out


@dataclass(frozen=True)
class Variance:
    """I-, c- and L-optimal: the variance trace(L M⁻¹) of something predicted. weight: L (K, K)."""

    weight: Array

    def value(self, information: Array) -> float:
        """log trace(L M⁻¹)."""
        return float(np.log(np.trace(linalg.solve(information, self.weight, assume_a="pos"))))

    def change(self, information: Array, columns: Array, sign: float) -> Array:
        """-log of what (I ± J M⁻¹ Jᵀ)⁻¹ J M⁻¹ L M⁻¹ Jᵀ leaves of the trace."""
        inverse = linalg.inv(information)
        through = columns @ inverse
        inner = _inner(inverse, columns, sign)
        moved = np.linalg.solve(inner, through @ self.weight @ np.swapaxes(through, 1, 2))
        whole = np.trace(inverse @ self.weight)
        left: Array = 1.0 - sign * np.trace(moved, axis1=1, axis2=2) / whole
        return -np.log(np.maximum(left, 1e-300))


def _inner(inverse: Array, columns: Array, sign: float) -> Array:
    return np.eye(columns.shape[1]) + sign * columns @ inverse @ np.swapaxes(columns, 1, 2)


def choose(columns: Array, known: Array, count: int, goal: Goal) -> IntArray:
    """Indices (count,) of the poses to take, the one that tells most first.

    columns: (P, 3, K) of the pool, of the order of 1. known: (K, K), M of what is measured already. One after the
    other the pose that gains most, then swaps until none gains, then in the order in which each next one gains most.
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


def _swap(columns: Array, chosen: IntArray, information: Array, goal: Goal) -> tuple[int, int] | None:
    """A pose to enter and the place of the one to leave, so that the goal gains; None where none of the TRIED does."""
    gains = goal.change(information, columns, 1.0)
    gains[chosen] = -np.inf
    for enter in np.argsort(-gains)[:TRIED].tolist():
        losses = goal.change(information + columns[enter].T @ columns[enter], columns[chosen], -1.0)
        leave = int(np.argmax(losses))
        if gains[enter] + losses[leave] > ENOUGH:
            return enter, leave
    return None


def _greedy(columns: Array, known: Array, count: int, among: IntArray, goal: Goal) -> tuple[IntArray, Array]:
    """Each next pose the one of `among` that gains most; and M with all of them."""
    information, left, chosen = known.copy(), list(among.tolist()), []
    for _ in range(count):
        at = left.pop(int(np.argmax(goal.change(information, columns[left], 1.0))))
        information = information + columns[at].T @ columns[at]
        chosen.append(at)
    return np.array(chosen, dtype=np.int64), information


@dataclass(frozen=True)
class Question:
    """Something to find out: columns (P, 3, K) of the pool and known M (K, K) of its unknowns, and what is to be
    small."""

    columns: Array
    known: Array
    goal: Goal


def at_best(question: Question) -> float:
    """Square root of the variance in question with every candidate pose measured. Raises TypeError where no variance
    is."""
    every = np.arange(len(question.columns))
    whole = replace(question, known=question.known + np.einsum("pij,pik->jk", question.columns, question.columns))
    return float(_deviations(whole, every[:0])[0])


def in_units_of(deviation: float, question: Question) -> Question:
    """The question of a variance with that deviation as its unit. Raises TypeError where the
    goal is no variance."""
    if not isinstance(question.goal, Variance):
        raise TypeError("a deviation is that of a Variance")
    return replace(question, goal=Variance(question.goal.weight / deviation**2))


def choose_for_all(questions: Sequence[Question], count: int) -> IntArray:
    """Indices (count,) of the poses to take: each next one tells most of the question that is then the worst answered.

    A single question is answered as `choose` does.
    """
    if len(questions) == 1:
        return choose(questions[0].columns, questions[0].known, count, questions[0].goal)
    known = [question.known + LITTLE * np.eye(len(question.known)) for question in questions]
    left, chosen = list(range(len(questions[0].columns))), list[int]()
    for _ in range(count):
        values = [question.goal.value(m) for question, m in zip(questions, known, strict=True)]
        worst = int(np.argmax(values))
        question = questions[worst]
        at = left.pop(int(np.argmax(question.goal.change(known[worst], question.columns[left], 1.0))))
        known = [m + q.columns[at].T @ q.columns[at] for m, q in zip(known, questions, strict=True)]
        chosen.append(at)
    return np.array(chosen, dtype=np.int64)


def deviations(questions: Sequence[Question], order: IntArray) -> Array:
    """√ trace(L M⁻¹) (n + 1,) of the worst answered of questions of variances, with none, the first, the first two ...
    of the poses `order` (n,); NaN where an unknown is not determined."""
    return np.asarray(np.max([_deviations(question, order) for question in questions], axis=0))


def decided_after(question: Question, order: IntArray, odds: float) -> int | None:
    """Number of the poses `order` (n,) after which one of two causes is COVERAGE probable, whichever is true, in as
    large a share of cases; None where so many do not suffice.

    odds: of the causes now. The inverse deviation s is their distance in standard errors. Poses add ln odds
    ~ N(d²/2, d²) for the true cause, d² = s² - s₀², to -|ln odds| at worst:
    d²/2 - z d ≥ ln (COVERAGE / (1 - COVERAGE)) + |ln odds|, z the quantile of COVERAGE.
    """
    apart = np.nan_to_num(deviations((question,), order) ** -2.0)
    z, lacking = float(ndtri(COVERAGE)), np.log(COVERAGE / (1.0 - COVERAGE)) + abs(np.log(odds))
    enough = np.flatnonzero(np.sqrt(apart - apart[0]) >= z + np.sqrt(z**2 + 2.0 * lacking))
    return int(enough[0]) if len(enough) else None


def _deviations(question: Question, order: IntArray) -> Array:
    goal = question.goal
    if not isinstance(goal, Variance):
        raise TypeError("a deviation is that of a Variance")
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
class Asked:
    """said: in words. choose: what decides; none to spread them, away from those `taken` (M, n). measure: questions of
    variances whose worst is what the curve shows, as `label`: times `factor`, or its inverse where that is larger the
    better. pairs: two causes by their names, with the question and the odds of them."""

    said: str
    choose: tuple[Question, ...]
    measure: tuple[Question, ...]
    label: str
    factor: float = 1.0
    inverse: bool = False
    taken: Array | None = None
    pairs: Mapping[str, tuple[Question, float]] = field(default_factory=dict)

    def said_of(self, deviation: Array) -> Array:
        """Standard deviations (n,) as the curve shows them."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / deviation if self.inverse else self.factor * deviation)
