"""Check the arguments of public functions before any computation."""

import math
import numbers
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeGuard, TypeVar

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import QUOTED, InputError
from gpmodel.mechanism.protocol import LARGEST, SI, Mechanism
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.table.units import parse_quantity

NOISIEST = {"length": 1.0, "angle": 0.2, "pixels": 1e3}
"""Largest accepted noise of an instrument, in SI units, above that of every instrument."""
LONGEST_NAME = 255
"""Longest file or folder name, bytes, on Linux, Windows and macOS."""
LARGEST_FLOAT = sys.float_info.max
"""Largest accepted number; a larger integer cannot be represented as a float."""

Choice = TypeVar("Choice", bound=str)


def brief(value: object) -> str:
    """Write a user's value for a one-line message; a long value is replaced by its type."""
    text = repr(value)
    return text if len(text) <= QUOTED and "\n" not in text else f"a {type(value).__name__}"


@contextmanager
def errors_about(argument: str) -> Iterator[None]:
    """Name the given argument in every InputError that is raised inside the context."""
    try:
        yield
    except InputError as error:
        raise (error if error.argument else InputError(error.said, argument)) from None


def check_integer(value: object, argument: str, least: int = 0, most: float = math.inf) -> int:
    """Check that a value is a whole number from `least` to `most`; otherwise raise InputError naming the argument."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or not least <= int(value) <= most:
        to = "up" if most == math.inf else f"to {most}"
        raise InputError(f"{brief(value)}, expected a whole number from {least} {to}", argument)
    return int(value)


def _real(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite real number; a bool is not."""
    number = isinstance(value, numbers.Real) and not isinstance(value, bool | np.bool)
    return number and bool(abs(value) <= LARGEST_FLOAT)  # type: ignore[arg-type]


def check_share(value: object, argument: str, *, positive: bool = False) -> float:
    """Check that a value is a share from 0 (above 0 if `positive`) to below 1; otherwise raise InputError."""
    wanted = "above 0 and below 1" if positive else "from 0 to below 1"
    if not _real(value) or not 0.0 <= float(value) < 1.0 or (positive and value == 0):
        raise InputError(f"{brief(value)}, expected a share {wanted}, as in 0.3", argument)
    return float(value)


def check_limit(value: object, argument: str, least: float) -> float | None:
    """Check that a value is a finite number of at least `least`, or None; otherwise raise InputError."""
    return None if value is None else check_number(value, argument, least)


def check_number(value: object, argument: str, least: float, most: float = math.inf) -> float:
    """Check that a value is a finite number from `least` to `most`; otherwise raise InputError naming the argument."""
    if not _real(value) or not least <= float(value) <= most:
        to = "up" if most == math.inf else f"to {most:g}"
        raise InputError(f"{brief(value)}, expected a finite number from {least:g} {to}", argument)
    return float(value)


def check_choice(value: object, choices: Iterable[Choice], argument: str) -> Choice:
    """Check that a value is one of the allowed words; otherwise raise InputError naming the argument."""
    known = tuple(choices)
    for choice in known:
        if isinstance(value, str) and value == choice:
            return choice
    raise InputError(f"{brief(value)}, expected {' or '.join(known)}", argument)


def check_list(value: object, argument: str, example: str) -> tuple[object, ...]:
    """Check that a value is a list, and return its items; otherwise, also for a single text, raise InputError with an
    example."""
    if isinstance(value, str) or not isinstance(value, Iterable) or (isinstance(value, np.ndarray) and not value.ndim):
        raise InputError(f"{brief(value)}, expected a list, as in {example}", argument)
    return tuple(value)


def check_texts(value: object, argument: str, example: str) -> tuple[str, ...]:
    """Check that a value is a list of texts; otherwise raise InputError with the argument and an example."""
    items = check_list(value, argument, example)
    for item in items:
        if not isinstance(item, str):
            raise InputError(f"{brief(item)}, expected texts, as in {example}", argument)
    return tuple(str(item) for item in items)


def check_bool(value: object, argument: str) -> bool:
    """Check that a value is True or False; otherwise raise InputError naming the argument."""
    if not isinstance(value, bool | np.bool):
        raise InputError(f"{brief(value)}, expected True or False", argument)
    return bool(value)


def check_text(value: object, argument: str, what: str) -> str:
    """Check that a value is a text; otherwise raise InputError with the argument and its expected content."""
    if not isinstance(value, str):
        raise InputError(f"{brief(value)}, expected {what} as text", argument)
    return str(value)


def check_function(value: object, argument: str) -> Callable[..., object]:
    """Check that a value is a function; otherwise raise InputError naming the argument."""
    if not callable(value):
        raise InputError(f"{brief(value)}, expected a function, as in print", argument)
    return value


def file_path(value: object, argument: str) -> Path:
    """Check that a value is a path of a file or folder; otherwise raise InputError naming the argument."""
    if not isinstance(value, str | os.PathLike) or not str(value) or "\0" in str(value):
        raise InputError(f"{brief(value)}, expected a path", argument)
    if any(len(os.fsencode(part)) > LONGEST_NAME for part in Path(value).parts):
        raise InputError(f"{brief(value)}, expected a path whose names have {LONGEST_NAME} bytes at most", argument)
    return Path(value)


