"""`gpmodel joint stiffness`: predicted force-displacement curve, and the regimes of a measured curve."""

from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from joints import figures
from joints.film import film_geometry, orifice_law
from joints.settings import Settings, curve_of, load_settings, not_negative, positive, require
from joints.stiffness import (
    RegimeCurve,
    contact_tension,
    fit_regimes,
    layer_stiffness,
    lifted_tension,
    magnet_force,
    rest_displacement,
)
from joints.studies.study import MICRO, N_PER_UM, Study, Table

_UNITS = {
    "contact_stiffness": ("N/um", N_PER_UM),
    "transition_stiffness": ("N/um", N_PER_UM),
    "film_stiffness": ("N/um", N_PER_UM),
    "peak_force": ("N", 1.0),
    "contact_end": ("um", MICRO),
    "transition_end": ("um", MICRO),
    "film_end": ("um", MICRO),
    "stand_off": ("um", MICRO),
}

_PREDICTED = (
    "Replica layer [N/um]", "Brass tube [N/um]", "Rest [um]", "Magnets at rest [N]", "Film and magnets [N/um]",
)  # fmt: skip


def stiffness_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate contact stiffnesses, the force-displacement curve of Fig 4.14, and the four regimes fitted to measured
    or simulated data."""
    s = load_settings("stiffness", path)
    replica, tube = (float(layer_stiffness(**s[name])) for name in ("replica", "tube"))
    geometry, orifice = film_geometry(s["film"]), orifice_law(s["orifice"])
    rest = rest_displacement(geometry, orifice, s["inlet_pressure"], s["preload"], s["stand_off"])
    x = np.linspace(-1e-6, max(3 * rest, 100e-6), 400)

    def tension(inlet: float, x: Array) -> Array:
        lifted = lifted_tension(geometry, orifice, inlet, s["preload"], s["stand_off"], np.maximum(x, 0.0))
        return lifted + contact_tension(tube, x)

    curves = {name: tension(inlet, x) for name, inlet in (("air on", s["inlet_pressure"]), ("no air", 0.0))}
    step = np.array([-1e-8, 1e-8]) + max(rest, 1e-8)
    pulled = tension(s["inlet_pressure"], step)
    predicted = {
        "replica_N_per_um": replica * N_PER_UM,
        "tube_N_per_um": tube * N_PER_UM,
        "rest_displacement_um": rest * MICRO,
        "pull_at_rest_N": float(magnet_force(rest, s["preload"], s["stand_off"])),
        "film_and_magnet_N_per_um": float(np.diff(pulled)[0] / np.diff(step)[0]) * N_PER_UM,
    }
    displacement, force, source = _measured(s["measured"], path, seed)
    fit = fit_regimes(displacement, force)
    rows = [
        (name, getattr(fit.curve, name) * scale, fit.stderr[name] * scale, unit)
        for name, (unit, scale) in _UNITS.items()
    ]
    coefficient, error = fit.curve.magnet_coefficient, fit.stderr["magnet_coefficient"]
    rows.append(("magnet_coefficient", coefficient * 1e6, error * 1e6, "N mm^2"))
    return Study(
        (
            Table("Predicted", _PREDICTED, [tuple(predicted.values())]),
            Table(
                f"Regimes of {source}: rms residual {fit.rms:.3g} N, {fit.status}",
                ("Quantity", "Value", "Standard error", "Unit"),
                rows,
            ),
        ),
        {
            "predicted": predicted,
            "fit": {
                "source": source,
                "status": fit.status,
                "rms_N": fit.rms,
                "values": {row[0]: {"value": row[1], "stderr": row[2], "unit": row[3]} for row in rows},
            },
        },
        {
            "stiffness_predicted.png": figures.stiffness_predicted(x, curves, rest),
            "stiffness_regimes.png": figures.stiffness_regimes(displacement, force, fit.curve, source),
        },
    )


def _measured(s: Settings, path: Path | None, seed: int) -> tuple[Array, Array, str]:
    if curve := curve_of(s, path, {"displacement": "um", "force": "N"}):
        return curve["displacement"], curve["force"], s["file"]
    require(12 <= s["rows"] <= 10_000, "measured.rows", s["rows"], "12 to 10000")
    not_negative("measured.noise", s["noise"], "N")
    for name, (unit, scale) in _UNITS.items():
        if unit.startswith("N"):
            positive(f"measured.{name}", s[name] / scale, unit)
    truth = RegimeCurve(**{name: s[name] for name in _UNITS})
    reach = truth.film_end - truth.contact_end
    x = np.linspace(truth.contact_end - 0.12 * reach, truth.film_end + 4 * reach, s["rows"])
    noise = np.random.default_rng(seed).normal(0.0, s["noise"], x.size)
    return x, truth.force(x) + noise, "simulated data (no file given)"
