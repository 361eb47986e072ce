"""Dry friction and the magnets' hysteresis in the joint's periodic response (thesis chapter 6).

    D x + f = F sin wt,   f in F_c sign(x'),   |f| <= F_c where x' = 0

D(nw) = D_film(nw) + k_m + i eta |k_m| is the dynamic stiffness at each odd harmonic n: the magnets pull with stiffness
k_m (negative: they pull the less the farther away) and lose eta pi |k_m| X^2 a cycle, whatever the frequency. f and x
change sign over half a period. With the mobility Y = i n w / D the speed is v = Y (F - f): at each instant of half a
period either v = 0 and |f| < F_c or f = F_c sign(v). Re Y > 0 makes this a monotone complementarity problem with one
solution, whatever the frequency; where motion is slow it is the play X = (F - F_c) / k.

Source: J. P. Den Hartog, Trans. ASME 53 (1931), for one mass and spring; P. L. Lions and B. Mercier, SIAM J. Numer.
Anal. 16 (1979), for the splitting.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.dynamics import BallOnFilm
from joints.settings import not_negative, positive

INSTANTS, COARSE = 256, 64
"""Instants of half a period, and of the coarse search for the frequency of the largest motion.

Half as many odd harmonics are used. Amplitudes are accurate to 0.5 % at any frequency with 256 instants, to 1 % with
128.
"""
SETTLED, SWEEPS = 1e-5, 20_000
"""Share of the friction by which no instant changes any more; sweeps, of which a few hundred are needed."""


@dataclass(frozen=True)
class Losses:
    """friction: F_c, N, of the sliding contact. magnet_stiffness: k_m, N/m, at most 0. loss_factor: eta of the magnets.

    The joint sticks under a force that never exceeds F_c. Raises InputError for negative friction or loss.
    """

    friction: float
    magnet_stiffness: float = 0.0
    loss_factor: float = 0.0

    def __post_init__(self) -> None:
        not_negative("friction force", self.friction, "N")
        not_negative("magnets' pull falling with distance, -k_m", -self.magnet_stiffness, "N/m")
        not_negative("magnets' loss factor", self.loss_factor, "")

    @property
    def magnets(self) -> complex:
        """k_m + i eta |k_m| [N/m]."""
        return complex(self.magnet_stiffness, self.loss_factor * abs(self.magnet_stiffness))


@dataclass(frozen=True)
class SteadyState:
    """Periodic motion.

    motion: (M,) x [m] over half a period. film, friction, magnets: J lost a cycle.
    """

    motion: Array
    film: float
    friction: float
    magnets: float

    @property
    def amplitude(self) -> float:
        """Largest |x| [m]."""
        return float(np.abs(self.motion).max())

    @property
    def lost(self) -> float:
        """Energy lost a cycle [J]."""
        return self.film + self.friction + self.magnets


def magnet_stiffness(preload: float, stand_off: float) -> float:
    """dF/dx = -2 P / s [N/m] at contact of a pull P (s / (s + x))^2."""
    return float(-2 * positive("preload", preload, "N") / positive("stand-off", stand_off, "m"))


def steady_state(
    system: BallOnFilm, losses: Losses, force: float, frequency: float, instants: int = INSTANTS
) -> SteadyState:
    """Periodic motion under `force` [N] of `frequency` [Hz], at `instants` of half a period."""
    drive, f = float(positive("force amplitude", force, "N")), float(positive("frequency", frequency, "Hz"))
    omega = 2 * np.pi * f
    order = np.arange(1, instants if losses.friction else 2, 2)
    wave = np.exp(1j * np.pi * np.outer(np.arange(instants) / instants, order))
    film = np.asarray(system.dynamic_stiffness(order * f))
    mobility = 1j * order * omega / (film + losses.magnets)
    pushed, dry = drive * wave[:, 0].imag, np.zeros(instants)
    if losses.friction:
        dry = _friction(np.real(wave * mobility @ wave.conj().T) * 2 / instants, pushed, losses.friction)
    speed = mobility * (2 / instants) * ((pushed - dry) @ wave.conj())
    x = speed / (1j * order * omega)
    square = np.pi * order * np.abs(x) ** 2
    rubbed = float(np.mean(dry * np.real(wave @ speed))) / f
    motion = np.real(wave @ x) if losses.friction else np.abs(x) * np.sin(np.pi * np.arange(instants) / instants)
    magnets = float(square.sum() * losses.magnets.imag)
    return SteadyState(motion, float(square @ film.imag), max(rubbed, 0.0), magnets)


def _friction(mobility: Array, pushed: Array, limit: float) -> Array:
    """Friction force f (M,) at instants where the speed is mobility (M, M) (pushed - f), by Douglas-Rachford splitting.

    Raises InputError where it does not settle.
    """
    sizes = np.linalg.svd(mobility, compute_uv=False)
    scale = 1.0 / np.sqrt(sizes[0] * sizes[-1])
    inverse = np.linalg.inv(np.eye(len(pushed)) + scale * mobility)
    driven, z = scale * (inverse @ (mobility @ pushed)), pushed
    for _ in range(SWEEPS):
        dry = np.clip(z, -limit, limit)
        step = inverse @ (2 * dry - z) + driven - dry
        z = z + step
        if np.abs(step).max() < SETTLED * limit:
            return np.asarray(np.clip(z, -limit, limit))
    raise InputError("friction: no steady state was found; expected a joint that loses energy at every frequency")


def largest_motion(system: BallOnFilm, losses: Losses, force: float, frequency: Array) -> float:
    """Largest amplitude [m] over frequencies [Hz] from the lowest to the highest, refined between two of them."""

    def below(log_frequency: float) -> float:
        return -steady_state(system, losses, force, float(np.exp(log_frequency)), COARSE).amplitude

    at = np.log(frequency)
    k = int(np.argmin([below(x) for x in at]))
    bounds = (at[max(k - 1, 0)], at[min(k + 1, len(at) - 1)])
    found = minimize_scalar(below, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    best = min((at[k], found.x), key=below)
    return steady_state(system, losses, force, float(np.exp(best))).amplitude
