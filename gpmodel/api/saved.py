"""Load calibration results from folders; compare, explain and export them."""

from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from gpmodel.api.arguments import brief, check_integer, file_path
from gpmodel.api.fitted import RecordedResult
from gpmodel.api.model import MODEL, Model, load_model
from gpmodel.api.results import save_record, write_results
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.files import to_json, write_text
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect
from gpmodel.report.saved import NAME, read_report
from gpmodel.report.schema import Report

if TYPE_CHECKING:
    from gpmodel.api.exports import ExportsResult
    from gpmodel.report.compare import Comparison
    from gpmodel.report.explain import Explanation


@dataclass(frozen=True, repr=False)
class SavedResult(RecordedResult):
    """Result of `calibrate` or `discover`, loaded from its folder. record: content of report.json."""

    folder: Path
    record: Report

    @cached_property
    def model(self) -> Model:
        """Fitted model, read from model.json in the result's folder. Raises InputError if the file is missing."""
        return load_model(self.folder)

    def effects(self, formula: int | None = None, finding: int | None = None) -> tuple[Effect, ...]:
        """Return the found effects, for use in `calibrate`.

        formula: number, from 1, of an alternative formula of a finding, which replaces the selected formula. finding:
        number of the finding, from 1; None if only one finding has alternatives. Raises InputError without findings, or
        for an invalid number.
        """
        saved = self.model.saved
        values = zip(saved.model.effects, saved.theta, strict=True)  # corrections of constants inside formulas are zero
        effects = tuple(effect for effect, value in values if not effect.constant and value)
        if not effects:
            raise InputError(f"{self.folder}: the model has no findings, expected a result with findings", "findings")
        if formula is None:
            return effects
        able = [k for k, record in enumerate(self.findings, 1) if record.front]
        wanted = able if finding is None else [k for k in able if k == finding]
        if len(wanted) != 1:
            asked = f"finding {finding}: no formula" if finding is not None else f"{len(able)} findings have formulas"
            listed = ", ".join(map(str, able)) or "none"
            raise InputError(f"{asked}, expected the number of a finding with formulas: {listed}", "finding")
        record = self.findings[wanted[0] - 1]
        if not 1 <= check_integer(formula, "formula") <= len(record.front):
            raise InputError(f"{formula}, expected 1 to {len(record.front)}", "formula")
        basis = Expression(record.front[formula - 1].basis)
        return tuple(_of_another_basis(e, basis) if e.name == record.name else e for e in effects)

    def report(self, folder: str | Path) -> None:
        """Write the report's pages, poses.csv and figures again, without a new fit. Raises InputError if a file cannot
        be written."""
        write_results(self.record, folder)

    def save(self, file: str | Path) -> None:
        """Write the result to report.json. Raises InputError if the file cannot be written."""
        save_record(self.record, file)

    def __repr__(self) -> str:
        return f"<{self.record.kind} of {self.record.mechanism.name} in {self.folder}: {self.verdict}>"


def _of_another_basis(effect: Effect, basis: Expression) -> Effect:
    """Return a copy of an effect at the same sites (frames and axes) with the basis function `basis`."""
    terms = tuple(replace(term, basis=basis) for term in effect.terms)
    return replace(effect, name=f"{basis} on {effect.terms[0].slot} {effect.terms[0].axis}", terms=terms)


def load_result(folder: str | Path) -> SavedResult:
    """Load the result of `calibrate` or `discover` from a folder. Raises InputError if missing or damaged."""
    path = file_path(folder, "folder")
    return SavedResult(path, read_report(path))


