"""What gravity and masses can be: the one g, and the one rule for what no part of a machine weighs."""

import math

from gpmodel.errors import InputError

GRAVITY = 9.81
"""m/s²: that of middle latitudes. Standard gravity is 9.80665; on Earth it is 9.78 to 9.83, so that loads, and with
them compliances, are right to 0.3 % anywhere."""

LARGEST_MASS = 5e4
"""kg: more than any payload or link of a robot or machine tool; what is heavier is a wrong unit."""


def checked_mass(mass: float, where: str, argument: str = "") -> float:
    """A mass, kg. Raises InputError naming `where` when it is negative, over LARGEST_MASS or no number."""
    if not 0.0 <= mass <= LARGEST_MASS or not math.isfinite(mass):
        said = f"{where}: " if where else ""
        raise InputError(f"{said}{mass:g} kg; expected a mass from 0 to {LARGEST_MASS:g} kg", argument)
    return mass
