"""What a study hands back, before anything is printed or written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gpmodel.errors import InputError
from joints.figures import Figure
from joints.film import FilmGeometry
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.settings import Settings

MICRO = 1e6
N_PER_UM = 1e-6


@dataclass(frozen=True)
class Table:
    """A printed table: units in the column heads, numbers as they are."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    note: str = ""


@dataclass(frozen=True)
class Study:
    """Tables to print, `data` for JSON (units in the key names), figures by file name."""

    tables: Sequence[Table]
    data: Mapping[str, Any]
    figures: Mapping[str, Figure] = field(default_factory=dict)


def film_geometry(settings: Settings, ball_radius: float | None = None) -> FilmGeometry:
    """The film's geometry from the keys of a TOML table."""
    return FilmGeometry(
        settings["ball_radius"] if ball_radius is None else ball_radius,
        settings["socket_angle"],
        settings["orifice_angle"],
        settings["clearance"],
        settings["orifices"],
        settings["viscosity"],
    )


def orifice_law(settings: Settings) -> Orifice:
    """The orifice an [orifice] table describes."""
    if settings["law"] == "linear":
        return LinearOrifice(settings["slope"], settings["offset"])
    if settings["law"] == "nozzle":
        return NozzleOrifice(settings["diameter"], settings["discharge"], settings["temperature"])
    raise InputError(f"orifice.law = '{settings['law']}', expected 'linear' or 'nozzle'")


def plain(value: Any) -> Any:
    """`value` with NumPy arrays and numbers as lists and Python numbers, and nan or inf as None, ready for JSON."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
