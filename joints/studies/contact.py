"""`gpmodel joint contact`, `thermal` and `contact_types`: Hertz contact of the ball on a support, as published and
exact."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from matplotlib.figure import Figure

from gpmodel.errors import InputError
from joints import figures
from joints.contact import (
    Body,
    HertzContact,
    LoopPart,
    allowed_temperature_change,
    first_yield_pressure,
    gap_growth,
    growth,
    hertz,
    loop_growth,
    published_hertz,
)
from joints.settings import DATA, load_settings, positive, quantity, read_toml
from joints.studies.study import MICRO, N_PER_UM, Study, Table

LENGTHS = ("predicted_max", "sphere_fit_max", "calibrated_max")


class ContactType(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A contact type of a spherical joint and its published accuracy.

    supports: number of discrete contacts, 0 for a surface.
    predicted_max, sphere_fit_max, calibrated_max: largest residuals, m, None if not published.
    figure: figure of the thesis with the residuals.
    """

    name: str
    contact: str
    supports: Annotated[int, msgspec.Meta(ge=0)]
    friction: str
    predicted_max: float | None
    sphere_fit_max: float | None
    calibrated_max: float | None
    figure: str


def contact_types(path: Path | None = None) -> tuple[ContactType, ...]:
    """Return the contact types of a TOML table ([[type]] entries), by default the four of the thesis.

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
    """Make Figures 3.29 and 4.30: largest residuals before and after calibration, by contact type of the joint."""
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
    """Plot the largest residual of every prototype: predicted, and before and after calibration (Figs 3.29, 4.30)."""
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


def thermal_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate thermal growth per kelvin and for a temperature change, and the temperature change at which the growth
    equals the tolerance."""
    s = load_settings("thermal", path)
    change, tolerance = s["temperature_change"], s["tolerance"]
    parts = [LoopPart(**part) for part in s["part"]]
    per_kelvin = {
        "socket column": float(growth(s["socket"]["length"], s["socket"]["expansion"], 1.0)),
        **{part.name: part.growth_per_kelvin for part in parts},
        "whole loop": float(loop_growth(parts, 1.0)),
        "radial gap": float(gap_growth(**s["gap"], temperature_change=1.0)),
    }
    rows = [
        (name, rate * MICRO, rate * change * MICRO, float(allowed_temperature_change(tolerance, rate)))
        for name, rate in per_kelvin.items()
    ]
    heads = ("um_per_K", "um", "allowed_K")
    return Study(
        (
            Table(
                f"Thermal growth over {change:g} K, and the change that uses up {tolerance * MICRO:g} um",
                ("Part", "Growth [um/K]", "Growth [um]", "Allowed change [K]"),
                rows,
            ),
        ),
        {
            "temperature_change_K": change,
            "tolerance_um": tolerance * MICRO,
            "growth": {row[0]: dict(zip(heads, row[1:], strict=True)) for row in rows},
        },
        {"thermal.png": figures.thermal(per_kelvin, change, tolerance)},
    )


_HEADS = (
    "Case", "a [um]", "b [um]", "Peak [GPa]", "Approach [um]", "F/approach [N/um]", "Stiffness [N/um]",
    "Peak / allowed", "Peak / first yield",
)  # fmt: skip
_KEYS = (
    "a_um", "b_um", "pressure_GPa", "approach_um", "secant_N_per_um", "tangent_N_per_um", "stress_over_allowed",
    "pressure_over_first_yield",
)  # fmt: skip


def contact_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate a Hertz contact: as in Table 3.3 (two cylinders), by Slocum's formulas with true radii, and exact."""
    s = load_settings("contact", path)
    ball, support = Body(**s["ball"]), Body(**s["support"])
    flat = s["published_major_radius"]
    cylinders = replace(ball, major_radius=flat), replace(support, major_radius=flat)
    force, angle = s["force"], s["plane_angle"]
    printed = published_hertz(force, *cylinders, angle)
    fitted = published_hertz(force, ball, support, angle)
    exact = hertz(force, ball, support, angle)
    onset = float(first_yield_pressure(s["yield_stress"], min(ball.poisson, support.poisson)))

    cases: dict[str, HertzContact] = {"as printed": printed, "printed formulas, true radii": fitted, "exact": exact}
    allowed = float(positive("allowed stress", s["allowed_stress"], "Pa"))
    rows = [(name, *_numbers(case, force, allowed, onset)) for name, case in cases.items()]
    coefficients = {
        "equivalent_radius_m": printed.equivalent_radius, "cos_theta": printed.cos_theta, "theta_rad": printed.theta,
        "alpha": printed.alpha, "beta": printed.beta, "lambda": printed.lam,
    }  # fmt: skip
    forces = np.linspace(force / 50, 2 * force, 100)
    return Study(
        (
            Table(
                f"Hertz contact at {force:g} N",
                _HEADS,
                rows,
                "first yield: Tresca below a circular contact, peak = 1.61 x yield stress for nu = 0.3",
            ),
            Table(
                "Coefficients of Table 3.3, as printed",
                ("Re [m]", "cos theta", "theta [rad]", "alpha", "beta", "lambda"),
                [tuple(coefficients.values())],
            ),
        ),
        {
            "force_N": force,
            "cases": {row[0]: dict(zip(_KEYS, row[1:], strict=True)) for row in rows},
            "published_coefficients": coefficients,
            "first_yield_pressure_GPa": onset * 1e-9,
        },
        {
            "contact.png": figures.contact(
                forces, published_hertz(forces, *cylinders, angle), hertz(forces, ball, support, angle), onset
            )
        },
    )


def _numbers(case: HertzContact, force: float, allowed: float, onset: float) -> tuple[float, ...]:
    """Return a row of the table of Hertz contacts, in the order of its columns."""
    major, minor, peak, approach = map(float, (case.semi_major, case.semi_minor, case.pressure, case.approach))
    stiffness = (force / approach * N_PER_UM, 1.5 * force / approach * N_PER_UM)
    return major * MICRO, minor * MICRO, peak * 1e-9, approach * MICRO, *stiffness, peak / allowed, peak / onset
