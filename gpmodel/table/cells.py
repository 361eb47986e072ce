"""Read files as text cells, and convert cells to numbers; separators and decimal commas are recognised."""

import contextlib
import csv
import hashlib
import io
import re
import warnings
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.errors import InputError, LayoutError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.cell_units import MISSING, split_unit, unit_of_cells, with_unit
from gpmodel.table.dataset import LABELS, Dataset
from gpmodel.table.units import joint_column, split_header
from gpmodel.texts import read_limited

_DIGITS = {"deg": 9, "rad": 11}
"""Number of decimals of an angle in an output file: the last digit is a nanoradian or finer."""
CONTROLLER_DECIMALS = 4
"""Number of decimals of a degree or a millimetre that a robot controller accepts."""


def frame_of(dataset: Dataset, mechanism: Mechanism) -> pd.DataFrame:
    """Return a data set as text cells with units in the headers: joints, inputs, payload, labels and measurements.
    The units of the cells are [deg], [mm] and [kg]; a component that was not measured is an empty cell."""
    names = tuple(joint.name for joint in mechanism.joints)
    frame = replace(dataset, columns=names, kinds=tuple(joint.kind for joint in mechanism.joints), extra_names={})
    cells = frame.to_dataframe().drop(columns="row")
    nowhere = ~np.isfinite(dataset.position).any(axis=0)
    cells = cells.drop(columns=[f"{axis} [mm]" for axis in np.array(list("xyz"))[nowhere]])
    fine = {*names, *dataset.extras, "rx", "ry", "rz"}
    for header, column in cells.items():
        if pd.api.types.is_float_dtype(column):
            cells[header] = _cells(column.to_numpy(), 9 if split_header(str(header))[0] in fine else 6)
    return cells


def with_results(
    frame: pd.DataFrame, results: Mapping[str, Array | list[str]], prefixes: tuple[str, ...]
) -> pd.DataFrame:
    """Add computed columns to a table. Columns of an earlier run, with equal names or with `prefixes`, are replaced."""
    names = {split_header(header)[0] for header in results}
    old = [c for c in frame.columns if (name := split_header(str(c))[0]) in names or name.startswith(prefixes)]
    return frame.drop(columns=old).assign(**results)


def joint_table(mechanism: Mechanism, q: Array, names: Sequence[str] = ()) -> pd.DataFrame:
    """Write joint values, rad or m, as a table of poses with units in the headers.
    names: column names, by default the names of the joints."""
    columns = zip(names or [joint.name for joint in mechanism.joints], mechanism.joints, q.T, strict=True)
    return pd.DataFrame(dict(joint_column(name, joint.kind, values) for name, joint, values in columns))


def table_text(frame: pd.DataFrame, decimals: int | None = None) -> str:
    """Return a table as CSV text; missing numbers are empty cells.
    decimals: number of decimals of all numbers; by default nine for degrees, eleven for radians and six for other
    numbers."""
    cells = frame.copy()
    for header, column in frame.items():
        if pd.api.types.is_float_dtype(column):
            digits = decimals or _DIGITS.get(split_header(str(header))[1] or "", 6)
            cells[header] = _cells(column.to_numpy(dtype=float, na_value=np.nan), digits)
    return cells.to_csv(index=False, lineterminator="\n")


def _cells(values: np.ndarray, digits: int) -> list[str]:
    return ["" if np.isnan(v) else f"{v:.{digits}f}" for v in values]


LARGEST = 1e20
"""Largest accepted number in a table's cell, in any unit. A time stamp in nanoseconds since 1970 is smaller."""

LARGEST_FILE = 128 << 20
"""Largest size of an unpacked Excel table, bytes: a million poses. A table takes ten times its size in memory."""

MOST_COLUMNS = 1000
"""Largest number of columns of a table. The reading time grows with the columns; a model accepts 500 inputs."""
LONGEST_HEADER = 100_000
"""Largest number of characters of the first line of a table file: a hundred per column."""

EMPTY = "{}: the file is empty; expected a header line and one row per pose"

COMMENTS = ("#", "//", "%", "!")
"""Prefixes of comment lines in table files. No column name begins with a prefix of a comment."""
NAMES = "expected names with units, as J1 [deg]"
MOST_ABOVE, FEWEST_UNITS = 50, 3
"""Number of lines of a file in which the header is searched, and least number of units in the header: those of x, y,
z."""
SEPARATORS, OF_TABLES = ("\t", ";", ",", "|", " "), ("\t", ";", ",")
"""Separators of columns in files of any layout, and in tables whose column names contain blanks."""
FEWEST_NUMBERS = 3
"""Least number of numeric cells in a line of a file that counts as data: x, y and z."""
SNIFFED = 300
"""Number of lines of a file from which column separator and decimal sign are recognised."""
_UNIT = re.compile(r"[\[(][^\W\d_][^\])]*[\])](?=\s*(?:[,;\t\"]|$))", re.MULTILINE)
_NUMBER = re.compile(r"^[-+]?\d+,\d+(?:[eE][-+]?\d+)?$")


