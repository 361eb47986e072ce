"""The certificate as PDF: sides of A4, drawn line by line."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Literal

from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gpmodel import wording
from gpmodel.report.certificate import Certificate, Parameter
from gpmodel.report.figures import STYLE
from gpmodel.report.picture import INK, MUTED, RULE

WIDTH, HEIGHT = 8.27, 11.69
"""Inches: A4."""
LEFT, RIGHT, TOP, BOTTOM = 0.08, 0.92, 0.945, 0.06
"""Margins of the text as shares of the side."""
STEP = 0.0145
"""Height of a line of 8 points as a share of the side."""
PER_COLUMN = 2
"""Parameters stand in this many columns."""


@dataclass(frozen=True)
class TextStyle:
    """How a text is set: its size in points, colour, weight, and which of its ends stands at its place."""

    size: float = 8.0
    colour: str = INK
    weight: Literal["normal", "bold"] = "normal"
    end: Literal["left", "right"] = "left"


PLAIN, FAINT, RIGHT_END = TextStyle(), TextStyle(colour=MUTED), TextStyle(end="right")
HEADING, BOLD_END = TextStyle(10.0, weight="bold"), TextStyle(weight="bold", end="right")
"""How its texts are set."""

Cell = tuple[float, str, TextStyle]
Row = tuple[float, list[Cell], bool]


def write_pdf(found: Certificate, path: Path) -> None:
    """Write the certificate to `path`, as many sides as it needs."""
    with rc_context(STYLE | {"pdf.fonttype": 42}), PdfPages(path, metadata={"Title": found.title}) as pdf:
        rows = list(_rows(found))
        number = 1
        while rows:
            figure = Figure(figsize=(WIDTH, HEIGHT))
            y = TOP
            while rows and y - sum(height for height, _, _ in _together(rows)) * STEP >= BOTTOM:
                height, cells, ruled = rows.pop(0)
                y -= height * STEP
                for x, text, look in cells:
                    _write(figure, x, y, text, look)
                if ruled:
                    _rule(figure, y - 0.35 * STEP)
            _write(figure, RIGHT, 0.035, f"{number}", TextStyle(7.0, MUTED, end="right"))
            _write(figure, LEFT, 0.035, found.title, TextStyle(7.0, MUTED))
            pdf.savefig(figure)
            number += 1


def _write(figure: Figure, x: float, y: float, text: str, look: TextStyle) -> None:
    figure.text(
        x, y, text, fontsize=look.size, color=look.colour, weight=look.weight, ha=look.end, va="baseline"
    )  # fmt: skip


def _together(rows: Sequence[Row]) -> Sequence[Row]:
    """The first row; with it the next one where it is a heading."""
    return rows[: 1 if rows[0][2] else 2]


def _rule(figure: Figure, y: float) -> None:
    figure.add_artist(Line2D([LEFT, RIGHT], [y, y], color=RULE, lw=0.6, transform=figure.transFigure))


def _rows(found: Certificate) -> Iterator[Row]:
    """Height in lines, cells and whether a rule follows, from the top of the first side."""
    yield 1.2, [(LEFT, found.title, TextStyle(14.0, weight="bold"))], False
    for title, lines in (("", found.particulars), ("Scope", found.scope)):
        yield from _block(title, lines)
    if found.statistics:
        heads: list[Cell] = [(0.62, "before, mm", RIGHT_END), (0.82, "after, mm", RIGHT_END)]
        yield 2.2, [(LEFT, f"Accuracy over {found.poses}", HEADING)], False
        yield 1.3, heads, True
        for name, before, after in found.statistics:
            yield 1.3, [(LEFT, name, PLAIN), (0.62, before, RIGHT_END), (0.82, after, BOLD_END)], True
    yield from _block("Repeatability", found.repeatability)
    yield from _parameters("Tool in the flange, root in the instrument's frame, ± σ", found.placement)
    yield from _block("Effects", [(name, f"{v} ± {s} {unit}") for name, v, s, unit in found.effects])
    yield from _parameters("Parameters ± σ", found.parameters)
    yield from _block("Record", found.record)
    yield 1.0, [], False
    for line in wrap(found.small_print, 132):
        yield 0.95, [(LEFT, line, TextStyle(6.5, MUTED))], False
    yield 4.0, [(LEFT, "Date, signature: ____________________________", PLAIN)], False


def _block(title: str, lines: Sequence[tuple[str, str]]) -> Iterator[Row]:
    if lines and title:
        yield 2.2, [(LEFT, title, HEADING)], False
    for name, value in lines:
        parts = wrap(value, 84) or [""]
        for k, part in enumerate(parts):
            heading: list[Cell] = [(LEFT, name, FAINT)] if k == 0 else []
            yield 1.3, [*heading, (0.34, part, PLAIN)], k == len(parts) - 1


def _parameters(title: str, entries: Sequence[Parameter]) -> Iterator[Row]:
    if not entries:
        return
    yield 2.2, [(LEFT, title, HEADING)], False
    width = (RIGHT - LEFT) / PER_COLUMN
    rows = -(-len(entries) // PER_COLUMN)
    for k in range(rows):
        cells: list[Cell] = []
        for column, (name, value, deviation, unit) in enumerate(entries[k::rows]):
            x = LEFT + column * width
            short = wording.short_name(name, 22)
            cells += [
                (x, short, PLAIN), (x + 0.235, value, BOLD_END),
                (x + 0.24, f"± {deviation} {unit}", FAINT),
            ]  # fmt: skip
        yield 1.2, cells, True
