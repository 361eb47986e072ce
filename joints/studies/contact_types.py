"""`gpmodel joint contact_types`: the four prototypes and what was measured of them."""

from dataclasses import asdict
from pathlib import Path

from joints import figures
from joints.contact_types import contact_types
from joints.sphere_charts import contact_chart
from joints.studies.study import MICRO, Study, Table


def contact_types_study(path: Path | None = None, seed: int = 0) -> Study:
    """Figures 3.29 and 4.30: largest residuals before and after calibration, by contact type."""
    types = contact_types(path)
    largest = ((t.predicted_max, t.sphere_fit_max, t.calibrated_max) for t in types)
    rows = [(t.name, t.contact, t.friction, *map(_um, of), t.figure) for t, of in zip(types, largest, strict=True)]
    columns = ("type", "contact", "friction", "predicted [um]", "sphere fit [um]", "calibrated [um]", "source")
    return Study(
        tables=(Table("Largest residual by contact type", columns, rows, "empty: not printed in the text"),),
        data={"types_m": [asdict(t) for t in types]},
        figures={"contact_types.png": figures.drawn(7.0, contact_chart, types)},
    )


def _um(value: float | None) -> float | str:
    return "" if value is None else value * MICRO
