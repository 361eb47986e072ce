"""Write results to disk (report.json, pages and other files): all files, or none after an error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from gpmodel.api.arguments import file_path
from gpmodel.api.model import MODEL, Model
from gpmodel.application.model_reader import REPORT
from gpmodel.errors import InputError, WriteError
from gpmodel.executor import Forks, called_beside
from gpmodel.extras import extra_for
from gpmodel.files import as_write_error, finished_folder, remove_files, write_text
from gpmodel.report.saved import to_json
from gpmodel.report.schema import Report
from gpmodel.texts import SEAL


def check_writable() -> None:
    """Raise InputError if the Python packages that draw the report's pages are not installed."""
    with extra_for("a report", "report"):
        import gpmodel.application.exports.make
        import gpmodel.report.write  # noqa: F401


def write_results(record: Report, folder: str | Path, *beside: Callable[[Path], None]) -> None:
    """Write report.json, the pages, poses.csv and figures into `folder`.

    beside: functions that write further files into a folder, their argument.
    Raises InputError if a file cannot be written.
    """
    check_writable()
    from gpmodel.report.write import write_report

    with finished_folder(file_path(folder, "folder")) as draft:
        write_report(record, draft)
        for write in beside:
            write(draft)


def write_fitted(look: Callable[[], Report], model: Model, folder: str | Path, workers: Forks) -> None:
    """Write the report of a calibration, model.json and every export file that the model allows, in parallel.

    look: function that returns the content of report.json. If writing the report fails, model.json is still written, so
    that the fit is not lost. Raises InputError if a file cannot be written.
    """
    check_writable()
    from gpmodel.api.exports import ExportsResult
    from gpmodel.application.exports.make import merged, parts_of
    from gpmodel.application.exports.sample import Place
    from gpmodel.report.page import pictures
    from gpmodel.report.write import write_pages

    def content() -> Report:
        from gpmodel.report import figures  # noqa: F401  # loads matplotlib while the exports are computed

        return look()

    path = file_path(folder, "folder")
    with without_earlier(path, model), finished_folder(path) as draft, _kept(model, path):
        with as_write_error(path):
            record, made = called_beside(workers, content, parts_of(model.saved, Place.of(model.saved)))
        from gpmodel.report.figures import draw_during

        exports = ExportsResult(model.mechanism.name, merged(made))
        drawings, _ = draw_during(pictures(record), draft, partial(save_model, model, draft), workers)
        write_pages(replace(record, exports=exports.records), drawings, draft)
        exports.write(draft)
    exports.remove_refused(path)


def write_numbers(record: Report, model: Model, folder: Path) -> None:
    """Write report.json and model.json into `folder`, without pages and exports; raise InputError if writing fails."""
    with without_earlier(folder, model), finished_folder(folder) as draft:
        save_record(record, draft / REPORT)
        save_model(model, draft)


DERIVED = ("certificate.html", "verify.html", "verify.csv", "verify.json", "repaired.json", "finding_*.html")
"""Files of other commands that describe the model in their folder."""


@contextmanager
def without_earlier(folder: Path, model: Model) -> Iterator[None]:
    """Remove files that describe an earlier model of a folder after the code in the context has written another one."""
    same = f'"{SEAL}": "{model.sha256}"'
    kept = (folder / MODEL).is_file() and same in (folder / MODEL).read_text(encoding="utf-8", errors="replace")
    yield
    if not kept:
        remove_files(folder, DERIVED)


@contextmanager
def _kept(model: Model, folder: Path) -> Iterator[None]:
    """Write model.json into `folder` if the code in the context fails for another reason than a failed write."""
    try:
        yield
    except WriteError:
        raise
    except Exception as error:
        folder.mkdir(parents=True, exist_ok=True)
        save_model(model, folder)
        if not isinstance(error, InputError):
            raise
        message = f"no report could be made ({error}); the model with the findings is in {folder / MODEL}"
        raise InputError(message) from None


def save_model(model: Model, folder: Path) -> None:
    """Write the fitted model as model.json into a folder. Raises InputError if the file cannot be written."""
    model.save(folder / MODEL)


def save_fitted(record: Report, model: Model, file: str | Path) -> None:
    """Write a calibration's report.json to `file`, with errors of every export file; raise InputError if it fails."""
    path = file_path(file, "file")
    with as_write_error(path):
        exports = model.export().records
    save_record(replace(record, exports=exports), path)


def save_record(record: Report, file: str | Path) -> None:
    """Write report.json to `file`. Raises InputError if the file cannot be written."""
    write_text(file_path(file, "file"), to_json(record))
