"""Flat-plate air film of a spherical joint: gap, pressure, flow and stiffness (thesis section 4.2).

Air enters through orifices at polar angle phi and leaves at the socket's edge alpha. Pressures are gauge [Pa],
flows volumes at atmospheric pressure [m^3/s], displacements and gaps [m], angles [rad], stiffnesses [N/m].
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.preload import projected_area
from joints.settings import Settings, angle_within, not_negative, positive, require


@dataclass(frozen=True)
class FilmGeometry:
    """Ball radius r [m], socket edge alpha and orifices' phi [rad] from the axis, radial clearance h0 [m] of the
    concentric ball, number of orifices, viscosity [Pa s]."""

    ball_radius: float
    socket_angle: float
    orifice_angle: float
    clearance: float
    orifices: int = 3
    viscosity: float = 1.826e-5

    def __post_init__(self) -> None:
        positive("ball radius", self.ball_radius, "m")
        angle_within("socket angle", self.socket_angle, np.pi / 2)
        angle_within("orifice angle", self.orifice_angle, self.socket_angle * (1 - 1e-9))
        positive("radial clearance", self.clearance, "m")
        require(self.orifices >= 1, "number of orifices", self.orifices, "at least 1")
        positive("viscosity", self.viscosity, "Pa s")

    @property
    def area(self) -> float:
        """Projected area pi (r sin alpha)^2 [m^2]."""
        return float(projected_area(self.ball_radius, self.socket_angle))

    @property
    def orifice_length(self) -> float:
        """l_o = eta r phi [m], eta = sqrt(4 alpha / pi): 11.5 mm (Figs 4.10, 4.17)."""
        return self._arc_factor * self.ball_radius * self.orifice_angle

    @property
    def socket_length(self) -> float:
        """l_s = eta r (alpha - phi) [m]: 32.2 mm; Fig 4.10 prints the bracket with its sign turned."""
        return self._arc_factor * self.ball_radius * (self.socket_angle - self.orifice_angle)

    @property
    def outer_length(self) -> float:
        """l_o + l_s [m], the outer radius of the equivalent flat pad."""
        return self.orifice_length + self.socket_length

    @property
    def log_ratio(self) -> float:
        """ln((l_o + l_s) / l_o)."""
        return float(np.log(self.socket_angle / self.orifice_angle))

    @property
    def _arc_factor(self) -> float:
        return float(np.sqrt(4 * self.socket_angle / np.pi))


def film_gap(geometry: FilmGeometry, displacement: ArrayLike, angle: ArrayLike) -> Array:
    """h(t) = h0 + (d - h0) cos t [m] at polar angle t; d counts from the ball resting in the socket.

    Figs 4.10 and 4.12 print h0 + d cos(alpha), which is the same with d counted from the concentric ball;
    Table 4.2 and Fig 4.17 count from contact. Raises InputError where the ball would touch the socket.
    """
    gap = gap_along(geometry, not_negative("displacement", displacement, "m"), np.cos(np.asarray(angle, float)))
    require(gap > 0, "film gap", gap, "above 0 m")
    return gap


def gap_along(geometry: FilmGeometry, lift: Array, cosine: Array) -> Array:
    """`film_gap` of displacements and cos t already checked."""
    return geometry.clearance + (lift - geometry.clearance) * cosine


def edge_gap(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """`film_gap` at the socket's edge, alpha."""
    return film_gap(geometry, displacement, geometry.socket_angle)


def film_resistance(geometry: FilmGeometry, gap: ArrayLike) -> Array:
    """R_s = 6 mu ln((l_o + l_s)/l_o) / (pi h^3) [Pa s/m^3], socket pressure over total flow (Fig 4.9)."""
    return 6 * geometry.viscosity * geometry.log_ratio / (np.pi * positive("film gap", gap, "m") ** 3)


def film_pressure(geometry: FilmGeometry, socket_pressure: ArrayLike, radius: ArrayLike) -> Array:
    """P(l) = P_s ln((l_o + l_s)/l) / ln((l_o + l_s)/l_o) [Pa] at arc radius l of the flat pad, P_s inside l_o."""
    clipped = np.clip(np.asarray(radius, float), geometry.orifice_length, geometry.outer_length)
    share: Array = np.log(geometry.outer_length / clipped) / geometry.log_ratio
    return not_negative("socket pressure", socket_pressure, "Pa") * share


def supporting_pressure(geometry: FilmGeometry, preload: ArrayLike) -> Array:
    """P_s = F / (pi (r sin alpha)^2) [Pa], uniform over the projected socket (Fig 4.11)."""
    return not_negative("preload", preload, "N") / geometry.area


def pad_load(geometry: FilmGeometry, socket_pressure: ArrayLike) -> Array:
    """pi P_s (R^2 - l_o^2) / (2 ln(R/l_o)) [N], R = l_o + l_s: the integral of `film_pressure`, the classical pad."""
    ring = geometry.outer_length**2 - geometry.orifice_length**2
    return np.pi * not_negative("socket pressure", socket_pressure, "Pa") * ring / (2 * geometry.log_ratio)