def to_si(
    value: str | float, dimension: str, argument: str, *, least: float = 0.0, positive: bool = False,
    most: Mapping[str, float] = LARGEST,
) -> float:  # fmt: skip
    """Convert text with a unit, "0.03 mm", to SI.

    A bare number is accepted in SI units, but not for a length other than zero, which users nearly always mean in mm.
    Raises InputError naming the argument for a missing unit, another dimension, a value that is not finite, below
    `least`, zero if `positive`, or above the `most` of its dimension.
    """
    if dimension == "length" and _real(value) and value != 0:
        raise InputError(f"{brief(value)} has no unit, expected a length as text, as in '{value:g} mm'", argument)
    number = parse_quantity(value, dimension, argument) if isinstance(value, str) else value
    if not _real(number):
        raise InputError(f"{brief(value)}, expected a {dimension} as text with a unit or in {SI[dimension]}", argument)
    if number < least or (positive and number == 0):
        raise InputError(f"{value}, expected {'more than zero' if positive else 'zero or more'}", argument)
    if abs(number) > (largest := most[dimension]):
        raise InputError(f"{value}, expected at most {largest:g} {SI[dimension]}, the unit may be wrong", argument)
    return float(number)


def to_point(value: object, argument: str) -> tuple[float, ...]:
    """Convert "0,0,120mm" or three numbers in m to three lengths, m; otherwise raise InputError naming the argument."""
    parts: tuple[object, ...]
    if isinstance(value, str):
        words = [word.strip() for word in value.split(",")]
        for word in words:
            if not re.match(r"[-+]?\.?\d", word):
                raise InputError(f"{word[:QUOTED]!r} is no number; expected three lengths, as in 0,0,120mm", argument)
        unit = words[-1].lstrip("+-.0123456789eE").strip()
        parts = tuple(w if w.endswith(unit) else f"{w}{unit}" for w in words)
    else:
        parts = check_list(value, argument, "(0, 0, 0.12)")
    if len(parts) != 3:
        raise InputError(f"{brief(value)}, expected three lengths with a unit, as in 0,0,120mm", argument)
    out = [parse_quantity(p, "length", argument) if isinstance(p, str) else p for p in parts]
    largest = LARGEST["length"]
    if not all(_real(p) and abs(p) <= largest for p in out):
        raise InputError(f"{brief(value)}, expected three lengths of at most {largest:g} m", argument)
    return tuple(float(p) for p in out if _real(p))


def box_limits(value: str | Sequence[Sequence[float]], argument: str) -> Array:
    """Convert "800:1200,-200:200,300:700mm" or two points to the corners (2, 3) of a box, m, lowest corner first.

    Raises InputError naming the argument.
    """
    example = "800:1200,-200:200,300:700mm"
    if isinstance(value, str):
        sides = [side.split(":") for side in value.split(",")]
        if [len(side) for side in sides] != [2, 2, 2]:
            raise InputError(f"{brief(value)}, expected lowest and highest x, y and z, as in {example}", argument)
        unit = sides[2][1].strip().lstrip("+-.0123456789eE").strip()
        corners = tuple(to_point(",".join([side[k] for side in sides]) + unit * (k == 0), argument) for k in (0, 1))
    else:
        corners = tuple(to_point(corner, argument) for corner in check_list(value, argument, example))
    if len(corners) != 2 or not all(low < high for low, high in zip(*corners, strict=True)):
        raise InputError(f"{brief(value)}, expected lowest below highest in x, y and z, as in {example}", argument)
    return np.array(corners)


MechanismLike = Mechanism | str | Path


def load_mechanism(
    source: str | Path,
    payload: str | float | None = None,
    *,
    frame: str | None = None,
    payload_com: str | Sequence[float] | None = None,
) -> LoadedMechanism:
    """Load a mechanism by name or from a file.

    source: built-in name (`irb6400r`, `ur5`, `spherical-joint`), .urdf file, or .toml file of DH rows or of a joint.
    payload: mass at the tool in every row of the table, "60 kg" or a number in kg.
    frame: name of the measured link; None for the chain's last link.
    payload_com: centre of mass of the payload, "0,0,120mm" or (3,) m in the measured frame; None for the tool point,
    which every calibration determines.
    Raises InputError for an unknown name, an invalid file, or a missing unit.
    """
    if not isinstance(source, str | Path):
        raise InputError(f"{brief(source)}, expected the name or the file of a mechanism", "source")
    if not isinstance(frame, str | None):
        raise InputError(f"{brief(frame)}, expected the name of a link", "frame")
    mass = None if payload is None else to_si(payload, "mass", "payload")
    com = None if payload_com is None else to_point(payload_com, "payload_com")
    return MechanismChoice(str(source), frame, mass, com).load()


def mechanism_of(given: MechanismLike | None) -> Mechanism:
    """Return the mechanism given as a Mechanism object, a name or a file; otherwise raise InputError."""
    if isinstance(given, str | Path):
        return load_mechanism(given)
    if not isinstance(given, Mechanism):
        raise InputError(f"{brief(given)}, expected a mechanism, its name or its file", "mechanism")
    return given
