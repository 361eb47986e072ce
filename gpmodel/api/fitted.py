"""Common interface of calibration results: parameter values, predictions and figures."""

import html
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from gpmodel.api.model import Model
from gpmodel.api.results import save_fitted, write_fitted
from gpmodel.api.table import Described, TableLike
from gpmodel.api.verification import VerifyResult
from gpmodel.calibration.result import Calibration
from gpmodel.errors import InputError, choices
from gpmodel.evolution.input_histogram import without_runs
from gpmodel.executor import Forks
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import names_of, translate
from gpmodel.report.fitted import root_residual
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord
from gpmodel.report.text import summary
from gpmodel.wording import measured


class RecordedResult:
    """Result of a calibration or search, computed or loaded from a folder, with the content of its report.json."""

    if TYPE_CHECKING:  # a field of one subclass, a cached property of others

        @property
        def record(self) -> Report:
            """Content of the file report.json of a calibration."""

    @property
    def histogram(self) -> pd.DataFrame:
        """One row per input in round 1: number of evolved programs that contain it, also on permuted residuals, p,
        significance.

        The histogram is empty if no program was evolved.
        """
        found = self.record.histograms[0] if self.record.histograms else without_runs((), 1.0)
        rows = {
            "input": found.inputs, **found.counts, "shuffled": found.referring_by_chance, "p_value": found.p_values,
            "significant": [name in found.significant for name in found.inputs],
        }  # fmt: skip
        return pd.DataFrame({name: pd.Series(list(values)) for name, values in rows.items()})

    @property
    def findings(self) -> tuple[EffectRecord, ...]:
        """Accepted effects, in the order of their discovery."""
        return self.record.effects

    @property
    def verdict(self) -> str:
        """Verdict on the calibration or search in one sentence."""
        return self.record.verdict

    @property
    def rms(self) -> float:
        """RMS, mm, of the 3-D error of the last model on held-out poses, or on training poses if none were held out."""
        found = self.record.ladder[-1].errors.rms_mm
        return float("nan") if found is None else found

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per parameter or effect: name, value, stderr, unit, unique_share, kept (in the model)."""
        columns = ["name", "value", "stderr", "unit", "unique_share", "kept"]
        return pd.DataFrame((*self.record.parameters, *self.record.effects), columns=columns)

    def summary(self) -> str:
        """Return the result as text: verdict, errors of each model, effects, parameters, standard errors, warnings."""
        return summary(self.record)

    def ladder(self) -> pd.DataFrame:
        """Return one row per model: 3-D errors [mm] on held-out and training poses, and the number of unknowns."""
        rows = []
        for rung in self.record.ladder:
            row: dict[str, str | float | None] = {"step": self.record.title(rung)}
            for side, errors in (("held-out", rung.heldout), ("training", rung.train)):
                row |= {f"{side} {k} [mm]": getattr(errors, f"{k}_mm") for k in ("mean", "rms", "max")}
            rows.append(row | {"unknowns": rung.rank})
        return pd.DataFrame(rows)

    def plot(self, name: str | None = None) -> object:
        """Return a figure of the report as a matplotlib Figure. name: name of the figure; None for the first figure.

        Raises InputError for an unknown name, with the names of all figures.
        """
        from gpmodel.report.figures import figure
        from gpmodel.report.page import pictures

        known = {p.name: p for p in pictures(self.record)}
        if not known or (name is not None and name not in known):
            raise InputError(f"{name!r} is no picture of this result; available: {choices(name, known)}", "name")
        return figure(known[name or next(iter(known))])

    def _repr_html_(self) -> str:
        """Return HTML for a notebook: verdict, errors of each model, effects with standard errors, a figure."""
        ladder = self.ladder().dropna(axis="columns", how="all").to_html(index=False, float_format="{:.4g}".format)
        effects = pd.DataFrame(
            [{"effect": e.name, "value": str(measured(e.value, e.stderr, e.unit))} for e in self.findings]
        )
        drawn = ""
        with suppress(ImportError):
            from gpmodel.report.figures import standalone_svg
            from gpmodel.report.page import pictures

            drawn = next((standalone_svg(p) for p in pictures(self.record)), "")
        table = effects.to_html(index=False) if len(effects) else ""
        return f"<p><b>{html.escape(self.verdict)}</b></p>{ladder}{table}{drawn}"


class FittedResult(RecordedResult, ABC):
    """Calibration result with a fitted model. Parameters and effects have the joint names of the table."""

    @property
    @abstractmethod
    def model(self) -> Model:
        """Model for prediction and compensation, fitted to all poses; `save` and `report` write this model."""

    @property
    @abstractmethod
    def fit(self) -> tuple[Calibration, Poses]:
        """The fitted model with all standard errors, fitted to all poses, and the dataset of the poses."""

    def predict(self, poses: TableLike, *, as_measured: bool = False, in_order: bool = False) -> pd.DataFrame:
        """Return the tool position predicted by the model for each pose; `Model.predict` documents the arguments."""
        return self.model.predict(poses, as_measured=as_measured, in_order=in_order)

    def verify(
        self, table: TableLike, *, tolerance: str | None = None, in_order: bool = False, **sights: Described
    ) -> VerifyResult:
        """Test whether the model is valid for a table measured later; `Model.verify` documents the arguments."""
        return self.model.verify(table, tolerance=tolerance, in_order=in_order, **sights)

    @property
    def residuals(self) -> pd.DataFrame:
        """One row per pose: row, measured minus modelled x, y, z [mm] in the mechanism's root frame, 3-D error [mm]."""
        fit, poses = self.fit
        left = 1e3 * root_residual(fit, poses)
        columns = {f"{a} [mm]": left[:, i] for i, a in enumerate("xyz")}
        return pd.DataFrame({"row": poses.dataset.row, **columns, "error [mm]": 1e3 * fit.error})

    @property
    def params(self) -> pd.Series:
        """Values of the model's parameters and effects by name, SI units."""
        return pd.Series(self.fit[0].theta, index=self._names, name="value")

    @property
    def stderr(self) -> pd.Series:
        """Standard errors of the parameters and effects by name, SI units; NaN for a quantity that was not fitted."""
        return pd.Series(self.fit[0].stderr, index=self._names, name="stderr")

    @property
    def covariance(self) -> pd.DataFrame:
        """Covariance of registration, tool, parameters and effects, SI; zero for a quantity that was not fitted."""
        known = self.fit[0].covariance
        names = [*known.placement, *self._names]
        return pd.DataFrame(known.values, index=names, columns=names)

    @property
    def _names(self) -> list[str]:
        fit, poses = self.fit
        names = names_of(poses.dataset)
        return [translate(e.name, names) for e in fit.model.effects]

    def report(self, folder: str | Path, *, workers: int = 0) -> None:
        """Write report.html, report.json, model.json, figures and exported files into `folder`; all files or none.

        workers: number of processes; 0 for one per core, 1 for this process alone.
        """
        write_fitted(lambda: self.record, self.model, folder, Forks(workers))

    def save(self, file: str | Path) -> None:
        """Write report.json to `file`, with the errors of the exported files. Raises InputError if the file cannot
        be written."""
        save_fitted(self.record, self.model, file)
