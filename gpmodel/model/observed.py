"""Predicted readings, and how they move with every twist of the mechanism, the tool and the registration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.model.observation import Distance, Observation, Tips
from gpmodel.numerics import se3


@dataclass(frozen=True)
class Observed:
    """Predicted readings and what moves them.

    tips: predicted. frames: (S + 1, N, 4, 4) of the slots, then of the instrument itself, in the instrument's frame,
    each after its error twist.
    twists: slot's index -> its error twist (N, 6), m and rad. kinds: what is read. own: name -> (k,) unknowns.
    carried: what a twist of a slot moves the tool's by, of a mechanism with closed loops; None of a chain.
    """

    tips: Tips
    frames: Array
    twists: Mapping[int, Array]
    kinds: tuple[Observation, ...]
    own: Mapping[str, Array]
    carried: Callable[[Array, int], Array] | None = None
    _known: dict[int, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def tip(self) -> Array:
        """Predicted tip poses (N, 4, 4) in the instrument's frame."""
        return self.tips.instrument

    @property
    def components(self) -> int:
        """Scalar readings a pose: 3 of position, 3 of rotation, then those of the other observations."""
        return sum(kind.components for kind in self.kinds)

    @property
    def distances(self) -> Array:
        """Predicted distances (N, D), m."""
        found = [kind.predict(self.tips, self.unknowns(kind)) for kind in self.kinds if isinstance(kind, Distance)]
        return np.hstack(found) if found else np.zeros((len(self.tip), 0))

    @property
    def turns(self) -> Mask:
        """Which components (m,) are angles."""
        return np.repeat([kind.unit == "rad" for kind in self.kinds], [kind.components for kind in self.kinds])

    def unknowns(self, kind: Observation) -> Array:
        """Own unknowns (k,) of an observation."""
        return self.own[kind.name] if kind.own else np.zeros(0)

    def rows(self, kind: Observation) -> slice:
        """Which components are of an observation."""
        first = 0
        for other in self.kinds:
            if other.name == kind.name:
                return slice(first, first + kind.components)
            first += other.components
        raise KeyError(kind.name)

    def sensitivity(self, slot: int) -> Array:
        """Change (N, m, 6) of the m components per unit of an error twist at a slot, beside the twist it has; worked
        out once.

        The frame is that after the twist ξ, so exp(ξ + dξ) = exp(ξ) exp(J_r(ξ) dξ) brings in the right Jacobian.
        The point moves by R e for a translation, by (R e) × (p_tip - p_slot) for a rotation, which turns it by R e.
        Where loops close, the twist at the slot first becomes one of the tool's slot, the last before the instrument.
        """
        if slot not in self._known:
            self._known[slot] = self._sensitivity(slot)
        return self._known[slot]

    def _sensitivity(self, slot: int) -> Array:
        instrument = len(self.frames) - 1
        looped = self.carried is not None and slot < instrument
        at = self.frames[instrument - 1 if looped else slot]
        turn = at[:, :3, :3]
        motion = _motion(turn, -se3.hat(self.tip[:, :3, 3] - at[:, :3, 3]) @ turn, turn)
        if self.carried is not None and looped:
            motion = motion @ self.carried(self.frames[:instrument], slot)
        if slot in self.twists:
            motion = motion @ se3.right_jacobian(self.twists[slot])
        return self._moved(motion, absolute=slot == instrument)

    def tool_sensitivity(self) -> Array:
        """The same per unit twist of the tool frame: (N, m, 6)."""
        turn = self.tip[:, :3, :3]
        return self._moved(_motion(turn, np.zeros_like(turn), turn))

    def registration_sensitivity(self, centre: Array) -> Array:
        """The same per unit twist of the registration about `centre`, in the instrument's axes."""
        eye = np.broadcast_to(np.eye(3), (len(self.tip), 3, 3))
        return self._moved(_motion(eye, -se3.hat(self.tip[:, :3, 3] - centre), eye), absolute=True)

    def own_sensitivity(self, kind: Observation) -> Array:
        """The same per unit of an observation's own unknowns: (N, m, k)."""
        out = np.zeros((len(self.tip), self.components, len(kind.own)))
        out[:, self.rows(kind)] = kind.by_own(self.tips, self.unknowns(kind))
        return out

    def _moved(self, motion: Array, absolute: bool = False) -> Array:
        """Change (N, m, 6) by a motion of the tip; absolute: of what is read in the instrument's frame alone."""
        parts = [kind.by_tip(self.tips, self.unknowns(kind)) @ motion for kind in self.kinds]
        if absolute:
            parts = [p if kind.absolute else np.zeros_like(p) for p, kind in zip(parts, self.kinds, strict=True)]
        return np.concatenate(parts, axis=1)


def _motion(moves: Array, swings: Array, turns: Array) -> Array:
    """Motion (N, 6, 6) of the tip: its point by translations and rotations, its axes by rotations."""
    out = np.zeros((len(moves), 6, 6))
    out[:, :3, :3], out[:, :3, 3:], out[:, 3:, 3:] = moves, swings, turns
    return out
