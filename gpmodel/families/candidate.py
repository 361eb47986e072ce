"""Define candidates: groups of effects that the error model may lack and that enter the model together."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.families.inner import NonlinearParameters
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import Effect, Term, axis_unit, drive_effect, made_of
from gpmodel.model.states import States

NO_LOAD, NEXT_TO_NONE = 1e-6, 1e-4
"""Largest load that counts as rounding error, N·m or N; and least share of the largest load of equal unit that is not
negligible. Under a smaller load a joint would need ten thousand times the compliance of other joints, and at other
poses the load may be a hundred times as large."""

STANDARD_TEMPERATURE = {"degC": 20.0, "K": 293.15, "degF": 68.0}
"""Reference temperature of dimensions (ISO 1), by the unit of a temperature column."""

Kind = Literal["single", "harmonic", "vector", "curve"]

CATALOGUE, NAMED, SMOOTH_TERM = "catalogue", "named", "smooth term"
FORMULA, FORMULA_OF_PROGRAM = "formula", "formula of a program"
BRED = tuple(f"formula of generation {g}" for g in range(1, 10))
SEQUENCE, TREE = "sequence", "tree"
"""Values of `found_by`, the origin of a candidate: the catalogue; the user; a smooth term without a formula; a formula
that replaces a smooth term or effect; a formula that replaces an evolved program; a formula made by crossover, by its
generation; genetic programming, by its representation."""


FORMULAS = FORMULA, FORMULA_OF_PROGRAM, *BRED


def maker_of(representation: str) -> str:
    """Return the origin of an evolved candidate from the representation of its program, "linear" or "tree"."""
    return {"linear": SEQUENCE}.get(representation, representation)


def is_program(found_by: str) -> bool:
    """Return whether genetic programming generated a candidate. found_by: origin of the candidate."""
    return found_by not in {CATALOGUE, NAMED, SMOOTH_TERM, *FORMULAS}


def formula_of(makers: Iterable[str], generation: int = 0) -> str:
    """Return the origin of a formula that replaces candidates of the given origins. generation: number of generations
    of crossover and mutation, 0 for an enumerated formula."""
    if generation:
        return BRED[generation - 1]
    unevolved = {CATALOGUE, NAMED, SMOOTH_TERM, FORMULA, *BRED}
    return FORMULA if unevolved.issuperset(makers) else FORMULA_OF_PROGRAM


def without_phase(name: str) -> str:
    """Return the common name of the sine and cosine of one error: `gear error, J4` for `gear error, J4, sin`."""
    return name.removesuffix(", sin").removesuffix(", cos")


@dataclass(frozen=True)
class Candidate:
    """One error that the model may lack: effects that enter the model together, each with its own coefficient.

    family: name of the candidate's catalogue family, or empty.
    cost: penalty of the candidate's description, nats: the log of the number of alternatives.
    found_by: origin of the candidate, such as the catalogue or genetic programming.
    explanation: physical cause of the candidate and its source in the literature.
    inner: nonlinear constants inside the candidate's basis functions, or None.
    specified: whether the prior standard deviations come from a specification, so that larger values are not tried.
    """

    name: str
    effects: tuple[Effect, ...]
    family: str
    cost: float
    found_by: str = CATALOGUE
    explanation: str = ""
    inner: NonlinearParameters | None = None
    specified: bool = False

    def __post_init__(self) -> None:
        if not self.effects or not made_of(self.effects, Effect):
            raise InputError(f"candidate {self.name!r}: expected a tuple of one Effect or more")
        if not math.isfinite(self.cost):
            raise InputError(f"candidate {self.name!r}: its cost is {self.cost}, expected finite nats")

    def at(self, inner: NonlinearParameters) -> "Candidate":
        """Return a copy of the candidate with new constants in its basis functions, and without priors."""
        effects = tuple(replace(e, prior=math.inf) for e in inner.effects)
        return replace(self, name=inner.full_name, effects=effects, inner=inner)

    @property
    def has_priors(self) -> bool:
        """True if all effects of the candidate have priors, False if none has."""
        return bool(np.isfinite(self.effects[0].prior))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs (columns) of the candidate's basis functions, in the order of first use."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.inputs))

    @property
    def place(self) -> Term:
        """First term of the candidate's first effect, whose frame, axis and basis function represent the candidate."""
        return self.effects[0].terms[0]

    @property
    def unit(self) -> str:
        """Unit of the candidate's amplitude: rad or m for a smooth function, else the unit of its first coefficient."""
        return axis_unit(self.place.axis) if self.kind == "curve" else self.effects[0].unit

    @property
    def bases(self) -> tuple[Basis, ...]:
        """Basis function of the first term of each effect of the candidate."""
        return tuple(effect.terms[0].basis for effect in self.effects)

    @property
    def kind(self) -> Kind:
        """Kind of the candidate effect, by the basis functions and axes of its effects.

        single: a candidate of one effect.
        harmonic: a candidate of sine and cosine of one argument.
        vector: a candidate of one basis function along several axes.
        curve: a candidate that is a sum of different basis functions.
        """
        if len(self.effects) == 1:
            return "single"
        if len({str(basis) for basis in self.bases}) == 1:
            return "vector"
        written = [basis for basis in self.bases if isinstance(basis, Expression)]
        if len(written) == len(self.effects) == 2:
            (first, argument), (second, other) = (basis.call for basis in written)
            if (first, second) == ("sin", "cos") and argument == other:
                return "harmonic"
        return "curve"

    def amplitude(self, theta: Array, states: States) -> tuple[float, Array]:
        """Return the size of the candidate as one number, and the derivative of the size with respect to each
        coefficient `theta`.

        The size is the coefficient θ of a single effect, √(θ₁² + θ₂²) of a sine and cosine, the length of a vector (of
        the components in the unit of the first effect), and the RMS over the poses of a curve Σ θ φ with basis
        functions φ.
        """
        match self.kind:
            case "single":
                return float(theta[0]), np.ones(1)
            case "harmonic":
                size = float(np.hypot(*theta))
                return size, theta / size if size else np.array([1.0, 0.0])
            case "vector":
                along = np.where([e.unit == self.unit for e in self.effects], theta, 0.0)
                size = float(np.linalg.norm(along))
                return size, along / size if size else np.ones(len(theta))
            case "curve":
                shapes = np.array([basis(states) for basis in self.bases])
                total = theta @ shapes
                size = float(np.sqrt(np.mean(total**2)))
                return size, shapes @ total / (len(total) * size) if size else np.zeros(len(theta))


