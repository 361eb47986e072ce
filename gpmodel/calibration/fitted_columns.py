"""The columns of a fit, each seen without the others."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.priors import prior_rows
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import Poses
from gpmodel.numerics.least_squares import LeaveOneOut


@dataclass(frozen=True)
class FittedColumns:
    """The weighted columns (M, K) of a fitted model at some poses: of the placement, then of its effects."""

    calibration: Calibration
    problem: Linearised

    @classmethod
    def at(cls, calibration: Calibration, poses: Poses) -> "FittedColumns":
        """Those at poses of known set-ups and tools."""
        return cls(calibration, problem_at(calibration, poses))

    @property
    def columns(self) -> Array:
        """(M, K), weighted like the residual."""
        return self.problem.columns

    @property
    def first(self) -> int:
        """The column of the first effect."""
        return self.problem.placement

    @property
    def held(self) -> Mask:
        """The columns (K,) of the placement and of the effects that are not dropped."""
        return self.problem.free(self.calibration.kept)

    @cached_property
    def apart(self) -> LeaveOneOut:
        """Each of those columns without the others, as far as these are let by their priors, rows below the others."""
        fit = self.calibration
        loose = fit.kept & np.array([not effect.constant for effect in fit.model.effects], dtype=bool)
        priors, _ = prior_rows(fit.model, fit.theta, self.problem, loose)
        return LeaveOneOut.of(np.vstack([self.columns[:, self.held], priors[:, self.held]]))

    def over_all_rows(self, values: Array) -> Array:
        """Values (M, R) with zeros in the rows of the priors."""
        return np.vstack([values, np.zeros((len(self.apart.u) - len(values), values.shape[1]))])

    def number(self, k: int) -> int:
        """Return the column number of effect k."""
        return self.first + int(np.sum(self.calibration.kept[:k]))

    def of(self, candidate: Candidate) -> Array:
        """Columns (M, k) of a candidate's effects."""
        return self.problem.effect_rows(candidate.effects, self.calibration.model)

    def difference(self, k: int, candidate: Candidate, sizes: Array) -> Array:
        """Return the displacement of the readings by effect k minus that by a candidate of given sizes (M,)."""
        return np.asarray(self.calibration.theta[k] * self.columns[:, self.first + k] - self.of(candidate) @ sizes)
