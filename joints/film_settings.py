"""The film and its orifices from the keys of a TOML table."""

from dataclasses import fields

from gpmodel.errors import InputError
from joints.film import FilmGeometry
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.settings import Settings


def film_geometry(settings: Settings, ball_radius: float | None = None) -> FilmGeometry:
    """The film's geometry from the keys of a TOML table, which are called as its fields."""
    given = settings if ball_radius is None else {**settings, "ball_radius": ball_radius}
    return FilmGeometry(**{field.name: given[field.name] for field in fields(FilmGeometry)})


def orifice_law(settings: Settings) -> Orifice:
    """The orifice an [orifice] table describes."""
    if settings["law"] == "linear":
        return LinearOrifice(settings["slope"], settings["offset"])
    if settings["law"] == "nozzle":
        return NozzleOrifice(settings["diameter"], settings["discharge"], settings["temperature"])
    raise InputError(f"orifice.law = '{settings['law']}', expected 'linear' or 'nozzle'")
