"""Contact types as data: what differs between the four prototypes, and their measured residual errors."""

from pathlib import Path
from typing import Annotated, Any

import msgspec

from gpmodel.errors import InputError
from joints.limits import positive
from joints.settings import DATA, quantity, read_toml

LENGTHS = ("predicted_max", "sphere_fit_max", "calibrated_max")


class ContactType(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """supports: discrete contacts, 0 for a surface. Maxima: m, None where none was published. figure: their source."""

    name: str
    contact: str
    supports: Annotated[int, msgspec.Meta(ge=0)]
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
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries) or not entries:
        keys = ", ".join(ContactType.__struct_fields__)
        raise InputError(f"{file.name}: no contact type; expected [[type]] entries with {keys}")
    return tuple(_entry(e, f"{file.name}, type {i}") for i, e in enumerate(entries, 1))


def _entry(entry: dict[str, Any], where: str) -> ContactType:
    lengths = {k: _length(entry[k], f"{where}: {k}") for k in LENGTHS if k in entry}
    try:
        return msgspec.convert({**entry, **lengths}, ContactType)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None


def _length(text: Any, where: str) -> float | None:
    return None if text == "" else float(positive(where, quantity(text, "10 um", where), "m"))
