"""Results as text and as cells of a notebook."""

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

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


class Shown:
    """A result that a notebook shows as its summary and, where `_with_rows`, the rows below it."""

    _with_rows = True

    if TYPE_CHECKING:

        def summary(self) -> str:
            """Return the text to print."""

        def to_dataframe(self) -> pd.DataFrame:
            """Its rows."""

    def _repr_html_(self) -> str:
        table = self.to_dataframe().to_html(index=False, max_rows=20) if self._with_rows else ""
        return f"<pre>{html.escape(self.summary())}</pre>{table}"
