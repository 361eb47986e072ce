"""Where the tool may be while it is measured: limits, a box, in sight of the instrument, clear of the arm itself."""

from dataclasses import dataclass, field

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import joint_range, random_poses
from gpmodel.mechanism.protocol import Collides, Mechanism, bare_of, closed
from gpmodel.numerics.se3 import chain

MARGIN = 0.02
"""Share of a joint's range that is left free at its limits."""

ATTEMPTS = 50
"""Times as many random poses as are wanted are tried before it is said that there are too few."""


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