def published_load(geometry: FilmGeometry, socket_pressure: ArrayLike) -> Array:
    """pi R^2 P_s (1 - 1/(2 ln(R/l_o))) [N] as printed in Fig 4.12, where the pressure grows outwards: 199 N for
    Table 4.2, where the preload is 100.7 N and the classical pad carries 111 N."""
    shape = 1 - 1 / (2 * geometry.log_ratio)
    return np.pi * geometry.outer_length**2 * not_negative("socket pressure", socket_pressure, "Pa") * shape


def published_stiffness(geometry: FilmGeometry, socket_pressure: ArrayLike, gap: ArrayLike) -> Array:
    """(3 pi/2) R^2 P_s cos(alpha) (2 - 1/ln(R/l_o)) / h [N/m] (Fig 4.12, Table 4.2; Fig 4.17 misprints 2 pi)."""
    return 3 * published_load(geometry, socket_pressure) * float(np.cos(geometry.socket_angle)) / _gap(gap)


def stiffness_constant_flow(geometry: FilmGeometry, load: ArrayLike, gap: ArrayLike) -> Array:
    """-dF/dd = 3 F cos(alpha) / h [N/m] of the load F actually carried, the flow held constant."""
    return 3 * not_negative("load", load, "N") * float(np.cos(geometry.socket_angle)) / _gap(gap)


def feed_factor(geometry: FilmGeometry, resistance: ArrayLike, flow_slope: ArrayLike) -> Array:
    """1 / (1 - N R_s dq/dP_s): what remains of the constant-flow stiffness at constant inlet pressure."""
    return 1 / (1 - geometry.orifices * np.asarray(resistance, np.float64) * np.asarray(flow_slope, np.float64))


def _gap(gap: ArrayLike) -> Array:
    return positive("film gap", gap, "m")


def film_geometry(settings: Settings, ball_radius: float | None = None) -> FilmGeometry:
    """The film's geometry from the keys of a TOML table, which are called as its fields. Raises InputError for numbers
    that no film has, a clearance as large as the ball among them."""
    given = settings if ball_radius is None else {**settings, "ball_radius": ball_radius}
    film = FilmGeometry(**{field.name: given[field.name] for field in fields(FilmGeometry)})
    require(film.clearance < film.ball_radius, "radial clearance", film.clearance, "less than the ball radius")
    return film


def orifice_law(settings: Settings) -> Orifice:
    """The orifice an [orifice] table describes. Raises InputError for a number that either law cannot have."""
    laws: dict[str, Orifice] = {
        "linear": LinearOrifice(settings["slope"], settings["offset"]),
        "nozzle": NozzleOrifice(settings["diameter"], settings["discharge"], settings["temperature"]),
    }
    if settings["law"] not in laws:
        raise InputError(f"orifice.law = '{settings['law']}', expected {choices(settings['law'], laws)}")
    return laws[settings["law"]]


@dataclass(frozen=True)
class FilmDesign:
    """One row of the design guide for each displacement; `flow` is through one orifice, `resistance_ratio` is
    orifice over socket resistance."""

    displacement: Array
    gap: Array
    flow: Array
    socket_pressure: Array
    orifice_drop: Array
    inlet_pressure: Array
    resistance_ratio: Array
    published_stiffness: Array
    stiffness_constant_flow: Array
    stiffness_constant_inlet: Array


def design_film(geometry: FilmGeometry, preload: ArrayLike, orifice: Orifice, displacement: ArrayLike) -> FilmDesign:
    """The design flow chart of Fig 4.13: preload and displacement to flow, inlet pressure and stiffness."""
    lift, load = np.broadcast_arrays(np.asarray(displacement, float), np.asarray(preload, float))
    gap = edge_gap(geometry, lift)
    socket = supporting_pressure(geometry, load)
    resistance = film_resistance(geometry, gap)
    flow = socket / (resistance * geometry.orifices)
    inlet = orifice.inlet_pressure(flow, socket)
    constant_flow = stiffness_constant_flow(geometry, load, gap)
    feed = feed_factor(geometry, resistance, orifice.flow_slope(inlet, socket))
    ratio = geometry.orifices * np.divide(inlet - socket, socket, out=np.full_like(gap, np.nan), where=socket > 0)
    return FilmDesign(
        lift,
        gap,
        flow,
        socket,
        inlet - socket,
        inlet,
        ratio,
        published_stiffness(geometry, socket, gap),
        constant_flow,
        constant_flow * feed,
    )


def displacement_at_inlet(geometry: FilmGeometry, preload: ArrayLike, orifice: Orifice, inlet: ArrayLike) -> Array:
    """Displacement [m] at which the film fed with `inlet` pressure carries `preload` (Fig 4.21), 0 if it cannot
    lift the ball: the gap at which `film_resistance` takes the socket's pressure from the flow."""
    supply = not_negative("inlet pressure", inlet, "Pa")
    socket = positive("preload", preload, "N") / geometry.area
    flow = np.where(supply > socket, orifice.flow(np.maximum(supply, socket), socket), 0.0)
    cubed = film_resistance(geometry, 1.0) * geometry.orifices * flow / socket
    lift: Array = geometry.clearance + (np.cbrt(cubed) - geometry.clearance) / np.cos(geometry.socket_angle)
    return np.maximum(lift, 0.0)
