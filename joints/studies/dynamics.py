"""`gpmodel joint dynamics`: frequency response of the ball on its film, and a fit to a measured response."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from joints import figures
from joints.dynamics import (
    BallOnFilm,
    Losses,
    ball_mass,
    ball_on_constant_feed,
    ball_on_fed_film,
    bandwidth,
    fit_response,
    largest_motion,
    magnet_stiffness,
    natural_frequency,
    receptance,
    resonance,
    slow_damping,
    steady_state,
)
from joints.film import design_film, film_geometry, orifice_law
from joints.reynolds import FedFilm, fed_film, spherical_film, squeeze_impedance, squeeze_number
from joints.settings import Settings, curve_of, load_settings, not_negative, positive, require
from joints.studies.study import MICRO, N_PER_UM, Study, Table

_HEADS = (
    "System", "Mass [kg]", "Stiffness [N/um]", "Slow damping [N s/m]", "Natural [Hz]", "Peak [Hz]",
    "Peak over static", "Bandwidth [Hz]",
)  # fmt: skip

SOUGHT = 40
"""Number of frequencies in the first search for the frequency of the ball's largest motion."""
RATIO_DIGITS = 5
"""Number of printed digits of a damping ratio, which is zero up to rounding at the onset of pneumatic hammer."""


