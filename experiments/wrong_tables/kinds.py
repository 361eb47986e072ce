"""Make tables of simulated robots that are wrong in one of 44 ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.checks.notes import flange, tips
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import observe, prepare
from gpmodel.planning.simulate import simulate

ARMS = ("ur10", "irb6400r", "ur5", "panda", "kinova", "irb6400r-2.8", "xarm7", "ur3", "tiago_no_hand", "talos_arm")
SI = {"deg": np.pi / 180, "rad": 1.0, "mm": 1e-3, "um": 1e-6, "m": 1.0, "in": 0.0254}
"""Radians or metres of a unit."""


@dataclass(frozen=True)
class Table:
    """q (N, n), rad or m; position (N, 3), m; rotation (N, 3), rotation vectors. mechanism: that describes the arm.
    angle, length: the units that the table is written in."""

    mechanism: Mechanism
    q: Array
    position: Array
    rotation: Array
    with_rotation: bool = False
    angle: str = "deg"
    length: str = "mm"

    def frame(self) -> pd.DataFrame:
        """The table with headers."""
        units = [self.angle if j.kind == "revolute" else self.length for j in self.mechanism.joints]
        units += 3 * [self.length] + 3 * [self.angle] * self.with_rotation
        names = [j.name for j in self.mechanism.joints] + ["x", "y", "z"] + ["rx", "ry", "rz"] * self.with_rotation
        values = [self.q, self.position, *[self.rotation] * self.with_rotation]
        headers = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
        return pd.DataFrame(np.hstack(values) / [SI[unit] for unit in units], columns=headers)


def measured(arm: str, seed: int, *, poses: int = 60, narrow: float = 1.0, offset: float = 0.1, noise: float = 3e-5,
             sigma: float = 3e-4, effects: tuple[str, ...] = ()) -> Table:  # fmt: skip
    """A sound table. narrow: share of the range of the joints. sigma: of the geometric errors, m."""
    rng, mechanism = np.random.default_rng(seed), gp.load_mechanism(arm)
    low, high = np.array([[max(j.lower, -3.0), min(j.upper, 3.0)] for j in mechanism.joints]).T
    q = (low + high) / 2 + narrow * (high - low) / 2 * rng.uniform(-1, 1, (poses, len(low)))
    made = simulate(mechanism, q, effects, rng, geometry_sigma=sigma, tool_point=np.array([offset, 0.0, 0.05]))
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, made.placement).tip
    turned = Rotation.from_matrix(tip[:, :3, :3]) * Rotation.from_rotvec(rng.normal(0, 1e-4, (poses, 3)))
    return Table(mechanism, q, tip[:, :3, 3] + rng.normal(0, noise, (poses, 3)), turned.as_rotvec())


Change = Callable[[Table, np.random.Generator], Table]


def joints(change: Callable[[Array], Array]) -> Change:
    """Joint values changed in a copy."""
    return lambda t, _: replace(t, q=change(t.q.copy()))


def points(change: Callable[[Array, np.random.Generator], Array]) -> Change:
    """Positions changed in a copy."""
    return lambda t, rng: replace(t, position=change(t.position.copy(), rng))


def turned(change: Callable[[Rotation], Array]) -> Change:
    """Rotations written in another convention."""
    return lambda t, _: replace(t, rotation=change(Rotation.from_rotvec(t.rotation)), with_rotation=True)


def part(values: Array, where: object, change: Callable[[Array], Array]) -> Array:
    """Some rows or cells changed."""
    values[where] = change(values[where])  # type: ignore[index]
    return values


def column(k: int, change: Callable[[Array], Array]) -> Change:
    """One joint changed; -1 the last."""
    return joints(lambda q: part(q, (slice(None), k), change))


def shuffled(k: int) -> Change:
    """A joint's column in another order of the rows."""
    return lambda t, rng: replace(t, q=part(t.q.copy(), (slice(None), k), rng.permutation))


def rows(t: Table, q: Array, p: Array) -> Table:
    """Joint values of some rows beside positions of others: indices (K,) each."""
    return replace(t, q=t.q[q], position=t.position[p], rotation=t.rotation[p])


def computed(digits: int, tool: tuple[float, float, float]) -> Change:
    """Positions of the controller's own forward kinematics, in mm with so many decimals."""
    return lambda t, _: replace(t, position=np.round(tips(flange(t.mechanism, t.q), np.array(tool)), digits + 3))


def tools(first: int, step: int, longer: float) -> Change:
    """A tool longer along z, m, in every `step`th row from `first` on."""

    def changed(t: Table, _: np.random.Generator) -> Table:
        axis = Rotation.from_rotvec(t.rotation).as_matrix()[:, :, 2]
        chosen = np.arange(len(t.q))[:, None] % step == step - 1
        return replace(t, position=t.position + longer * axis * (chosen & (np.arange(len(t.q))[:, None] >= first)))

    return changed


def moved(first: int, by: float) -> Change:
    """The instrument elsewhere from one row on, m."""
    return points(lambda p, _: part(p, slice(first, None), lambda x: x + np.array([by, 0.0, -0.5 * by])))


def described(change: Callable[[Mechanism], Mechanism]) -> Change:
    """The table read with another description."""
    return lambda t, _: replace(t, mechanism=change(t.mechanism))


