"""Units of table headers and command options, and their conversion to SI on input."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import pint

from gpmodel.arrays import Array
from gpmodel.characters import is_name
from gpmodel.errors import QUOTED, InputError, choices
from gpmodel.mechanism.protocol import SI, checked

_HEADER = re.compile(r"^\s*(?P<name>.*?)\s*\[\s*(?P<unit>[^\]]*?)\s*\]\s*$")
_QUANTITY = re.compile(r"^\s*(?P<value>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(?P<unit>\S.*?)\s*$")
_NUMBER = re.compile(r"^\s*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\s*$")
_PRINTED = str.maketrans("·−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "*--0123456789")
_DEVIATION = re.compile(r"\s*±\s*[0-9.]+")
_TIMES_TEN = re.compile(r"\s*×10(-?[0-9]+)")
_POWER = re.compile(r"(?:[^\W\d_]|[°%])\s*(?:\*\*|\^)\s*[-+]?\d{1,2}(?![\d.])(?!\s*(?:\*\*|\^))")
_RAISED = re.compile(r"\*\*|\^|[\d)][⁻⁰¹²³⁴-⁹]|[⁰¹²³⁴-⁹]{3}")
DIMENSIONS = {unit: dimension for dimension, unit in SI.items()}


JOINT_UNITS = {"revolute": "rad", "prismatic": "m"}
"""SI units of joint values by kind of joint."""


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry:
    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define("sccm = centimeter ** 3 / minute")
    registry.define("px = pixel")  # not the 1/96 inch of style sheets
    registry.define("row = [row]")  # of drifts
    return registry


def split_header(header: str) -> tuple[str, str | None]:
    """Split a header into name and unit: `J1 [deg]` gives ("J1", "deg"). Without brackets no unit (None)."""
    match = _HEADER.match(header)
    return (match["name"], match["unit"].replace("℃", "°C").replace("℉", "°F")) if match else (header.strip(), None)


def joint_column(name: str, kind: str, values: Array) -> tuple[str, Array]:
    """Return header and values of a joint's output column: [deg] for revolute joints, [mm] for prismatic joints."""
    return (f"{name} [deg]", np.degrees(values)) if kind == "revolute" else (f"{name} [mm]", 1e3 * values)


def identifier(name: str) -> str:
    """Return the name of a column in expressions: every character except letters and digits becomes an underscore.
    A name that begins with a digit or is a keyword of Python begins with an underscore."""
    word = "".join(c if f"_{c}".isidentifier() else "_" for c in re.sub(r"\W", "_", name))
    return word if is_name(word) else f"_{word}"


def _spelled(unit: str) -> str:
    """Return the text of a unit if the text is safe to parse.

    Raises ValueError if the text is too long or contains a power of anything but a name, as 9**9**9, which the units
    library would evaluate.
    """
    if len(unit) > QUOTED or len(_POWER.findall(unit)) != len(_RAISED.findall(unit)):
        raise ValueError(unit)
    return unit


@lru_cache(maxsize=256)
def known_unit(unit: str) -> bool:
    """Return True if the units library can parse and convert a unit; the unit `1` is dimensionless."""
    try:
        registry = _registry()
        spelled = registry.parse_units("" if unit == "1" else _spelled(unit))
        times: float | None = registry.get_root_units(spelled)[0]  # type: ignore[assignment]
    except Exception:  # pint raises its own, tokenize's, attribute and overflow errors
        return False
    return times is None or 0.0 < times < math.inf  # None: a unit with an offset


TEMPERATURES = {"degree_Celsius": "degC", "kelvin": "K", "degree_Fahrenheit": "degF"}
"""Usual spelling of the units of temperature, by the name of the unit in the library pint."""


@lru_cache(maxsize=256)
def one_spelling(unit: str) -> str:
    """Return the usual spelling of a unit of temperature, which may be written [°C]; other units are unchanged."""
    return unit if unit == "1" else TEMPERATURES.get(str(_registry().parse_units(_spelled(unit))), unit)


@lru_cache(maxsize=256)
def is_time(unit: str) -> bool:
    """Return True if a unit is a unit of time."""
    return unit != "1" and known_unit(unit) and _registry().parse_units(unit).is_compatible_with("s")


def clock_names(units: Mapping[str, str]) -> set[str]:
    """Return "row" and the names of inputs with units of time: the inputs that order the poses of a session."""
    return {"row", *(name for name, unit in units.items() if is_time(unit))}