def dynamics_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate the vibration of the ball on a flat and a spherical film of air, and a fit to a measured response."""
    s = load_settings("dynamics", path)
    geometry = film_geometry(s["film"], s["ball_radius"])
    orifice, lift = orifice_law(s["orifice"]), positive("displacement", s["displacement"], "m")
    mass = ball_mass(s["ball_radius"], s["ball_density"]) + float(not_negative("added mass", s["added_mass"], "kg"))
    flat = float(design_film(geometry, s["load"], orifice, lift).stiffness_constant_inlet)
    sphere = float(spherical_film(geometry, s["load"], orifice, lift).stiffness_constant_inlet)
    fed, pocket = fed_film(geometry, s["load"], orifice, float(lift)), geometry.orifices * s["orifice"]["pocket"]
    systems = {
        "flat film": ball_on_constant_feed(mass, flat, geometry, float(lift)),
        "spherical film": ball_on_constant_feed(mass, sphere, geometry, float(lift)),
        "spherical film, feed in motion": ball_on_fed_film(mass, fed, pocket),
    }
    frequency = _frequencies(s["response"])
    responses = {name: receptance(system, frequency) for name, system in systems.items()}
    measured_frequency, measured, source = _measured(s["measured"], path, seed, systems["spherical film"], frequency)
    fit = fit_response(measured_frequency, measured, squeeze_impedance(geometry, float(lift), measured_frequency))
    fitted = ball_on_constant_feed(fit.mass, fit.stiffness, geometry, float(lift), fit.resistance)
    limit = 1.0 / float(squeeze_number(geometry, lift, 1.0))
    rows = [_row(name, system) for name, system in (*systems.items(), (f"fit of {source}", fitted))]
    heads: tuple[str, ...] = ("mass_kg", "stiffness_N_per_um", "slow_damping_Ns_per_m", "natural_Hz", "resonance_Hz")
    heads += ("peak_over_static", "bandwidth_Hz")
    losses, held = _lossy(s["losses"], s["load"], systems["spherical film"], frequency)
    hammer, begins = _hammer(
        fed, mass, magnet_stiffness(s["load"], s["losses"]["stand_off"]), pocket, geometry.orifices
    )
    return Study(
        (
            Table(
                "Ball on its film",
                _HEADS,
                rows,
                f"air compressed in the gap; it damps as if incompressible up to {limit:.3g} Hz alone, where the"
                " squeeze number passes 1; feed constant but for the last",
            ),
            hammer,
            losses,
        ),
        {
            "systems": {row[0]: dict(zip(heads, row[1:], strict=True)) for row in rows},
            "fit_stderr": fit.stderr,
            "hammer": begins,
            "losses": held,
            "squeeze_number_below_1_up_to_Hz": limit,
            "response": {
                "frequency_Hz": frequency,
                **{f"{name} [um/N]": np.abs(response) * MICRO for name, response in responses.items()},
            },
        },
        {"dynamics.png": figures.dynamics(frequency, responses, (measured_frequency, measured, source))},
    )


def _row(name: str, system: BallOnFilm) -> tuple[str | float, ...]:
    """Return a row of the table of vibrating systems."""
    slow, natural = slow_damping(system), natural_frequency(system)
    return name, system.mass, system.stiffness * N_PER_UM, slow, natural, *resonance(system), bandwidth(system)


def _hammer(
    film: FedFilm, mass: float, magnets: float, pocket: float, orifices: int
) -> tuple[Table, dict[str, dict[str, float]]]:
    """Tabulate the least damped vibration of ball, magnets and fed film, and the onset of pneumatic hammer."""
    numbers = {}
    for name, air in (("as described", pocket), ("where hammer begins", film.hammering_pocket(mass, magnets))):
        least = film.least_damped(mass, magnets, air)
        numbers[name] = {
            "pocket_mm3": 1e9 * air / orifices,
            "Hz": least.imag / (2 * np.pi),
            "damping_ratio": round(-least.real / abs(least), RATIO_DIGITS),
        }
    heads = ("Fed film", "Air pocket at each orifice [mm^3]", "Vibration [Hz]", "Damping ratio")
    said = "hammers" if numbers["as described"]["damping_ratio"] < 0 else "does not hammer"
    note = f"the joint {said}; air that is trapped between orifice and film follows the gap late"
    return Table("Pneumatic hammer", heads, [(name, *row.values()) for name, row in numbers.items()], note), numbers


def _lossy(s: Settings, load: float, system: BallOnFilm, frequency: Array) -> tuple[Table, dict[str, dict[str, float]]]:
    """Tabulate the effect of sliding friction and magnetic hysteresis on the motion at one amplitude of force."""
    pull, force = magnet_stiffness(load, s["stand_off"]), float(positive("losses.force", s["force"], "N"))
    grip = float(not_negative("losses.friction_coefficient", s["friction_coefficient"], "")) * load
    cases = {
        "film alone": Losses(0.0),
        "film and magnets": Losses(0.0, pull, s["loss_factor"]),
        "the same, with the friction of a sliding joint": Losses(grip, pull, s["loss_factor"]),
    }
    sought = np.geomspace(frequency[0], frequency[-1], SOUGHT)
    numbers = {}
    for name, losses in cases.items():
        slow = steady_state(system, losses, force, float(frequency[0]))
        numbers[name] = {
            "friction_N": losses.friction,
            "slow_motion_um": slow.amplitude * MICRO,
            "largest_motion_um": largest_motion(system, losses, force, sought) * MICRO,
            "slow_loss_uJ": slow.lost * MICRO,
        }
    heads = ("Joint", "Friction [N]", "Slow motion [um]", "Largest motion [um]", "Lost a cycle [uJ]")
    title = f"Friction and magnet hysteresis under {force:g} N, spherical film's stiffness"
    note = f"slow: at {frequency[0]:.3g} Hz; under less force than its friction the joint does not move"
    return Table(title, heads, [(name, *row.values()) for name, row in numbers.items()], note), numbers


def _frequencies(s: Settings) -> Array:
    lowest, highest = positive("response.lowest", s["lowest"], "Hz"), s["highest"]
    require(highest > lowest, "response.highest", highest, f"above {float(lowest):g} Hz")
    require(s["points"] >= 3, "response.points", s["points"], "at least 3")
    return np.geomspace(float(lowest), float(highest), s["points"])


def _measured(
    s: Settings, path: Path | None, seed: int, system: BallOnFilm, frequency: Array
) -> tuple[Array, NDArray[np.complex128], str]:
    if curve := curve_of(s, path, {"frequency": "Hz", "real": "um/N", "imaginary": "um/N"}):
        return curve["frequency"], curve["real"] + 1j * curve["imaginary"], s["file"]
    noise = float(not_negative("measured.noise", s["noise"], ""))
    random = np.random.default_rng(seed)
    ripple = random.normal(size=frequency.size) + 1j * random.normal(size=frequency.size)
    return frequency, receptance(system, frequency) * (1 + noise * ripple), "simulated response (no file given)"