class Resized:
    """A mechanism whose lengths are all `factor` times, or one of which is `longer` m longer."""

    def __init__(self, mechanism: Mechanism, factor: float = 1.0, longer: float = 0.0) -> None:
        self.mechanism, self.factor, self.longer = mechanism, factor, longer

    def __getattr__(self, name: str) -> object:
        return getattr(self.mechanism, name)

    def transforms(self, q: Array) -> Array:
        """Transforms (N, K, 4, 4) of the description."""
        out = self.mechanism.transforms(q).copy()
        out[..., :3, 3] *= self.factor
        out[len(self.mechanism.joints), :, 0, 3] += self.longer
        return out


def outliers(share: float, size: float) -> Change:
    """Gross errors of some readings, m."""

    def changed(p: Array, rng: np.random.Generator) -> Array:
        chosen = rng.choice(len(p), max(1, int(share * len(p))), replace=False)
        return part(p, chosen, lambda x: x + rng.normal(0.0, size, x.shape))

    return points(changed)


def coupled(sign: float) -> Change:
    """The third joint counted from the second, as some controllers show it."""
    return joints(lambda q: part(q, (slice(None), 2), lambda x: x + sign * q[:, 1]))


def lost(row: int) -> Change:
    """Delete one position: every later row has the joint values of the pose before."""
    return lambda t, _: rows(t, np.arange(len(t.q) - 1), np.delete(np.arange(len(t.q)), row))


def order(*columns: int) -> Callable[[Array], Array]:
    """Two columns exchanged."""

    def changed(values: Array) -> Array:
        values[:, list(columns)] = values[:, list(columns)[::-1]]
        return values

    return changed


def blocks(t: Table, rng: np.random.Generator) -> Table:
    """The order of time lost within stretches of five rows."""
    n = len(t.q)
    return rows(t, np.arange(n), np.concatenate([rng.permutation(np.arange(k, min(k + 5, n))) for k in range(0, n, 5)]))


def of_another_run(t: Table, rng: np.random.Generator) -> Table:
    """z of another measurement."""
    return replace(t, position=np.column_stack([t.position[:, :2], rng.permutation(t.position[:, 2])]))


KINDS: dict[str, Change] = {
    **{f"J{k} flipped": column(k - 1, np.negative) for k in (1, 2, 4)},
    "last joint flipped": column(-1, np.negative),
    "all joints flipped": joints(np.negative),
    "J2, J3 swapped": joints(order(1, 2)),
    "J4, J6 swapped": joints(order(3, 5)),
    "x, y swapped": points(lambda p, _: order(0, 1)(p)),
    "z mirrored": points(lambda p, _: part(p, (slice(None), 2), np.negative)),
    "joints in radians under [deg]": joints(np.radians),
    "J5 in radians under [deg]": column(4, np.radians),
    "last joint in radians under [deg]": column(-1, np.radians),
    "points in m under [mm]": points(lambda p, _: 1e-3 * p),
    "points in inches under [mm]": points(lambda p, _: p / 25.4),
    "y in m under [mm]": points(lambda p, _: part(p, (slice(None), 1), lambda y: 1e-3 * y)),
    "points one row late": lambda t, _: rows(t, np.arange(1, len(t.q)), np.arange(len(t.q) - 1)),
    "J4 one row late": column(3, lambda x: np.roll(x, 1)),
    "reading 20 lost": lost(20),
    "reading 45 lost": lost(45),
    "controller's positions, 3 decimals": computed(3, (0.1, 0.0, 0.05)),
    "controller's positions, 2 decimals, no tool": computed(2, (0.0, 0.0, 0.0)),
    "one coordinate 100 mm off": points(lambda p, _: part(p, (17, 0), lambda x: x + 0.1)),
    "one joint value 10 deg off": joints(lambda q: part(q, (23, 1), lambda x: x + np.radians(10))),
    "a lost beam, 0 0 0": points(lambda p, _: part(p, 31, lambda x: 0.0 * x)),
    "40 % of the readings 60 mm off": outliers(0.4, 0.06),
    "every third row of a tool 30 mm longer": tools(0, 3, 0.03),
    "two tools, 2 mm apart, from row 30 on": tools(30, 1, 0.002),
    "two stands, 300 mm apart": moved(30, 0.3),
    "two stands, 2 mm apart": moved(30, 2e-3),
    "rotations as Euler angles xyz": turned(lambda r: r.as_euler("xyz")),
    "rotations as the inverse": turned(lambda r: r.inv().as_rotvec()),
    "quaternions wxyz read as xyzw": turned(lambda r: Rotation.from_quat(r.as_quat()[:, [3, 0, 1, 2]]).as_rotvec()),
    "J3 + J2": coupled(1.0),
    "J3 - J2": coupled(-1.0),
    "description in mm": described(lambda m: Resized(m, factor=1e3)),  # type: ignore[arg-type, return-value]
    "description with a link 30 mm longer": described(lambda m: Resized(m, longer=0.03)),  # type: ignore[arg-type, return-value]
    "points within five rows shuffled": blocks,
    "last joint shuffled": shuffled(-1),
    "J2 shuffled": shuffled(1),
    "ten rows copied": lambda t, _: rows(t, *(2 * [np.r_[np.arange(len(t.q)), np.arange(10)]])),
    "z of another measurement": of_another_run,
    "points 1 % too large": points(lambda p, _: 1.01 * p),
    "z 0.1 % too large": points(lambda p, _: part(p, (slice(None), 2), lambda z: 1.001 * z)),
    "J4 0.1 % too large": column(3, lambda q: 1.001 * q),
}
