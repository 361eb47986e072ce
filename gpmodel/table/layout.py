"""Read files of any layout as cells: encoding, separator, decimal sign, header and units are recognised."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from gpmodel.errors import InputError
from gpmodel.table.cell_units import BEHIND, MISSING, spelled_unit, split_unit, unit_of_cells, with_unit
from gpmodel.table.cells import (
    COMMENTS,
    EMPTY,
    FEWEST_NUMBERS,
    LARGEST_FILE,
    MOST_COLUMNS,
    SNIFFED,
    clock_seconds,
    decoded,
    excel_cells,
    is_number,
    separator_and_decimal,
    split,
)
from gpmodel.table.robot_programs import AXIS_NAMES, JOINT_TARGET
from gpmodel.texts import read_limited

MOST_HEADERS = 4
"""Largest number of header lines of a table file: names, kinds and units in separate lines."""
LONGEST_NAME = 200
"""Number of characters of a column's header that are searched for a unit."""
_BRACKETS = re.compile(r"[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]")
_BEHIND = re.compile(rf"(?i)^(.*?\w)\s*(?:[ _/,.-]|\bin\b)\s*({'|'.join(BEHIND)})$")
_ROBTARGET = re.compile(r"\brobtarget\b|\[\[[^][]*\],\s*\[(?:[^][,]*,){3}[^][,]*\],\s*\[(?:[^][,]*,){3}[^][,]*\]")
_POSE, _AXES = re.compile(r"\bX Y Z (?:A B C|W P R)\b"), re.compile(r"\b[AJ]1\b")
_POSTYPE = re.compile(r"(?m)^///POSTYPE[ \t]+(\w+)")
_BETWEEN_WORDS = re.compile(
    r"(?:(?<!\w)([A-Za-z]\w{0,30})\s{0,9}[=:]?\s{0,9})?"
    r"(?<![\w.])([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])(?:\s*(deg|rad|mm)\b)?"
)


@dataclass(frozen=True)
class Sheet:
    """Cells of a table file as text, with the headers of its columns.

    names: header of each column, "" without header.
    cells: text by row and column with decimal points, missing where empty; columns are numbered from 0.
    said: notes on the recognised separator, header and units.
    """

    names: tuple[str, ...]
    cells: pd.DataFrame
    said: tuple[str, ...]
    source: str

    @property
    def columns(self) -> range:
        """Numbers of the columns of the sheet, from 0."""
        return range(len(self.names))

    def part(self, rows: slice) -> "Sheet":
        """Return some of the sheet's rows, with its headers."""
        return replace(self, cells=self.cells.iloc[rows].reset_index(drop=True))

    def numbers(self, column: int) -> "pd.Series[float] | None":
        """Return the numbers of a sheet's column, NaN for empty cells; None if the column has text or is empty."""
        text = self.cells[column]
        values = pd.to_numeric(text, errors="coerce")
        return values.astype(float) if values.notna().any() and (values.isna() == text.isna()).all() else None

    def seconds(self, column: int) -> "pd.Series[float] | None":
        """Return the clock times of a sheet's column, s after the first time; None for columns without clock times."""
        return clock_seconds(self.cells[column])


def read_sheets(path: Path, header: bool = True) -> list[Sheet]:
    """Read a text file of any layout, or the sheets of an Excel file that hold numbers.
    header: True if lines above the data may name the columns. Raises InputError if the file is missing, empty or has no
    number."""
    raw = read_limited(path, LARGEST_FILE, "a measured table")
    if not raw.strip():
        raise InputError(EMPTY.format(path.name))
    if path.suffix.lower() in (".xlsx", ".xls"):
        return [_sheet(rows, ".", path, header) for rows in excel_cells(raw, path)]
    text, encoding = decoded(raw, path)
    lines = text.splitlines()
    if _programmed(lines[:SNIFFED]):
        return [_between_words(text, path)]
    separator, decimal = separator_and_decimal(lines)
    sheet = _sheet([split(line, separator) if line.strip() else [] for line in lines], decimal, path, header)
    named = {"\t": "tabs", " ": "blanks"}.get(separator, f"'{separator}'")
    return [replace(sheet, said=(f"{encoding}, {named} between cells, decimal '{decimal}'", *sheet.said))]


def name_and_unit(header: str, own: str | None = None) -> tuple[str, str | None, bool]:
    """Split a header into name, unit, and whether the unit is certain: in brackets, or in a line of units (`own`).
    `J1 (deg)`, `X_mm` and `Temperature in °C` are recognised as well as `J1 [deg]`."""
    text = " ".join(header.split()).strip("\"' ")
    if own and (unit := spelled_unit(own)):
        return text, unit, True
    for found in reversed(list(_BRACKETS.finditer(text[:LONGEST_NAME]))):
        if unit := spelled_unit(found[1]):
            return " ".join(f"{text[: found.start()]} {text[found.end() :]}".split()), unit, True
    if len(text) <= LONGEST_NAME and (behind := _BEHIND.match(text)):
        return behind[1].strip(" _/,.-"), spelled_unit(behind[2]), False
    return text, None, False


def _plain(cell: str, decimal: str) -> str:
    """Write a number with a decimal point and without thousands separators; other text and units are unchanged."""
    if not is_number(cell, decimal):
        return cell
    number, unit = split_unit(cell)
    return re.sub(r"[. ']" if decimal == "," else r"[, ']", "", number).replace(",", ".") + unit


