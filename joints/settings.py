"""Settings of the studies of the joint: a TOML table with units, over defaults of the joint of the thesis."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.units import factor_like, split_header, split_quantity
from gpmodel.texts import read_toml as read_table


def require(valid: ArrayLike, name: str, value: ArrayLike, expected: str) -> None:
    """Raise InputError "name = value, expected ..." for the first entry of an array that is not valid."""
    ok, values = np.broadcast_arrays(np.asarray(valid, bool), np.asarray(value, float))
    if not ok.all():
        raise InputError(f"{name} = {values[~ok].flat[0]:.6g}, expected {expected}")


def positive(name: str, value: ArrayLike, unit: str) -> Array:
    """Return `value` as a float array. Raises InputError unless every entry is finite and above zero."""
    array = np.asarray(value, float)
    require(np.isfinite(array) & (array > 0), name, array, f"above 0 {unit}".rstrip())
    return array


def not_negative(name: str, value: ArrayLike, unit: str) -> Array:
    """Return `value` as a float array. Raises InputError unless every entry is finite and at least zero."""
    array = np.asarray(value, float)
    require(np.isfinite(array) & (array >= 0), name, array, f"at least 0 {unit}".rstrip())
    return array


def angle_within(name: str, value: ArrayLike, upper: float) -> Array:
    """Return the angle `value` [rad] as a float array. Raises InputError, in degrees, unless 0 < angle <= upper."""
    array = np.asarray(value, float)
    valid = np.isfinite(array) & (array > 0) & (array <= upper * (1 + 1e-12))
    bounds = f"above 0 and at most {np.degrees(upper):.6g} deg"
    require(valid, f"{name} [deg]", np.degrees(array), bounds)
    return array


LONGEST, MOST = 100.0, 1e15
"""Largest length of a joint, m, except for the radius of a nearly flat surface; largest value of any other quantity, in
SI units. Elastic moduli and orifice resistances are of the order of 1e11."""

DATA = Path(__file__).parent / "data"

Settings = dict[str, Any]
_EXPECTED = {
    dict: "a table", list: "a list", str: "text", bool: "true or false", int: "a whole number", float: "a number",
}  # fmt: skip


def quantity(text: Any, like: str, where: str) -> float:
    """Return the SI value of `text`, a number and a unit such as "25.4 mm".

    like: an example with the expected dimension, for example "1 mm". where: place in messages. Raises InputError
    for an invalid `text`.
    """
    given, example = (split_quantity(t) if isinstance(t, str) else None for t in (text, like))
    unit = factor_like(given[1], example[1]) if given and example else None
    if given is None or example is None or unit is None:
        raise InputError(f"{where}: {text!r}, expected a quantity with a unit, such as '{like}'")
    value, usual = given[0] * unit, example[0] * (factor_like(example[1], example[1]) or 1.0)
    most, name = (LONGEST, "m") if factor_like(given[1], "m") else (MOST, "in SI")
    if not abs(value) <= (most := max(most, usual)):
        raise InputError(f"{where}: {text!r}, expected at most {most:g} {name}, the unit may be wrong")
    return value


def load_settings(study: str, path: Path | None = None) -> Settings:
    """Return the settings of `study` in SI: values of the TOML file at `path`, or defaults in joints/data/<study>.toml.

    A list of tables in the TOML file replaces the default list. Raises InputError for an unreadable file, an unknown
    key, a missing unit, or a dimension or type other than the default's.
    """
    return laid_over(study, read_toml(path) if path else {}, path.name if path else f"{study}.toml")


def laid_over(study: str, given: Settings, file: str) -> Settings:
    """Return the settings of `study` in SI: the values `given`, or the defaults; see load_settings. file: file name for
    error messages."""
    return _overlay(read_toml(DATA / f"{study}.toml"), given, file, "")


def read_toml(path: Path) -> Settings:
    """Return the content of the TOML file at `path`. Raises InputError for a missing or invalid file."""
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
                raise InputError(f"{where} = [], expected at least one entry")
            return [_entry(default[0], entry, file, f"{place}[{i}]") for i, entry in enumerate(value)]
        case int() | float():
            require(abs(value) < float("inf"), where, value, "a finite number")
    return value


def _entry(default: Any, given: Any, file: str, place: str) -> Any:
    """Return one entry of a settings list in SI. An entry that is a table has no defaults and needs all keys."""
    if isinstance(default, dict) and isinstance(given, dict):
        missing = [key for key in default if key not in given]
        if missing:
            raise InputError(f"{file}: {place} has no '{missing[0]}', expected {', '.join(default)}")
    return _value(default, given, file, place)


def curve_of(settings: Settings, path: Path | None, columns: Mapping[str, str]) -> dict[str, Array] | None:
    """Return the columns of the data file that the table [measured] names; None without a file name. The name of the
    data file is relative to the TOML file at `path`."""
    return None if settings["file"] == "none" else read_curve((path or Path()).parent / settings["file"], columns)


def read_curve(path: Path, columns: Mapping[str, str]) -> dict[str, Array]:
    """Return the named columns of the data file at `path`, in SI. columns: {name: example unit}.

    Header of a file: `displacement [um],force [N]`. Raises InputError for a missing column, unit or number.
    """
    frame, curve = read_frame(path)[0], dict[str, Array]()
    heads = {str(head): split_header(str(head)) for head in frame.columns}
    for name, unit in columns.items():
        found = next((head for head, (called, given) in heads.items() if called == name and given is not None), "")
        factor = factor_like(heads[found][1] or "", unit) if found else None
        if factor is None:
            raise InputError(f"{path}: columns {choices(name, heads)}, expected a column '{name} [{unit}]'")
        curve[name] = factor * numbers(frame[found], f"{path}: column '{name}'")
        if (empty := np.flatnonzero(np.isnan(curve[name]))).size:
            raise InputError(f"{path}: column '{name}', row {empty[0] + 1}: empty, expected a number")
    return curve
