"""What dry friction and the magnets' hysteresis do to the joint's response, by harmonic balance (thesis chapter 6).

    m x'' + film + F_c sign(x') + magnets = F sin wt

The magnets pull with stiffness k_m (negative: they pull the less the farther away) and lose eta pi |k_m| X^2 a cycle,
whatever the frequency. With D(w) the dynamic stiffness of ball and film, at amplitude X dry friction resists like
4 F_c / pi in phase with the speed, so that

    F^2 = ((Re D + k_m) X)^2 + ((Im D + eta |k_m|) X + 4 F_c / pi)^2

which is quadratic in X. Source: J. P. Den Hartog, Trans. ASME 53 (1931); its equivalent damper for friction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from joints.dynamics import BallOnFilm
from joints.limits import not_negative, positive


@dataclass(frozen=True)
class Losses:
    """friction: F_c, N, of the sliding contact. magnet_stiffness: k_m, N/m, at most 0. loss_factor: eta of the magnets.

    Raises InputError for negative friction or loss.
    """

    friction: float
    magnet_stiffness: float = 0.0
    loss_factor: float = 0.0

    def __post_init__(self) -> None:
        not_negative("friction force", self.friction, "N")
        not_negative("magnets' pull falling with distance, -k_m", -self.magnet_stiffness, "N/m")
        not_negative("magnets' loss factor", self.loss_factor, "")

    @property
    def break_away(self) -> float:
        """Amplitude of force, N, below which harmonic balance has the joint stick: 4 F_c / pi."""
        return 4 * self.friction / np.pi


def magnet_stiffness(preload: float, stand_off: float) -> float:
    """dF/dx = -2 P / s [N/m] at contact of a pull P (s / (s + x))^2."""
    return float(-2 * positive("preload", preload, "N") / positive("stand-off", stand_off, "m"))


def amplitude(system: BallOnFilm, losses: Losses, force: ArrayLike, frequency: ArrayLike) -> Array:
    """Amplitude of motion [m] under `force` [N] of `frequency` [Hz]; 0 where friction holds the joint."""
    drive, held = positive("force amplitude", force, "N"), system.dynamic_stiffness(frequency)
    elastic = held.real + losses.magnet_stiffness
    viscous = held.imag + losses.loss_factor * abs(losses.magnet_stiffness)
    dry = losses.break_away
    squared = elastic**2 + viscous**2
    root = np.sqrt(np.maximum(squared * drive**2 - (elastic * dry) ** 2, 0.0))
    return np.where(drive > dry, np.maximum(root - viscous * dry, 0.0) / squared, 0.0)


def energy_per_cycle(system: BallOnFilm, losses: Losses, motion: ArrayLike, frequency: float) -> dict[str, Array]:
    """What a cycle of amplitude `motion` [m] loses, J: to the film, to friction, to the magnets."""
    x = not_negative("amplitude", motion, "m")
    return {
        "film": np.pi * system.dynamic_stiffness(frequency).imag * x**2,
        "friction": 4 * losses.friction * x,
        "magnets": np.pi * losses.loss_factor * abs(losses.magnet_stiffness) * x**2,
    }
