"""Test that the checks of `gpmodel.testing` pass correct extensions and name the fault of wrong ones."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from effect_cases import mechanism
from numpy.typing import NDArray

import gpmodel as gp
from gpmodel import testing
from gpmodel.arrays import Array
from gpmodel.evolution.linear import Sequences
from gpmodel.evolution.machine import Layout
from gpmodel.families.catalogue import catalogue


@pytest.mark.parametrize("name", ["irb6400r", "ur5", "spherical-joint"])
def test_our_own_mechanisms_pass(name: str) -> None:
    testing.check_mechanism(gp.load_mechanism(name))


@dataclass(frozen=True)
class Spoiled:
    """A mechanism with one thing wrong."""

    good: gp.Mechanism
    flaw: str

    @property
    def name(self) -> str:
        return self.good.name

    @property
    def joints(self) -> tuple[gp.Joint, ...]:
        first, *others = self.good.joints
        if self.flaw == "drive":
            first = replace(first, drive=tuple((s, a, -w) for s, a, w in first.drive))
        return (first, *others)

    @property
    def slots(self) -> tuple[str, ...]:
        return self.good.slots if self.flaw != "slots" else self.good.slots[::-1]

    def transforms(self, q: Array) -> Array:
        out = self.good.transforms(q)
        return out * 1.001 if self.flaw == "rigid" else out

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        out = self.good.loads(q, payload)
        match self.flaw:
            case "reactions":
                return {name: -values for name, values in out.items()}
            case "torque":
                return out | {"torque_J2": -out["torque_J2"]}
            case "none":
                return {}
        return out


FLAWS = {
    "slots": "expected 'base' first",
    "rigid": "not rigid",
    "drive": "J1: a small change of the joint value moves the tool",
    "reactions": "the sign of loads",
    "torque": "torque_J2 of a payload differs from minus the derivative",
    "none": "loads are empty",
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_mechanism_with_a_flaw_is_told_which(flaw: str) -> None:
    with pytest.raises(AssertionError, match=FLAWS[flaw]):
        testing.check_mechanism(Spoiled(gp.load_mechanism("irb6400r"), flaw))


COUNT = 48
INPUTS = {
    "temperature [degC]": 20.0 + np.arange(COUNT) / 3.0 + np.sin(np.arange(COUNT)),
    "approach_J2 [1]": np.resize([1.0, -1.0, -1.0], COUNT),
    "time [s]": 60.0 * np.arange(COUNT),
} | {f"gravity_{axis} [1]": np.sin(np.arange(COUNT) + k) for k, axis in enumerate("xyz")}
ON = {
    "linear_axis": "dh", "cyclic_error": "dh", "ball_lobes": "spherical-joint", "following": "spherical-joint",
    "preload": "hexapod",
}  # fmt: skip
"""Where a family has instances, or a hundred instead of thousands."""


@pytest.mark.long
@pytest.mark.parametrize("family", catalogue, ids=lambda family: family.name)
def test_our_own_families_pass(family: gp.Family) -> None:
    name = ON.get(family.name, "irb6400r")
    arm = mechanism(name) if name == "dh" else gp.load_mechanism(name)
    testing.check_family(family, arm, inputs=INPUTS, poses=COUNT)


def drag(mechanism: gp.Mechanism, states: gp.States) -> Iterator[gp.Effect]:
    yield gp.effect_at("cable drag", "J4.moving", "Ry", gp.Expression("sin(J4) * temperature"))


def test_a_family_from_outside_with_a_column_of_its_own_passes() -> None:
    arm = gp.load_mechanism("irb6400r")
    family = gp.Family("cable_drag", "the cable pulls at the wrist", "own measurements, 2024", drag)
    testing.check_family(family, arm, inputs={"temperature [degC]": np.linspace(20.0, 30.0, 24)})
    with pytest.raises(AssertionError, match="unknown input 'temperature'; expected a column"):
        testing.check_family(family, arm)


class Kink:
    """A basis that has no text."""

    inputs = ("J4",)

    def __str__(self) -> str:
        return "abs(J4)"

    def __call__(self, states: gp.States) -> Array:
        return np.maximum(states["J4"], 0.0)


EFFECTS = {
    "unknown slot 'J9'; expected a slot of": gp.effect_at("e", "J9", "Rz"),
    "is infinite or undefined": gp.effect_at("e", "J4.moving", "Rz", gp.Expression("1/(row - 3)")),
    "is zero at every pose": gp.effect_at("e", "J4.moving", "Rz", gp.Expression("J4 - J4")),
    "is parsed again; expected equal values": gp.effect_at("e", "J4.moving", "Rz", Kink()),
}


@pytest.mark.parametrize("said", EFFECTS)
def test_an_effect_with_a_flaw_is_told_which(said: str) -> None:
    with pytest.raises(AssertionError, match=said):
        testing.check_effect(EFFECTS[said], gp.load_mechanism("irb6400r"))


@pytest.mark.parametrize("representation", [gp.Linear(), gp.Tree()], ids=["linear", "tree"])
def test_our_own_representations_pass(representation: gp.Linear | gp.Tree) -> None:
    testing.check_representation(representation)


class Turned(Sequences):
    """A population that returns its programs in the wrong order."""

    def take(self, rows: NDArray[np.intp]) -> Sequences:
        return super().take(rows[::-1])


@dataclass(frozen=True)
class Turning(gp.Linear):
    """A representation of such populations."""

    def initial(self, layout: Layout, population: int, rng: np.random.Generator) -> Turned:
        made = super().initial(layout, population, rng)
        return Turned(made.genes, made.constants)


def test_a_representation_whose_populations_mix_programs_up_is_told_so() -> None:
    with pytest.raises(AssertionError, match="take and join change programs"):
        testing.check_representation(Turning())
