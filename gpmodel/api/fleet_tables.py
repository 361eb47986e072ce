"""The machines of a fleet, each with its table."""

from collections.abc import Mapping
from pathlib import Path

from gpmodel.api.arguments import file_path
from gpmodel.api.calibrate import checked_poses
from gpmodel.api.mechanism import MechanismLike, mechanism_of
from gpmodel.api.table import TableLike
from gpmodel.errors import InputError
from gpmodel.hierarchy.folder import folder_of_tables
from gpmodel.hierarchy.record import check_serial
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Poses

Machines = Mapping[str, tuple[Mechanism, Poses]]


def machines_of(mechanism: MechanismLike | None, tables: str | Path | Mapping[str, TableLike]) -> Machines:
    """The machines by serial, their tables judged. Raises InputError for fewer than two machines, two of one serial
    or table, or a table that is not sound."""
    if not isinstance(tables, Mapping):
        folder = folder_of_tables(file_path(tables, "tables"))
        tables, mechanism = folder.tables, folder.said_mechanism if mechanism is None else mechanism
    arm = mechanism_of(mechanism)
    out: dict[str, tuple[Mechanism, Poses]] = {}
    seen: dict[tuple[str, bytes], str] = {}
    for serial, table in tables.items():
        check_serial(serial)
        try:
            out[serial] = checked_poses(arm, table)
        except InputError as error:
            known = error.said if Path(str(table)).name in error.said else f"{serial}: {error.said}"
            raise InputError(known, error.argument) from None
        dataset = out[serial][1].dataset
        rows = dataset.sha256, dataset.row.tobytes()
        if dataset.sha256 and rows in seen:
            raise InputError(f"machines '{seen[rows]}' and '{serial}' have the same table; expected one for each")
        seen[rows] = serial
    if len(out) < 2:
        raise InputError(f"{len(out)} machine; expected at least 2 of one type", "tables")
    return out
