"""Flat-plate air film of a spherical joint: gap, pressure, flow and stiffness (thesis section 4.2).

Air enters the socket through orifices at polar angle phi and leaves at its edge, polar angle alpha. Gauge pressures
[Pa], flows as volumes at atmospheric pressure [m^3/s], displacements and gaps [m], angles [rad], stiffnesses [N/m].
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
    """Geometry of an air film between ball and socket.

    ball_radius: radius of the ball, m.
    socket_angle, orifice_angle: polar angles of the socket's edge and of the orifices, rad.
    clearance: radial gap between socket and concentric ball, m.
    orifices: number of orifices.
    viscosity: dynamic viscosity of the air, Pa s.
    """

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
        """Projected area [m^2] of the socket, a circle of radius (ball radius) sin(socket angle)."""
        return float(projected_area(self.ball_radius, self.socket_angle))

    @property
    def orifice_length(self) -> float:
        """Inner radius l_o = eta r phi [m] of the equivalent flat pad: ball radius r, orifices at polar angle phi,
        socket's edge at alpha, eta = sqrt(4 alpha / pi); 11.5 mm in the thesis (Figs 4.10, 4.17)."""
        return self._arc_factor * self.ball_radius * self.orifice_angle

    @property
    def socket_length(self) -> float:
        """Width eta r (alpha - phi) [m] of the equivalent flat pad (32.2 mm in the thesis) of a ball of radius r, from
        the orifices at polar angle phi to the socket's edge at alpha, with eta = sqrt(4 alpha / pi). In the thesis, Fig
        4.10 prints phi - alpha in place of alpha - phi."""
        return self._arc_factor * self.ball_radius * (self.socket_angle - self.orifice_angle)

    @property
    def outer_length(self) -> float:
        """Outer radius [m] of the flat pad that is equivalent to the socket."""
        return self.orifice_length + self.socket_length

    @property
    def log_ratio(self) -> float:
        """Natural logarithm of the ratio of outer to inner radius of the equivalent flat pad."""
        return float(np.log(self.socket_angle / self.orifice_angle))

    @property
    def _arc_factor(self) -> float:
        return float(np.sqrt(4 * self.socket_angle / np.pi))


def film_gap(geometry: FilmGeometry, displacement: ArrayLike, angle: ArrayLike) -> Array:
    """Return the gap h0 + (d - h0) cos t [m] at polar angle t: clearance h0, displacement d of the ball from contact.

    Figs 4.10 and 4.12 print the edge gap h0 + d cos(alpha), displacement d from the concentric ball; in Table 4.2 and
    Fig 4.17 d counts from contact. Raises InputError if the ball would touch the socket.
    """
    gap = gap_along(geometry, not_negative("displacement", displacement, "m"), np.cos(np.asarray(angle, float)))
    require(gap > 0, "film gap", gap, "above 0 m")
    return gap


def gap_along(geometry: FilmGeometry, lift: Array, cosine: Array) -> Array:
    """Return the gap [m] at the displacement `lift` and the cosine of a polar angle, without a check."""
    return geometry.clearance + (lift - geometry.clearance) * cosine


