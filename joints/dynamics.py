"""The joint as spring, mass and damper: frequency response, and its identification (thesis chapter 6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpmodel.errors import InputError
from joints.limits import not_negative, positive, require


@dataclass(frozen=True)
class SpringMassDamper:
    """m x'' + c x' + k x = F: `mass` [kg], `damping` [N s/m], `stiffness` [N/m]."""

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kg")
        not_negative("damping", self.damping, "N s/m")
        positive("stiffness", self.stiffness, "N/m")

    @property
    def natural_frequency(self) -> float:
        """sqrt(k/m) / 2 pi [Hz]."""
        return float(np.sqrt(self.stiffness / self.mass) / (2 * np.pi))

    @property
    def damping_ratio(self) -> float:
        """c / (2 sqrt(k m))."""
        return float(self.damping / (2 * np.sqrt(self.stiffness * self.mass)))

    @property
    def resonance(self) -> float:
        """Frequency [Hz] of the largest response, 0 from a damping ratio of 0.707 on."""
        return self.natural_frequency * float(np.sqrt(max(1 - 2 * self.damping_ratio**2, 0.0)))

    @property
    def bandwidth(self) -> float:
        """Frequency [Hz] above which the compliance stays below 1/sqrt(2) of the static one."""
        middle = 1 - 2 * self.damping_ratio**2
        return self.natural_frequency * float(np.sqrt(middle + np.sqrt(middle**2 + 1)))

    def receptance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """x/F = 1 / (k - m w^2 + i w c) [m/N] at `frequency` [Hz]."""
        return 1 / (self.stiffness + dynamic_part(self.mass, self.damping, frequency))


def ball_mass(radius: float, density: float) -> float:
    """4/3 pi r^3 rho [kg]."""
    return float(4 / 3 * np.pi * positive("ball radius", radius, "m") ** 3 * positive("density", density, "kg/m^3"))


def dynamic_part(mass: float, damping: float, frequency: ArrayLike) -> NDArray[np.complex128]:
    """-m w^2 + i w c [N/m]."""
    omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
    return -mass * omega**2 + 1j * omega * damping


def film_receptance(
    mass: float, stiffness: float, impedance: ArrayLike, frequency: ArrayLike
) -> NDArray[np.complex128]:
    """x/F [m/N] of a mass on a fed film of `stiffness` in which trapped air adds `impedance` [N/m, complex]."""
    return 1 / (stiffness + np.asarray(impedance, complex) + dynamic_part(mass, 0.0, frequency))


@dataclass(frozen=True)
class ResponseFit:
    """Spring, mass and damper identified from a frequency response, with one standard error each."""

    system: SpringMassDamper
    stderr: dict[str, float]


def fit_response(frequency: ArrayLike, receptance: ArrayLike) -> ResponseFit:
    """Stiffness, mass and damping from a measured receptance (N,), complex [m/N].

    1/H = k - m w^2 + i w c is linear in the three; rows are weighted by |H| so that the error is relative. Raises
    InputError below 3 frequencies or where the fitted mass or stiffness is not above 0.
    """
    f = positive("frequency", frequency, "Hz").ravel()
    response = np.asarray(receptance, complex).ravel()
    if f.size != response.size or np.unique(f).size < 3:
        raise InputError(f"frequency response: {f.size} frequencies and {response.size} values, expected 3 or more")
    size = np.abs(response)
    require(np.isfinite(size) & (size > 0), "receptance", size, "finite and not 0 m/N")
    omega = 2 * np.pi * f
    real = np.column_stack([np.ones_like(f), -(omega**2), np.zeros_like(f)])
    imaginary = np.column_stack([np.zeros_like(f), np.zeros_like(f), omega])
    weighted = np.vstack([real * size[:, None], imaginary * size[:, None]])
    target = np.concatenate([(size / response).real, (size / response).imag])
    scale = np.linalg.norm(weighted, axis=0)
    solution, *_ = np.linalg.lstsq(weighted / scale, target, rcond=None)
    residual = weighted / scale @ solution - target
    noise = residual @ residual / max(target.size - 3, 1)
    errors = np.sqrt(np.diag(np.linalg.inv((weighted / scale).T @ (weighted / scale))) * noise) / scale
    stiffness, mass, damping = solution / scale
    system = SpringMassDamper(float(mass), float(max(damping, 0.0)), float(stiffness))
    return ResponseFit(system, dict(zip(("stiffness", "mass", "damping"), errors.tolist(), strict=True)))
