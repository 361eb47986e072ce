"""Magnet rings and sockets of largest preload, and published preloads.

Thesis Tables 3.1 and 4.1 (number of magnets on a ring, ring and socket); Figures 3.25, 3.30, 4.31 (predicted and
measured preloads).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpmodel.errors import InputError
from joints.preload import MagnetRing, cap_area, published_socket_area
from joints.settings import DATA, angle_within, not_negative, positive, quantity, read_toml


@dataclass(frozen=True)
class Magnet:
    """A commercial magnet: `diameter` and `thickness` [m], measured pull `force` [N], `cost` [$]."""

    diameter: float
    thickness: float
    force: float
    cost: float = 1.0

    def __post_init__(self) -> None:
        positive("magnet diameter", self.diameter, "m")
        positive("magnet thickness", self.thickness, "m")
        positive("magnet force", self.force, "N")
        not_negative("magnet cost", self.cost, "$")


def stack_factor(diameter: float, thickness: float, layers: int, gap: float) -> float:
    """Return the pull of a stack of `layers` magnets relative to one magnet, over `gap` [m] to the ball.

    The pull is proportional to the square of the field B at distance z from a cylinder of length L and radius R
    (Furlani 2001, section 4.2), without steel behind it: B(z) ~ (L + z) / sqrt(R^2 + (L + z)^2) - z / sqrt(R^2 + z^2).
    """
    radius = float(positive("magnet diameter", diameter, "m")) / 2
    z = float(not_negative("gap", gap, "m"))

    def field(length: float) -> float:
        return float((length + z) / np.hypot(radius, length + z) - z / np.hypot(radius, z))

    return (field(layers * thickness) / field(thickness)) ** 2


@dataclass(frozen=True)
class MagnetSeat:
    """Geometry of the magnet seats in the socket.

    radius: distance of the magnet faces from the centre of the ball, m.
    clearance: thickness of the wall between two magnets, m.
    paired: True if the poles alternate around the ring, so that the number of magnets is even (thesis 3.2.1).
    """

    radius: float
    clearance: float
    paired: bool = True

    def __post_init__(self) -> None:
        positive("magnet seat radius", self.radius, "m")
        not_negative("magnet clearance", self.clearance, "m")

    def half_width(self, diameter: float) -> float:
        """Return the angle [rad] from a magnet's axis to its rim, seen from the centre of the ball."""
        if diameter >= 2 * self.radius:
            raise InputError(f"magnet diameter = {diameter:.6g} m, expected below {2 * self.radius:.6g} m")
        return float(np.arcsin(diameter / (2 * self.radius)))

    def fitting_count(self, diameter: float, angle: float) -> int:
        """Return the number of magnets that fit on a ring at polar angle `angle`, rad. The number of magnets is the
        largest n with a chord 2 radius sin(angle) sin(pi/n) between neighbours of at least diameter + clearance."""
        chord = (diameter + self.clearance) / (2 * self.radius * np.sin(angle))
        if chord > 1:
            return 0 if self.paired else 1
        count = int(np.pi / np.arcsin(chord) + 1e-9)
        return count - count % 2 if self.paired else count

    def smallest_angle(self, diameter: float, count: int) -> float:
        """Return the smallest polar angle [rad] of a ring on which `count` >= 2 magnets fit; nan if they do not fit at
        any angle up to 90 deg."""
        sine = (diameter + self.clearance) / (2 * self.radius * np.sin(np.pi / count))
        return float(np.arcsin(sine)) if sine <= 1 else float("nan")

    def check(self, rings: Sequence[MagnetRing], socket_angle: float) -> None:
        """Raise InputError for a magnet ring with too many magnets, or a magnet ring that extends beyond the socket or
        overlaps another ring."""
        angle_within("socket angle", socket_angle, np.pi / 2)
        for number, ring in enumerate(rings, 1):
            fits = MagnetSeat(self.radius, self.clearance, paired=False).fitting_count(ring.diameter, ring.angle)
            place = f"magnet ring {number} at {np.degrees(ring.angle):.4g} deg"
            if ring.count > fits:
                raise InputError(
                    f"{place}: {ring.count} magnets of {ring.diameter * 1e3:.4g} mm do not fit, expected at most {fits}"
                )
            rim = ring.angle + self.half_width(ring.diameter)
            if rim > socket_angle + 1e-12:
                raise InputError(
                    f"{place}: the rim at {np.degrees(rim):.4g} deg is outside the socket,"
                    f" expected at most {np.degrees(socket_angle):.4g} deg"
                )
        ordered = sorted(rings, key=lambda ring: ring.angle)
        for inner, outer in pairwise(ordered):
            apart = self.half_width(inner.diameter) + self.half_width(outer.diameter)
            if outer.angle - inner.angle < apart:
                raise InputError(
                    f"magnet rings at {np.degrees(inner.angle):.4g} and {np.degrees(outer.angle):.4g} deg overlap,"
                    f" expected at least {np.degrees(apart):.4g} deg between them"
                )


