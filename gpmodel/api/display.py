"""Results as text and as cells of a notebook."""

import html
from collections.abc import Iterable, Sequence
from contextlib import suppress

import pandas as pd

from gpmodel.errors import InputError
from gpmodel.report.schema import Report


def aligned(rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Rows of cells as lines, columns lined up: the first `left` to the left, the others to the right."""
    table = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    )


def notebook(summary: str, frame: pd.DataFrame | None = None) -> str:
    """HTML for a notebook: the summary as it is printed, and the rows below it."""
    table = "" if frame is None else frame.to_html(index=False, max_rows=20)
    return f"<pre>{html.escape(summary)}</pre>{table}"


def ladder_of(record: Report) -> pd.DataFrame:
    """One row a step: 3-D errors [mm] on held-out and training poses, and the unknowns solved."""
    rows = []
    for rung in record.ladder:
        row: dict[str, str | float | None] = {"step": record.title(rung)}
        for side, errors in (("held-out", rung.heldout), ("training", rung.train)):
            row |= {f"{side} {k} [mm]": getattr(errors, f"{k}_mm") for k in ("mean", "rms", "max")}
        rows.append(row | {"unknowns": rung.rank})
    return pd.DataFrame(rows)


def figure_of(record: Report, name: str | None = None) -> object:
    """A picture of a report as a matplotlib Figure: the first, or that of a name. Raises InputError for another."""
    from gpmodel.report.figures import figure, pictures

    known = {p.name: p for p in pictures(record)}
    if not known or (name is not None and name not in known):
        raise InputError(f"{name!r} is no picture of this result; available: {', '.join(known) or 'none'}", "name")
    return figure(known[name or next(iter(known))])


def notebook_of(record: Report) -> str:
    """HTML of a result for a notebook: the verdict, the ladder, the effects with ±, and the errors drawn."""
    from gpmodel import wording

    ladder = ladder_of(record).dropna(axis="columns", how="all").to_html(index=False, float_format="{:.4g}".format)
    effects = pd.DataFrame(
        [{"effect": e.name, "value": str(wording.measured(e.value, e.stderr, e.unit))} for e in record.effects]
    )
    drawn = ""
    with suppress(ImportError):
        from gpmodel.report.figures import in_a_page_of_its_own, pictures

        drawn = next((in_a_page_of_its_own(p) for p in pictures(record)), "")
    table = effects.to_html(index=False) if len(effects) else ""
    return f"<p><b>{html.escape(record.verdict)}</b></p>{ladder}{table}{drawn}"
