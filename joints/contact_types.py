"""Contact types as data: what differs between the four prototypes, and their measured residual errors."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from gpmodel.errors import InputError
from joints.limits import positive, require
from joints.settings import DATA, quantity, read_toml

KEYS = ("name", "contact", "supports", "friction", "predicted_max", "sphere_fit_max", "calibrated_max", "figure")


@dataclass(frozen=True)
class ContactType:
    """supports: discrete contacts, 0 for a surface. Maxima: m, None where none was published. figure: their source."""

    name: str
    contact: str
    supports: int
    friction: str
    predicted_max: float | None
    sphere_fit_max: float | None
    calibrated_max: float | None
    figure: str


def contact_types(path: Path | None = None) -> tuple[ContactType, ...]:
    """The contact types of a TOML table ([[type]] entries), the thesis' four without one.

    Raises InputError for a missing or unknown key, or a length without its unit.
    """
    file = path or DATA / "contact_types.toml"
    entries = read_toml(file).get("type", [])
    if not entries:
        raise InputError(f"{file.name}: no contact type; expected [[type]] entries with {', '.join(KEYS)}")
    return tuple(_entry(e, f"{file.name}, type {i}") for i, e in enumerate(entries, 1))


def _entry(entry: dict[str, Any], where: str) -> ContactType:
    missing = [k for k in KEYS if k not in entry]
    unknown = [k for k in entry if k not in KEYS]
    if missing or unknown:
        problem = f"no '{missing[0]}'" if missing else f"unknown key '{unknown[0]}'"
        raise InputError(f"{where}: {problem}; expected {', '.join(KEYS)}")
    lengths = {k: _length(entry[k], f"{where}: {k}") for k in KEYS if k.endswith("_max")}
    try:
        found = msgspec.convert({**entry, **lengths}, ContactType)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None
    require(found.supports >= 0, f"{where}: supports", found.supports, "at least 0")
    return found


def _length(text: Any, where: str) -> float | None:
    return None if text == "" else float(positive(where, quantity(text, "10 um", where), "m"))
