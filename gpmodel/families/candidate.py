"""A candidate: one thing that the model may be missing, and the shapes that many of them share."""

from dataclasses import dataclass

import numpy as np

from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.states import States

NO_LOAD = 1e-6


@dataclass(frozen=True)
class Inner:
    """A constant inside the bases that the linear solve cannot reach.

    name, template: the candidate's name and effects with CONSTANT in its place (see gpmodel.families.inner).
    lower, upper: its neighbours on the grid, between which it may be refined.
    """

    name: str
    template: tuple[Effect, ...]
    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Candidate:
    """One thing the model may be missing: effects that come together, each with its own unknown.

    family: the name of its family, empty for what nobody has named. cost: nats of description beyond the data: the log
    of how many alternatives it was chosen from. found_by: catalogue or evolved. explanation: what it would be
    physically and who says so, as its family has it. inner: the constant inside its bases, if there is one.
    """

    name: str
    effects: tuple[Effect, ...]
    family: str
    cost: float
    found_by: str = "catalogue"
    explanation: str = ""
    inner: Inner | None = None

    @property
    def has_priors(self) -> bool:
        """Whether its unknowns are believed to be small before measuring: its effects come with priors, all or none."""
        return bool(np.isfinite(self.effects[0].prior))

    @property
    def inputs(self) -> tuple[str, ...]:
        """What its bases read, in the order of their first mention."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.inputs))

    @property
    def place(self) -> Term:
        """The slot, axis and basis of its first effect, which stand for where it acts."""
        return self.effects[0].terms[0]


def one(name: str, effect: Effect, cost: float) -> Candidate:
    return Candidate(name, (effect,), effect.family, cost)


def pair(name: str, joint: Joint, argument: str, family: str, cost: float) -> Candidate:
    effects = tuple(
        drive_effect(f"{name}, {f}", joint, Expression(f"{f}({argument})"), family=family) for f in ("sin", "cos")
    )
    return Candidate(name, effects, family, cost)


def revolute(mechanism: Mechanism) -> list[Joint]:
    return [j for j in mechanism.joints if j.kind == "revolute"]


def across(joint: Joint) -> tuple[str, str]:
    """The two axes at right angles to a joint's own."""
    own = joint.drive[0][1][1]
    first, second = (a for a in "xyz" if a != own)
    return first, second


def loaded(states: States, load: str) -> bool:
    """Whether a load is there and more than rounding: an axis through its centre of mass carries none."""
    return load in states.columns and float(np.max(np.abs(states[load]), initial=0.0)) > NO_LOAD
