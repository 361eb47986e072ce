"""Settings of the joint's studies: a TOML table laid over the thesis' joint, every quantity written with its unit."""

from pathlib import Path
from typing import Any

import msgspec

from gpmodel.errors import InputError, choices
from gpmodel.table.units import factor_like, split_quantity
from gpmodel.texts import read_toml as read_table
from joints.limits import require

LONGEST, MOST = 100.0, 1e15
"""Metres of anything of a joint but the radius of what is nearly flat, and whatever else in SI: elastic moduli and
resistances of orifices are some 1e11."""

DATA = Path(__file__).parent / "data"

Settings = dict[str, Any]
_EXPECTED = {
    dict: "a table", list: "a list", str: "text", bool: "true or false", int: "a whole number", float: "a number",
}  # fmt: skip


def quantity(text: Any, like: str, where: str) -> float:
    """The SI value of `text`, a number and a unit such as "25.4 mm", of the same dimension as the example `like`.

    Raises InputError naming `where`.
    """
    given, example = (split_quantity(t) if isinstance(t, str) else None for t in (text, like))
    unit = factor_like(given[1], example[1]) if given and example else None
    if given is None or example is None or unit is None:
        raise InputError(f"{where}: {text!r}, expected a quantity with its unit, such as '{like}'")
    value, usual = given[0] * unit, example[0] * (factor_like(example[1], example[1]) or 1.0)
    most, name = (LONGEST, "m") if factor_like(given[1], "m") else (MOST, "in SI")
    if not abs(value) <= (most := max(most, usual)):
        raise InputError(f"{where}: {text!r}, expected at most {most:g} {name}, the unit may be wrong")
    return value


def load_settings(study: str, path: Path | None = None) -> Settings:
    """The defaults of `study` (joints/data/<study>.toml) with the table at `path` laid over them, in SI.

    A list of tables in `path` replaces the default list. Raises InputError for a file that cannot be read, an unknown
    key, a missing unit, another dimension or another type than the default's.
    """
    return laid_over(study, read_toml(path) if path else {}, path.name if path else f"{study}.toml")


def laid_over(study: str, given: Settings, file: str) -> Settings:
    """The defaults of `study` with the keys `given` laid over them, in SI. `file`: in messages. As load_settings."""
    return _overlay(read_toml(DATA / f"{study}.toml"), given, file, "")


def read_toml(path: Path) -> Settings:
    """The TOML table at `path`; InputError in one line if there is none."""
    return read_table(path, "a TOML file")


def _overlay(default: Settings, given: Settings, file: str, place: str) -> Settings:
    unknown = [key for key in given if key not in default]
    if unknown:
        names = choices(unknown[0], default)
        raise InputError(f"{file}: unknown key '{place}{unknown[0]}', expected one of {names}")
    return {key: _value(default[key], given.get(key), file, f"{place}{key}") for key in default}


def _value(default: Any, given: Any, file: str, place: str) -> Any:
    where, value = f"{file}: {place}", default if given is None else given
    if isinstance(default, str) and split_quantity(default):
        return quantity(value, default, where)
    try:
        msgspec.convert(value, type(default))
    except msgspec.ValidationError:
        raise InputError(f"{where} = {value!r}, expected {_EXPECTED[type(default)]}") from None
    match default:
        case dict():
            return _overlay(default, value, file, f"{place}.")
        case list():
            if not value:
                raise InputError(f"{where} = [], expected a list that is not empty")
            return [_entry(default[0], entry, file, f"{place}[{i}]") for i, entry in enumerate(value)]
        case int() | float():
            require(abs(value) < float("inf"), where, value, "a finite number")
    return value


def _entry(default: Any, given: Any, file: str, place: str) -> Any:
    """One entry of a list; a table must name all of its keys, since there is no default entry to lend them."""
    if isinstance(default, dict) and isinstance(given, dict):
        missing = [key for key in default if key not in given]
        if missing:
            raise InputError(f"{file}: {place} has no '{missing[0]}', expected {', '.join(default)}")
    return _value(default, given, file, place)
