"""Join two files of one measurement session row by row: in order, by a common column, or by time."""

import re
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import IntArray
from gpmodel.errors import InputError
from gpmodel.table.foreign import column_of
from gpmodel.table.layout import Sheet, read_sheets
from gpmodel.wording import some

ORDER, ROWS = "order", "rows "
COMMON = 0.5
"""Least share of the shorter file's rows that have a partner with an equal value of a common column, for a join."""
_STRETCH = re.compile(r"^\s*(\d{1,7})-(\d{1,7}) *= *(\d{1,7})-(\d{1,7})\s*$")
_LAST_NUMBER = re.compile(r"(\d+)\D*$")


def sheets_of(paths: Sequence[Path], header: bool = True) -> list[Sheet]:
    """Read one file or two; one Excel file may hold two sheets.
    Raises InputError for an unreadable file, and for more than two files."""
    sheets = [sheet for path in paths for sheet in read_sheets(path, header)[: max(2 // len(paths), 1)]]
    if len(paths) > 2:
        raise InputError(
            f"{paths[2]}: a third file; expected one file, or one file of joint values and one of positions"
        )
    return sheets


def read_files(paths: Sequence[Path], how: str, header: bool = True) -> Sheet:
    """Read one table file, or join two. Raises InputError for an unreadable file or an impossible join."""
    sheets = sheets_of(paths, header)
    if len(sheets) == 1 and how:
        raise InputError(f"{paths[0].name} alone; expected a second file that is joined by '{how}'", "join")
    return sheets[0] if len(paths) == 1 and not how else joined(sheets[0], sheets[1], how or ORDER)


def ways(first: Sheet, second: Sheet) -> Iterator[str]:
    """Yield the ways in which two sheets can be joined, the most reliable first.
    The most reliable joins are by columns with common texts or point numbers, then by clock times, then by the order of
    equally many rows."""
    ours, theirs = ({i: _keys(sheet, i) for i in sheet.columns} for sheet in (first, second))
    for i, one in ours.items():
        for k, other in theirs.items():
            if one.is_unique and len(set(one) & set(other)) >= max(COMMON * min(len(one), len(set(other))), 2):
                yield f"c{i + 1} = c{k + 1}"
    clocks = [[i for i in sheet.columns if sheet.seconds(i) is not None] for sheet in (first, second)]
    yield from (f"time c{i + 1} = c{k + 1}" for i, k in product(*clocks))
    if len(first.cells) == len(second.cells):
        yield ORDER


def joined(first: Sheet, second: Sheet, how: str) -> Sheet:
    """Join the rows of two sheets; the field `said` lists rows without a partner.

    how: rule by which rows are joined. `order`; `No = Point`, a column of each sheet, or one name for both; `time t =
    Time Stamp`, the row of the first sheet nearest in time to each row of the second; `rows 1-6 = 1-6, 8-40 = 7-39`.
    Raises InputError if the join is impossible.
    """
    if how == ORDER:
        if len(first.cells) != len(second.cells):
            message = f"{len(first.cells)} rows, {second.source} has {len(second.cells)}"
            raise InputError(
                f"{first.source}: {message}; expected equal numbers, or --join with a column of both files"
            )
        return _beside(first, second, np.arange(len(first.cells)), np.arange(len(second.cells)), how)
    if how.startswith(ROWS):
        pairs = np.array([pair for text in how.removeprefix(ROWS).split(",") for pair in _stretch(text)])
        if (pairs < 0).any() or (pairs >= [len(first.cells), len(second.cells)]).any():
            raise InputError(
                f"join: '{how[:60]}'; expected rows within both files: {first.source} has {len(first.cells)} rows, "
                f"{second.source} {len(second.cells)}"
            )
        return _beside(first, second, pairs[:, 0], pairs[:, 1], "nearest pose")
    by_time = how.startswith("time ")
    left, _, right = how.removeprefix("time ").partition("=")
    i = column_of(first, left.strip(), "join")
    k = column_of(second, (right or left).strip(), "join")
    if by_time:
        one, other = _clock(first, i), _clock(second, k)
        order = np.argsort(one)
        after = np.clip(np.searchsorted(one[order], other), 1, len(one) - 1)
        earlier = other - one[order][after - 1] < one[order][after] - other
        return _beside(first, second, order[after - earlier], np.arange(len(other)), how)
    places = {key: row for row, key in enumerate(_keys(first, i))}
    rows = np.array([(places[key], row) for row, key in enumerate(_keys(second, k)) if key in places])
    if not len(rows):
        raise InputError(f"join: {first.source} and {second.source} have no common value of '{how}'")
    return _beside(first, second, rows[:, 0], rows[:, 1], how)


def rows_side_by_side(pairs: IntArray) -> str:
    """Write pairs of row numbers, counted from 0, as a rule of a join: `rows 1-6 = 1-6, 8-40 = 7-39`."""
    parts = np.split(pairs, np.flatnonzero((np.diff(pairs, axis=0) != 1).any(axis=1)) + 1)
    ends = [(part[0] + 1, part[-1] + 1) for part in parts]
    return ROWS + ", ".join(f"{a[0]}-{b[0]} = {a[1]}-{b[1]}" for a, b in ends)


def _stretch(text: str) -> list[tuple[int, int]]:
    """Parse `8-40 = 7-39` into pairs of row numbers, counted from 0. Raises InputError for other text."""
    found = _STRETCH.match(text)
    numbers = [int(word) - 1 for word in found.groups()] if found else [0, 0, 0, 1]
    if numbers[1] - numbers[0] != numbers[3] - numbers[2]:
        raise InputError(
            f"join: '{text.strip()[:60]}'; expected equal numbers of rows, as in rows 1-6 = 1-6, 8-40 = 7-39"
        )
    return list(zip(range(numbers[0], numbers[1] + 1), range(numbers[2], numbers[3] + 1), strict=True))


def _clock(sheet: Sheet, column: int) -> np.ndarray:
    """Return the seconds of the day of a column of clock times, or the values of a column of numbers."""
    if sheet.seconds(column) is None:
        if (values := sheet.numbers(column)) is None:
            raise InputError(f"join: {sheet.source}, column {column + 1}: no times; expected clock times or numbers")
        return values.to_numpy()
    stamps = pd.to_datetime(
        sheet.cells[column].str.extract(r"(\d+:\d+(?::\d+(?:[.,]\d+)?)?)")[0].str.replace(",", "."), format="mixed"
    )
    return (stamps.dt.hour * 3600 + stamps.dt.minute * 60 + stamps.dt.second + 1e-6 * stamps.dt.microsecond).to_numpy()


def _keys(sheet: Sheet, column: int) -> "pd.Series[str]":
    """Return the identifier of each row's point: the text of its cell, or the last whole number in the cell."""
    text = sheet.cells[column].fillna("").astype(str).str.strip().str.casefold()
    if text.str.contains(r"\d[.:]\d").any() or (text == "").any():
        return pd.Series([f"{column} {row} {sheet.source}" for row in range(len(text))])
    numbers = text.str.extract(_LAST_NUMBER)[0].str.lstrip("0")
    return text if numbers.isna().any() else numbers


def _beside(first: Sheet, second: Sheet, one: np.ndarray, other: np.ndarray, how: str) -> Sheet:
    left = first.cells.iloc[one].reset_index(drop=True)
    right = second.cells.iloc[other].reset_index(drop=True)
    cells = pd.concat([left, right], axis=1)
    cells.columns = pd.RangeIndex(cells.shape[1])
    said = [f"{first.source} and {second.source} joined by {how}: {len(cells)} rows"]
    for sheet, rows in ((first, one), (second, other)):
        lost = sorted(set(range(len(sheet.cells))) - set(rows.tolist()))
        if lost and not (how.startswith("time") and sheet is first):
            said.append(f"rows of {sheet.source} without a partner: {some([row + 1 for row in lost])}")
    return Sheet(
        first.names + second.names, cells, (*first.said, *second.said, *said), f"{first.source} + {second.source}"
    )