_TYPESET = str.maketrans("\u2212\u00a0\u202f\u2009\u2019", "-   '")
"""Minus sign, blanks and apostrophe of typeset numbers, as the characters of a keyboard."""
_POINT = re.compile(r"^[-+]?(?:\d{1,3}(?:[, ']\d{3})+|\d*)(?:\.\d*)?(?:[eE][-+]?\d+)?$")
_COMMA = re.compile(r"^[-+]?(?:\d{1,3}(?:[. ']\d{3})+|\d*)(?:,\d*)?(?:[eE][-+]?\d+)?$")
_GROUPED = {".": re.compile(r"\d[, ']\d{3}"), ",": re.compile(r"\d[. ']\d{3}")}
"""Pattern of a number with thousands separators, by decimal sign."""


def read_frame(path: Path) -> tuple[pd.DataFrame, str]:
    """Return the cells of a file as text, with decimal points and None for empty cells, and the SHA-256 of its bytes.

    Raises InputError if the file is missing, empty or unreadable, or if rows do not fit the header.
    """
    raw = read_limited(path, LARGEST_FILE, "a measured table")
    if not raw.strip():
        raise InputError(EMPTY.format(path.name))
    digest = hashlib.sha256(raw).hexdigest()
    if path.suffix.lower() in (".xlsx", ".xls"):
        first = excel_cells(raw, path)[0]
        if not first:
            raise InputError(EMPTY.format(path.name))
        names = [name or f"Unnamed: {i}" for i, name in enumerate(first[0])]
        _check_names([name for name in first[0] if name], path)
        frame = pd.DataFrame(first[1:], columns=names, dtype=object).replace("", None)
    else:
        frame = _read_text(raw, path)
    rows, names = len(frame), [str(name) for name in frame]
    frame = frame.dropna(how="all").dropna(axis="columns", how="all")
    frame.attrs["empty_rows"] = rows - len(frame)
    frame.attrs["empty_columns"] = [name for name in names if name not in frame]
    if frame.empty:
        raise InputError(f"{path.name}: no rows below the header; expected one row per pose")
    return frame.reset_index(drop=True), digest


