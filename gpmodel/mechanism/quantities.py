"""Admissible gravity, masses and lengths: one value of g, and one range that excludes impossible machines."""

from gpmodel.errors import InputError

GRAVITY = 9.81
"""m/s²: that of middle latitudes. Standard gravity is 9.80665; on Earth it is 9.78 to 9.83, so that loads, and with
them compliances, are right to 0.3 % anywhere."""

SI = {"length": "m", "angle": "rad", "mass": "kg", "acceleration": "m/s**2", "pixels": "px"}
"""Units by dimension."""

LARGEST = {"length": 1e3, "angle": 1e3, "mass": 5e4, "acceleration": 1e2, "pixels": 1e5}
"""In SI: more than any part, joint, link, payload, gravity or image of a machine has; what is more is a wrong unit."""


def checked(value: float, dimension: str, where: str) -> float:
    """A value in SI of a machine. Raises InputError naming `where` when it is beyond LARGEST or no number."""
    if not abs(value) <= LARGEST[dimension]:
        most = f"{LARGEST[dimension]:g} {SI[dimension]}"
        raise InputError(f"{where}: {value:g} {SI[dimension]}; expected at most {most}, the unit may be wrong")
    return value


def checked_mass(mass: float, where: str, argument: str = "") -> float:
    """A mass, kg. Raises InputError naming `where` when it is negative, beyond LARGEST or no number."""
    if not 0.0 <= mass <= LARGEST["mass"]:
        said = f"{where}: " if where else ""
        raise InputError(f"{said}{mass:g} kg; expected a mass from 0 to {LARGEST['mass']:g} kg", argument)
    return mass
