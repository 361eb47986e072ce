"""Test columns of a table for a wrong scale factor: of positions, or of joint values."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpmodel.calibration.result import Calibration
from gpmodel.checks.smooth_errors import mixed_model
from gpmodel.checks.warnings import BUILT_WRONG
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import INSTRUMENT, Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank
from gpmodel.wording import measured

BETTER = 1.5
"""Least factor by which a scale factor of one column has to reduce the residual of the standard model."""
CURED = BUILT_WRONG / 2
"""Standard deviation of the errors of the description, m and rad, that a scale factor has to leave at most: 95 % of the
constants are then below the limit of a wrong description."""
SMALLEST = 2e-4
"""Least deviation from one of a wrong scale factor of columns. Smaller deviations from one are errors of instruments
(0.00001) and gears (0.0001), which `discover` names."""
IMPOSSIBLE = 2e-3
"""Deviation of a scale factor from one that no machine has: aluminium grows by 0.0023 over 100 K."""
CHANCE = 1e-4
"""Probability of a scale factor at least so far from one in a sound table, below which the factor causes a warning."""


@dataclass(frozen=True)
class Factor:
    """A common scale factor of some columns of a table.

    columns: names of the columns, in words.
    value, stderr: the factor and its standard error.
    chance: probability of a factor at least so far from one in a sound table.
    less: residual without the factor over residual with the factor.
    left: standard deviation of the errors of the description, given the factor, m and rad.
    """

    columns: str
    value: float
    stderr: float
    chance: float
    less: float
    left: float

    @property
    def size(self) -> str:
        """Value and standard error of the scale factor as text."""
        return str(measured(self.value, self.stderr, "1"))

    @property
    def wrong(self) -> bool:
        """True if neither chance, an instrument nor a gear explains the factor, and no wrong description remains."""
        return self.chance < CHANCE and abs(self.value - 1.0) > SMALLEST and self.left < CURED


def scaled(fit: Calibration, poses: Poses) -> Iterator[tuple[str, str, str]]:
    """Yield severity, text and reason of unfitness for a wrong scale factor of positions or joint values.

    A scale factor of one column must reduce the residual by a factor of 1.5. For a scale factor of all positions no
    reduction is required: longer links would fit equally well. A scale factor that is wrong in the model without smooth
    errors of the joints is tested in the model with smooth errors. fit: fit of the standard model.

    With the model of the function `mixed_model` and the column c of a factor f, r = ... + (f - 1) c. Positions 1 % too
    large and links all described 1 % too short move the points alike. τ, the standard deviation of the errors of the
    description, determines the probability of an error of all links. Likewise a spring or a gear moves a joint almost
    as a factor does, but not in proportion to the joint value. ω, the size of the smooth errors in addition to the
    factor, determines the probability of a smooth error that resembles the factor.
    """
    sound = poses.subset(np.delete(np.arange(len(poses)), fit.outliers))
    whole, *each = _factors(fit, sound) or (None,)
    if whole is None:
        return
    suspected = sorted((f for f in each if f.wrong and f.less > BETTER), key=lambda f: -f.less)
    for suspect in (*suspected, *[whole] * whole.wrong):
        (factor,) = _factors(fit, sound, suspect.columns)
        if factor.wrong:
            by = " against the lengths described"
            if suspect is not whole:
                by = f": with this factor removed, the residual is {suspect.less:.3g} times smaller"
            text = (
                f"{factor.columns} scaled by {factor.size}{by}; expected 1: check the unit, the length standard or "
                "the gear ratio"
            )
            yield "warning", text, "columns with a wrong scale" if abs(factor.value - 1.0) > IMPOSSIBLE else ""
            return
    yield "note", f"scale of x, y and z against the lengths described: {whole.size}", ""


def _factors(fit: Calibration, poses: Poses, only: str | None = None) -> list[Factor]:
    """Estimate the scale factor of all positions, then of each of x, y, z and each joint; empty without positions.

    only: columns of the one factor that is estimated in a model with smooth errors of the joints.
    """
    if not np.isfinite(poses.dataset.position).any():
        return []
    problem, taken, model = mixed_model(fit, poses, smooth=only is not None)
    if problem.reduced is not None:
        return []
    effects = [effect for effect in _effects(fit.model.mechanism) if only in (None, effect.name)]
    columns = rank.remove(taken, problem.effect_rows(effects, fit.model))
    before = model.deviations()[0][-1]
    found = []
    for effect, column in zip(effects, columns.T, strict=True):
        if np.linalg.norm(column) > rank.NEGLIGIBLE:
            off = model.fixed(column)
            less, left = before / off.deviations[-1], off.deviations[0]
            found.append(Factor(effect.name, 1.0 + off.value, off.stderr, off.chance, float(less), float(left)))
    return found


def _effects(mechanism: Mechanism) -> Iterator[Effect]:
    """Yield the effect of each scale factor (of x, y and z together, of each axis, of each joint) per unit. A joint
    with too large values moves less than the column states."""
    for axes, name in (("xyz", "x, y and z look"), *((axis, f"column '{axis}' looks") for axis in "xyz")):
        terms = tuple(Term(INSTRUMENT, f"T{axis}", Expression(f"instrument_{axis}")) for axis in axes)
        yield Effect(name, terms, "1")
    for joint in mechanism.joints:
        yield drive_effect(f"column '{joint.name}' looks", joint, Expression(f"-1*{joint.name}"), "1")
