"""What results of a fit have in common: numbers, predictions and pictures at hand."""

from abc import ABC, abstractmethod

import pandas as pd

from gpmodel.api.display import figure_of, ladder_of, notebook_of
from gpmodel.api.model import Model
from gpmodel.api.table import TableLike
from gpmodel.api.verification import VerifyResult
from gpmodel.calibration.result import Calibration
from gpmodel.model.error_model import Poses
from gpmodel.report.fitted import root_residual
from gpmodel.report.schema import Report


class FittedResult(ABC):
    """A result with a fitted model."""

    @property
    @abstractmethod
    def record(self) -> Report:
        """The same as report.json has it."""

    @property
    @abstractmethod
    def model(self) -> Model:
        """What predicts, compensates and is saved, fitted to all poses."""

    @property
    @abstractmethod
    def fit(self) -> tuple[Calibration, Poses]:
        """The fit to all poses, and these."""

    def predict(self, poses: TableLike, *, as_measured: bool = False, in_order: bool = False) -> pd.DataFrame:
        """As `Model.predict`."""
        return self.model.predict(poses, as_measured=as_measured, in_order=in_order)

    def verify(self, table: TableLike, *, tolerance: str | None = None, in_order: bool = False) -> VerifyResult:
        """As `Model.verify`."""
        return self.model.verify(table, tolerance=tolerance, in_order=in_order)

    @property
    def residuals(self) -> pd.DataFrame:
        """One row a pose: row, measured minus modelled x, y, z [mm] in the mechanism's root frame, 3-D error [mm]."""
        fit, poses = self.fit
        left = 1e3 * root_residual(fit, poses)
        columns = {f"{a} [mm]": left[:, i] for i, a in enumerate("xyz")}
        return pd.DataFrame({"row": poses.dataset.row, **columns, "error [mm]": 1e3 * fit.error})

    @property
    def params(self) -> pd.Series:
        """The values of the model's parameters and effects by name, SI."""
        fit = self.fit[0]
        return pd.Series(fit.theta, index=[e.name for e in fit.model.effects], name="value")

    @property
    def stderr(self) -> pd.Series:
        """Their standard deviations; NaN where the poses could not determine one."""
        fit = self.fit[0]
        return pd.Series(fit.stderr, index=[e.name for e in fit.model.effects], name="stderr")

    @property
    def covariance(self) -> pd.DataFrame:
        """Their covariance, SI, registration and tool first; zero where not fitted."""
        fit = self.fit[0]
        names = [*fit.covariance.placement, *(e.name for e in fit.model.effects)]
        return pd.DataFrame(fit.covariance.values, index=names, columns=names)

    @property
    def rms(self) -> float:
        """RMS, mm, of the 3-D error of the last step, on the held-out poses where there are any."""
        found = self.record.ladder[-1].errors.rms_mm
        return float("nan") if found is None else found

    def ladder(self) -> pd.DataFrame:
        """One row a step: 3-D errors [mm] on held-out and training poses, and the unknowns solved."""
        return ladder_of(self.record)

    def plot(self, name: str | None = None) -> object:
        """A picture of the report as a matplotlib Figure: the first one, or that of a name.

        Raises InputError, listing the names, for one that is none.
        """
        return figure_of(self.record, name)

    def _repr_html_(self) -> str:
        return notebook_of(self.record)
