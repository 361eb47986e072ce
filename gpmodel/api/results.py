"""Results on disk: report.json and the pages made of it, with what belongs beside them, all of them or none."""

from collections.abc import Callable
from pathlib import Path

from gpmodel.files import finished_folder, write_text
from gpmodel.report.saved import NAME, to_json
from gpmodel.report.schema import Report


def write_results(record: Report, folder: str | Path, *beside: Callable[[Path], None]) -> None:
    """Leave report.json, report.html and figures in `folder`, and what each of `beside` writes into a folder.

    Raises InputError when they cannot be written.
    """
    from gpmodel.report.figures import write_figures
    from gpmodel.report.page import write_page

    with finished_folder(Path(folder)) as draft:
        write_text(draft / NAME, to_json(record))
        for write in beside:
            write(draft)
        write_page(record, draft, write_figures(record, draft))


def save_record(record: Report, file: str | Path) -> None:
    """Write the content of report.json to `file`. Raises InputError when it cannot be written."""
    write_text(Path(file), to_json(record))
