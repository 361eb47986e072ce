"""Predicted readings, and how they move with every twist of the mechanism, the tool and the registration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.model.observation import Distance, Observation, Tips
from gpmodel.numerics import se3


@dataclass(frozen=True)
class Observed:
    """Predicted readings and what moves them.

    tips: predicted. frames: (S + 1, N, 4, 4) of the slots, then of the instrument itself, in the instrument's frame,
    each after its error twist.
    twists: slot's index -> its error twist (N, 6), m and rad; after the instrument's the tool's. kinds: what is read.
    own: key -> (k,) unknowns.
    carried: what a twist of a slot moves the tool's by, of a mechanism with closed loops; None of a chain.
    lineage: (S, S) whether a twist at one slot moves the frame of the other. tip_slot: (N,) slot that carries the tip.
    """

    tips: Tips
    frames: Array
    twists: Mapping[int, Array]
    kinds: tuple[Observation, ...]
    own: Mapping[str, Array]
    lineage: Mask
    tip_slot: IntArray
    carried: Callable[[Array, int], Array] | None = None
    _known: dict[int, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def tip(self) -> Array:
        """Predicted tip poses (N, 4, 4) in the instrument's frame."""
        return self.tips.instrument

    @property
    def components(self) -> int:
        """Scalar readings a pose: 3 of position, 3 of rotation, then the components of the other observations."""
        return sum(kind.components for kind in self.kinds)

    @property
    def distances(self) -> Array:
        """Predicted distances (N, D), m."""
        found = [kind.predict(self.tips, self.own) for kind in self.kinds if isinstance(kind, Distance)]
        return np.hstack(found) if found else np.zeros((len(self.tip), 0))

    @property
    def turns(self) -> Mask:
        """Rotational components (m,), whose weight the fit estimates."""
        return np.repeat([kind.metres is None for kind in self.kinds], [kind.components for kind in self.kinds])

    def scales(self, rotation_weight: float) -> Array:
        """Metres (m,) that one unit of each component counts as."""
        each = [rotation_weight if kind.metres is None else kind.metres for kind in self.kinds]
        return np.repeat(each, [kind.components for kind in self.kinds])

    def rows(self, kind: Observation) -> slice:
        """Return the slice of the components of an observation."""
        first = 0
        for other in self.kinds:
            if other.name == kind.name:
                return slice(first, first + kind.components)
            first += other.components
        raise KeyError(kind.name)

    def sensitivity(self, slot: int) -> Array:
        """Change (N, m, 6) of the m components per unit of an error twist at a slot, given the twist it has; worked
        out once. Of the index after the instrument's: at the tool.

        The frame is that after the twist ξ, so exp(ξ + dξ) = exp(ξ) exp(J_r(ξ) dξ) brings in the right Jacobian.
        The point moves by R e for a translation, by (R e) × (p_tip - p_slot) for a rotation, which turns it by R e.
        Where loops close, the twist at the slot first becomes one of the tool's slot, the last before the instrument.
        """
        if slot not in self._known:
            self._known[slot] = self._sensitivity(slot)
        return self._known[slot]

    def _sensitivity(self, slot: int) -> Array:
        instrument = len(self.frames) - 1
        if slot > instrument:
            turned = self.twists.get(slot)
            return self.tool_sensitivity() @ (np.eye(6) if turned is None else se3.right_jacobian(turned))
        looped = self.carried is not None and slot < instrument
        at = self.frames[instrument - 1 if looped else slot]
        within = np.eye(6)
        if self.carried is not None and looped:
            within = self.carried(self.frames[:instrument], slot)
        if slot in self.twists:
            within = within @ se3.right_jacobian(self.twists[slot])
        motion = _by_twist(at, self.tip)
        if slot == instrument:
            return self._moved(motion @ within, absolute=True)
        motion *= self.lineage[slot, self.tip_slot][:, None, None]
        out = self._moved(motion @ within)
        for rows, carrier, change in self._by_slots:
            if self.lineage[slot, carrier] and not looped:
                out[:, rows] += change @ _by_twist(at, self.frames[carrier]) @ within
        return out

    @cached_property
    def _by_slots(self) -> list[tuple[slice, int, Array]]:
        """Components, the slot whose frame moves them, and their change (N, m, 6) in the instrument's axes."""
        axes = np.zeros((len(self.tip), 6, 6))
        axes[:, :3, :3] = axes[:, 3:, 3:] = np.swapaxes(self.tips.turn, 1, 2)
        return [
            (self.rows(kind), slot, change @ axes)
            for kind in self.kinds
            for slot, change in kind.by_slots(self.tips, self.own).items()
        ]

    def tool_sensitivity(self) -> Array:
        """Return the sensitivity to a unit twist of the tool frame: (N, m, 6)."""
        turn = self.tip[:, :3, :3]
        return self._moved(_motion(turn, np.zeros_like(turn), turn))

    def registration_sensitivity(self, centre: Array) -> Array:
        """Return the sensitivity to a unit twist of the registration about `centre`, in the instrument's axes."""
        eye = np.broadcast_to(np.eye(3), (len(self.tip), 3, 3))
        return self._moved(_motion(eye, -se3.hat(self.tip[:, :3, 3] - centre), eye), absolute=True)

    def own_sensitivity(self, kind: Observation) -> Array:
        """Return the sensitivity to a unit step of an observation's unknowns: (N, m, k)."""
        out = np.zeros((len(self.tip), self.components, sum(len(names) for names in kind.own.values())))
        out[:, self.rows(kind)] = kind.by_own(self.tips, self.own)
        return out

    def _moved(self, motion: Array, absolute: bool = False) -> Array:
        """Change (N, m, 6) by a motion of the tip; absolute: of what is read in the instrument's frame alone."""
        parts = [kind.by_tip(self.tips, self.own) @ motion for kind in self.kinds]
        if absolute:
            parts = [p if kind.absolute else np.zeros_like(p) for p, kind in zip(parts, self.kinds, strict=True)]
        return np.concatenate(parts, axis=1)


def _by_twist(at: Array, frame: Array) -> Array:
    """Motion (N, 6, 6) of frames (N, 4, 4), origin (m) and turn (rad), by unit twists in the axes of others."""
    turn = at[:, :3, :3]
    return _motion(turn, -se3.hat(frame[:, :3, 3] - at[:, :3, 3]) @ turn, turn)


def _motion(moves: Array, swings: Array, turns: Array) -> Array:
    """Motion (N, 6, 6) of the tip: its point by translations and rotations, its axes by rotations."""
    out = np.zeros((len(moves), 6, 6))
    out[:, :3, :3], out[:, :3, 3:], out[:, 3:, 3:] = moves, swings, turns
    return out
