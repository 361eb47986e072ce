"""The design of an air film: from preload and displacement to inlet pressure and stiffness (thesis Fig 4.13).

Units as in `joints.film`.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from joints.film import (
    FilmGeometry,
    edge_gap,
    feed_factor,
    film_resistance,
    published_stiffness,
    stiffness_constant_flow,
    supporting_pressure,
)
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.settings import Settings, not_negative, positive, require


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
