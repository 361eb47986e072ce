"""The ball on its air film: frequency response, its peak and bandwidth, and its identification (thesis chapter 6)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.fed_film import FedFilm, squeeze_impedance
from joints.film import FilmGeometry
from joints.settings import not_negative, positive, require

SPAN = (0.01, 20.0)
"""Range of frequencies searched for peak and bandwidth, in units of sqrt(k/m) / 2 pi."""
STEPS = 400
"""Frequencies over that span, 2 % apart; what lies between two is refined."""


@dataclass(frozen=True)
class BallOnFilm:
    """m x'' + k x + Z(w) x = F: a film of static `stiffness` [N/m] and air that is squeezed as it moves.

    air: Z [N/m], the complex stiffness beside the static one at frequencies [Hz]. mass: kg.
    """

    mass: float
    stiffness: float
    air: Callable[[Array], NDArray[np.complex128]]

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kg")
        positive("stiffness", self.stiffness, "N/m")

    def dynamic_stiffness(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """k - m w^2 + Z(w) [N/m] at `frequency` [Hz], above 0."""
        f = positive("frequency", frequency, "Hz")
        return self.stiffness - self.mass * (2 * np.pi * f) ** 2 + self.air(f)


def ball_on_constant_feed(
    mass: float, stiffness: float, geometry: FilmGeometry, displacement: float, share: float = 1.0
) -> BallOnFilm:
    """A film whose feed stays constant while the air in its gap is squeezed, `share` times as computed."""
    factor = float(not_negative("share of the squeezed air", share, ""))
    return BallOnFilm(mass, stiffness, lambda f: factor * squeeze_impedance(geometry, displacement, f))


def ball_on_fed_film(mass: float, film: FedFilm, pocket: float = 0.0) -> BallOnFilm:
    """A film whose feed answers to its pressure, with air pockets [m^3] behind its orifices."""
    static = float(film.impedance(0.0).real)
    return BallOnFilm(mass, static, lambda f: film.impedance(f, pocket) - static)


def slow_damping(system: BallOnFilm, frequency: float = 0.1) -> float:
    """Im Z / w [N s/m] of slow motion, at `frequency` [Hz]."""
    return float(system.air(np.asarray(frequency)).imag / (2 * np.pi * frequency))


def receptance(system: BallOnFilm, frequency: ArrayLike) -> NDArray[np.complex128]:
    """x/F [m/N] at `frequency` [Hz]."""
    return 1 / system.dynamic_stiffness(frequency)


def natural_frequency(system: BallOnFilm) -> float:
    """sqrt(k/m) / 2 pi [Hz], of the static stiffness."""
    return float(np.sqrt(system.stiffness / system.mass) / (2 * np.pi))


def resonance(system: BallOnFilm) -> tuple[float, float]:
    """Frequency [Hz] of the largest response and that over the static one; 0 and 1 where none is larger."""
    f = natural_frequency(system) * np.geomspace(*SPAN, STEPS)
    size = _times_static(system, f)
    at = int(np.argmax(size))
    if at == 0 or at + 1 == len(f):
        return 0.0, 1.0
    found = optimize.minimize_scalar(
        lambda x: -float(_times_static(system, x)), bounds=(f[at - 1], f[at + 1]), method="bounded"
    )
    return (float(found.x), float(-found.fun)) if -found.fun > 1 else (0.0, 1.0)


def bandwidth(system: BallOnFilm) -> float:
    """Frequency [Hz] above which the response stays below 1/sqrt(2) of the static one."""
    f = natural_frequency(system) * np.geomspace(*SPAN, STEPS)
    last = int(np.flatnonzero(_times_static(system, f) >= np.sqrt(0.5)).max(initial=0))
    return float(optimize.brentq(lambda x: float(_times_static(system, x)) - np.sqrt(0.5), f[last], f[last + 1]))


def _times_static(system: BallOnFilm, frequency: ArrayLike) -> Array:
    return system.stiffness * np.abs(receptance(system, frequency))


def ball_mass(radius: float, density: float) -> float:
    """4/3 pi r^3 rho [kg]."""
    return float(4 / 3 * np.pi * positive("ball radius", radius, "m") ** 3 * positive("density", density, "kg/m^3"))


@dataclass(frozen=True)
class ResponseFit:
    """Identified from a frequency response: kg, N/m, what resists in units of its impedance, and standard errors."""

    mass: float
    stiffness: float
    resistance: float
    stderr: dict[str, float]


def fit_response(frequency: ArrayLike, measured: ArrayLike, impedance: ArrayLike) -> ResponseFit:
    """Stiffness, mass and resistance s from a measured receptance (N,), complex [m/N].

    1/H = k - m w^2 + s Z is linear in the three; rows are weighted by |H| so that the error is relative. impedance: Z
    (N,) [N/m], i w of a plain damper, s then its N s/m. Raises InputError below 3 frequencies or where the fitted mass
    or stiffness is not above 0.
    """
    f = positive("frequency", frequency, "Hz").ravel()
    response, resists = np.asarray(measured, complex).ravel(), np.asarray(impedance, complex).ravel()
    if f.size != response.size or np.unique(f).size < 3:
        raise InputError(f"frequency response: {f.size} frequencies and {response.size} values, expected 3 or more")
    size = np.abs(response)
    require(np.isfinite(size) & (size > 0), "receptance", size, "finite and not 0 m/N")
    columns = np.column_stack([np.ones(f.size), -((2 * np.pi * f) ** 2), resists]) * size[:, None]
    weighted = np.vstack([columns.real, columns.imag])
    target = np.concatenate([(size / response).real, (size / response).imag])
    scale = np.linalg.norm(weighted, axis=0)
    solution, *_ = np.linalg.lstsq(weighted / scale, target, rcond=None)
    residual = weighted / scale @ solution - target
    noise = residual @ residual / max(target.size - 3, 1)
    errors = np.sqrt(np.diag(np.linalg.inv((weighted / scale).T @ (weighted / scale))) * noise) / scale
    stiffness, mass, resistance = solution / scale
    positive("mass", mass, "kg")
    positive("stiffness", stiffness, "N/m")
    names = ("stiffness", "mass", "resistance")
    return ResponseFit(mass, stiffness, max(resistance, 0.0), dict(zip(names, errors.tolist(), strict=True)))
