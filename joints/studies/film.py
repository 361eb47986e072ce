"""`gpmodel joint film`: the design guide of Table 4.2, and the film in the real spherical gap."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints import figures
from joints.film import (
    Film,
    FilmDesign,
    FilmGeometry,
    design_film,
    displacement_at_inlet,
    edge_gap,
    film_geometry,
    orifice_law,
    pad_load,
    published_load,
    supporting_pressure,
)
from joints.orifice import ATMOSPHERE, SCCM, Orifice
from joints.reynolds import (
    compressible_film,
    lateral_stiffness,
    orifice_spreading_resistance,
    spherical_film,
)
from joints.settings import Settings, curve_of, load_settings, positive
from joints.studies.study import MICRO, N_PER_UM, Study, Table

APART = 1e4
"""Condition number of the scaled fit above which measured rows cannot separate clearance from flow ratio."""


@dataclass(frozen=True)
class FilmFit:
    """Result of fitting clearance and flow ratio of an air film.

    clearance: fitted radial clearance, m.
    passed: fitted ratio of the flow through the orifices to the flow by the orifice formula.
    stderr: standard errors of clearance and passed, by name.
    rms: RMS of the relative residuals of the inlet pressures.
    status: "ok", or the reason for a missing standard error.
    """

    clearance: float
    passed: float
    stderr: dict[str, float]
    rms: float
    status: str


def fit_film(
    film: Callable[[FilmGeometry, ArrayLike, Orifice, ArrayLike], Film], geometry: FilmGeometry, orifice: Orifice,
    inlet: ArrayLike, lift: ArrayLike, load: ArrayLike,
) -> FilmFit:  # fmt: skip
    """Fit clearance and flow ratio to inlet pressures [Pa] at displacements [m] and loads [N], by relative least
    squares.

    film: `design_film` or `spherical_film`, which gives the flow and the socket pressure that carry the load. The flow
    ratio `passed` is the flow through an orifice over the flow by the orifice formula. Raises InputError for a table of
    fewer than 3 rows, or for a physically impossible row.
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


NO_TILT = "stiffness along the axis, and across it at constant inlet; a ball that turns about its centre meets none"


