"""Predicted measurements, and their derivatives with respect to each twist of the mechanism, the tool and the
registration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.model.observation import Distance, Observation, Orientation, Tips, Weights, weight_of
from gpmodel.numerics import se3


@dataclass(frozen=True)
class Observed:
    """Predicted measurements and their derivatives.

    tips: predicted poses of the tip.
    frames: poses (frames + 1, poses, 4, 4) of all frames, then of the instrument, with errors, in instrument axes.
    twists: {frame index: error twist (poses, 6), m and rad}; the last two indices are instrument and tool.
    kinds: kinds of measurements, such as positions or pixels.
    own: unknowns of the measuring equipment by key.
    carried: derivative of the tool's twist with respect to the twist of a frame, for closed loops; None without loops.
    lineage: mask (frames, frames), True if a twist at one frame moves the other frame.
    tip_slot: index of the frame that carries the tip, for each pose.
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
        """Predicted poses (poses, 4, 4) of the tip in the frame of the instrument."""
        return self.tips.instrument

    @property
    def components(self) -> int:
        """Number of components of the measurements at a pose: 3 of position, 3 of rotation, then other measurements."""
        return sum(kind.components for kind in self.kinds)

    @property
    def distances(self) -> Array:
        """Predicted distances (poses, distances), m."""
        found = [kind.predict(self.tips, self.own) for kind in self.kinds if isinstance(kind, Distance)]
        return np.hstack(found) if found else np.zeros((len(self.tip), 0))

    @property
    def turns(self) -> Mask:
        """Mask of the measured components that are rotations."""
        return np.repeat([isinstance(k, Orientation) for k in self.kinds], [k.components for k in self.kinds])

    def scales(self, weights: Weights) -> Array:
        """Return the weight of each measured component, m per unit."""
        each = [weight_of(kind, weights) for kind in self.kinds]
        return np.repeat(each, [kind.components for kind in self.kinds])

    def rows(self, kind: Observation) -> slice:
        """Return the slice of the measured components that belong to one kind of measurement."""
        first = 0
        for other in self.kinds:
            if other.name == kind.name:
                return slice(first, first + kind.components)
            first += other.components
        raise KeyError(kind.name)

    def sensitivity(self, slot: int) -> Array:
        """Return derivatives (poses, components, 6) of the measurements with respect to an error twist ξ at a frame, at
        its present value.

        slot: index of the frame; the index after that of the instrument is the tool. The right Jacobian J_r(ξ) converts
        a change of the twist: exp(ξ + dξ) = exp(ξ) exp(J_r dξ). With the rotation R of the frame after ξ, a translation
        e moves the tip by R e; a rotation e turns the tip by R e and moves the tip by (R e) × d, with d the vector from
        the frame to the tip. With closed loops, the twist is first converted to a twist of the tool frame, the last
        frame before the instrument.
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
        """Measured components that depend on a frame of a link, the frame, and derivatives (poses, components, 6) in
        instrument axes."""
        axes = np.zeros((len(self.tip), 6, 6))
        axes[:, :3, :3] = axes[:, 3:, 3:] = np.swapaxes(self.tips.turn, 1, 2)
        return [
            (self.rows(kind), slot, change @ axes)
            for kind in self.kinds
            for slot, change in kind.by_slots(self.tips, self.own).items()
        ]

    def tool_sensitivity(self) -> Array:
        """Return derivatives (poses, components, 6) of the measurements with respect to a twist of the tool frame."""
        turn = self.tip[:, :3, :3]
        return self._moved(_motion(turn, np.zeros_like(turn), turn))

    def registration_sensitivity(self, centre: Array) -> Array:
        """Return derivatives (poses, components, 6) of measurements with respect to a twist of the registration about
        `centre`."""
        eye = np.broadcast_to(np.eye(3), (len(self.tip), 3, 3))
        return self._moved(_motion(eye, -se3.hat(self.tip[:, :3, 3] - centre), eye), absolute=True)

    def own_sensitivity(self, kind: Observation) -> Array:
        """Return derivatives (poses, components, unknowns) of the measurements with respect to unknowns of their
        equipment."""
        out = np.zeros((len(self.tip), self.components, sum(len(names) for names in kind.own.values())))
        out[:, self.rows(kind)] = kind.by_own(self.tips, self.own)
        return out

    def _moved(self, motion: Array, absolute: bool = False) -> Array:
        """Return derivatives (poses, components, 6) of the measurements with respect to a motion of the tip. absolute:
        True to include only measurements in the instrument's frame."""
        parts = [kind.by_tip(self.tips, self.own) @ motion for kind in self.kinds]
        if absolute:
            parts = [p if kind.absolute else np.zeros_like(p) for p, kind in zip(parts, self.kinds, strict=True)]
        return np.concatenate(parts, axis=1)


def _by_twist(at: Array, frame: Array) -> Array:
    """Return the motion (poses, 6, 6) of `frame`, origin (m) and rotation (rad), by unit twists in the other frame
    `at`."""
    turn = at[:, :3, :3]
    return _motion(turn, -se3.hat(frame[:, :3, 3] - at[:, :3, 3]) @ turn, turn)


def _motion(moves: Array, swings: Array, turns: Array) -> Array:
    """Return the motion (poses, 6, 6) of the tip: its point by translations and rotations, its axes by rotations."""
    out = np.zeros((len(moves), 6, 6))
    out[:, :3, :3], out[:, :3, 3:], out[:, 3:, 3:] = moves, swings, turns
    return out
