"""Ball joints in a mechanism: the angles by which a ball turns in its socket, and the ways its centre may shift."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism, bare_of

Shift = tuple[tuple[str, str, float], ...]
"""(slot, axis, weight) terms of a shift of a ball's centre by one metre."""


@dataclass(frozen=True)
class Ball:
    """A ball in its socket.

    name: empty where a mechanism has but one. angles: columns of States, rad, by which it turns in its socket, about
    the socket's x, then its own y, then z. shifts: of its centre, by the direction in words, that along its lever or
    leg last. axial: the name of the load on it along its leg, N, positive where it pulls; empty without one.
    """

    name: str
    angles: tuple[str, ...]
    shifts: Mapping[str, Shift]
    axial: str = ""

    @property
    def along(self) -> tuple[str, Shift]:
        """The direction of its lever or leg in words, and the shift."""
        return list(self.shifts.items())[-1]

    @property
    def suffix(self) -> str:
        """Suffix that distinguishes an effect of this ball from that of another ball of the machine."""
        return f", {self.name}" if self.name else ""


@runtime_checkable
class BallJointed(Protocol):
    """A mechanism with ball joints, whose angles nothing reads."""

    @property
    def balls(self) -> tuple[Ball, ...]:
        """Its balls, from the base on."""

    def turned(self, q: Array) -> dict[str, Array]:
        """Angles (N,) of its balls, rad, that are no joint coordinates of the table, at nominal geometry; q: (N, n)."""


def ball_jointed(mechanism: Mechanism) -> BallJointed | None:
    """The mechanism, or what it was loaded from, where it has ball joints."""
    bare = bare_of(mechanism)
    return bare if isinstance(bare, BallJointed) else None


def balls_of(mechanism: Mechanism) -> tuple[Ball, ...]:
    """The balls of a mechanism; none of one without."""
    jointed = ball_jointed(mechanism)
    return jointed.balls if jointed else ()