def film_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate the flat-plate and the spherical air film at every displacement of the ball, for one preload."""
    s = load_settings("film", path)
    geometry, orifice, preload = film_geometry(s), orifice_law(s["orifice"]), s["preload"]
    displacement = np.array(s["displacements"])
    flat = design_film(geometry, preload, orifice, displacement)
    sphere = spherical_film(geometry, preload, orifice, displacement)
    spreading = orifice_spreading_resistance(geometry, displacement, s["orifice"]["diameter"]) * sphere.flow
    compressible = np.array([compressible_film(geometry, preload, lift) for lift in displacement])
    guide, real = _guide(flat), _sphere(sphere, compressible, spreading)
    real["stiffness_across_the_axis_N_per_um"] = lateral_stiffness(geometry, sphere, orifice) * N_PER_UM
    socket = supporting_pressure(geometry, preload)
    fits = _fitted(s["measured"], path, geometry, orifice)
    inlets = np.linspace(float(socket) * 1.05, 8 * ATMOSPHERE, 120)
    lift = displacement_at_inlet(geometry, preload, orifice, inlets)
    lifts = np.linspace(2e-6, 1.2 * displacement.max(), 120)
    return Study(
        (
            Table(f"Design guide at a preload of {preload:g} N, flat plate (Table 4.2)", _heads(guide), _rows(guide)),
            Table("The same over the real gap of the sphere (Reynolds)", _heads(real), _rows(real), NO_TILT),
            *([_calibrated(s["measured"]["file"], fits)] if fits else []),
        ),
        {
            "preload_N": preload,
            "orifice_length_mm": geometry.orifice_length * 1e3,
            "socket_length_mm": geometry.socket_length * 1e3,
            "classical_pad_load_N": pad_load(geometry, socket),
            "published_load_N": published_load(geometry, socket),
            "flat_plate": guide,
            "sphere": real,
            "calibrated": {name: asdict(fit) for name, fit in fits.items()},
            "flat_plate_lift": {"inlet_atm": inlets / ATMOSPHERE, "displacement_um": lift * MICRO},
        },
        {
            "film_guide.png": figures.film_guide(flat, sphere),
            "film_inlet.png": figures.film_inlet(
                inlets, lift, edge_gap(geometry, lift), spherical_film(geometry, preload, orifice, lifts)
            ),
            "film_pressure.png": figures.film_pressure(geometry, preload, float(displacement.max())),
        },
    )


def _fitted(s: Settings, path: Path | None, geometry: FilmGeometry, orifice: Orifice) -> dict[str, FilmFit]:
    """Fit both film models to a measured table; without a table, return an empty dictionary."""
    rows = curve_of(s, path, {"inlet": "atm", "lift": "um", "load": "N"})
    films: dict[str, Callable[..., Film]] = {"flat plate": design_film, "sphere": spherical_film}
    return {name: fit_film(film, geometry, orifice, **rows) for name, film in films.items()} if rows else {}


def _calibrated(source: str, fits: dict[str, FilmFit]) -> Table:
    heads = ("Film", "Clearance [um]", "± [um]", "Flow over the law", "±", "Inlet rms [%]", "Status")
    rows = [
        (name, f.clearance * MICRO, f.stderr["clearance"] * MICRO, f.passed, f.stderr["passed"], 100 * f.rms, f.status)
        for name, f in fits.items()
    ]
    return Table(f"Calibrated by {source}", heads, rows, "for clearance, and slope or discharge of [orifice]")


def _guide(design: FilmDesign) -> dict[str, np.ndarray]:
    return {
        "displacement_um": design.displacement * MICRO,
        "gap_um": design.gap * MICRO,
        "flow_sccm": design.flow / SCCM,
        "stiffness_published_N_per_um": design.published_stiffness * N_PER_UM,
        "resistance_ratio": design.resistance_ratio,
        "socket_atm": design.socket_pressure / ATMOSPHERE,
        "orifice_atm": design.orifice_drop / ATMOSPHERE,
        "inlet_atm": design.inlet_pressure / ATMOSPHERE,
        "stiffness_constant_flow_N_per_um": design.stiffness_constant_flow * N_PER_UM,
        "stiffness_constant_inlet_N_per_um": design.stiffness_constant_inlet * N_PER_UM,
    }


def _sphere(film: Film, compressible: np.ndarray, spreading: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "displacement_um": film.displacement * MICRO,
        "flow_sccm": film.flow / SCCM,
        "socket_atm": film.socket_pressure / ATMOSPHERE,
        "inlet_atm": film.inlet_pressure / ATMOSPHERE,
        "stiffness_constant_flow_N_per_um": film.stiffness_constant_flow * N_PER_UM,
        "stiffness_constant_inlet_N_per_um": film.stiffness_constant_inlet * N_PER_UM,
        "compressible_flow_sccm": compressible[:, 0] / SCCM,
        "compressible_socket_atm": compressible[:, 1] / ATMOSPHERE,
        "orifice_spreading_atm": spreading / ATMOSPHERE,
    }


_UNITS = {"N_per_um": "N/um", "um": "um", "sccm": "sccm", "atm": "atm"}


def _heads(columns: dict[str, np.ndarray]) -> list[str]:
    """Return table heads with units: `stiffness_published_N_per_um` becomes `stiffness published [N/um]`."""
    heads = []
    for name in columns:
        unit = next((unit for unit in _UNITS if name.endswith(f"_{unit}")), "")
        text = name.removesuffix(f"_{unit}").replace("_", " ")
        heads.append(f"{text} [{_UNITS[unit]}]" if unit else text)
    return heads


def _rows(columns: dict[str, np.ndarray]) -> list[tuple[float, ...]]:
    return list(zip(*(column.tolist() for column in columns.values()), strict=True))
