"""The ball on its air film: frequency response, resonance, bandwidth and identification (thesis chapter 6)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize
from scipy.optimize import minimize_scalar

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.film import FilmGeometry
from joints.reynolds import FedFilm, squeeze_impedance
from joints.settings import not_negative, positive, require

SPAN = (0.01, 20.0)
"""Range of frequencies searched for resonance and bandwidth, relative to the ball's natural frequency."""
STEPS = 400
"""Number of searched frequencies, 2 % apart (SPAN). The frequency of the largest response is then refined."""


@dataclass(frozen=True)
class BallOnFilm:
    """A ball of mass m on an air film, moved x by a force F: m x'' + k x + Z(w) x = F at the angular frequency w.

    mass: mass m of the ball, kg.
    stiffness: static stiffness k of the film, N/m.
    air: function of the frequency [Hz]; complex stiffness Z [N/m] of the squeezed air in addition to k.
    """

    mass: float
    stiffness: float
    air: Callable[[Array], NDArray[np.complex128]]

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kg")
        positive("stiffness", self.stiffness, "N/m")

    def dynamic_stiffness(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return k - m w^2 + Z [N/m]: stiffness k, mass m, air Z, angular frequency w = 2 pi `frequency` [Hz]."""
        f = positive("frequency", frequency, "Hz")
        return self.stiffness - self.mass * (2 * np.pi * f) ** 2 + self.air(f)


def ball_on_constant_feed(
    mass: float, stiffness: float, geometry: FilmGeometry, displacement: float, share: float = 1.0
) -> BallOnFilm:
    """Return a ball on an air film with constant feed, in which air is squeezed. share: factor of the computed squeeze
    stiffness."""
    factor = float(not_negative("share of the squeezed air", share, ""))
    return BallOnFilm(mass, stiffness, lambda f: factor * squeeze_impedance(geometry, displacement, f))


def ball_on_fed_film(mass: float, film: FedFilm, pocket: float = 0.0) -> BallOnFilm:
    """Return a ball on a film whose feed depends on the film pressure. pocket: air volume behind all orifices, m^3."""
    static = float(film.impedance(0.0).real)
    return BallOnFilm(mass, static, lambda f: film.impedance(f, pocket) - static)


def slow_damping(system: BallOnFilm, frequency: float = 0.1) -> float:
    """Return the damping coefficient [N s/m] of slow motion, from the squeeze stiffness at `frequency` [Hz]."""
    return float(system.air(np.asarray(frequency)).imag / (2 * np.pi * frequency))


def receptance(system: BallOnFilm, frequency: ArrayLike) -> NDArray[np.complex128]:
    """Return the receptance (displacement over force) [m/N] at `frequency` [Hz]."""
    return 1 / system.dynamic_stiffness(frequency)


def natural_frequency(system: BallOnFilm) -> float:
    """Return the natural frequency sqrt(k/m) / 2 pi [Hz] of the mass m with the static stiffness k."""
    return float(np.sqrt(system.stiffness / system.mass) / (2 * np.pi))


def resonance(system: BallOnFilm) -> tuple[float, float]:
    """Return the resonance frequency [Hz] and the ratio of largest to static response; without a resonance, 0 and 1."""
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
    """Return the frequency [Hz] above which the response stays below 1/sqrt(2) of the static response."""
    f = natural_frequency(system) * np.geomspace(*SPAN, STEPS)
    last = int(np.flatnonzero(_times_static(system, f) >= np.sqrt(0.5)).max(initial=0))
    return float(optimize.brentq(lambda x: float(_times_static(system, x)) - np.sqrt(0.5), f[last], f[last + 1]))


def _times_static(system: BallOnFilm, frequency: ArrayLike) -> Array:
    return system.stiffness * np.abs(receptance(system, frequency))


def ball_mass(radius: float, density: float) -> float:
    """Return the mass [kg] of a solid ball: 4/3 pi radius^3 density."""
    return float(4 / 3 * np.pi * positive("ball radius", radius, "m") ** 3 * positive("density", density, "kg/m^3"))


@dataclass(frozen=True)
class ResponseFit:
    """Result of fitting mass and stiffness to a measured response.

    mass: fitted mass, kg. stiffness: fitted static stiffness, N/m.
    resistance: fitted factor of the given impedance.
    stderr: standard errors of mass, stiffness and resistance by name.
    """

    mass: float
    stiffness: float
    resistance: float
    stderr: dict[str, float]


def fit_response(frequency: ArrayLike, measured: ArrayLike, impedance: ArrayLike) -> ResponseFit:
    """Fit stiffness k, mass m and resistance s to a measured receptance H (frequencies,), complex [m/N].

    At the angular frequency w the inverse receptance 1/H = k - m w^2 + s Z is linear in k, m and s. The fit weighs 1/H
    by |H|, so that its errors are relative.
    impedance: impedance Z (frequencies,) [N/m]. If Z = i w (plain damper), the unit of s is N s/m.
    Raises InputError below 3 frequencies, or if the fitted mass or stiffness is not above 0.
    """
    f = positive("frequency", frequency, "Hz").ravel()
    response, resists = np.asarray(measured, complex).ravel(), np.asarray(impedance, complex).ravel()
    if f.size != response.size or np.unique(f).size < 3:
        raise InputError(
            f"frequency response: {f.size} frequencies and {response.size} values, expected equal numbers, at least 3"
        )
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


INSTANTS, COARSE = 256, 64
"""Number of instants of half a period in the steady state, and in the coarse search for the frequency of largest
motion; half as many odd harmonics. Amplitudes are within 0.5 % at any frequency with 256 instants, 1 % with 128.
"""
SETTLED, SWEEPS = 1e-5, 20_000
"""Relative change of the friction force below which the iteration for the steady vibration ends; largest number of
iterations (usually some hundred)."""


@dataclass(frozen=True)
class Losses:
    """Friction and magnetic losses of a joint.

    friction: largest friction force F_c of the sliding contact, N. Below the friction force F_c the contact sticks.
    magnet_stiffness: stiffness k_m of the magnets, N/m, at most 0.
    loss_factor: loss factor eta of the magnets: imaginary part of their complex stiffness over |k_m|.
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
    def magnets(self) -> complex:
        """Complex stiffness k_m + i eta |k_m| of the magnets [N/m], with their stiffness k_m and loss factor eta."""
        return complex(self.magnet_stiffness, self.loss_factor * abs(self.magnet_stiffness))


@dataclass(frozen=True)
class SteadyState:
    """Steady periodic motion of the ball.

    motion: displacement [m] at equally spaced instants of half a period.
    film, friction, magnets: energy that film, friction or magnets dissipate per cycle, J.
    """

    motion: Array
    film: float
    friction: float
    magnets: float

    @property
    def amplitude(self) -> float:
        """Largest displacement of the ball in either direction [m]."""
        return float(np.abs(self.motion).max())

    @property
    def lost(self) -> float:
        """Energy that film, friction and magnets dissipate per cycle [J]."""
        return self.film + self.friction + self.magnets


def magnet_stiffness(preload: float, stand_off: float) -> float:
    """Return the stiffness -2 P / s [N/m] at contact of magnets with pull P (s / (s + x))^2 [N] at distance x [m]."""
    return float(-2 * positive("preload", preload, "N") / positive("stand-off", stand_off, "m"))


def steady_state(
    system: BallOnFilm, losses: Losses, force: float, frequency: float, instants: int = INSTANTS
) -> SteadyState:
    """Return the periodic motion x under `force` [N] at `frequency` [Hz], at `instants` of half a period.

    D x + f = F sin wt,   f in F_c sign(x'),   |f| <= F_c if x' = 0         f: friction force, F: `force`

    D(nw) = D_film(nw) + k_m + i eta |k_m| is the dynamic stiffness at each odd harmonic n. The stiffness k_m of the
    magnets is negative, because their pull falls with distance; they dissipate eta pi |k_m| X^2 per cycle of amplitude
    X. Friction f and motion x change sign after half a period. With the mobility Y = i n w / D the speed is v = Y (F -
    f): at each instant either v = 0 and |f| < F_c, or f = F_c sign(v). With Re Y > 0 the complementarity problem is
    monotone with one solution; for slow motion its amplitude is X = (F - F_c) / k.
    Sources: Den Hartog (1931), Transactions of the ASME 53, for one mass and spring; Lions and Mercier (1979), SIAM
    Journal on Numerical Analysis 16, for the splitting.
    """
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
    """Return the friction force [N] at each instant, by Douglas-Rachford splitting; InputError without convergence.
    Speed of the ball: mobility (instants, instants) times the difference of driving force `pushed` and friction."""
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
    """Return the largest amplitude [m] of the motion at ascending frequencies [Hz], refined between them."""

    def below(log_frequency: float) -> float:
        return -steady_state(system, losses, force, float(np.exp(log_frequency)), COARSE).amplitude

    at = np.log(frequency)
    k = int(np.argmin([below(x) for x in at]))
    bounds = (at[max(k - 1, 0)], at[min(k + 1, len(at) - 1)])
    found = minimize_scalar(below, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    best = min((at[k], found.x), key=below)
    return steady_state(system, losses, force, float(np.exp(best))).amplitude
