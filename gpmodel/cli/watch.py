"""`gpmodel discover --watch`: a table that grows while somebody measures."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gpmodel.api.discover import DiscoveryResult
from gpmodel.api.poses import choose_poses
from gpmodel.errors import InputError
from gpmodel.progress import Progress, Say
from gpmodel.report.schema import Report
from gpmodel.table.cells import LARGEST_FILE
from gpmodel.texts import read_limited

PAUSE = 1.0
"""Seconds between two looks at the file; rows count once it has rested for so long."""
NEXT = "next.csv"


@dataclass(frozen=True)
class Watch:
    """A table that is followed: after every `batch` further rows, until it has `rows` (None: until interrupted)."""

    table: Path
    batch: int
    rows: int | None = None

    def follow(self, look: Callable[[Say], DiscoveryResult], folder: Path, say: Callable[[str], None]) -> None:
        """Look after every batch, leave the results and the next poses in `folder`, and say how things stand; and where
        it is still busy when the next batch comes, that it waits.

        A table that is not sound yet is said so, and looked at again when it has grown. Raises InputError for a
        workbook.
        """
        if self.table.suffix.lower() == ".xlsx":
            raise InputError(f"{self.table} does not grow by rows; expected a .csv or .txt", "watch")
        seen = 0
        while self.rows is None or seen < self.rows:
            seen = self._grown(seen)
            try:
                found = look(self._noticing(seen, say))
                found.report(folder)
                chosen = self._next(folder)
                say(f"{seen} rows: {standing(found.record)}\n{chosen}")
            except InputError as error:
                say(f"{seen} rows: {error}")

    def _noticing(self, seen: int, say: Callable[[str], None]) -> Say:
        """Looks at the table whenever a search has something to tell."""
        told = 0

        def notice(_: Progress) -> None:
            nonlocal told
            waiting = _rows(self.table) - seen
            if waiting >= told + self.batch:
                told = waiting
                say(f"{waiting} new rows wait")

        return notice

    def _next(self, folder: Path) -> str:
        chosen = choose_poses(count=self.batch, after=folder)
        chosen.save(folder / NEXT)
        return f"next {self.batch} poses, {chosen.said}: {folder / NEXT}"

    def _grown(self, seen: int) -> int:
        """Rows of the table once it rests and has grown by a batch, or to as many as are wanted; one that has fewer
        rows than before is another."""
        before = -1
        while True:
            size = self.table.stat().st_size if self.table.exists() else 0
            if size == before:
                rows = _rows(self.table)
                seen = seen if rows >= seen else 0
                if rows >= seen + self.batch or (self.rows is not None and seen < self.rows <= rows):
                    return rows
            before = size
            time.sleep(PAUSE)


def standing(record: Report) -> str:
    """The verdict, and the findings that poses so far do not tell from something else."""
    open_questions = [
        f"{effect.name} or {', '.join(rival.name for rival in effect.close_rivals())}"
        for effect in record.effects
        if effect.close_rivals()
    ]
    ambiguous = f" Still ambiguous: {'; '.join(open_questions)}." if open_questions else ""
    return f"{record.verdict}{ambiguous}"


def _rows(table: Path) -> int:
    """Whole lines below the header. Raises InputError for a folder, a device or what is too large."""
    return max(0, read_limited(table, LARGEST_FILE, "a measured table").count(b"\n") - 1) if table.exists() else 0
