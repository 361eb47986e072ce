"""Result classes of a study: tables, numbers, figures and pages."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

MICRO = 1e6
DPI = 110
N_PER_UM = 1e-6


@dataclass(frozen=True)
class Table:
    """A printed table with units in the column heads."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""


@dataclass(frozen=True)
class Study:
    """Result of a study: tables to print, `data` for JSON (units in the keys), figures and HTML pages by file name."""

    tables: Sequence[Table]
    data: Mapping[str, object]
    figures: Mapping[str, Figure] = field(default_factory=dict)
    pages: Mapping[str, str] = field(default_factory=dict)


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=DPI, metadata={"Software": None})
    return image.getvalue()
