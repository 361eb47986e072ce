"""`gpmodel joint thermal`: growth of the socket, the loop and the gap."""

from pathlib import Path

from joints import figures
from joints.settings import load_settings
from joints.studies.study import MICRO, Study, Table
from joints.thermal import LoopPart, allowed_temperature_change, gap_growth, growth, loop_growth


def thermal_study(path: Path | None = None, seed: int = 0) -> Study:
    """Growth per kelvin and at the given temperature change, and the change that uses up the tolerance."""
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