@lru_cache(maxsize=256)
def torque_factor(unit: str) -> float | None:
    """Return the size of one `unit` in N·m (torque) or N (force); None for units of another kind."""
    if unit == "1" or not known_unit(unit.replace("Nm", "N*m")):
        return None
    own = _registry().Quantity(1.0, unit.replace("Nm", "N*m"))
    return next((float(own.to(si).magnitude) for si in ("N*m", "N") if own.is_compatible_with(si)), None)


def factor(unit: str, dimension: str, where: str) -> float:
    """Return the size of one `unit` of `dimension` (length, angle, mass or pixels) in SI units.

    Raises InputError naming `where` if the unit is unknown or of another dimension.
    """
    si = SI[dimension]
    if known_unit(unit) and unit != "1":
        registry = _registry()
        own, wanted = (registry.get_root_units(u)[1] for u in (unit, si))
        if own == wanted:
            return float(registry.Quantity(1.0, unit).to(si).magnitude)
    examples = {"length": "[mm], [m], [um] or [in]", "angle": "[deg] or [rad]", "mass": "[kg] or [lb]",
                "pixels": "[px]"}  # fmt: skip
    raise InputError(f"'[{unit}]' is no unit of {dimension}; write {examples[dimension]}", where)


def as_typed(text: str) -> str:
    """Return a printed quantity with the characters of a keyboard: `12.0 ± 0.3 ×10⁻⁶ 1/°C` becomes `12.0e-6 1/degC`."""
    text = _TIMES_TEN.sub(lambda m: f"e{m[1]}", _DEVIATION.sub("", text).translate(_PRINTED))
    return text.replace("°C", "degC").replace("°F", "degF").strip()


def split_quantity(text: str) -> tuple[float, str] | None:
    """Split a quantity into number and unit: `0.03 mm` gives (0.03, "mm"). Return None for a text without number or
    unit."""
    text = as_typed(text)
    match = None if _NUMBER.match(text) else _QUANTITY.match(text)
    return (float(match["value"]), match["unit"]) if match else None


def factor_like(unit: str, like: str) -> float | None:
    """Return the size of one `unit`, which may be `/K`, in SI units; None if its dimension differs from `like`'s.

    Units with an offset (degC) give None, because temperatures in degC are not multiples of a unit.
    """
    try:
        value: pint.Quantity = _one(unit)
        offset = _registry().Quantity(0.0, value.units).to_base_units().magnitude != 0
        same = value.dimensionality == _one(like).dimensionality
        return None if offset or not same else float(value.to_base_units().magnitude)
    except Exception:  # pint raises its own, tokenize's and attribute errors for malformed text
        return None


def _one(unit: str) -> pint.Quantity:
    quantity: pint.Quantity = _registry().Quantity(1.0, _spelled(unit.removeprefix("/").strip()))
    return 1 / quantity if unit.startswith("/") else quantity


def parse_quantity(text: str, dimension: str, where: str) -> float:
    """Convert a quantity such as `60kg` or `0.03 mm` to SI. Raises InputError without a number or a unit."""
    split = split_quantity(text)
    if split is None:
        example = {"length": "0.03mm", "angle": "20deg", "mass": "60kg", "pixels": "0.1px"}[dimension]
        raise InputError(f"'{text}' is no quantity; write a number and its unit, as in {example}", where)
    return split[0] * factor(split[1], dimension, where)


def convert(text: str, unit: str, where: str) -> float:
    """Convert a text such as `20 arcsec` or `20` to a number in `unit`; a number without a unit is already in `unit`.

    Raises InputError if the text has no number, or the unit cannot be converted.
    """
    try:
        split = split_quantity(text)
        value = split[0] if split else float(as_typed(text))
        if split:
            spelled = [u.replace("Nm", "(N*m)") for u in (split[1], "" if unit == "1" else unit)]
            value = float(_registry().Quantity(value, _spelled(spelled[0])).to(spelled[1]).magnitude)
    except Exception:  # pint raises its own, tokenize's and attribute errors for malformed text
        raise InputError(
            f"'{text.strip()}' is no value in [{unit}]; write a number, as in 1e-3 {unit}", where
        ) from None
    if not math.isfinite(value):
        raise InputError(f"'{text.strip()}' is not finite; expected a number in [{unit}]", where)
    return value


UNITS = {"angle": ("deg", "rad"), "length": ("mm", "m", "in"), "mass": ("kg",), "acceleration": ("m_s2",)}


