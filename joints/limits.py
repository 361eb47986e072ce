"""One-line refusals of impossible physical inputs."""

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError


def require(valid: ArrayLike, name: str, value: ArrayLike, expected: str) -> None:
    """Raise InputError "name = value, expected ..." for the first entry of `value` that is not `valid`."""
    ok, values = np.broadcast_arrays(np.asarray(valid, bool), np.asarray(value, float))
    if not ok.all():
        raise InputError(f"{name} = {values[~ok].flat[0]:.6g}, expected {expected}")


def positive(name: str, value: ArrayLike, unit: str) -> Array:
    """`value` as a float array, every entry finite and above zero."""
    array = np.asarray(value, float)
    require(np.isfinite(array) & (array > 0), name, array, f"above 0 {unit}".rstrip())
    return array


def not_negative(name: str, value: ArrayLike, unit: str) -> Array:
    """`value` as a float array, every entry finite and at least zero."""
    array = np.asarray(value, float)
    require(np.isfinite(array) & (array >= 0), name, array, f"at least 0 {unit}".rstrip())
    return array


def angle_within(name: str, value: ArrayLike, upper: float) -> Array:
    """`value` [rad] as a float array within 0 < value <= upper; the message speaks degrees."""
    array = np.asarray(value, float)
    valid = np.isfinite(array) & (array > 0) & (array <= upper * (1 + 1e-12))
    bounds = f"above 0 and at most {np.degrees(upper):.6g} deg"
    require(valid, f"{name} [deg]", np.degrees(array), bounds)
    return array
