"""Units, only at the door: what a header or an option says, turned into SI."""

import math
import re
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pint

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import SI

_HEADER = re.compile(r"^\s*(?P<name>.*?)\s*\[\s*(?P<unit>[^\]]*?)\s*\]\s*$")
_QUANTITY = re.compile(r"^\s*(?P<value>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(?P<unit>\S.*?)\s*$")
_NUMBER = re.compile(r"^\s*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\s*$")
_PRINTED = str.maketrans("·−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "*--0123456789")
_DEVIATION = re.compile(r"\s*±\s*[0-9.]+")
_TIMES_TEN = re.compile(r"\s*×10(-?[0-9]+)")
_POWER = re.compile(r"(?:[^\W\d_]|[°%])\s*(?:\*\*|\^)\s*[-+]?\d{1,2}(?![\d.])(?!\s*(?:\*\*|\^))")
_RAISED = re.compile(r"\*\*|\^|[\d)][⁻⁰¹²³⁴-⁹]|[⁰¹²³⁴-⁹]{3}")
LONGEST = 60
"""Characters of a unit."""
DIMENSIONS = {unit: dimension for dimension, unit in SI.items()}


JOINT_UNITS = {"revolute": "rad", "prismatic": "m"}
"""SI units of joint values by the kind of the joint."""


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry:
    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define("sccm = centimeter ** 3 / minute")
    registry.define("px = pixel")  # not the 1/96 inch of style sheets
    return registry


def split_header(header: str) -> tuple[str, str | None]:
    """`J1 [deg]` gives ("J1", "deg"); a header without brackets gives (header, None)."""
    match = _HEADER.match(header)
    return (match["name"], match["unit"]) if match else (header.strip(), None)


def joint_column(name: str, kind: str, values: Array) -> tuple[str, Array]:
    """Header and values of a joint column as it is written: [deg] for revolute joints, [mm] for prismatic ones."""
    return (f"{name} [deg]", np.degrees(values)) if kind == "revolute" else (f"{name} [mm]", 1e3 * values)


def identifier(name: str) -> str:
    """A name as expressions can write it: what is no letter or digit becomes an underscore."""
    word = "".join(c if f"_{c}".isidentifier() else "_" for c in re.sub(r"\W", "_", name))
    return word if word.isidentifier() else f"_{word}"


def _spelled(unit: str) -> str:
    """Return the text of a unit.

    Raises ValueError if it is too long or raises anything but a name to a power: the units library would evaluate
    9**9**9.
    """
    if len(unit) > LONGEST or len(_POWER.findall(unit)) != len(_RAISED.findall(unit)):
        raise ValueError(unit)
    return unit


@lru_cache(maxsize=256)
def known_unit(unit: str) -> bool:
    """Return whether the units library can read and convert this unit; `1` is the dimensionless one."""
    try:
        registry = _registry()
        spelled = registry.parse_units("" if unit == "1" else _spelled(unit))
        times: float | None = registry.get_root_units(spelled)[0]  # type: ignore[assignment]
    except Exception:  # pint raises its own, tokenize's, attribute and overflow errors
        return False
    return times is None or 0.0 < times < math.inf  # None: a scale with a zero of its own


@lru_cache(maxsize=256)
def is_time(unit: str) -> bool:
    """Return whether it is a unit of time."""
    return unit != "1" and known_unit(unit) and _registry().parse_units(unit).is_compatible_with("s")


def clock_names(units: Mapping[str, str]) -> set[str]:
    """The row number and, of inputs with these units, the times: what the order of a session is told by."""
    return {"row", *(name for name, unit in units.items() if is_time(unit))}


@lru_cache(maxsize=256)
def torque_factor(unit: str) -> float | None:
    """Return the size of one `unit` in N·m (or N, of a force); None for a unit of neither."""
    if unit == "1" or not known_unit(unit.replace("Nm", "N*m")):
        return None
    own = _registry().Quantity(1.0, unit.replace("Nm", "N*m"))
    return next((float(own.to(si).magnitude) for si in ("N*m", "N") if own.is_compatible_with(si)), None)


def factor(unit: str, dimension: str, where: str) -> float:
    """Return the size of one `unit` of `dimension` (length, angle or mass) in SI units.

    Raises InputError naming `where` when the unit is unknown or of another dimension.
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
    """A quantity as the pages print it, in the letters of a keyboard: `12.0 ± 0.3 ×10⁻⁶ 1/°C` as `12.0e-6 1/degC`."""
    text = _TIMES_TEN.sub(lambda m: f"e{m[1]}", _DEVIATION.sub("", text).translate(_PRINTED))
    return text.replace("°C", "degC").replace("°F", "degF").strip()


def split_quantity(text: str) -> tuple[float, str] | None:
    """`0.03 mm` gives (0.03, "mm"); None where there is no number or no unit."""
    text = as_typed(text)
    match = None if _NUMBER.match(text) else _QUANTITY.match(text)
    return (float(match["value"]), match["unit"]) if match else None


def factor_like(unit: str, like: str) -> float | None:
    """Return the size of one `unit` in SI units, also of `/K`; None unless its dimension is that of `like`.

    None also for scales with a zero of their own (degC): their values are no multiples of a unit.
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
    """`60kg`, `0.03 mm` in SI. Raises InputError when there is no number or no unit."""
    split = split_quantity(text)
    if split is None:
        example = {"length": "0.03mm", "angle": "20deg", "mass": "60kg", "pixels": "0.1px"}[dimension]
        raise InputError(f"'{text}' is no quantity; write a number and its unit, as in {example}", where)
    return split[0] * factor(split[1], dimension, where)


def convert(text: str, unit: str, where: str) -> float:
    """The number in `text`, `20 arcsec` or `20`, in `unit`; without a unit of its own it is in `unit` already.

    Raises InputError when it is no number or its unit does not convert.
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
