"""`gpmodel joint contact`: Hertz contact of the ball on a support, as published and right."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from joints import figures
from joints.contact import Body, HertzContact, first_yield_pressure, hertz, published_hertz
from joints.settings import load_settings, positive
from joints.studies.study import MICRO, N_PER_UM, Study, Table

_HEADS = (
    "Case", "a [um]", "b [um]", "Peak [GPa]", "Approach [um]", "F/approach [N/um]", "Stiffness [N/um]",
    "Peak / allowed", "Peak / first yield",
)  # fmt: skip
_KEYS = (
    "a_um", "b_um", "pressure_GPa", "approach_um", "secant_N_per_um", "tangent_N_per_um", "stress_over_allowed",
    "pressure_over_first_yield",
)  # fmt: skip


def contact_study(path: Path | None = None, seed: int = 0) -> Study:
    """Table 3.3 as printed (two cylinders), with its formulas on the true radii, and exact."""
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
    """A row of the table: what _KEYS say."""
    major, minor, peak, approach = map(float, (case.semi_major, case.semi_minor, case.pressure, case.approach))
    stiffness = (force / approach * N_PER_UM, 1.5 * force / approach * N_PER_UM)
    return major * MICRO, minor * MICRO, peak * 1e-9, approach * MICRO, *stiffness, peak / allowed, peak / onset
