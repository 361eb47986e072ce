"""The certificate of a result: what machine, measured how, how accurate, on one or two sides of A4."""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.api.arguments import file_path, quantity, shown
from gpmodel.api.model import Model, load_model
from gpmodel.api.saved import record_of
from gpmodel.api.table import Shown
from gpmodel.api.verification import VerifyResult
from gpmodel.checks.judge import computed_positions
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.files import finished_folder, to_json, write_text
from gpmodel.model.error_model import prepare
from gpmodel.numerics.interval import chance_of_less
from gpmodel.report.particulars import Particulars, read_particulars
from gpmodel.report.schema import Report
from gpmodel.report.verification import TOO_GOOD, Verification, read_verification

if TYPE_CHECKING:
    from gpmodel.report.certificate import Certificate


@dataclass(frozen=True, repr=False)
class CertificateResult(Shown):
    """The certificate of a calibration, a discovery or a verification. said: what stands beside the numbers."""

    record: Report | Verification
    said: Particulars
    tolerance_mm: float | None = None
    _with_rows = False

    @cached_property
    def sheet(self) -> "Certificate":
        """Everything that it states, as text. Raises InputError where this installation cannot make one."""
        with extra_for("a certificate", "report"):
            from gpmodel.report import certificate as of_report
            from gpmodel.report import verification_certificate as of_verification

        record, said, tolerance = self.record, self.said, self.tolerance_mm
        if isinstance(record, Verification):
            judged = record if tolerance is None else replace(record, tolerance_mm=tolerance)
            return of_verification.certificate(judged, said)
        return of_report.certificate(record, said, tolerance)

    def summary(self) -> str:
        """Particulars, scope, accuracy, repeatability and effects in 80 columns."""
        sheet = self.sheet
        from gpmodel.report.certificate import text

        return text(sheet)

    def report(self, folder: str | Path) -> None:
        """Leave certificate.html in `folder`, a page that prints to A4. Raises InputError in these cases too."""
        sheet = self.sheet
        from gpmodel.report.certificate import html

        with finished_folder(file_path(folder, "folder")) as draft:
            write_text(draft / "certificate.html", html(sheet, self.record.mechanism.name))

    def save(self, file: str | Path) -> None:
        """Write all that it states as JSON. Raises InputError when it cannot be written."""
        write_text(file_path(file, "file"), to_json({"schema": 1, **asdict(self.sheet)}))

    def __repr__(self) -> str:
        kind = "verification" if isinstance(self.record, Verification) else self.record.kind
        return f"<certificate of {self.record.mechanism.name}, by {kind} of {self.record.data.file}>"


def certificate(
    result: object, particulars: str | Path | Particulars | None = None, *, tolerance: str | None = None, **said: str
) -> CertificateResult:
    """State the accuracy of a machine as a certificate with `summary()`, `report(folder)` and, as JSON,
    `save(file)`.

    result: of `calibrate`, `discover` or `verify`, or a folder that one of them left; where it holds a verification,
    that is certified: it was measured and not predicted. particulars: a TOML file of the lines machine, serial,
    controller, location, instrument, instrument_serial, instrument_calibrated, operator, date, temperature, payload,
    remarks, or said: these by name; the others are left to be filled in. tolerance: what no pose may be off by, as in
    "0.1 mm": pass or fail. Raises InputError for what is none of them.
    """
    limit = None if tolerance is None else 1e3 * quantity(tolerance, "length", "tolerance", positive=True)
    if not isinstance(particulars, str | Path | Particulars | None):
        raise InputError(f"{shown(particulars)}, expected a TOML file or Particulars of the certificate", "particulars")
    known = (
        read_particulars(file_path(particulars, "particulars")) if isinstance(particulars, str | Path) else particulars
    )
    return CertificateResult(_record(result), (known or Particulars()).with_lines(said), limit)


def _record(result: object) -> Report | Verification:
    """Raises InputError for computed positions, as in results of earlier versions."""
    verified = result.record if isinstance(result, VerifyResult) else None
    if isinstance(result, str | Path):
        verified = read_verification(file_path(result, "result"))
    if verified is not None:
        ratio, noise = verified.chi_square / max(verified.degrees, 1), verified.noise_degrees
        if chance_of_less(ratio, verified.degrees, np.inf if noise is None else noise) < TOO_GOOD:
            raise InputError(
                f"{verified.data.file}: nearer to the model than its noise allows (chi-square "
                f"{verified.chi_square:.3g} of {verified.degrees}); expected positions that were measured, not computed"
            )
        return verified
    record = record_of(result, "result")
    if isinstance(result, str | Path):
        with suppress(InputError):  # a folder without a model, or whose mechanism was moved
            result = load_model(result)
    model = result if isinstance(result, Model) else getattr(result, "model", None)
    if isinstance(model, Model) and model.saved.measured is not None:
        measured = prepare(model.mechanism, model.saved.measured.dataset)
        for text in computed_positions(model.mechanism, measured):
            raise InputError(f"{text}; no accuracy can be certified by them")
    return record
