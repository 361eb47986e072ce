"""A hexapod as a TOML file describes it: two rings of balls, the legs' range, the measured point."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.hexapod import Hexapod
from joints.legs import OnLegs
from joints.limits import positive
from joints.passive_joint import vector
from joints.settings import Settings, laid_over, read_toml

Machine = TypeVar("Machine", bound=OnLegs)

KIND = "hexapod"
WEAKEST = 1e-3
"""The smallest singular value of the legs' Jacobian at home, lengths in units of the platform's radius, under which the
legs do not hold the platform: two similar hexagons have zero."""


def hexapod(path: Path | None = None) -> Hexapod:
    """The hexapod of a TOML file, the built-in one without.

    Raises InputError: an unknown key, a missing unit, a ring or range without size, legs that cannot meet or that leave
    the platform loose.
    """
    return described(KIND, path, _built)


def described(kind: str, path: Path | None, build: Callable[[Settings, str], Machine]) -> Machine:
    """What `build` makes of the settings of a TOML file, called as the file where that has no name; the built-in one
    without. build: also takes the file's name, for messages."""
    given, file = (read_toml(path), path.name) if path else ({}, f"{kind}.toml")
    machine = build(laid_over(kind, given, file), file)
    return replace(machine, name=path.stem) if path and "name" not in given else machine


def _built(s: Settings, file: str) -> Hexapod:
    for place, key, unit in (("base", "radius", "m"), ("platform", "radius", "m"), ("leg", "shortest", "m")):
        positive(f"{file}: {place}.{key}", s[place][key], unit)
    shortest, longest = s["leg"]["shortest"], s["leg"]["longest"]
    if not shortest < longest:
        raise InputError(f"{file}: leg.longest = {1e3 * longest:g} mm, expected above shortest = {1e3 * shortest:g} mm")
    base = _ring(s["base"]["radius"], [sign * s["base"]["pair"] / 2 for sign in (-1, 1)])
    half = np.pi / 3 - s["platform"]["pair"] / 2
    platform = _ring(s["platform"]["radius"], [-half, half])
    machine = Hexapod(
        limits=(shortest, longest), name=s["name"], base=base, platform=platform, tool=vector(s["tool"]["centre"]),
        mass=s["platform"]["mass"], gravity=vector(s["gravity"]),
    )  # fmt: skip
    return held(machine, file)


def _ring(radius: float, angles: list[float]) -> Array:
    """Centres (6, 3) of three pairs of balls on a circle, m; angles: of the first pair, rad."""
    at = np.concatenate([np.asarray(angles) + turn for turn in np.radians([0.0, 120.0, 240.0])])
    return radius * np.column_stack([np.cos(at), np.sin(at), np.zeros(len(at))])


def held(machine: Machine, file: str) -> Machine:
    """The same. Raises InputError where at home the links do not meet, or hold the platform no better than WEAKEST."""
    try:
        weakest = float(machine.weakest(machine.home)[0])
    except InputError as error:
        raise InputError(f"{file}: {error}; expected longer legs or smaller rings") from None
    if weakest < WEAKEST:
        raise InputError(f"{file}: at half stroke the legs leave the platform loose; expected rings that are not alike")
    return machine
