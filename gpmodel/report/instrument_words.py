"""The instrument in words: its specification, the noise expected of it, and its own errors beside both."""

from gpmodel import wording
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord

BEYOND = 2.0
"""Times its specification from which an error of the instrument is beyond it: a limit is two standard deviations, and
four of them nobody meets by chance."""
_CAUSES = {
    "m": "a wrong reflector constant?", "1": "wrong air temperature or pressure, or another unit of length?",
    "rad": "it needs its own compensation, or the error is the mechanism's",
}  # fmt: skip


def instrument(report: Report) -> str:
    """State the noise expected from the instrument's specification and the noise found; empty without a
    specification.
    """
    stated = report.instrument
    if stated is None:
        return ""
    found = "" if report.sigma_mm is None else f", {wording.length(report.sigma_mm)} found about the model"
    return (
        f"specified to {stated.specification}, {wording.length(stated.limit_mm)} at the distance of these poses: noise "
        f"of one coordinate {wording.length(stated.noise_mm)} expected{found}"
    )


def beside_specification(effect: EffectRecord) -> str:
    """Compare an error of the instrument with its specification; empty for any other effect."""
    times = effect.of_specification
    if times is None:
        return ""
    if times < BEYOND:
        return f"{times:.2g} times the instrument's specification, as an instrument in order may have"
    cause = _CAUSES["rad" if effect.kind != "single" else effect.unit]
    return f"{times:.0f} times the instrument's specification: {cause}"