def _sheet(rows: list[list[str]], decimal: str, path: Path, header: bool) -> Sheet:
    """Find the lines of data, and the header above the data, among the rows of cells of a file."""
    counts = [sum(is_number(cell, decimal) for cell in row) for row in rows]
    fewest = max(min(FEWEST_NUMBERS, max(counts, default=0)), 1)
    data = [i for i, n in enumerate(counts) if n >= fewest and not rows[i][0].startswith(COMMENTS)]
    if not data:
        raise InputError(f"{path.name}: no line with a number; expected a table, a row a pose")
    width = Counter(len(rows[i]) for i in data).most_common(1)[0][0]
    if width > MOST_COLUMNS:
        raise InputError(f"{path.name}: {width} columns; expected at most {MOST_COLUMNS}")
    usual = Counter(counts[i] for i in data).most_common(1)[0][0]
    whole = [i for i in data if 2 * counts[i] > usual]
    fitting = [i for i in whole if len(rows[i]) == width or (len(rows[i]) < width and i > whole[0])]
    odd = [i + 1 for i in data if i not in set(fitting)]
    above = _above(rows, fitting[0], width, decimal) if header else []
    names = [" ".join(dict.fromkeys(w for w in words if w)) for words in zip(*above, strict=True)] or [""] * width
    cells = pd.DataFrame([[_plain(c, decimal) for c in rows[i] + [""] * (width - len(rows[i]))] for i in fitting])
    cells = cells.mask(cells.map(lambda cell: cell.lower() in MISSING)).astype(object)
    for i, name in enumerate(names):
        values, unit = unit_of_cells(cells[i].tolist(), f"{path.name}, column '{name or i + 1}'")
        if unit:
            cells[i] = pd.Series(values, dtype=object)
            _, own, sure = name_and_unit(name)
            names[i] = with_unit(name, own if sure else None, unit, path.name)
    said = [f"{len(cells)} rows from line {fitting[0] + 1} on"]
    said += [f"lines {', '.join(map(str, odd[:6]))} left out: not {width} cells, or few numbers"] * bool(odd)
    return Sheet(tuple(names), cells, tuple(said), path.name)


def _above(rows: list[list[str]], first: int, width: int, decimal: str) -> list[list[str]]:
    """Return the header lines of a file, each with `width` cells.
    Header lines stand above the data, have about as many cells, and contain hardly any numbers."""
    found: list[list[str]] = []
    for row in reversed(rows[:first]):
        words = list(row)
        if not any(words):
            if found:
                break
            continue
        words[0] = words[0].lstrip("".join(COMMENTS) + "/ ") if words[0].startswith(COMMENTS) else words[0]
        words = words[1:] if len(words) == width + 1 and not words[0] else words
        texts = [w for w in words if w and not is_number(w, decimal)]
        if not width / 2 < len(words) <= width or len(texts) < (width + 1) // 2 or len(found) == MOST_HEADERS:
            break
        found.insert(0, words + [""] * (width - len(words)))
    if len(found) > 1 and all(not w or spelled_unit(w) for w in found[-1]):
        found[-1] = [f"[{w.strip('[]()')}]" if w else "" for w in found[-1]]
    return found


def _programmed(lines: Sequence[str]) -> bool:
    """Return whether a line has numbers in brackets or after equals signs, like the points of a robot program."""
    numbers = [line for line in lines if len(_BETWEEN_WORDS.findall(line)) >= FEWEST_NUMBERS]
    return bool(numbers) and sum(bool(re.search(r"[={\[].*\d", line)) for line in numbers) > len(numbers) / 2


def _of_the_controller(line: str, names: Sequence[str]) -> bool:
    """Return True if a line of a robot program is a Cartesian position computed by the controller.
    Examples are a robtarget of ABB, an E6POS of KUKA or a position of Fanuc."""
    words = " ".join(name.split(" ")[0] for name in names)
    return bool(_ROBTARGET.search(line) or _POSE.search(words)) and not _AXES.search(words)


def _between_words(text: str, path: Path) -> Sheet:
    """Extract the numbers from lines that differ in numbers only, as `A1 -12.5,A2 30` or `[[1.5,2,3],[1,0,0,0]]`."""
    if kind := _POSTYPE.search(text):
        what = "pulses of the encoders" if kind[1] == "PULSE" else "positions that the controller computed"
        raise InputError(f"{path.name}: a job with {what}; expected joint values in degrees")
    whole = re.sub(r"\{[^{}]*\}", lambda found: " ".join(found[0].split()), text)
    alike: dict[tuple[str, ...], list[list[str]]] = {}
    own = 0
    for line in whole.splitlines():
        found = _BETWEEN_WORDS.findall(line)
        names = tuple(f"{word} [{unit}]" if unit else word for word, _, unit in found)
        names = AXIS_NAMES if JOINT_TARGET.search(line) and not any(names) and len(names) == len(AXIS_NAMES) else names
        point = re.search(r"(\w+)\s*:?=", line)
        if _of_the_controller(line, names):
            own += 1
        elif len(found) >= FEWEST_NUMBERS:
            alike.setdefault(names, []).append([point[1] if point else "", *(number for _, number, _ in found)])
    if own > 2 * max(map(len, alike.values()), default=0):
        raise InputError(
            f"{path.name}: {own} positions that the controller computed, and no joint values; expected joint values "
            "(jointtarget of ABB, E6AXIS of KUKA, joint representation of Fanuc)"
        )
    if not alike:
        raise InputError(f"{path.name}: no line of {FEWEST_NUMBERS} numbers; expected a table, a row a pose")
    names, rows = max(alike.items(), key=lambda item: len(item[1]) * len(item[0]))
    said = f"{len(rows)} lines of a program that differ in {len(names)} numbers"
    said += f"; {own} positions of the controller left out" * bool(own)
    return Sheet(("point", *names), pd.DataFrame(rows, dtype=object).replace("", None), (said,), path.name)
