"""A folder of measured tables, one a machine, and what it says of them."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gpmodel.errors import InputError
from gpmodel.texts import read_toml

TABLES = (".csv", ".txt", ".xlsx")
HIDDEN = (".", "~$")
"""Prefixes of files that are not tables; Excel leaves the latter next to an open table."""
LONGEST_NAME = 60
"""Characters of the name of a machine's folder."""
ABOUT = "fleet.toml"
EXPECTED = "mechanism = NAME and, below [serials], FILE = SERIAL"


@dataclass(frozen=True)
class Folder:
    """Tables by the serial of their machine, and the mechanism of all, where the folder says it."""

    tables: Mapping[str, Path]
    mechanism: str | None

    @property
    def said_mechanism(self) -> str:
        """The mechanism of all. Raises InputError where the folder does not say it."""
        if self.mechanism is None:
            raise InputError(f"is not said; expected a name or a file, here or in {ABOUT}", "mechanism")
        return self.mechanism


def folder_of_tables(folder: Path) -> Folder:
    """Every table in a folder, by the serial that fleet.toml gives its file, else by the file's name without ending.

    fleet.toml: `mechanism`, a name or a file seen from the folder, and `[serials]`, both optional. Raises InputError:
    no folder, no tables, two of one serial, a serial of a file that is not there, no such TOML.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with a table for each machine")
    files = _tables(folder)
    if not files:
        raise InputError(f"{folder}: has no tables ({', '.join(TABLES)}); expected one for each machine")
    mechanism, serials = _said(folder / ABOUT)
    if missing := sorted(set(serials) - {p.name for p in files}):
        raise InputError(f"{folder / ABOUT}: '{missing[0]}' is no table of the folder; expected one of its files")
    tables: dict[str, Path] = {}
    for path in files:
        serial = serials.get(path.name, path.stem)
        if serial in tables:
            raise InputError(f"{folder}: {tables[serial].name} and {path.name} are both of machine '{serial}'")
        tables[serial] = path
    return Folder(tables, mechanism)


def folder_names(serials: Sequence[str]) -> tuple[str, ...]:
    """A name of a folder for each machine: its serial as files may be called, with its place where two are alike."""
    plain = [re.sub(r"[^\w-]+", "_", serial)[:LONGEST_NAME] for serial in serials]
    alike = {name for name, count in Counter(name.lower() for name in plain).items() if count > 1}
    return tuple(f"{n}-{k}" if n.lower() in alike else n for k, n in enumerate(plain, 1))


def files_of(folder: Path) -> tuple[Path, ...]:
    """Every table in a folder, and its fleet.toml where there is one. Raises InputError where a table is no file."""
    return (*_tables(folder), *(path for path in [folder / ABOUT] if path.is_file()))


def _tables(folder: Path) -> list[Path]:
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in TABLES and not p.name.startswith(HIDDEN))
    if other := next((p for p in found if not p.is_file()), None):
        raise InputError(f"{other}: is no file; expected a measured table")
    return found


def _said(path: Path) -> tuple[str | None, dict[str, str]]:
    """The mechanism and the serials of a fleet.toml; nothing where there is none."""
    if not path.exists():
        return None, {}
    content = read_toml(path, EXPECTED)
    if unknown := sorted(set(content) - {"mechanism", "serials"}):
        raise InputError(f"{path}: '{unknown[0]}' is unknown; expected {EXPECTED}")
    mechanism, serials = content.get("mechanism"), content.get("serials", {})
    if not isinstance(mechanism, str | None) or not isinstance(serials, dict):
        raise InputError(f"{path}: mechanism or serials are of another kind; expected {EXPECTED}")
    if not all(isinstance(s, str) and s for s in serials.values()):
        raise InputError(f"{path}: a serial is no text; expected {EXPECTED}")
    beside = path.parent / (mechanism or "")
    return str(beside) if mechanism and beside.is_file() else mechanism, serials
