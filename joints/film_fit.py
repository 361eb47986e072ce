"""A film calibrated by a measured table of inlet pressure, lift and load: clearance, and what the orifices pass."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.film import FilmGeometry
from joints.film_design import FilmDesign
from joints.limits import positive
from joints.orifice import Orifice
from joints.reynolds import SphericalFilm

APART = 1e4
"""Condition of the two columns, scaled, above which the rows do not tell clearance from flow."""


Film = FilmDesign | SphericalFilm
"""A film that carries a load at a displacement."""


@dataclass(frozen=True)
class FilmFit:
    """clearance: m. passed: how many times the flow of their law the orifices let through. stderr: of both, by name.
    rms: of the inlet pressures, relative. status: ok, or why there is no stderr."""

    clearance: float
    passed: float
    stderr: dict[str, float]
    rms: float
    status: str


def fit_film(
    film: Callable[[FilmGeometry, ArrayLike, Orifice, ArrayLike], Film], geometry: FilmGeometry, orifice: Orifice,
    inlet: ArrayLike, lift: ArrayLike, load: ArrayLike,
) -> FilmFit:  # fmt: skip
    """Least squares of the relative error of the inlet pressure (N,) [Pa] at displacements [m] and loads [N].

    film: `design_film` or `spherical_film`; its flow q and socket pressure p_s are those that hold the load there, and
    the orifices pass them at the inlet pressure of their law for q / passed. Raises InputError below 3 rows, or for a
    row that no film has.
    """
    given, at, held = np.broadcast_arrays(
        positive("inlet pressure", inlet, "Pa"), positive("lift", lift, "m"), positive("load", load, "N")
    )
    if given.size < 3:
        raise InputError(f"film: {given.size} rows of inlet pressure, lift and load, expected 3 or more")

    def error(logs: Array) -> Array:
        found = film(replace(geometry, clearance=float(np.exp(logs[0]))), held, orifice, at)
        share: Array = orifice.inlet_pressure(found.flow / np.exp(logs[1]), found.socket_pressure) / given
        return share - 1.0

    solved = least_squares(error, [np.log(geometry.clearance), 0.0])
    clearance, passed = np.exp(solved.x).tolist()
    scale = np.linalg.norm(solved.jac, axis=0)
    status, relative = "ok", np.full(2, np.nan)
    if np.any(scale == 0) or np.linalg.cond(solved.jac / scale) > APART:
        status = "clearance and flow cannot be told apart at these lifts"
    else:
        spread = np.linalg.inv((solved.jac / scale).T @ (solved.jac / scale)) / np.outer(scale, scale)
        relative = np.sqrt(2.0 * solved.cost / (given.size - 2) * np.diag(spread))
    stderr = {"clearance": clearance * float(relative[0]), "passed": passed * float(relative[1])}
    return FilmFit(clearance, passed, stderr, float(np.sqrt(2.0 * solved.cost / given.size)), status)
