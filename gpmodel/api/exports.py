"""Exported files of a fitted model, each with its position error."""

from dataclasses import astuple, dataclass
from pathlib import Path

import pandas as pd

from gpmodel.api.table import Shown
from gpmodel.application.exports.make import Exports
from gpmodel.files import as_write_error, finished_folder, write_text
from gpmodel.report.fitted import optional
from gpmodel.report.schema import ExportRecord
from gpmodel.wording import wrapped


@dataclass(frozen=True, repr=False)
class ExportsResult(Shown):
    """Exported files of a model, with the position error of each. exports: exported files in the order of writing."""

    mechanism: str
    exports: Exports

    @property
    def records(self) -> tuple[ExportRecord, ...]:
        """Records of the exported files for report.json."""
        return tuple(
            ExportRecord(
                e.file,
                "; ".join([e.what, *e.notes]),
                optional(1e3 * e.rms),
                optional(1e3 * e.largest),
                optional(1e3 * e.heldout),
                e.missing,
            )
            for e in self.exports.files
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per exported file: content, position errors relative to `predict` and on held-out poses [mm],
        omitted effects."""
        heads = ["file", "what", "RMS [mm]", "max [mm]", "held-out RMS [mm]", "missing"]
        return pd.DataFrame([(*astuple(r)[:-1], "; ".join(r.missing)) for r in self.records], columns=heads)

    def summary(self) -> str:
        """List the exported files with their errors against predict, mm, omitted effects, notes and refused files."""
        lines = [f"{'against predict, mm':<26}{'RMS':>10}{'max':>10}{'held out':>10}"]
        for r in self.records:
            numbers = "".join(f"{_said(v):>10}" for v in (r.rms_mm, r.max_mm, r.heldout_rms_mm))
            lines.append(f"{r.file:<26}{numbers}")
        missing = dict.fromkeys(name for r in self.records for name in r.missing)
        if missing:
            holds = ", ".join(r.file for r in self.records if r.missing)
            lines.append(wrapped(f"not in {holds}: {'; '.join(missing)}", 2, ""))
        said = {
            text: [e.file for e in self.exports.files if text in e.notes]
            for text in (note for e in self.exports.files for note in e.notes)
        }
        lines += [wrapped(f"{', '.join(files)}: {text}", 2, "") for text, files in said.items()]
        lines += [wrapped(f"{file}: none, {why}", 2, "") for file, why in self.exports.refused.items()]
        return "\n".join(lines)

    def report(self, folder: str | Path) -> None:
        """Write calibrated.urdf and the folder exports/ into `folder`; on an error nothing is written."""
        with finished_folder(Path(folder)) as draft:
            self.write(draft)
        self.remove_refused(Path(folder))

    def remove_refused(self, folder: Path) -> None:
        """Remove exported files of an earlier model in `folder` that this model does not allow."""
        for file in self.exports.refused:
            with as_write_error(folder / file):
                (folder / file).unlink(missing_ok=True)

    def write(self, folder: Path) -> None:
        """Write the exported files into an existing folder."""
        for export in self.exports.files:
            write_text(folder / export.file, export.text)

    def __repr__(self) -> str:
        return f"<exports of {self.mechanism}: {', '.join(r.file for r in self.records)}>"


def _said(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}" if value < 1e-4 else f"{value:.4f}"
