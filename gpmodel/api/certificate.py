"""Certificate of a calibration: machine, measurement and accuracy on one or two pages of A4."""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.api.arguments import brief, file_path, to_si
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
from gpmodel.report.origin import Particulars, read_particulars
from gpmodel.report.schema import Report
from gpmodel.report.verification import TOO_GOOD, Verification, read_verification

if TYPE_CHECKING:
    from gpmodel.report.certificate import Certificate


@dataclass(frozen=True, repr=False)
class CertificateResult(Shown):
    """Certificate of a calibration, a discovery or a verification. said: text fields of the certificate, such as the
    serial number."""

    record: Report | Verification
    said: Particulars
    tolerance_mm: float | None = None
    _with_rows = False

    @cached_property
    def sheet(self) -> "Certificate":
        """Content of the certificate, as text. Raises InputError if the packages of the extra `report` are missing."""
        with extra_for("a certificate", "report"):
            from gpmodel.report import certificate as of_report
            from gpmodel.report import verification_words as of_verification

        record, said, tolerance = self.record, self.said, self.tolerance_mm
        if isinstance(record, Verification):
            judged = record if tolerance is None else replace(record, tolerance_mm=tolerance)
            return of_verification.certificate(judged, said)
        return of_report.certificate(record, said, tolerance)

    def summary(self) -> str:
        """Return the certificate as text of 80 columns: particulars, scope, accuracy, repeatability, effects."""
        sheet = self.sheet
        from gpmodel.report.certificate import text

        return text(sheet)

    def report(self, folder: str | Path) -> None:
        """Write certificate.html, a page for A4, into `folder`. Raises InputError if drawing or writing fails."""
        sheet = self.sheet
        from gpmodel.report.certificate import html

        with finished_folder(file_path(folder, "folder")) as draft:
            write_text(draft / "certificate.html", html(sheet, self.record.mechanism.name))

    def save(self, file: str | Path) -> None:
        """Write the certificate to a JSON file. Raises InputError if the file cannot be written."""
        write_text(file_path(file, "file"), to_json({"schema": 1, **asdict(self.sheet)}))

    def __repr__(self) -> str:
        kind = "verification" if isinstance(self.record, Verification) else self.record.kind
        return f"<certificate of {self.record.mechanism.name}, by {kind} of {self.record.data.file}>"


def certificate(
    result: object, particulars: str | Path | Particulars | None = None, *, tolerance: str | None = None, **said: str
) -> CertificateResult:
    """Certify the accuracy of a machine; the result has `summary()`, `report(folder)` and `save(file)` for JSON.

    result: result of `calibrate`, `discover` or `verify`, or the folder of a result. If a folder contains a
    verification, the verification is certified, because the accuracy of a verification is measured and not predicted.
    particulars: TOML file with any of machine, serial, controller, location, instrument, instrument_serial,
    instrument_calibrated, operator, date, temperature, payload, remarks. said: the fields of `particulars` as keywords;
    fields without a value stay blank.
    tolerance: largest allowed error of a pose, "0.1 mm", for pass or fail.
    Raises InputError if `result` is not a result or a folder, or if no positions were measured.
    """
    limit = None if tolerance is None else 1e3 * to_si(tolerance, "length", "tolerance", positive=True)
    if not isinstance(particulars, str | Path | Particulars | None):
        raise InputError(f"{brief(particulars)}, expected a TOML file or Particulars of the certificate", "particulars")
    known = (
        read_particulars(file_path(particulars, "particulars")) if isinstance(particulars, str | Path) else particulars
    )
    return CertificateResult(_record(result), (known or Particulars()).with_lines(said), limit)


def _record(result: object) -> Report | Verification:
    """Return the report to certify; raise InputError if its positions were computed, or if none were measured."""
    verified = result.record if isinstance(result, VerifyResult) else None
    if isinstance(result, str | Path):
        verified = read_verification(file_path(result, "result"))
    if verified is not None:
        ratio, noise = verified.chi_square / max(verified.degrees, 1), verified.noise_degrees
        if chance_of_less(ratio, verified.degrees, np.inf if noise is None else noise) < TOO_GOOD:
            raise InputError(
                f"{verified.data.file}: errors smaller than the noise of the model allows (chi-square "
                f"{verified.chi_square:.3g} of {verified.degrees}); expected measured positions, not computed ones"
            )
        return verified
    record = record_of(result, "result")
    if record.unseen:
        raise InputError(
            f"{record.data.file}: no positions were measured ({record.data.counted}), so that no accuracy of positions "
            "can be certified; expected a table with x, y and z"
        )
    if isinstance(result, str | Path):
        with suppress(InputError):  # a folder without a model, or whose mechanism was moved
            result = load_model(result)
    model = result if isinstance(result, Model) else getattr(result, "model", None)
    if isinstance(model, Model) and model.saved.measured is not None:
        measured = prepare(model.mechanism, model.saved.measured.dataset)
        for text in computed_positions(model.mechanism, measured):
            raise InputError(f"{text}; an accuracy cannot be certified with computed positions")
    return record
