"""Results as text and as cells of a notebook."""

import html
from collections.abc import Iterable, Sequence

import pandas as pd


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
