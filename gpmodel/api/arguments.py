"""Arguments of the public functions, checked before any work."""

import math
import numbers
from collections.abc import Sequence

from gpmodel.errors import InputError
from gpmodel.table.units import parse_quantity

_SI = {"length": "m", "mass": "kg"}


def whole(value: object, argument: str, least: int = 0) -> int:
    """A whole number from `least` up. Raises InputError naming the argument."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
        raise InputError(f"{value!r}, expected a whole number from {least} up", argument)
    return int(value)


def share(value: object, argument: str) -> float:
    """A share from 0 to below 1. Raises InputError naming the argument."""
    if not isinstance(value, numbers.Real) or not 0.0 <= float(value) < 1.0:
        raise InputError(f"{value!r}, expected a share from 0 to below 1, as in 0.3", argument)
    return float(value)


def limit(value: object, argument: str, least: float) -> float | None:
    """A finite number from `least` up, or None. Raises InputError naming the argument."""
    if value is None:
        return None
    if not isinstance(value, numbers.Real) or not math.isfinite(value) or float(value) < least:
        raise InputError(f"{value!r}, expected a finite number from {least:g} up", argument)
    return float(value)


def quantity(value: str | float, dimension: str, argument: str, *, least: float = 0.0, positive: bool = False) -> float:
    """Text with a unit, "0.03 mm", or a number in m or kg; in SI.

    Raises InputError naming the argument: no unit, another dimension, not finite, below `least`, zero where `positive`.
    """
    number = parse_quantity(value, dimension, argument) if isinstance(value, str) else value
    if not isinstance(number, numbers.Real) or not math.isfinite(number):
        raise InputError(f"{value!r}, expected a {dimension} as text with a unit or in {_SI[dimension]}", argument)
    if number < least or (positive and number == 0):
        raise InputError(f"{value}, expected {'more than zero' if positive else 'zero or more'}", argument)
    return float(number)


def point(value: str | Sequence[float], argument: str) -> tuple[float, ...]:
    """Three lengths, "0,0,120mm" or numbers in m. Raises InputError naming the argument."""
    parts: list[str | float] = []
    if isinstance(value, str):
        words = [word.strip() for word in value.split(",")]
        unit = words[-1].lstrip("+-.0123456789eE").strip()
        parts += [w if w.endswith(unit) else f"{w}{unit}" for w in words] if unit else words
    else:
        parts += list(value)
    if len(parts) != 3:
        raise InputError(f"{value!r}, expected three lengths with a unit, as in 0,0,120mm", argument)
    out = [parse_quantity(p, "length", argument) if isinstance(p, str) else p for p in parts]
    if not all(isinstance(p, numbers.Real) and math.isfinite(p) for p in out):
        raise InputError(f"{value!r}, expected three finite lengths in m", argument)
    return tuple(float(p) for p in out)
