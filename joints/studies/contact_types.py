"""`gpmodel joint contact_types`: the four prototypes and what was measured of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from matplotlib.figure import Figure

from gpmodel.errors import InputError
from joints import figures
from joints.settings import DATA, positive, quantity, read_toml
from joints.studies.study import MICRO, Study, Table

LENGTHS = ("predicted_max", "sphere_fit_max", "calibrated_max")


class ContactType(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """supports: discrete contacts, 0 for a surface. Maxima: m, None where none was published. figure: their source."""

    name: str
    contact: str
    supports: Annotated[int, msgspec.Meta(ge=0)]
    friction: str
    predicted_max: float | None
    sphere_fit_max: float | None
    calibrated_max: float | None
    figure: str


def contact_types(path: Path | None = None) -> tuple[ContactType, ...]:
    """The contact types of a TOML table ([[type]] entries), the thesis' four without one.

    Raises InputError for a missing or unknown key, or a length without its unit.
    """
    file = path or DATA / "contact_types.toml"
    entries = read_toml(file).get("type", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries) or not entries:
        keys = ", ".join(ContactType.__struct_fields__)
        raise InputError(f"{file.name}: no contact type; expected [[type]] entries with {keys}")
    return tuple(_entry(e, f"{file.name}, type {i}") for i, e in enumerate(entries, 1))


def _entry(entry: dict[str, Any], where: str) -> ContactType:
    lengths = {k: _length(entry[k], f"{where}: {k}") for k in LENGTHS if k in entry}
    try:
        return msgspec.convert({**entry, **lengths}, ContactType)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None


def _length(text: Any, where: str) -> float | None:
    return None if text == "" else float(positive(where, quantity(text, "10 um", where), "m"))


def contact_types_study(path: Path | None = None, seed: int = 0) -> Study:
    """Figures 3.29 and 4.30: largest residuals before and after calibration, by contact type."""
    types = contact_types(path)
    largest = (["" if v is None else v * MICRO for v in (getattr(t, key) for key in LENGTHS)] for t in types)
    rows = [(t.name, t.contact, t.friction, *of, t.figure) for t, of in zip(types, largest, strict=True)]
    columns = ("type", "contact", "friction", "predicted [um]", "sphere fit [um]", "calibrated [um]", "source")
    return Study(
        tables=(Table("Largest residual by contact type", columns, rows, "empty: not printed in the text"),),
        data={"types_m": msgspec.to_builtins(types)},
        figures={"contact_types.png": figures.drawn(7.0, contact_chart, types)},
    )


def contact_chart(figure: Figure, types: Sequence[ContactType]) -> None:
    """Largest residual of every prototype, predicted and before and after calibration (Figs 3.29, 4.30)."""
    ax = figure.subplots()
    at = np.arange(len(types))
    for k, (name, key) in enumerate(
        (("predicted", "predicted_max"), ("sphere fit", "sphere_fit_max"), ("calibrated", "calibrated_max"))
    ):
        values = [getattr(t, key) for t in types]
        ax.bar(at + 0.26 * (k - 1), [0.0 if v is None else MICRO * v for v in values], 0.24, label=name)
        for i, value in enumerate(values):
            label = "not printed" if value is None else f"{MICRO * value:g}"
            ax.annotate(label, (i + 0.26 * (k - 1), 0.0 if value is None else MICRO * value), ha="center", va="bottom",
                        rotation=90 if value is None else 0, fontsize="small")  # fmt: skip
    ax.set_xticks(at, [t.name for t in types])
    ax.set(ylabel="largest residual [µm]", title="Published accuracy of the prototypes")
    ax.legend()