class TomlTable:
    """One table of a TOML file with units in its keys. Keys are read and removed one by one; a remaining key is an
    error.

    content: output of tomllib. where: name of the table in messages. Methods raise InputError for a value of the wrong
    type.
    """

    def __init__(self, content: object, where: str) -> None:
        if not isinstance(content, dict):
            raise InputError(f"{where}: expected a table of keys, one `key = value` a line")
        self.content: dict[str, Any] = dict(content)
        self.where = where
        self.known: list[str] = []

    def take(self, key: str, default: Any) -> Any:
        """Remove a key from the TOML table and return its value, or the default."""
        self.known.append(key)
        return self.content.pop(key, default)

    def tables(self, key: str) -> list[TomlTable]:
        """Return the array of TOML tables [[key]]; empty if the key is missing."""
        content = self.take(key, [])
        if not isinstance(content, list):
            raise InputError(f"{self.where}: {key} is one table, expected [[{key}]] with double brackets")
        return [TomlTable(row, f"{self.where}: [[{key}]] {number}") for number, row in enumerate(content, 1)]

    def table(self, key: str) -> TomlTable:
        """Return the TOML table [key]; empty if the key is missing."""
        return TomlTable(self.take(key, {}), f"{self.where}: [{key}]")

    def quantity(self, key: str, dimension: str, default: Any, size: int | None = None) -> Any:
        """Return a number, or a vector of `size`, in SI units, from a TOML key that ends in a unit of the dimension."""
        units = UNITS[dimension]
        written = [f"{key}_{unit}" for unit in units]
        self.known += written
        found = [text for text in written if text in self.content]
        if key in self.content or len(found) > 1:
            raise InputError(f"{self.where}: {key} needs one unit; write one of {', '.join(written)}")
        if not found:
            return default
        value = self.content.pop(found[0])
        numbers = value if isinstance(value, list) else [value]
        good = all(isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in numbers)
        expected = "one finite number" if size is None else f"a list of {size} finite numbers"
        if not good or isinstance(value, list) != (size is not None) or len(numbers) != (size or 1):
            raise InputError(f"{self.where}: {found[0]} is {value!r}, expected {expected}")
        scale = factor(found[0].removeprefix(f"{key}_").replace("m_s2", "m/s**2"), dimension, self.where)
        for x in numbers:
            checked(float(x) * scale, dimension, f"{self.where}: {found[0]}")
        return value * scale if size is None else np.array(value, dtype=np.float64) * scale

    def choice(self, key: str, choices: tuple[Any, ...], default: Any = None) -> Any:
        """Return the value of a TOML key that has to be one of `choices`."""
        value = self.take(key, default)
        if value not in choices or isinstance(value, bool):
            listed = ", ".join(map(repr, choices))
            raise InputError(f"{self.where}: {key} is {value!r}, expected one of {listed}")
        return value

    def text(self, key: str, default: str) -> str:
        """Return the text of a TOML key, which may not be empty."""
        value = self.take(key, default)
        if not isinstance(value, str) or not value:
            raise InputError(f"{self.where}: {key} is {value!r}, expected a text")
        return value

    def number(self, key: str) -> float:
        """Return the finite number, without unit, of a required TOML key."""
        value = self.take(key, None)
        if value is None:
            raise InputError(f"{self.where}: {key} is missing; expected one finite number")
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            raise InputError(f"{self.where}: {key} is {value!r}, expected one finite number")
        return float(value)

    def numbers(self, key: str, size: int) -> Array | None:
        """Return a TOML list of `size` finite numbers without unit; None if the key is missing."""
        value = self.take(key, None)
        if value is None:
            return None
        good = isinstance(value, list) and len(value) == size
        if not good or not all(isinstance(x, int | float) and math.isfinite(x) for x in value):
            raise InputError(f"{self.where}: {key} is {value!r}, expected a list of {size} finite numbers")
        return np.array(value, dtype=np.float64)

    def needed(self, key: str, size: int) -> Array:
        """Return the list of `size` finite numbers of a required TOML key."""
        values = self.numbers(key, size)
        if values is None:
            raise InputError(f"{self.where}: expected {key}, a list of {size} finite numbers")
        return values

    def done(self) -> None:
        """Raise InputError if a key of the TOML table was not read."""
        if self.content:
            unknown = next(iter(self.content))
            raise InputError(f"{self.where}: unknown key {unknown}; expected {choices(unknown, self.known)}")
