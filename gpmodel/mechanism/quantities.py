"""What gravity, masses and lengths can be: the one g, and the one rule for what no part of a machine is."""

import math

from gpmodel.errors import InputError

GRAVITY = 9.81
"""m/s²: that of middle latitudes. Standard gravity is 9.80665; on Earth it is 9.78 to 9.83, so that loads, and with
them compliances, are right to 0.3 % anywhere."""

LARGEST_LENGTH = 1e3
"""m: longer than any part of a machine; what is longer is a wrong unit."""

LARGEST_MASS = 5e4
"""kg: more than any payload or link of a robot or machine tool; what is heavier is a wrong unit."""


def checked_mass(mass: float, where: str, argument: str = "") -> float:
    """A mass, kg. Raises InputError naming `where` when it is negative, over LARGEST_MASS or no number."""
    if not 0.0 <= mass <= LARGEST_MASS or not math.isfinite(mass):
        said = f"{where}: " if where else ""
        raise InputError(f"{said}{mass:g} kg; expected a mass from 0 to {LARGEST_MASS:g} kg", argument)
    return mass


def checked_length(length: float, where: str) -> float:
    """A length of a machine, m. Raises InputError naming `where` when it is beyond LARGEST_LENGTH or no number."""
    if not abs(length) <= LARGEST_LENGTH:
        raise InputError(f"{where}: {length:g} m; expected at most {LARGEST_LENGTH:g} m, the unit may be wrong")
    return length
