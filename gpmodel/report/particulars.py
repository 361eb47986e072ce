"""Particulars of a certificate: machine, instrument, operator; from options or a TOML file."""

import dataclasses
import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gpmodel.errors import InputError, choices
from gpmodel.texts import read_toml


@dataclass(frozen=True)
class Particulars:
    """Free text; a line that is empty is left to be filled in by hand."""

    machine: str = ""
    serial: str = ""
    controller: str = ""
    location: str = ""
    instrument: str = ""
    instrument_serial: str = ""
    instrument_calibrated: str = ""
    operator: str = ""
    date: str = ""
    temperature: str = ""
    payload: str = ""
    remarks: str = ""

    def lines(self) -> tuple[tuple[str, str], ...]:
        """Every line as heading and text."""
        return tuple((f.name.replace("_", " "), getattr(self, f.name)) for f in dataclasses.fields(self))

    def with_lines(self, said: Mapping[str, str]) -> "Particulars":
        """With these lines instead, empty ones passed over. Raises InputError for a line that is none."""
        known = [f.name for f in dataclasses.fields(self)]
        for name in said:
            if name not in known:
                raise InputError(
                    f"'{name}' is no line of a certificate; available: {choices(name, known)}", "particulars"
                )
        return dataclasses.replace(self, **{name: value for name, value in said.items() if value})


def read_particulars(path: Path) -> Particulars:
    """The particulars of a TOML file with keys of the same names.

    Raises InputError: no such file, no TOML, an unknown key, or a value that is no text, number or date.
    """
    content = read_toml(path, "lines as in serial = '64-10291'")
    known = [f.name for f in dataclasses.fields(Particulars)]
    for key, value in content.items():
        if key not in known:
            raise InputError(f"{path}: key '{key}' is unknown; available: {choices(key, known)}")
        if not isinstance(value, str | int | float | datetime.date) or isinstance(value, bool):
            raise InputError(f"{path}: {key} = {value!r}; expected text")
    return Particulars(**{key: str(value) for key, value in content.items()})
