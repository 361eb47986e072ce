"""TOML tables with the units in their keys."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import checked
from gpmodel.table.units import factor

UNITS = {"angle": ("deg", "rad"), "length": ("mm", "m", "in"), "mass": ("kg",), "acceleration": ("m_s2",)}


class TomlTable:
    """One table of a TOML file, units in its keys; keys are taken one by one, what is left over is an error.

    content: what tomllib made of it. where: how messages name it. Every method raises InputError for a value of
    the wrong kind.
    """

    def __init__(self, content: object, where: str) -> None:
        if not isinstance(content, dict):
            raise InputError(f"{where}: expected a table of keys, one `key = value` a line")
        self.content: dict[str, Any] = dict(content)
        self.where = where
        self.known: list[str] = []

    def take(self, key: str, default: Any) -> Any:
        """Whatever the key holds."""
        self.known.append(key)
        return self.content.pop(key, default)

    def tables(self, key: str) -> list[TomlTable]:
        """The array of tables [[key]]; empty where there is none."""
        content = self.take(key, [])
        if not isinstance(content, list):
            raise InputError(f"{self.where}: {key} is one table, expected [[{key}]] with double brackets")
        return [TomlTable(row, f"{self.where}: [[{key}]] {number}") for number, row in enumerate(content, 1)]

    def table(self, key: str) -> TomlTable:
        """The table [key]; empty where there is none."""
        return TomlTable(self.take(key, {}), f"{self.where}: [{key}]")

    def quantity(self, key: str, dimension: str, default: Any, size: int | None = None) -> Any:
        """Number, or vector of `size`, in SI from the key with a unit of the dimension behind it."""
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
        """One of the choices."""
        value = self.take(key, default)
        if value not in choices or isinstance(value, bool):
            listed = ", ".join(map(repr, choices))
            raise InputError(f"{self.where}: {key} is {value!r}, expected one of {listed}")
        return value

    def text(self, key: str, default: str) -> str:
        """A text that is not empty."""
        value = self.take(key, default)
        if not isinstance(value, str) or not value:
            raise InputError(f"{self.where}: {key} is {value!r}, expected a text")
        return value

    def number(self, key: str) -> float:
        """A finite number without unit."""
        value = self.take(key, None)
        if value is None:
            raise InputError(f"{self.where}: {key} is missing; expected one finite number")
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            raise InputError(f"{self.where}: {key} is {value!r}, expected one finite number")
        return float(value)

    def numbers(self, key: str, size: int) -> Array | None:
        """A list of finite numbers without unit; None where the key is missing."""
        value = self.take(key, None)
        if value is None:
            return None
        good = isinstance(value, list) and len(value) == size
        if not good or not all(isinstance(x, int | float) and math.isfinite(x) for x in value):
            raise InputError(f"{self.where}: {key} is {value!r}, expected a list of {size} finite numbers")
        return np.array(value, dtype=np.float64)

    def needed(self, key: str, size: int) -> Array:
        """Return the numbers of a required key."""
        values = self.numbers(key, size)
        if values is None:
            raise InputError(f"{self.where}: expected {key}, a list of {size} finite numbers")
        return values

    def done(self) -> None:
        """Checks that no key was left over."""
        if self.content:
            unknown = next(iter(self.content))
            raise InputError(f"{self.where}: unknown key {unknown}; expected {choices(unknown, self.known)}")