def edge_gap(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return the gap [m] between ball and socket at the edge of the socket."""
    return film_gap(geometry, displacement, geometry.socket_angle)


def film_resistance(geometry: FilmGeometry, gap: ArrayLike) -> Array:
    """Return pressure over total flow of a film, 6 mu ln(R/l_o) / (pi gap^3) [Pa s/m^3] (thesis, Fig 4.9).
    mu: viscosity of the air; l_o, R: inner and outer radius of the flat pad."""
    return 6 * geometry.viscosity * geometry.log_ratio / (np.pi * positive("film gap", gap, "m") ** 3)


def film_pressure(geometry: FilmGeometry, socket_pressure: ArrayLike, radius: ArrayLike) -> Array:
    """Return the pressure [Pa] at radius l of the flat pad, P_s ln(R/l) / ln(R/l_o), at most the socket pressure P_s.
    l_o, R: inner and outer radius of the pad."""
    clipped = np.clip(np.asarray(radius, float), geometry.orifice_length, geometry.outer_length)
    share: Array = np.log(geometry.outer_length / clipped) / geometry.log_ratio
    return not_negative("socket pressure", socket_pressure, "Pa") * share


def supporting_pressure(geometry: FilmGeometry, preload: ArrayLike) -> Array:
    """Return the pressure [Pa] that carries the preload: preload over the projected area of the socket (Fig 4.11)."""
    return not_negative("preload", preload, "N") / geometry.area


def pad_load(geometry: FilmGeometry, socket_pressure: ArrayLike) -> Array:
    """Return the load pi P_s (R^2 - l_o^2) / (2 ln(R/l_o)) [N] of a flat pad: the integral of the film pressure.
    P_s: socket pressure; l_o, R: inner and outer radius of the pad."""
    ring = geometry.outer_length**2 - geometry.orifice_length**2
    return np.pi * not_negative("socket pressure", socket_pressure, "Pa") * ring / (2 * geometry.log_ratio)


def published_load(geometry: FilmGeometry, socket_pressure: ArrayLike) -> Array:
    """Return the pad load printed in Fig 4.12, pi R^2 P_s (1 - 1/(2 ln(R/l_o))) [N], symbols as in `pad_load`. The
    printed formula holds for a pressure that grows outwards. With Table 4.2 the printed load is 199 N, the preload
    100.7 N, and the load of the classical pad 111 N."""
    shape = 1 - 1 / (2 * geometry.log_ratio)
    return np.pi * geometry.outer_length**2 * not_negative("socket pressure", socket_pressure, "Pa") * shape


def published_stiffness(geometry: FilmGeometry, socket_pressure: ArrayLike, gap: ArrayLike) -> Array:
    """Return the printed stiffness [N/m], 3 published_load cos(socket angle) / gap (Fig 4.12, misprint in Fig 4.17)."""
    return 3 * published_load(geometry, socket_pressure) * float(np.cos(geometry.socket_angle)) / _gap(gap)


def stiffness_constant_flow(geometry: FilmGeometry, load: ArrayLike, gap: ArrayLike) -> Array:
    """Return the stiffness 3 load cos(socket angle) / gap [N/m] of the film at constant flow, for the carried load."""
    return 3 * not_negative("load", load, "N") * float(np.cos(geometry.socket_angle)) / _gap(gap)


def feed_factor(geometry: FilmGeometry, resistance: ArrayLike, flow_slope: ArrayLike) -> Array:
    """Return the ratio of stiffness at constant inlet pressure to stiffness at constant flow, at most 1."""
    return 1 / (1 - geometry.orifices * np.asarray(resistance, np.float64) * np.asarray(flow_slope, np.float64))


def _gap(gap: ArrayLike) -> Array:
    return positive("film gap", gap, "m")


def film_geometry(settings: Settings, ball_radius: float | None = None) -> FilmGeometry:
    """Return the geometry of the film from settings that have the names of the fields of FilmGeometry.
    Raises InputError for impossible numbers, such as a clearance as large as the ball."""
    given = settings if ball_radius is None else {**settings, "ball_radius": ball_radius}
    film = FilmGeometry(**{field.name: given[field.name] for field in fields(FilmGeometry)})
    require(film.clearance < film.ball_radius, "radial clearance", film.clearance, "less than the ball radius")
    return film


def orifice_law(settings: Settings) -> Orifice:
    """Return the orifice that a TOML table [orifice] describes. Raises InputError for an impossible number."""
    laws: dict[str, Orifice] = {
        "linear": LinearOrifice(settings["slope"], settings["offset"]),
        "nozzle": NozzleOrifice(settings["diameter"], settings["discharge"], settings["temperature"]),
    }
    if settings["law"] not in laws:
        raise InputError(f"orifice.law = '{settings['law']}', expected {choices(settings['law'], laws)}")
    return laws[settings["law"]]


@dataclass(frozen=True)
class Film:
    """An air film that carries a load, one entry per displacement of the ball.

    flow: flow through one orifice, m^3/s at atmospheric pressure.
    """

    displacement: Array
    flow: Array
    socket_pressure: Array
    inlet_pressure: Array
    stiffness_constant_flow: Array
    stiffness_constant_inlet: Array


@dataclass(frozen=True)
class FilmDesign(Film):
    """The air film's design guide of Fig 4.13 (Robertson 2003). resistance_ratio: flow resistance of one orifice over
    the resistance of the film."""

    gap: Array
    orifice_drop: Array
    resistance_ratio: Array
    published_stiffness: Array


def design_film(geometry: FilmGeometry, preload: ArrayLike, orifice: Orifice, displacement: ArrayLike) -> FilmDesign:
    """Return the design guide of Fig 4.13: flow, pressures and stiffness of the film at a preload and displacements."""
    lift, load = np.broadcast_arrays(np.asarray(displacement, float), np.asarray(preload, float))
    gap = edge_gap(geometry, lift)
    socket = supporting_pressure(geometry, load)
    resistance = film_resistance(geometry, gap)
    flow = socket / (resistance * geometry.orifices)
    inlet = orifice.inlet_pressure(flow, socket)
    constant_flow = stiffness_constant_flow(geometry, load, gap)
    feed = feed_factor(geometry, resistance, orifice.flow_slope(inlet, socket))
    ratio = geometry.orifices * np.divide(inlet - socket, socket, out=np.full_like(gap, np.nan), where=socket > 0)
    design = (inlet - socket, ratio, published_stiffness(geometry, socket, gap))
    return FilmDesign(lift, flow, socket, inlet, constant_flow, constant_flow * feed, gap, *design)


def displacement_at_inlet(geometry: FilmGeometry, preload: ArrayLike, orifice: Orifice, inlet: ArrayLike) -> Array:
    """Return the displacement [m] at which a film with pressure `inlet` [Pa] carries `preload` [N] (Fig 4.21), else 0.
    At the returned displacement, flow times film resistance is the socket pressure."""
    supply = not_negative("inlet pressure", inlet, "Pa")
    socket = positive("preload", preload, "N") / geometry.area
    flow = np.where(supply > socket, orifice.flow(np.maximum(supply, socket), socket), 0.0)
    cubed = film_resistance(geometry, 1.0) * geometry.orifices * flow / socket
    lift: Array = geometry.clearance + (np.cbrt(cubed) - geometry.clearance) / np.cos(geometry.socket_angle)
    return np.maximum(lift, 0.0)
