"""The certificate as PDF, drawn line by line: one side of A4, or more where the letters would be too small."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import wrap
from typing import Literal

from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.lines import Line2D

from gpmodel import wording
from gpmodel.report.certificate import Certificate, Parameter
from gpmodel.report.charts_certificate import draw
from gpmodel.report.figures import FONT, drawing_style
from gpmodel.report.picture import INK, MUTED, RULE

WIDTH, HEIGHT = 8.27, 11.69
"""Inches: A4."""
LEFT, RIGHT, TOP, BOTTOM = 0.07, 0.93, 0.965, 0.05
"""Margins of the text as shares of the side."""
STEP = 0.0145
"""Height of a line of 8 points as a share of the side."""
SMALLEST = 0.72
"""Of that size, that all of it may be set in so that it has one side."""
COLUMNS, PARTICULARS = 3, 2
"""Parameters, and particulars, stand in so many columns."""
ACCURACY = "Accuracy over "
NAME = 28
"""Characters of a name beside its value; below a longer one the value has a line of its own."""
CHART = (0.64, RIGHT)
"""From where to where across the side the histogram stands, beside the statistics."""

FURTHER_FONTS = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "Source Han Sans SC", "Microsoft YaHei", "PingFang SC",
    "WenQuanYi Micro Hei", "Yu Gothic", "Hiragino Sans", "Malgun Gothic", "Noto Sans Arabic", "Noto Sans Thai",
)  # fmt: skip
"""That have letters which ours lacks, of which a machine has one or none."""


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
    """Write the certificate to `path`, as many sides as it needs; a letter that no font here has is a box."""
    fonts = [FONT, *(name for name in FURTHER_FONTS if name in fontManager.get_font_names())]
    with (
        drawing_style({"pdf.fonttype": 42, "font.family": fonts}),
        PdfPages(path, metadata={"Title": found.title}) as pdf,
    ):
        rows = list(_rows(found))
        scale = min(1.0, (TOP - BOTTOM) / (STEP * sum(height for height, _, _ in rows)))
        scale = scale if scale >= SMALLEST else 1.0
        number, step = 1, STEP * scale
        while rows:
            figure = Figure(figsize=(WIDTH, HEIGHT))
            y = TOP
            while rows and y - sum(height for height, _, _ in _together(rows)) * step >= BOTTOM - 1e-9:
                height, cells, ruled = rows.pop(0)
                if cells and cells[0][1] == ACCURACY + found.poses and len(found.errors):
                    _chart(figure, found, y - 2.6 * step, (len(found.statistics) + 1.5) * step, scale)
                y -= height * step
                for x, text, look in cells:
                    _write(figure, x, y, text, replace(look, size=look.size * scale))
                if ruled:
                    _rule(figure, y - 0.3 * step)
            _write(figure, RIGHT, 0.025, f"{number}", TextStyle(7.0, MUTED, end="right"))
            _write(figure, LEFT, 0.025, found.title, TextStyle(7.0, MUTED))
            pdf.savefig(figure)
            number += 1


def _chart(figure: Figure, found: Certificate, top: float, height: float, scale: float) -> None:
    with rc_context({"font.size": 7 * scale, "legend.fontsize": 7 * scale, "axes.labelsize": 7 * scale,
                     "xtick.labelsize": 7 * scale, "ytick.labelsize": 7 * scale}):  # fmt: skip
        axes = figure.add_axes((CHART[0], top - height, CHART[1] - CHART[0], height))
        draw(axes, found.errors, found.tolerance_mm, (found.before, found.predicted))


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
    yield 0.6, [], False
    yield from _in_columns(
        [[(0.0, name, FAINT), (0.15, wording.shortened(value, 36), PLAIN)] for name, value in found.particulars],
        PARTICULARS,
    )
    yield from _block("Scope", found.scope)
    if found.statistics:
        first, second = (0.39, 0.565) if len(found.errors) else (0.62, 0.82)
        yield 2.2, [(LEFT, ACCURACY + found.poses, HEADING)], False
        yield 1.2, [(x, head, RIGHT_END) for x, head in zip((first, second), found.heads, strict=True)], False
        for name, before, after in found.statistics:
            yield 1.2, [(LEFT, name, PLAIN), (first, before, RIGHT_END), (second, after, BOLD_END)], False
        yield 1.0, [], False
    yield from _block("Repeatability", found.repeatability)
    yield from _block("Effects ± σ", [(name, f"{v} ± {s} {unit}") for name, v, s, unit in found.effects])
    yield from _parameters("Tool in the flange, root in the instrument's frame, ± σ", found.placement)
    yield from _parameters("Parameters ± σ", found.parameters)
    yield from _block("Record", found.record)
    yield 0.6, [], False
    for line in wrap(found.small_print, 150):
        yield 0.9, [(LEFT, line, TextStyle(6.5, MUTED))], False
    yield 3.0, [(LEFT, "Date  ______________________________", PLAIN),
                (0.5, "Signature  ______________________________", PLAIN)], False  # fmt: skip


def _block(title: str, lines: Sequence[tuple[str, str]]) -> Iterator[Row]:
    if lines:
        yield 2.0, [(LEFT, title, HEADING)], False
    for name, value in lines:
        parts, long = wrap(value, 92) or [""], len(name) > NAME
        if long:
            yield 1.2, [(LEFT, name, FAINT)], False
        for k, part in enumerate(parts):
            heading: list[Cell] = [(LEFT, name, FAINT)] if k == 0 and not long else []
            yield 1.2, [*heading, (0.27, part, PLAIN)], k == len(parts) - 1


def _parameters(title: str, entries: Sequence[Parameter]) -> Iterator[Row]:
    if entries:
        yield 2.0, [(LEFT, title, HEADING)], False
    at = (RIGHT - LEFT) / COLUMNS * 0.6
    yield from _in_columns(
        [
            [(0.0, wording.short_name(name, 16), PLAIN), (at, value, BOLD_END), (at + 0.004, f"± {s} {unit}", FAINT)]
            for name, value, s, unit in entries
        ],
        COLUMNS,
    )


def _in_columns(entries: Sequence[list[Cell]], count: int) -> Iterator[Row]:
    """Cells at places within a column, as rows of `count` columns, one below the other."""
    rows, width = -(-len(entries) // count), (RIGHT - LEFT) / count
    for k in range(rows):
        cells = [
            (LEFT + c * width + x, text, look) for c, entry in enumerate(entries[k::rows]) for x, text, look in entry
        ]
        yield 1.2, cells, True
