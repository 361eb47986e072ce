"""Draw the pictures of a report: PNG files, and SVG with the colours of the page."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from gpmodel.executor import Forks, called_beside
from gpmodel.files import write_bytes
from gpmodel.report.picture import AFTER, AFTER_LIGHT, AXIS, BEFORE, EXPLORE, INK, MUTED, NULL, PAPER, RULE, Picture

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

Made = TypeVar("Made")

DOTS_PER_INCH = 192
"""Resolution of figures, dots per inch: twice the resolution of a screen, so that enlarged text stays sharp."""
_LINK = rf'<a xlink:href="({EXPLORE}#row=(\d+))"[^>]*>'
FONT = "DejaVu Sans"
Setting = str | float | bool | list[str]
STYLE: dict[RcKeyType, Setting] = {
    "font.family": FONT,
    "font.size": 9.0,
    "text.color": INK,
    "text.parse_math": False,
    "axes.labelcolor": MUTED,
    "axes.labelsize": 8.5,
    "axes.edgecolor": AXIS,
    "axes.linewidth": 0.8,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.8,
    "xtick.color": AXIS,
    "ytick.color": AXIS,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.2,
    "figure.facecolor": PAPER,
    "svg.fonttype": "none",
}
"""Style of a report's figures; sizes in points."""
COLOURS = {
    INK: "ink", MUTED: "muted", RULE: "rule", AXIS: "axis", PAPER: "paper", BEFORE: "before", AFTER: "after",
    AFTER_LIGHT: "light", NULL: "null", "#000000": "ink",
}  # fmt: skip
"""Name in the page's style sheet of each colour of the pictures."""


@contextmanager
def drawing_style(more: Mapping[RcKeyType, Setting]) -> Iterator[None]:
    """Set the drawing style and options `more`, without warnings on missing letters; pages use browser fonts."""
    fonts = logging.getLogger("matplotlib.font_manager")
    with rc_context({**STYLE, **more}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from", UserWarning)
        fonts.disabled = True
        yield
        fonts.disabled = False


def drawn(pictures: Iterable[Picture], folder: Path | None = None) -> dict[str, str]:
    """Draw pictures in parallel; return inline SVG by name. With `folder`, write `figures/NAME.png` there too."""
    return draw_during(pictures, folder, lambda: None, Forks())[0]


def draw_during(
    pictures: Iterable[Picture], folder: Path | None, call: Callable[[], Made], workers: Forks
) -> tuple[dict[str, str], Made]:
    """Draw pictures in parallel while the function `call` runs; return SVG by name and the function's result."""
    if folder is not None:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
    asked = tuple(pictures)
    made, texts = called_beside(workers, call, [partial(_drawn, picture, folder) for picture in asked])
    return {picture.name: text for picture, text in zip(asked, texts, strict=True)}, made


def _drawn(picture: Picture, folder: Path | None) -> str:
    """Return the inline SVG of one picture."""
    with drawing_style({"svg.hashsalt": picture.name}):
        drawing = figure(picture)
        svg = inline(svg_of(drawing), picture.name)
        if folder is not None:
            png = io.BytesIO()
            FigureCanvasAgg(drawing).print_png(png, metadata={"Software": None, "Description": picture.alt})
            write_bytes(folder / "figures" / f"{picture.name}.png", png.getvalue())
    return svg


def figure(picture: Picture) -> Figure:
    """Draw a picture in the style of the pages."""
    with drawing_style({}):
        out = Figure(figsize=(picture.width, picture.height), dpi=DOTS_PER_INCH, layout="constrained")
        picture.draw(out)
    return out


def standalone_svg(picture: Picture) -> str:
    """Return a picture as SVG that includes its colours, for pages other than the report."""
    colours = "; ".join(f"--{name}: {colour}" for colour, name in COLOURS.items())
    return f'<div style="{colours}">{drawn([picture])[picture.name]}</div>'


def svg_of(figure: Figure) -> str:
    """Return a figure as SVG without background; the layout of the figure is then fixed.
    The canvas draws the figure once; matplotlib's `savefig` would draw the figure twice for the layout."""
    text, paper, dpi = io.StringIO(), figure.get_facecolor(), figure.dpi
    figure.set_facecolor("none")
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})
    figure.set_layout_engine("none")
    figure.set_facecolor(paper)
    figure.dpi = dpi
    return text.getvalue()


def inline(svg: str, name: str) -> str:
    """Return an SVG file as part of a page: no prolog, only used and unique ids, colours and font of the page."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>", "", svg, flags=re.S)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r"#[0-9a-f]{6}\b", lambda m: f"var(--{COLOURS[m[0]]})" if m[0] in COLOURS else m[0], svg)
    svg = re.sub(_LINK, r'<a href="\1" tabindex="-1"><title>row \2</title>', svg)
    svg = svg.replace(" font-family: 'DejaVu Sans';", "")
    width, height = (float(v) for v in re.findall(r'(?:width|height)="([\d.]+)pt"', svg)[:2])
    head = f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" width="{width / 0.75:.0f}" aria-hidden="true">'
    return head + re.sub(r"<!--.*?-->|\n\s*", " ", svg[svg.index(">") + 1 :], flags=re.S)
