"""Read measured tables from files or data frames."""

import hashlib
import html
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gpmodel.api.arguments import MechanismLike, brief, check_bool, file_path, mechanism_of, to_si
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import LARGEST, Mechanism
from gpmodel.mechanism.source import choice_of
from gpmodel.model.described import KINDS
from gpmodel.model.instruments import with_observations
from gpmodel.model.observation import Orientation, Weights, observations, weight_of
from gpmodel.progress import Progress, Say
from gpmodel.table.cells import frame_of, read_frame
from gpmodel.table.convention import Convention, with_joint_columns
from gpmodel.table.dataset import EXPECTED, TOUCHED, Dataset, specification, with_payload
from gpmodel.table.read import dataset_from
from gpmodel.table.robot_programs import is_program, program_frame, read_program
from gpmodel.table.units import DIMENSIONS, JOINT_UNITS, factor_like, split_quantity
from gpmodel.texts import read_toml


def aligned(rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Format rows of cells as lines with aligned columns: the first `left` columns left-aligned, the others
    right-aligned."""
    table = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    )


class Shown:
    """Base class of results that a notebook shows as a summary and, if `_with_rows`, a table of rows."""

    _with_rows = True

    if TYPE_CHECKING:

        def summary(self) -> str:
            """Return the result as text to print."""

        def to_dataframe(self) -> pd.DataFrame:
            """Return the rows of the result as a DataFrame."""

    def _repr_html_(self) -> str:
        table = self.to_dataframe().to_html(index=False, max_rows=20) if self._with_rows else ""
        return f"<pre>{html.escape(self.summary())}</pre>{table}"


TableLike = Dataset | pd.DataFrame | str | Path
"""Types accepted as a table of poses. Poses without measurements may also be an array of joint values, rad and m."""
Described = Mapping[str, object] | str | Path | None
"""Type of an argument that is the content or the path of a TOML file."""

LARGE = 4 << 20
"""Size of a table file, bytes, that is read in a second (about 30 000 poses). A message announces larger tables."""


@dataclass(frozen=True)
class Cells:
    """A table as given by the user, and its cells as text (missing if empty). path: name of the table in messages."""

    given: pd.DataFrame
    text: pd.DataFrame
    path: Path
    sha256: str


CORRECTED = "corrected_"
"""Prefix of the column names of corrected joint values in tables from `compensate`."""


def read_table(
    table: TableLike, mechanism: MechanismLike, *, in_order: bool = False, cameras: Described = None,
    board: Described = None, surfaces: Described = None,
) -> Dataset:  # fmt: skip
    """Read measured poses of a mechanism from a .csv or .xlsx file or from a data frame.

    Headers contain units in brackets: `J1 [deg]`, `x [mm]`, `temperature [degC]`. A payload of the mechanism applies to
    every row of the table.
    mechanism: a mechanism object, a name or a file.
    in_order: the rows are in the order of measurement, so that an effect may depend on earlier poses. A time column
    that never decreases implies the order of measurement.
    cameras, board, surfaces: descriptions of cameras, boards and touched surfaces, as TOML files or their content.
    Raises InputError for a missing or empty file, a column with an unknown or missing unit, missing or surplus joints,
    text among numbers, no measurement, a payload column if the mechanism has a payload, or joint values of
    `compensate` beside those of the poses.
    """
    arm, in_order = mechanism_of(mechanism), check_bool(in_order, "in_order")
    given = described(cameras, board, surfaces)
    dataset = dataset_of(table, arm, need_measurement=True, described=given)
    if sent := [name for name in dataset.extras if name.startswith(CORRECTED)]:
        own = sent[0].removeprefix(CORRECTED)
        raise InputError(
            f"{dataset.source}: columns '{own}' and '{sent[0]}': at which of them was the row measured? expected the "
            f"joint values of the measured poses in '{own}', ..., and no column {CORRECTED}JOINT"
        )
    check_named(dataset, given)
    if choice_of(arm).payload_com is not None and choice_of(arm).payload is None and not dataset.payload_given:
        said = f"{dataset.source} has no payload; expected a payload or a column 'payload [kg]' too"
        raise InputError(said, "payload_com")
    return replace(dataset, in_order=True) if in_order else dataset


def specified(dataset: Dataset, instrument: object) -> Dataset:
    """Add the specification of the instrument to a table; unchanged for None. Raises InputError if invalid."""
    if instrument is None:
        return dataset
    if not isinstance(instrument, str):
        raise InputError(f"{brief(instrument)}, {EXPECTED}", "instrument")
    return replace(dataset, instrument=specification(instrument))


def described(
    cameras: Described = None, board: Described = None, surfaces: Described = None
) -> dict[str, Mapping[str, object]]:
    """Return the descriptions of cameras, boards and surfaces as TOML content; raise InputError if unreadable."""
    given = dict(zip(KINDS, (cameras, board, surfaces), strict=True))
    return {
        name: value if isinstance(value, Mapping) else read_toml(file_path(value, name), f"a description of {name}")
        for name, value in given.items()
        if value is not None
    }


def check_named(dataset: Dataset, given: Collection[str]) -> None:
    """Raise InputError naming the argument if a described camera, board or surface does not occur in the table."""
    for name, columns in (("cameras", ("u", "v")), ("board", ("u", "v")), ("surfaces", TOUCHED)):
        if name in given and not {*dataset.readings, *dataset.labels} & {*columns}:
            raise InputError(
                f"{dataset.source} has no column {' or '.join(columns)}; expected a table with this column", name
            )


def dataset_of(
    source: TableLike, mechanism: Mechanism, *, need_measurement: bool, argument: str = "table",
    described: Mapping[str, Mapping[str, object]] | None = None,
) -> Dataset:  # fmt: skip
    """Read a table for a mechanism; accept poses without measurements if `need_measurement` is False.

    argument: name of the argument in messages. Raises InputError for a table that cannot be read, or whose joints are
    not those of the mechanism.
    """
    payload = choice_of(mechanism).payload
    if isinstance(source, np.ndarray) and not need_measurement:
        source = _frame_of_array(source, mechanism, argument)
    if isinstance(source, Dataset):
        named = tuple(joint.name for joint in mechanism.joints)
        if source.joints != named:
            raise InputError(
                f"{source.source} was read for joints {', '.join(source.joints)}; expected {', '.join(named)}", argument
            )
        carried = payload is not None and not source.payload_given
        source = with_payload(source, payload) if carried else source
        return with_observations(source, mechanism, described) if described else source
    cells = cells_of(source, argument)
    dataset = dataset_from(cells.text, cells.path, mechanism, need_measurement=need_measurement, sha256=cells.sha256)
    if need_measurement:
        dataset = with_observations(dataset, mechanism, described)
    return with_payload(dataset, payload)


def in_metres(
    value: str | float, dataset: Dataset, name: str, most: Mapping[str, float] = LARGEST, weights: Weights | None = None
) -> float:
    """Convert the size of one measurement, text with a unit, to metres by the weights of a fit.

    The unit names the first kind of measurement in the table that is measured in such a unit.
    Raises InputError naming the argument for a unit that no measurement of the table has, or a value above `most`.
    """
    _, unit = (isinstance(value, str) and split_quantity(value)) or (0.0, "")
    for kind in observations(dataset):
        if kind.readings.any() and not isinstance(kind, Orientation) and factor_like(unit, kind.unit) is not None:
            size = to_si(value, DIMENSIONS[kind.unit], name, positive=True, most=most)
            return weight_of(kind, weights or {}) * size
    return to_si(value, "length", name, positive=True, most=most)


def announce_reading(source: TableLike, progress: Say) -> None:
    """Announce that a large table is being read."""
    with suppress(OSError, ValueError):  # the reader reports such errors
        if isinstance(source, str | Path) and os.path.isfile(source) and Path(source).stat().st_size > LARGE:
            progress(Progress("reading the table"))


def cells_of(source: pd.DataFrame | str | Path, argument: str = "table") -> Cells:
    """Return the cells of a file or data frame; raise InputError for an empty table or an object of a different
    type."""
    if isinstance(source, str | Path) and str(source):
        path = Path(source)
        frame, digest = read_frame(path)
        return Cells(frame, frame, path, digest)
    if not isinstance(source, pd.DataFrame):
        raise InputError(f"{brief(source)}, expected a file or a pandas.DataFrame", argument)
    if source.empty:
        raise InputError("the data frame has no rows; expected one row per pose", argument)
    kept = source.reset_index(drop=True)
    text = pd.DataFrame({i: kept.iloc[:, i].map(_cell) for i in range(kept.shape[1])}, dtype=object)
    text.columns = pd.Index([str(header) for header in kept.columns])
    digest = hashlib.sha256(kept.to_csv(index=False).encode()).hexdigest()
    return Cells(kept, text, Path("data frame"), digest)


def frame_to_extend(
    source: TableLike, mechanism: Mechanism, argument: str, convention: Convention | None = None
) -> tuple[pd.DataFrame, pd.DataFrame, Path]:
    """Return the data frame that gets new columns, its cells as text, and its name in messages.

    Joint values of a robot program, or of columns controller_AXIS alone, are converted from the convention of the
    controller to that of the description.
    """
    if isinstance(source, Dataset):
        frame = frame_of(source, mechanism)
        return frame, frame, Path(source.source)
    if isinstance(source, str | Path) and is_program(source):
        path = file_path(source, argument)
        frame = program_frame(read_program(path), mechanism, convention)
        return frame, frame, path
    if isinstance(source, np.ndarray):
        source = _frame_of_array(source, mechanism, argument)
    cells = cells_of(source, argument)
    text = with_joint_columns(cells.text, cells.path, mechanism, "" if convention is None else convention.text)
    return cells.given, text, cells.path


def with_numbers(frame: pd.DataFrame) -> pd.DataFrame:
    """Convert text columns that hold only numbers to numbers; columns with other text are unchanged."""
    out = frame.copy()
    for name in out.columns[
        out.dtypes.map(pd.api.types.is_object_dtype) | out.dtypes.map(pd.api.types.is_string_dtype)
    ]:
        values = pd.to_numeric(out[name], errors="coerce")
        if values.notna().any() and values.notna().equals(out[name].notna()):
            out[name] = values
    return out


def _frame_of_array(values: Array, mechanism: Mechanism, argument: str) -> pd.DataFrame:
    """Return a data frame of joint values, rad and m, one row a pose.

    Raises InputError unless the array has one column per joint.
    """
    joints = mechanism.joints
    if values.ndim != 2 or values.shape[1] != len(joints) or values.dtype.kind not in "fiu":
        said = " x ".join(map(str, values.shape))
        raise InputError(
            f"an array of {said}, expected numbers, one row a pose and {len(joints)} joint values", argument
        )
    return pd.DataFrame(values, columns=[f"{joint.name} [{JOINT_UNITS[joint.kind]}]" for joint in joints])


def _cell(value: object) -> str | None:
    return None if value is None or value is pd.NA or value != value else str(value)
