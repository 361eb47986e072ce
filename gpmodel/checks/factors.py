"""Factors of columns: one unknown scales x, y and z together, one of them, or the values of one joint.

With r (M,) the readings about the description, P the columns of registration, tool and whatever a healthy machine does
(HEALTHY), A those of every constant, and c that of a factor,

    r = P ρ + A θ + (f - 1) c + e,   θ ~ N(0, τ² I),   e ~ N(0, σ² I)

Positions 1 % too large and links all described 1 % too short move the points alike: τ, the error that the other
constants of this description appear to have, tells how likely the latter is. f is the generalised least squares
estimate; (f - 1) / s has Student's t distribution with Σ τ² s_k² / (τ² s_k² + σ²) degrees of freedom, the number of
constants that τ is known from. Source: MacKay (1992), Bayesian Interpolation.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.size import MOST, spread
from gpmodel.checks.weak_columns import BETTER
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import INSTRUMENT, Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank

HEALTHY = ("base_compliance", "joint_compliance", "eccentricity")
"""Families that are fitted beside a factor: loads and gears off centre change with a joint as its factor does."""
SMALLEST = 2e-4
"""Factors nearer to one are errors of instruments (0.00001) and gears (0.0001), which `discover` names."""
IMPOSSIBLE = 2e-3
"""Factors farther from one are no property of a machine: aluminium grows by 0.0023 over 100 K."""
CHANCE = 1e-4
"""Chance of a factor this far from one of a sound table, below which it is a warning."""


@dataclass(frozen=True)
class Factor:
    """A factor of some columns: its value and standard error, its chance in a sound table, and how many times less is
    left with it."""

    columns: str
    value: float
    stderr: float
    chance: float
    less: float

    @property
    def size(self) -> str:
        """Value and standard error."""
        return f"{self.value:.5f} ± {self.stderr:.5f}"

    @property
    def wrong(self) -> bool:
        """True if neither chance nor an instrument or a gear explains the factor."""
        return self.chance < CHANCE and abs(self.value - 1.0) > SMALLEST


def scaled(fit: Calibration, poses: Poses) -> Iterator[tuple[str, str, str]]:
    """Yield the severity, the text and the reason why no sound fit follows, of the factor that the positions show.

    A factor of one column has to leave BETTER times less; that of all positions leaves as much as the lengths of the
    links do. fit: of the standard model.
    """
    whole, *each = _factors(fit, poses.subset(np.delete(np.arange(len(poses)), fit.outliers))) or (None,)
    best = max((f for f in each if f.wrong and f.less > BETTER), key=lambda f: f.less, default=whole)
    if best is None:
        return
    by = " against the lengths described" if best is whole else f": divided by that {best.less:.3g} times less is left"
    if best.wrong:
        unfit = "columns of another scale" if abs(best.value - 1.0) > IMPOSSIBLE else ""
        text = f"{best.columns} scaled by {best.size}{by}; expected 1: see the unit, length standard or gear ratio"
        yield "warning", text, unfit
    else:
        yield "note", f"scale of x, y and z{by}: {best.size}", ""


def _factors(fit: Calibration, poses: Poses) -> list[Factor]:
    """Estimate the factor of all positions, then of each of x, y, z and each joint; none without positions."""
    mechanism, problem = fit.model.mechanism, problem_at(fit, poses)
    if problem.left is not None or not np.isfinite(poses.dataset.position).any():
        return []
    pool = candidates(mechanism, poses.states, [f for f in catalogue if f.name in HEALTHY])
    healthy = problem.effect_rows([e for c in pool for e in c.effects], fit.model)
    placed, constants = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    taken = rank.orthonormal(np.hstack([placed, healthy]))
    readings = problem.residual + constants @ fit.theta
    u, s, _ = linalg.svd(rank.remove(taken, constants), full_matrices=False, lapack_driver="gesvd")
    effects = list(_effects(mechanism))
    columns = rank.remove(taken, problem.effect_rows(effects, fit.model))
    shown = np.linalg.norm(columns, axis=0) > rank.NEGLIGIBLE
    before = spread(u * s, readings, taken, MOST)[1]
    return [_factor(effects[k].name, (u, s), readings, (taken, columns[:, k]), before) for k in np.flatnonzero(shown)]


def _effects(mechanism: Mechanism) -> Iterator[Effect]:
    """Errors per unit of a factor. A joint whose values are too large moves less than they say."""
    for axes, name in (("xyz", "x, y and z look"), *((axis, f"column '{axis}' looks") for axis in "xyz")):
        terms = tuple(Term(INSTRUMENT, f"T{axis}", Expression(f"instrument_{axis}")) for axis in axes)
        yield Effect(name, terms, "1")
    for joint in mechanism.joints:
        yield drive_effect(f"column '{joint.name}' looks", joint, Expression(f"-1*{joint.name}"), "1")


def _factor(
    name: str, constants: tuple[Array, Array], readings: Array, free: tuple[Array, Array], before: float
) -> Factor:
    """Estimate one factor.

    constants: left singular vectors (M, H) and values (H,). free: the columns (M, P) of what is free, and that of the
    factor (M,) less its part in them. before: σ without the factor, m.
    """
    (u, s), (taken, column) = constants, free
    reach, sigma, _ = spread(u * s, readings, np.column_stack([taken, column]), MOST)
    known = (reach * s) ** 2 / ((reach * s) ** 2 + sigma**2)
    weighed = (column - u @ (known * (u.T @ column))) / sigma**2
    stderr = float(1.0 / np.sqrt(column @ weighed))
    off = float(weighed @ readings) * stderr**2
    return Factor(name, 1.0 + off, stderr, float(2 * stats.t.sf(abs(off) / stderr, known.sum())), before / sigma)
