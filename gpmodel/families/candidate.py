"""A candidate: one thing that the model may be missing, and the shapes that many of them share."""

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
from gpmodel.model.effect import Effect, Term, drive_effect, made_of
from gpmodel.model.states import States, load_unit

NO_LOAD, NEXT_TO_NONE = 1e-6, 1e-4
"""Load that counts as rounding, N·m or N; and the least share of the largest load of the same unit that counts at all.
With less, a joint would have to be ten thousand times as soft as the others, and at other poses the load may be a
hundred times as large."""

STANDARD_TEMPERATURE = {"degC": 20.0, "K": 293.15, "degF": 68.0}
"""Temperature at which dimensions are stated (ISO 1), by the unit of the column."""

Kind = Literal["single", "harmonic", "vector", "curve"]

CATALOGUE, NAMED, SMOOTH_TERM = "catalogue", "named", "smooth term"
FORMULA, FORMULA_OF_PROGRAM = "formula", "formula of a program"
BRED = tuple(f"formula of generation {g}" for g in range(1, 10))
SEQUENCE, TREE = "sequence", "tree"
"""Makers of a candidate: the catalogue; the user; a smooth term without a formula; a short formula, a founder, for a
smooth term or an effect, or for an evolved program; one that is bred from founders, by its generation; genetic
programming, by its representation."""


FORMULAS = FORMULA, FORMULA_OF_PROGRAM, *BRED


def maker_of(representation: str) -> str:
    """Maker of a program by the label of its representation."""
    return {"linear": SEQUENCE}.get(representation, representation)


def is_program(found_by: str) -> bool:
    """Return whether a maker is genetic programming in any representation."""
    return found_by not in {CATALOGUE, NAMED, SMOOTH_TERM, *FORMULAS}


def formula_of(makers: Iterable[str], generation: int = 0) -> str:
    """Maker of a formula of a generation that replaces candidates of some makers."""
    if generation:
        return BRED[generation - 1]
    unevolved = {CATALOGUE, NAMED, SMOOTH_TERM, FORMULA, *BRED}
    return FORMULA if unevolved.issuperset(makers) else FORMULA_OF_PROGRAM


def without_phase(name: str) -> str:
    """The name that the sine and the cosine of one error share: `gear error, J4` of `gear error, J4, sin`."""
    return name.removesuffix(", sin").removesuffix(", cos")


@dataclass(frozen=True)
class Candidate:
    """One thing the model may be missing: effects that come together, each with its own unknown.

    family: the name of its family, empty without one. cost: nats of description beyond the data: the log
    of how many alternatives it was chosen from. found_by: its maker. explanation: its physical cause and source, as the
    family states them. inner: the constants inside its bases, if there are any.
    believed: its priors are standard deviations that somebody stated, and no larger ones are tried.
    """

    name: str
    effects: tuple[Effect, ...]
    family: str
    cost: float
    found_by: str = CATALOGUE
    explanation: str = ""
    inner: NonlinearParameters | None = None
    believed: bool = False

    def __post_init__(self) -> None:
        if not self.effects or not made_of(self.effects, Effect):
            raise InputError(f"candidate {self.name!r}: expected a tuple of one Effect or more")
        if not math.isfinite(self.cost):
            raise InputError(f"candidate {self.name!r}: its cost is {self.cost}, expected finite nats")

    def at(self, inner: NonlinearParameters) -> "Candidate":
        """The candidate with other constants inside, its unknowns free of priors."""
        effects = tuple(replace(e, prior=math.inf) for e in inner.effects)
        return replace(self, name=inner.full_name, effects=effects, inner=inner)

    @property
    def has_priors(self) -> bool:
        """True if the effects have priors; either all of them do or none."""
        return bool(np.isfinite(self.effects[0].prior))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the basis functions, in the order of their first mention."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.inputs))

    @property
    def place(self) -> Term:
        """The slot, axis and basis of its first effect, which stand for where it acts."""
        return self.effects[0].terms[0]

    @property
    def unit(self) -> str:
        """The unit of its amplitude: of its first effect's unknown."""
        return self.effects[0].unit

    @property
    def bases(self) -> tuple[Basis, ...]:
        """The basis of every effect's first term."""
        return tuple(effect.terms[0].basis for effect in self.effects)

    @property
    def kind(self) -> Kind:
        """Kind of the unknowns together.

        single: one number. harmonic: sine and cosine of one argument. vector: one basis along several axes. curve: a
        sum of different bases.
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
        """Its size as one number, and the gradient (E,) of that by its unknowns `theta` (E,).

        single: θ. harmonic: √(θ₁² + θ₂²). vector: the length along the axes of the first one's unit. curve: the RMS of
        Σ θ φ over the poses of `states`.
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
    """A candidate with constants inside its bases."""
    return Candidate(inner.full_name, inner.effects, family, cost, inner=inner)


def one(name: str, effect: Effect, cost: float) -> Candidate:
    """A candidate of one effect, in that effect's family."""
    return Candidate(name, (effect,), effect.family, cost)


def pair(name: str, joint: Joint, argument: str, family: str, cost: float, prior: float = math.inf) -> Candidate:
    """A harmonic on a joint's drive: sine and cosine of `argument`, in rad. prior: of either, rad or m."""
    effects = tuple(
        drive_effect(f"{name}, {f}", joint, Expression(f"{f}({argument})"), family=family, prior=prior)
        for f in ("sin", "cos")
    )
    return Candidate(name, effects, family, cost)


def share_of_rows(states: States) -> str:
    """The row from 0 at the first to 1 at the last, as text."""
    rows = states["row"]
    return f"((row - {np.min(rows):g})/{float(np.ptp(rows)) or 1.0:g})"


def relative(states: States, column: str, unit: str) -> str:
    """Write a column relative to a reference, as text; constants of a model describe the mechanism at the reference.

    The reference is 20 °C for temperatures (ISO 1). For other columns it is the measured value nearest to zero: zero
    itself, or the start of a clock.
    """
    if (reference := STANDARD_TEMPERATURE.get(unit)) is None:
        values = states[column]
        reference = float(np.clip(0.0, np.min(values, initial=np.inf), np.max(values, initial=-np.inf)))
    return f"{column} - {reference:.12g}" if reference > 0 else f"{column} + {-reference:.12g}" if reference else column


def revolute(mechanism: Mechanism) -> list[Joint]:
    """The joints that turn."""
    return [j for j in mechanism.joints if j.kind == "revolute"]


def across(joint: Joint) -> tuple[str, str]:
    """The two axes at right angles to a joint's own."""
    own = joint.drive[0][1][1]
    first, second = (a for a in "xyz" if a != own)
    return first, second


def loaded(states: States, load: str) -> bool:
    """Return whether a load exists and exceeds rounding and negligible values.

    An axis through its centre of mass carries no load; a wrist that hangs straight down hardly any.
    """

    def most(name: str) -> float:
        return float(np.max(np.abs(states[name]), initial=0.0))

    if load not in states.columns or not most(load) > NO_LOAD:
        return False
    alike = (name for name in states.loads if load_unit(name) == load_unit(load))
    return most(load) > NEXT_TO_NONE * max(map(most, alike), default=0.0)
