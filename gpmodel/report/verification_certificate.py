"""The certificate of a verification: accuracy of a machine at poses measured after its calibration."""

from collections.abc import Iterator

import numpy as np

from gpmodel import wording
from gpmodel.report.certificate import Certificate, Line, repeated, statistics
from gpmodel.report.particulars import Particulars
from gpmodel.report.verification import Verification
from gpmodel.report.verification_words import NOMINAL, facts, tolerance, verdict

SMALL_PRINT = (
    "Accuracy in the manner of ISO 9283 (1998): distance between measured and predicted position of the tool point "
    "for the rows of a table that was measured after the fit of the model. Mean, mean + 3 s and maximum are statistics "
    "of these distances. Nominal: nominal geometry at the driven joint values, with fitted registration "
    "and tool point; "
    "this is not the machine before the calibration. After: the model, with a newly fitted registration."
)
OF_READINGS = (
    "Errors are those of the measured quantities in mm: distance of a touch from the surface or point, error of the "
    "length of a bar. Pixels and degrees are converted to mm as in the fit of the model. ISO 9283 "
    "requires measurements "
    "of the tool point, which this table does not have. Nominal: nominal geometry at the driven joint values. After: "
    "the model."
)


def certificate(record: Verification, particulars: Particulars) -> Certificate:
    """Return the certificate of a verification; both columns of errors are measurements."""
    pairs = [(p.without_mm, p.with_mm) for p in record.poses if not p.outlier and None not in (p.without_mm, p.with_mm)]
    errors = np.array(pairs, dtype=float).reshape(-1, 2)
    return Certificate(
        title=f"Verification certificate: {particulars.machine or record.mechanism.name}",
        particulars=particulars.lines(),
        scope=tuple(_scope(record)),
        poses=f"{len(pairs)} {record.data.unit}, measured after the model was fitted",
        statistics=statistics(errors) if len(pairs) > 1 else (),
        repeatability=() if record.repeatability is None else repeated(record.repeatability),
        effects=(),
        parameters=(),
        placement=(),
        record=tuple(_record(record)),
        errors=errors,
        tolerance_mm=record.tolerance_mm,
        predicted=False,
        before=NOMINAL,
        small_print=OF_READINGS if record.kinds else SMALL_PRINT,
    )


def _scope(record: Verification) -> Iterator[Line]:
    yield "result", verdict(record)
    judged = "" if record.tolerance_mm is None else f"{'fail' if record.beyond else 'pass'}: "
    yield "tolerance", f"{judged}{tolerance(record)}"
    yield from facts(record)
    yield "model of the machine", record.mechanism.name
    yield "measured", record.data.counted
    yield "noise of one coordinate", f"{wording.millimetres(record.sigma_mm)} mm, by the model"


def _record(record: Verification) -> Iterator[Line]:
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    lines = (
        ("table", record.data.file), ("SHA-256", record.data.sha256), ("model", record.model_file),
        ("SHA-256 of the model", record.model_sha256), ("command", record.command), ("versions", versions),
    )  # fmt: skip
    for name, value in lines:
        if value:
            yield name, value