def units_in_headers(frame: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Move units behind the numbers of a table's cells, as in `2070.7 mm`, into the headers; labels are unchanged.

    Raises InputError for two units in one column, or for another unit in the header.
    """
    out, headers = frame, list(frame.columns)
    for i, header in enumerate(frame.columns):
        name, own = split_header(str(header))
        values, unit = (
            ([], "") if name in LABELS else unit_of_cells(frame.iloc[:, i].tolist(), f"{path.name}, '{name}'")
        )
        if unit:
            out = frame.copy() if out is frame else out
            out.isetitem(i, pd.array(values, dtype=object))
            headers[i] = with_unit(str(header), own, unit, path.name)
    return out if out is frame else out.set_axis(headers, axis="columns")


def excel_cells(raw: bytes, path: Path) -> list[list[list[str]]]:
    """Return the cells of each Excel sheet that holds numbers, else of the first sheet, row by row.

    Empty Excel cells become "", decimal commas become points. Raises InputError if the file is unreadable.
    """
    try:
        _check_unpacked(raw, path)
        sheets = pd.read_excel(
            io.BytesIO(raw), header=None, sheet_name=None, dtype=str, keep_default_na=False, na_values=[""]
        )
    except ImportError:
        raise InputError(f"{path.name}: Excel tables need openpyxl; pip install 'gpmodel[excel]'") from None
    except InputError:
        raise
    except Exception as error:  # zip, xml and openpyxl errors of many kinds
        raise InputError(f"{path.name}: is no readable Excel table ({error})") from None
    cells = [_with_points(sheet.fillna("")).to_numpy(dtype=str).tolist() for sheet in sheets.values()]
    return [rows for rows in cells if any(is_number(cell, ".") for row in rows for cell in row)] or cells[:1]


def _with_points(frame: pd.DataFrame) -> pd.DataFrame:
    """Return text cells with decimal points instead of decimal commas."""
    return frame.map(
        lambda x: x.replace(",", ".") if isinstance(x, str) and _NUMBER.match(split_unit(x)[0].strip()) else x
    )


def _check_unpacked(raw: bytes, path: Path) -> None:
    """Raise InputError if an Excel table is too large when unpacked."""
    if zipfile.is_zipfile(io.BytesIO(raw)):
        size = sum(part.file_size for part in zipfile.ZipFile(io.BytesIO(raw)).infolist())
        if size > LARGEST_FILE:
            raise InputError(f"{path.name}: {size >> 20} MB unpacked, expected at most {LARGEST_FILE >> 20} MB")


def decoded(raw: bytes, path: Path) -> tuple[str, str]:
    """Return the text of a file, with plain minus signs and blanks, and its encoding: UTF-8, UTF-16, Windows-1252 or
    Latin-1.
    UTF-16 text is recognised by its byte order mark or by zeros in every other byte. Raises InputError if the file is
    not text."""
    wide = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}.get(raw[:2])
    start = raw[:200]
    if wide is None and len(start) > 9 and start[1::2].count(0) > 0.9 * len(start) // 2:
        wide = "utf-16-le"
    for encoding in (wide,) if wide else ("utf-8-sig", "cp1252", "latin-1"):
        with contextlib.suppress(UnicodeDecodeError):
            text = raw.decode(encoding).translate(_TYPESET)
            if "\0" not in text:
                return text, encoding.removesuffix("-sig")
    raise InputError(f"{path.name}: is no text; expected a table in UTF-8")


def is_number(cell: str, decimal: str) -> bool:
    """Return True if a cell is a number with the given decimal sign, with or without thousands separators and unit."""
    cell = split_unit(cell)[0]
    return bool((_COMMA if decimal == "," else _POINT).match(cell)) and any(c.isdigit() for c in cell)


def split(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without the blanks and quotes around them."""
    if separator == " " or len(line) > LONGEST_HEADER:
        return line.split()
    return [cell.strip().strip("'") for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def separator_and_decimal(lines: Sequence[str], among: Sequence[str] = SEPARATORS) -> tuple[str, str]:
    """Choose the separator and the decimal sign that give most numbers in lines with equal numbers of cells.
    Of equally good pairs of separator and sign, the most frequent separator in the first line is chosen, then the sign
    with the fewest thousands separators: 126,983 in a line with semicolons is read as 126.983."""
    lines = [line for line in lines[:SNIFFED] if line.strip()] or [""]
    best = (-1, -1, 0, ",", ".")
    for separator in among:
        rows = [split(line, separator) for line in lines]
        for decimal in ".,":
            counts = [sum(is_number(cell, decimal) for cell in row) for row in rows]
            fewest = min(FEWEST_NUMBERS, max(counts))
            wide = Counter(len(row) for row, n in zip(rows, counts, strict=True) if n >= fewest)
            usual = wide.most_common(1)[0][0] if wide else 0
            score = sum(n for row, n in zip(rows, counts, strict=True) if len(row) == usual)
            grouped = sum(bool(_GROUPED[decimal].search(cell)) for row in rows for cell in row)
            found = (score, lines[0].count(separator), -grouped, separator, decimal)
            best = max(best, found, key=lambda item: item[:3])
    return best[3:]


def _read_text(raw: bytes, path: Path) -> pd.DataFrame:
    text, _ = decoded(raw, path)
    header = text.lstrip().splitlines()[0]
    if len(header) > LONGEST_HEADER:
        message = f"expected at most {MOST_COLUMNS} columns in {LONGEST_HEADER}"
        raise InputError(f"{path.name}, line 1: a header of {len(header)} characters; {message}")
    separator, _ = separator_and_decimal(text.lstrip().splitlines(), OF_TABLES)
    names = next(csv.reader([header], delimiter=separator, skipinitialspace=True))
    if header.startswith(COMMENTS) or not np.isnan(pd.to_numeric(names[0].replace(",", "."), errors="coerce")):
        raise LayoutError(f"{path.name}, line 1: {header[:40]!r} is no header; {_header_line(text)}")
    if not _UNIT.search(header) and (below := _header_line(text)) != NAMES:
        raise LayoutError(f"{path.name}, line 1: {header[:40]!r} is no header; {below}")
    _check_names(names, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                io.StringIO(text.lstrip()), sep=separator, dtype=str, skipinitialspace=True, index_col=False,
                keep_default_na=False, na_values=[""],
            )  # fmt: skip
    except pd.errors.ParserWarning:
        raise LayoutError(
            f"{path.name}: rows have more cells than the header; expected one cell a column "
            f"(with decimal commas, separate columns by ';')"
        ) from None
    except (pd.errors.ParserError, csv.Error) as error:
        raise LayoutError(f"{path.name}: rows and header do not agree ({str(error).strip()})") from None
    if len(frame) > 1 and not text.endswith(("\n", "\r")):
        _check_end(frame, text.splitlines()[-2:], separator, path)
    return frame if separator == "," else _with_points(frame)


def _header_line(text: str) -> str:
    """Return the expected first line of a table, and the number of a lower line that has names and units, if any."""
    first = (i for i, line in enumerate(text.splitlines()[:MOST_ABOVE], 1) if len(_UNIT.findall(line)) >= FEWEST_UNITS)
    line = next(first, 0)
    return f"{NAMES}; line {line} has them, delete those above it" if line > 1 else NAMES


def _check_end(frame: pd.DataFrame, last: list[str], separator: str, path: Path) -> None:
    """Raise InputError if the file was cut within its last row.
    In a truncated file the last line has fewer cells, or its last cell fewer decimals than all rows above."""
    decimals = frame.iloc[:, -1].str.extract(r"^[^.,]*[.,]?(.*)$")[0].str.len()
    shorter = decimals.iloc[:-1].nunique() == 1 and decimals.iloc[-1] < decimals.iloc[0]
    if shorter or last[1].count(separator) < last[0].count(separator):
        end = last[1][-20:].strip()
        raise InputError(f"{path.name}: ends within a row, at '{end}'; expected whole rows: the file was cut")


def _check_names(header: list[str], path: Path) -> None:
    """Raise InputError if a header has too many columns, or a name twice, which pandas would rename."""
    if len(header) > MOST_COLUMNS:
        raise InputError(f"{path.name}: {len(header)} columns; expected at most {MOST_COLUMNS}")
    written = [name.strip() for name in header if name.strip()]
    for name in written:
        if written.count(name) > 1:
            raise LayoutError(f"{path.name}: column '{name}' appears twice; expected each name once")


_TIME_OF_DAY = r"(?i)\s*\d{1,2}:\d\d(:\d\d([.,]\d+)?)?\s*([ap]\.?m\.?)?\s*"
"""Pattern of a clock time without a date, such as 12:30:05."""
HALF_A_DAY = 43200.0
"""Half a day, s: a fall of the clock time by more means that midnight has passed."""


def clock_seconds(cells: "pd.Series[Any]") -> "pd.Series[float] | None":
    """Convert clock times in cells, with or without dates, to seconds after the first time; None without clock times.

    Clock times without dates continue past midnight if every fall from a row to the next is at least half a day. Dates
    with slashes are read only if all are equal, because the order of day and month differs between countries.
    """
    known = cells.dropna().astype(str)
    if known.empty or not known.str.contains(r"\d:\d\d").all():
        return None
    if known.str.extract(r"(\d+/\d+/\d+)")[0].nunique() > 1:
        return None
    days_first = bool(known.str.contains(r"\d\.\d").all() and not known.str.match(r"\d{4}-").any())
    stamps = pd.to_datetime(cells, errors="coerce", format="mixed", dayfirst=days_first, utc=True)
    if stamps.isna().any():
        return None
    seconds = (stamps - stamps.min()).dt.total_seconds()
    steps = seconds.diff()
    if known.str.fullmatch(_TIME_OF_DAY).all() and (steps[steps < 0.0] < -HALF_A_DAY).all():
        seconds += 2.0 * HALF_A_DAY * (steps < 0.0).cumsum()
    return seconds - seconds.min()


def numbers(column: pd.Series, where: str) -> Array:
    """Convert the cells of a column to numbers, NaN for empty cells.
    Raises InputError naming `where` for cells that are no numbers, LayoutError for cells that an import can read."""
    text = column.astype("string")
    values = pd.to_numeric(text, errors="coerce")
    unread = np.flatnonzero((values.isna() & text.notna()).to_numpy())
    for row, word in zip(unread.tolist(), text.iloc[unread].str.strip().tolist(), strict=True):
        if word:
            known = word.lower() in MISSING or is_number(word, ",") or is_number(word, ".")
            kind = LayoutError if known else InputError
            raise kind(f"{where}, row {row + 1}: '{word}' is no number; expected a number or an empty cell")
    out: Array = np.asarray(values.astype("float64").to_numpy(dtype=float, na_value=np.nan), dtype=np.float64)
    if np.isinf(out).any():
        raise InputError(f"{where}, row {int(np.flatnonzero(np.isinf(out))[0]) + 1}: infinite; expected a number")
    if np.nanmax(np.abs(out), initial=0.0) > LARGEST:
        row = int(np.nanargmax(np.abs(out)))
        raise InputError(f"{where}, row {row + 1}: {out[row]:g} is no measured value; expected at most {LARGEST:g}")
    return out
