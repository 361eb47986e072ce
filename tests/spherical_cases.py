"""Simulated rigs of the spherical joint with one undeclared effect each, and an oracle that is given its form."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from experiments.spherical_joint.rig import Disturbance, Rig
from gpmodel.arrays import Array
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, Term, effect_at
from gpmodel.table.dataset import Dataset
from joints import spherical_joint

OFFSETS = {14: -2.54e-6, 15: -25.4e-6, 19: 20.32e-6}
JOINT = spherical_joint()
PUBLISHED = Rig(JOINT, parameters=OFFSETS)


def published_table(seed: int, poses: int = 31) -> tuple[Rig, Dataset]:
    """The rig of Tables 3.4 and 3.5 as far as they are printed, with fresh poses and noise."""
    rng = np.random.default_rng(seed)
    return PUBLISHED, PUBLISHED.measure(PUBLISHED.poses(poses, rng), rng)


@dataclass(frozen=True)
class Undeclared:
    """An effect no standard model has. truth: told to the oracle. inputs: any of them names it."""

    name: str
    disturbance: Disturbance
    truth: tuple[Effect, ...]
    inputs: frozenset[str]
    columns: Mapping[str, str] = field(default_factory=dict)

    def table(self, seed: int, poses: int = 90) -> Dataset:
        rng = np.random.default_rng(seed)
        rig = Rig(JOINT, parameters=OFFSETS, reach=(1.5, 1.2, 1.5))
        q = rig.poses(poses, rng)
        extras = {name: (unit, self._values(unit, poses, rng)) for name, unit in self.columns.items()}
        return rig.measure(q, rng, extras, self.disturbance)

    @staticmethod
    def _values(unit: str, count: int, rng: np.random.Generator) -> Array:
        return rng.uniform(18.0, 26.0, count) if unit == "degC" else rng.choice([-1.0, 0.0, 1.0], count)


def _lobes(count: int) -> Undeclared:
    truth = tuple(effect_at(f"{f}", "base", "Tz", Expression(f"{f}({count}*J2)")) for f in ("sin", "cos"))
    return Undeclared(
        f"{count} lobes",
        lambda q, extras: {3: 12e-6 * np.cos(count * q[:, 1] + 0.4)},
        truth,
        frozenset({"J2", "x", "z"}),
    )


def _pitch_axis(shape: str) -> Undeclared:
    function = {"cos": np.cos, "sin": np.sin}[shape]
    return Undeclared(
        f"pitch axis Ty {shape} J1",
        lambda q, extras: {14: 20e-6 * function(q[:, 0])},
        (effect_at("Table 5.2, 31", "J1.moving", "Ty", Expression(f"{shape}(J1)")),),
        frozenset({"J1", "y"}),
    )


UNDECLARED = (
    _pitch_axis("sin"),
    _pitch_axis("cos"),
    _lobes(2),
    _lobes(3),
    Undeclared(
        "warm shaft",
        lambda q, extras: {27: 2e-6 * (extras["temperature"] - 20.0)},
        (effect_at("growth", "tool", "Tz", Expression("temperature")),),
        frozenset({"temperature"}),
        {"temperature": "degC"},
    ),
    Undeclared(
        "sagging socket",
        lambda q, extras: {1: 8e-6 * extras["gravity_x"], 2: 8e-6 * extras["gravity_y"]},
        (Effect("sag", tuple(Term("base", f"T{a}", Expression(f"gravity_{a}")) for a in "xy"), "m"),),
        frozenset({"gravity_x", "gravity_y"}),
        {"gravity_x": "1", "gravity_y": "1"},
    ),
)
THREE = Undeclared(
    "pitch axis, three lobes and a warm shaft",
    lambda q, extras: {
        3: 12e-6 * np.cos(3 * q[:, 1] + 0.4),
        14: 20e-6 * np.sin(q[:, 0]),
        27: 2e-6 * (extras["temperature"] - 20.0),
    },
    (),
    frozenset({"J1", "J2", "temperature"}),
    {"temperature": "degC"},
)
HIDDEN = Undeclared("angle error of the rig", lambda q, extras: {10: 3e-4 * np.sin(q[:, 0])}, (), frozenset())
NOTHING = Undeclared("nothing", lambda q, extras: {}, (), frozenset())
