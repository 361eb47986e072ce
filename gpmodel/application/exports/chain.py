"""Describe a mechanism as a chain of constant transforms and single-axis motions."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import ROUNDING, Array
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched, random_poses
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.numerics import se3

PROBES = 8
"""Random poses at which the exported chain is compared with the mechanism."""


@dataclass(frozen=True)
class Chain:
    """Serial chain T_s(q) = fixed_s · motion along or about axis_s by weights_s · q.

    slots: names. fixed: (S, 4, 4), m. axes: one of AXES, or "" for a slot without motion.
    weights: (S, n) of the table's joint values.
    """

    slots: tuple[str, ...]
    fixed: Array
    axes: tuple[str, ...]
    weights: Array

    @property
    def moving(self) -> tuple[int, ...]:
        """Indices of the slots that move."""
        return tuple(i for i, axis in enumerate(self.axes) if axis)

    @property
    def motions(self) -> Array:
        """Matrix (M, n) from the table's joint values to all motions."""
        return self.weights[list(self.moving)]

    def transforms(self, q: Array) -> Array:
        out = np.repeat(self.fixed[:, None], len(q), axis=1)
        for s in self.moving:
            twists = np.zeros((len(q), 6))
            twists[:, AXES.index(self.axes[s])] = q @ self.weights[s]
            out[s] = out[s] @ se3.exp(twists)
        return out


def coupled(mechanism: Mechanism) -> dict[str, dict[str, float]]:
    """Return the joints that several values of the controller move, as by a parallelogram linkage.

    Name of the joint -> joint whose value moves it -> factor, its own first and 1.
    """
    moves: dict[str, dict[str, float]] = {}
    for joint in mechanism.joints:
        for slot, _, weight in joint.drive:
            moves.setdefault(slot.removesuffix(".moving"), {})[joint.name] = weight
    several = {name: factors for name, factors in moves.items() if len(factors) > 1 and name in factors}
    return {
        name: {name: 1.0} | {other: w / factors[name] for other, w in factors.items() if other != name}
        for name, factors in several.items()
    }


def arm_of(mechanism: Mechanism, tip: str) -> Chain:
    """Return the chain that ends at a measured link `tip`, driven by all joint values; for one arm, the whole chain.

    Raises InputError as `chain_of`, or if several arms have no tool of their own.
    """
    tree = branched(mechanism)
    if tree is None:
        return chain_of(mechanism)
    if not tip:
        raise InputError(
            f"no tool belongs to a single arm of {mechanism.name}; expected a separate tool for each arm in 'tool'"
        )
    alone = tree.alone(tip)
    own = chain_of(alone)
    weights = np.zeros((len(own.slots), len(mechanism.joints)))
    weights[:, [[j.name for j in mechanism.joints].index(j.name) for j in alone.joints]] = own.weights
    return replace(own, slots=(*own.slots[:-1], tree.tips[tip]), weights=weights)


def chain_of(mechanism: Mechanism) -> Chain:
    """Return the chain of a mechanism.

    Raises InputError for several arms, or a slot that moves about more than one axis.
    """
    if branched(mechanism):
        raise InputError(f"{mechanism.name} has several arms; expected a serial chain")
    slots, joints = mechanism.slots, mechanism.joints
    axes, weights = [""] * len(slots), np.zeros((len(slots), len(joints)))
    for column, joint in enumerate(joints):
        for slot, axis, weight in joint.drive:
            at = slots.index(slot)
            if axes[at] not in ("", axis):
                raise InputError(f"{mechanism.name}: {slot} moves about more than one axis; expected a serial chain")
            axes[at], weights[at, column] = axis, weight
    rest = mechanism.transforms(np.zeros((1, len(joints))))[:, 0]
    found = Chain(slots, rest, tuple(axes), weights)
    q = random_poses(mechanism, PROBES, np.random.default_rng(0))
    if not np.allclose(found.transforms(q), mechanism.transforms(q), atol=ROUNDING, rtol=0):
        raise InputError(f"{mechanism.name}: a joint has several motions; expected a serial chain")
    return found