def inside(inner: NonlinearParameters, family: str, cost: float) -> Candidate:
    """Return the candidate of a template, in which the values of the constants replace the symbols."""
    return Candidate(inner.full_name, inner.effects, family, cost, inner=inner)


def one(name: str, effect: Effect, cost: float) -> Candidate:
    """Return a candidate that consists of one effect, in the family of the effect."""
    return Candidate(name, (effect,), effect.family, cost)


def pair(name: str, joint: Joint, argument: str, family: str, cost: float, prior: float = math.inf) -> Candidate:
    """Return a candidate on the drive of a joint: sine and cosine of `argument`, rad. prior: standard deviation of each
    coefficient, rad or m."""
    effects = tuple(
        drive_effect(f"{name}, {f}", joint, Expression(f"{f}({argument})"), family=family, prior=prior)
        for f in ("sin", "cos")
    )
    return Candidate(name, effects, family, cost)


def share_of_rows(states: States) -> str:
    """Write an expression of the row number that rises from 0 at the first row to 1 at the last row."""
    rows = states["row"]
    return f"((row - {np.min(rows):g})/{float(np.ptp(rows)) or 1.0:g})"


def relative(states: States, column: str, unit: str) -> str:
    """Write a column relative to a reference value, at which the geometric constants of a model describe the mechanism.

    The reference is 20 °C for temperatures (ISO 1). For other columns the reference is the measured value nearest to
    zero: zero itself, or the start of a clock.
    """
    if (reference := STANDARD_TEMPERATURE.get(unit)) is None:
        values = states[column]
        reference = float(np.clip(0.0, np.min(values, initial=np.inf), np.max(values, initial=-np.inf)))
    return f"{column} - {reference:.12g}" if reference > 0 else f"{column} + {-reference:.12g}" if reference else column


def revolute(mechanism: Mechanism) -> list[Joint]:
    """Return the revolute joints of a mechanism."""
    return [j for j in mechanism.joints if j.kind == "revolute"]


def across(joint: Joint) -> tuple[str, str]:
    """Return the names of the two axes at right angles to the axis of a joint."""
    own = joint.drive[0][1][1]
    first, second = (a for a in "xyz" if a != own)
    return first, second


def loaded(states: States, load: str) -> bool:
    """Return whether a load exceeds rounding error and a negligible share of other loads; True if not in N or N·m.

    A load is negligible if the joint axis passes through the centre of mass, or if the wrist hangs down. A load without
    a column is negligible.
    """

    def most(name: str) -> float:
        return float(np.max(np.abs(states[name]), initial=0.0))

    if load in states.columns and states.units[load] not in ("N", "Nm"):
        return True
    if load not in states.columns or not most(load) > NO_LOAD:
        return False
    alike = (name for name in states.loads if states.units[name] == states.units[load])
    return most(load) > NEXT_TO_NONE * max(map(most, alike), default=0.0)
