"""The film and its orifices from the keys of a TOML table."""

from dataclasses import fields

from gpmodel.errors import InputError, choices
from joints.film import FilmGeometry
from joints.limits import require
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.settings import Settings


def film_geometry(settings: Settings, ball_radius: float | None = None) -> FilmGeometry:
    """The film's geometry from the keys of a TOML table, which are called as its fields. Raises InputError for numbers
    that no film has, a clearance as large as the ball among them."""
    given = settings if ball_radius is None else {**settings, "ball_radius": ball_radius}
    film = FilmGeometry(**{field.name: given[field.name] for field in fields(FilmGeometry)})
    require(film.clearance < film.ball_radius, "radial clearance", film.clearance, "less than the ball radius")
    return film


def orifice_law(settings: Settings) -> Orifice:
    """The orifice an [orifice] table describes. Raises InputError for a number that either law cannot have."""
    laws: dict[str, Orifice] = {
        "linear": LinearOrifice(settings["slope"], settings["offset"]),
        "nozzle": NozzleOrifice(settings["diameter"], settings["discharge"], settings["temperature"]),
    }
    if settings["law"] not in laws:
        raise InputError(f"orifice.law = '{settings['law']}', expected {choices(settings['law'], laws)}")
    return laws[settings["law"]]
