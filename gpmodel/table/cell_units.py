"""Units that files of other programs write in other ways: behind the numbers of cells, or spelled otherwise."""

import re
from collections.abc import Sequence
from functools import lru_cache

from gpmodel.errors import InputError
from gpmodel.table.units import known_unit

UNITS = {
    "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "millimeters": "mm",
    "millimetres": "mm", "millimeter": "mm", "meter": "m", "meters": "m", "micron": "um", "microns": "um",
    "inches": "in", "inch": "in", "°c": "degC", "c": "degC", "celsius": "degC", "°f": "degF", "sec": "s",
    "seconds": "s", "%": "percent", "nm": "N*m", "grad": "deg",
}  # fmt: skip
"""Spellings of units in files of other programs, in lower case, by unit."""
BEHIND = (
    "mm", "cm", "um", "µm", "m", "in", "inch", "inches", "deg", "degree", "degrees", "°", "grad", "rad", "degc", "°c",
    "celsius", "kg", "s", "sec", "ms",
)  # fmt: skip
"""Units that are recognised without brackets at the end of a column name."""
MISSING = {"", "-", "--", "---", "nan", "n/a", "na", "#n/a", "null", "none", "-nan", "-nan(ind)"}
"""Texts in cells of a table that mean "not measured"."""
_CELL = re.compile(
    r"^(?P<number>[-+]?[\d.,' ]*\d[\d.,' ]*?(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\W\d_°%][^\s\d]{0,11}|°\s?[cCfF]?|%)$"
)
_IN_CELLS = {*BEHIND, *UNITS, "mrad", "g", "lb", "n", "n*m", "n·m", "k", "degf", "μm"} - {"c"}


@lru_cache(maxsize=1024)
def spelled_unit(text: str) -> str | None:
    """Return a unit in the spelling of this program, or None for text that is no unit."""
    bare = text.strip(" []().").replace("µ", "u").replace("μ", "u")
    for unit in (UNITS.get(bare.lower(), bare), bare.lower()):
        if unit and not unit[0].isdigit() and known_unit(unit):
            return unit
    return None


def split_unit(cell: str) -> tuple[str, str]:
    """Split a cell such as `2070.7 mm` or `12,5°` into number and unit; the unit of any other cell is ""."""
    if not cell or cell[-1].isdigit():
        return cell, ""
    found = _CELL.match(cell.strip())
    if not found or "".join(found["unit"].split()).lower() not in _IN_CELLS:
        return cell, ""
    return found["number"].strip(), "".join(found["unit"].split())


def unit_of_cells(cells: Sequence[object], where: str) -> tuple[list[object], str]:
    """Return the cells of a column without their unit, and the unit behind every number; "" without units.

    Columns with other text are unchanged. Raises InputError naming `where` for two units in one column.
    """
    if not any(isinstance(cell, str) and cell and not cell[-1].isdigit() for cell in cells):
        return list(cells), ""
    parts = [split_unit(cell) if isinstance(cell, str) else ("", "") for cell in cells]
    known = [k for k, c in enumerate(cells) if isinstance(c, str) and c.strip().lower() not in MISSING]
    if not any(parts[k][1] for k in known) or any(not parts[k][0].strip()[-1:].isdigit() for k in known):
        return list(cells), ""
    units = {k: spelled_unit(parts[k][1]) or "" for k in known}
    first = units[known[0]]
    if other := next((k for k in known if units[k] != first), 0):
        said = f"[{units[other]}]" if units[other] else "without unit"
        raise InputError(
            f"{where}, row {other + 1}: '{cells[other]}' is {said}, row {known[0] + 1} is '{cells[known[0]]}'; "
            "expected one unit in all cells of a column"
        )
    return [parts[k][0] if k in units else cell for k, cell in enumerate(cells)], first


def with_unit(header: str, own: str | None, unit: str, where: str) -> str:
    """Return a column's header with the unit of its cells. own: unit in the header, None without one.

    Raises InputError if the header has another unit than the cells.
    """
    if own is None:
        return f"{header} [{unit}]".strip()
    if spelled_unit(own) != unit:
        raise InputError(f"{where}, column '{header}': cells in [{unit}]; expected the unit of the header")
    return header