@dataclass(frozen=True)
class PreloadDesign:
    """A candidate design of a magnetic preload: socket, ring, preload [N], cost [$]. Angles in rad, pressures in Pa. An
    area ratio is the area of the magnet faces over the area of the socket."""

    socket_angle: float
    ring: MagnetRing
    magnet: Magnet
    preload: float
    cost: float
    published_area_ratio: float
    published_pressure: float
    area_ratio: float
    pressure: float


def preload_design(socket_angle: float, angle: float, magnet: Magnet, seat: MagnetSeat) -> PreloadDesign | None:
    """Return a ring with as many magnets as fit at polar angle `angle`, rad; None if beyond the socket."""
    count = seat.fitting_count(magnet.diameter, angle)
    if count < 2 or angle + seat.half_width(magnet.diameter) > socket_angle + 1e-12:
        return None
    ring = MagnetRing(count, magnet.force, angle, magnet.diameter)
    published = float(published_socket_area(seat.radius, socket_angle))
    true = float(cap_area(seat.radius, socket_angle))
    return PreloadDesign(
        socket_angle,
        ring,
        magnet,
        ring.axial_force,
        count * magnet.cost,
        ring.face_area / published,
        ring.axial_force / published,
        ring.face_area / true,
        ring.axial_force / true,
    )


def rank_designs(
    socket_angles: Sequence[float], ring_angles: Sequence[float], magnets: Sequence[Magnet], seat: MagnetSeat
) -> list[PreloadDesign]:
    """Return the feasible designs of a grid, best first: largest preload, then highest socket pressure.

    The six best designs with 12.7 mm magnets, on a grid of 9 deg up to a socket of 72 deg, are the rows of Table 3.1.
    """
    candidates = [
        preload_design(alpha, gamma, magnet, seat)
        for alpha in socket_angles
        for gamma in ring_angles
        for magnet in magnets
    ]
    fitting = [design for design in candidates if design is not None]
    if not fitting:
        raise InputError(
            "preload optimisation: no magnet ring fits any socket; expected smaller magnets or larger sockets"
        )
    return sorted(fitting, key=lambda design: (-round(design.preload, 9), -design.published_pressure))


def continuous_optimum(magnet: Magnet, seat: MagnetSeat, largest_socket: float) -> PreloadDesign:
    """Return the design of largest preload over all ring angles. For each number n of magnets of force F the ring is at
    the smallest possible polar angle gamma, because the preload n F cos(gamma) falls with gamma. The socket is the
    smallest socket that contains the ring."""
    half = seat.half_width(magnet.diameter)
    designs = []
    for count in range(2, 200, 2 if seat.paired else 1):
        angle = seat.smallest_angle(magnet.diameter, count)
        if np.isnan(angle) or angle + half > largest_socket:
            break
        designs.append(preload_design(angle + half, angle, magnet, seat))
    best = max((design for design in designs if design), key=lambda design: design.preload, default=None)
    if best is None:
        raise InputError(
            "preload optimisation: no magnet ring fits the socket; expected smaller magnets or a larger socket"
        )
    return best


THICKNESS, SPACER = 6e-3, 1.5875e-3
"""Thickness of a magnet in Table 3.1, m; thickness of the 1/16 in spacer between magnet and ball when the pull of one
magnet was measured (section 3.6), m."""


@dataclass(frozen=True)
class PublishedPreload:
    """A magnetic preload published in the thesis.

    predicted, measured: preload, N; measured is None if the value is only in a figure.
    layers: number of stacked magnets.
    """

    name: str
    predicted: float
    measured: float | None
    diameter: float
    layers: int
    source: str

    @property
    def stacked(self) -> float:
        """Predicted pull of the stack of magnets relative to one magnet, at the distance of the spacer."""
        return stack_factor(self.diameter, THICKNESS, self.layers, SPACER)


def published_preloads() -> tuple[PublishedPreload, ...]:
    """Return every preload whose value is stated in the text of the thesis."""
    file = DATA / "preload_published.toml"
    return tuple(
        PublishedPreload(
            entry["name"],
            quantity(entry["predicted"], "1 N", f"{file.name}: predicted"),
            quantity(entry["measured"], "1 N", f"{file.name}: measured") if entry["measured"] else None,
            quantity(entry["diameter"], "1 mm", f"{file.name}: diameter"),
            entry["layers"],
            entry["source"],
        )
        for entry in read_toml(file)["joint"]
    )