@dataclass(frozen=True, repr=False)
class CompareResult:
    """Difference between two calibrations of a machine. found: comparison of every quantity of the two calibrations."""

    found: "Comparison"

    @property
    def verdict(self) -> str:
        """Verdict on the difference of the two calibrations in one sentence."""
        from gpmodel.report.compare import verdict

        return verdict(self.found)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per quantity of both results: kind, name, before, after, change, standard error and p-value of
        the change, unit; values in SI units."""
        kinds = {"effect": self.found.effects, "parameter": self.found.parameters, "placement": self.found.placement}
        return pd.DataFrame(
            [
                {"kind": kind, "name": c.name, "before": c.before[0], "after": c.after[0], "change": c.difference,
                 "stderr": c.stderr, "chance": c.chance, "unit": c.unit}
                for kind, changes in kinds.items() for c in changes
            ]
        )  # fmt: skip

    def summary(self) -> str:
        """Return the comparison of two calibrations as text of 80 columns."""
        from gpmodel.report.compare import text

        return text(self.found)

    def report(self, folder: str | Path) -> None:
        """Write the comparison as compare.html into `folder`. Raises InputError if the file cannot be written."""
        with extra_for("the page of a comparison", "report"):
            from gpmodel.report.compare import html

            page = html(self.found)
        write_text(file_path(folder, "folder") / "compare.html", page)

    def save(self, file: str | Path) -> None:
        """Write verdict, sources and rows of the comparison as JSON. Raises InputError if writing fails."""
        rows = self.to_dataframe().to_dict("records")
        said = {"schema": 1, "verdict": self.verdict, "sources": self.found.sources, "changes": rows}
        write_text(file_path(file, "file"), to_json(said))

    def __repr__(self) -> str:
        return f"<comparison: {self.verdict}>"


def compare(before: object, after: object) -> CompareResult:
    """Compare two results of one machine: results of calibrate, discover or load_result, or their folders.

    Raises InputError for objects that are no results, or for results of two machines.
    """
    from gpmodel.report import compare as compared

    first, second = record_of(before, "before"), record_of(after, "after")
    return CompareResult(compared.compare(first, second, (_source(before, first), _source(after, second))))


def _source(result: object, record: Report) -> str:
    """Describe a calibration result by its folder, table and date; unknown items are omitted."""
    folder = _folder_of(result)
    said = f"{record.data.file}, {record.data.poses} poses"
    if folder is None:
        return said
    written = datetime.fromtimestamp((folder / NAME).stat().st_mtime, UTC)
    return f"{folder.resolve().name}: {said}, written on {written:%Y-%m-%d}"


def _folder_of(result: object) -> Path | None:
    """Return the folder of a calibration result, or None if the result is not saved."""
    folder = result.folder if isinstance(result, SavedResult) else result
    return Path(folder) if isinstance(folder, str | Path) else None


@dataclass(frozen=True, repr=False)
class ExplainResult:
    """Explanation of one finding. record: content of report.json. found: the explanation as text and numbers.

    tellable: names of alternative explanations that further poses could exclude; None if not computed.
    """

    record: Report
    found: "Explanation"
    tellable: frozenset[str] | None

    def summary(self) -> str:
        """Return the explanation as text: site and size of the finding, possible causes, decisive measurements."""
        from gpmodel.report import explain as explained

        return explained.text(self.found)

    def report(self, folder: str | Path) -> None:
        """Write finding_N.html into `folder`. Raises InputError if the file cannot be written."""
        from gpmodel.report import explain as explained

        page = explained.html(self.record, self.found.number, self.tellable)
        write_text(file_path(folder, "folder") / f"finding_{self.found.number}.html", page)

    def save(self, file: str | Path) -> None:
        """Write the explanation as JSON. Raises InputError if the file cannot be written."""
        write_text(file_path(file, "file"), to_json({"schema": 1, **asdict(self.found)}))

    def __repr__(self) -> str:
        return f"<finding {self.found.number}, {self.found.name}: {self.found.value}>"


def explain(result: object, number: int) -> ExplainResult:
    """Explain finding `number`, counted from 1, of a result or its folder.

    With a saved model, the advice names only alternative causes that further poses could exclude. Raises InputError for
    an object that is no result, or an invalid number.
    """
    with extra_for("an explanation", "report"):
        from gpmodel.api.poses import tellable_causes
        from gpmodel.report import explain as explained

    record, wanted = record_of(result, "result"), check_integer(number, "number", 1)
    asked = wanted <= len(record.effects) and record.effects[wanted - 1].others
    model = _model_of(result) if asked else None
    told = tellable_causes(model, record) if model is not None else None
    return ExplainResult(record, explained.explain(record, wanted, told), told)


def _model_of(result: object) -> Model | None:
    """Return the fitted model of a result or its folder; None without a model."""
    if folder := _folder_of(result):
        return load_model(folder) if (folder / MODEL).is_file() else None
    model = getattr(result, "model", None)
    return model if isinstance(model, Model) else None


def export(
    result: object, folder: str | Path | None = None, *, box: str | None = None, setup: str | None = None,
    tool: str | None = None, seed: int = 0,
) -> "ExportsResult":  # fmt: skip
    """Export the model of a result to files for other programs; write the files to `folder`, if given.

    result: a Model, a result with a model, a result folder, or a model.json. `Model.export` documents the other
    arguments. Raises InputError if the result has no model.
    """
    made = model_of(result, "result").export(box=box, setup=setup, tool=tool, seed=seed)
    if folder is not None:
        made.report(file_path(folder, "folder"))
    return made


def model_of(given: object, argument: str) -> Model:
    """Return a model from a Model, result, folder or file; raise InputError naming the argument otherwise."""
    model = load_model(file_path(given, argument)) if isinstance(given, str | Path) else given
    model = model if isinstance(model, Model) else getattr(model, "model", None)
    if not isinstance(model, Model):
        raise InputError(f"{brief(given)}, expected a gpmodel.Model, a result of a fit, its folder or file", argument)
    return model


def record_of(result: object, argument: str) -> Report:
    """Return the report of a result or its folder; raise InputError naming the argument otherwise."""
    if isinstance(result, str | Path):
        return read_report(file_path(result, argument))
    record = getattr(result, "record", None)
    if not isinstance(record, Report):
        raise InputError(f"{brief(result)}, expected a result of calibrate or discover, or its folder", argument)
    return record
