"""States: named columns with units, one value per pose, that are inputs of basis functions."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError, choices
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Joint, LoadsByTool, Mechanism, WeightByPart, ball_jointed
from gpmodel.model import memory
from gpmodel.model.memory import Past
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset, Specification
from gpmodel.table.units import torque_factor

PREFIX = "instrument_"
UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad", "x": "m", "y": "m", "z": "m"}


def seen_columns(points: Array) -> dict[str, Array]:
    """Return columns of the instrument (range, azimuth, elevation, x, y, z) for points (poses, 3), m."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    values = (np.hypot(flat, z), np.arctan2(y, x), np.arctan2(z, flat), x, y, z)
    return {f"{PREFIX}{name}": column for name, column in zip(UNITS, values, strict=True)}


@dataclass(frozen=True, eq=False)
class Seen:
    """The measured points (poses, 3) of a whole table in the frame of its instrument, m; NaN for unmeasured values.

    specification: stated accuracy of the instrument, None if unknown.
    """

    points: Array
    specification: Specification | None = None

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Range, azimuth, elevation, x, y, z by name. The median point replaces a point with unmeasured coordinates."""
        whole: Mask = np.asarray(np.isfinite(self.points).all(axis=1))
        middle = np.median(self.points[whole], axis=0) if whole.any() else np.zeros(3)
        return seen_columns(np.where(whole[:, None], self.points, middle))

    def column(self, name: str) -> Array | None:
        """Return a column of the instrument (such as `instrument_range`) by its name, or None."""
        return self.columns.get(name) if name.startswith(PREFIX) else None

    def unit(self, name: str) -> str:
        """Return the unit, m or rad, of a column of the instrument such as `instrument_range`."""
        return UNITS[name.removeprefix(PREFIX)]


@dataclass(frozen=True, eq=False)
class Derived:
    """Columns that one function computes for a whole table, on first use.

    made: function that computes all columns, by name.
    known: function that returns whether a name may be a derived column.
    unit: function from a column's name to its unit. The functions made, known and unit are pickled for worker processes
    and therefore belong to a module.
    """

    made: Callable[[], Mapping[str, Array]]
    known: Callable[[str], bool]
    unit: Callable[[str], str]

    @cached_property
    def columns(self) -> Mapping[str, Array]:
        """All columns that the function derives from a table, by name."""
        return self.made()

    def column(self, name: str) -> Array | None:
        """Return the derived column named `name`, or None."""
        return self.columns.get(name) if self.known(name) else None


def link_weights(mechanism: Mechanism, q: Array) -> Derived | None:
    """Return the joint torques of the weight of each link (WeightByPart.unit_loads); None if the weights are unknown.

    Torques are in N·m; torques of a unit first moment of mass (`_of_J4_x`) are in N·m per kg·m, which is m/s².
    """
    if not isinstance(mechanism, WeightByPart):
        return None
    return Derived(partial(mechanism.unit_loads, q), _of_a_link, _unit_of_weight)


def _of_a_link(name: str) -> bool:
    return "_of_" in name


def _unit_of_weight(name: str) -> str:
    return "m/s^2" if name[-2:] in ("_x", "_y", "_z") else "Nm"


def ball_angles(mechanism: Mechanism, q: Array) -> Derived | None:
    """Return the angles of a mechanism's ball joints, rad, that are not in the table; None without ball joints."""
    jointed = ball_jointed(mechanism)
    if jointed is None:
        return None
    names = {angle for ball in jointed.balls for angle in ball.angles}
    return Derived(partial(jointed.turned, q), names.__contains__, _unit_of_angle)


def _unit_of_angle(_: str) -> str:
    return "rad"


_SPELLED = re.compile(r"(?:measured_)?(?:torque|tau|effort|trq)_(?P<joint>\w+?)(?:_measured)?$", re.IGNORECASE)


def measured_torques(mechanism: Mechanism, dataset: Dataset) -> dict[str, str]:
    """Return the column of the measured torque of each joint, such as `torque_J2`, `tau_2`, `effort_elbow_joint`.

    A column may have any unit of torque, or of force for a prismatic joint. Columns with a constant value over several
    rows are ignored.
    """
    varies = {c for c, values in dataset.extras.items() if len(values) == 1 or np.ptp(values) > 0}
    return {j.name: c for j, c in torque_columns(mechanism, dataset) if c in varies}


def measured_torque(dataset: Dataset, column: str) -> Array:
    """Return measured torques, N·m or N, with the sign of the table: a drive at rest exerts minus the gravity load."""
    return dataset.extras[column] * (torque_factor(dataset.extra_units[column]) or 1.0)


def unused_torques(mechanism: Mechanism, dataset: Dataset) -> Iterator[str]:
    """Yield one warning for every torque column of a table that is not used as the load of a joint."""
    of_joints = {column: joint for joint, column in torque_columns(mechanism, dataset)}
    for column, unit in dataset.extra_units.items():
        if column not in of_joints and _SPELLED.match(column) and torque_factor(unit):
            yield (
                f"{dataset.source}: column '{column}' names no joint of {mechanism.name} and is an input like any "
                f"other; expected {choices(column, (f'torque_{joint.name}' for joint in mechanism.joints))}"
            )
    for column, joint in of_joints.items():
        if not np.ptp(dataset.extras[column]) > 0:
            yield (
                f"{dataset.source}: column '{column}' is {dataset.extras[column][0]:g} in every row and is not used "
                f"as the torque of {joint.name}; expected the torque of the joint at each pose"
            )


def torque_columns(mechanism: Mechanism, dataset: Dataset) -> Iterator[tuple[Joint, str]]:
    """Yield each joint with its column of measured torques, by its name in mechanism or table or its number."""
    tables = dataset.columns or dataset.joints
    called: dict[str, Joint] = {}
    for i, (joint, table) in enumerate(zip(mechanism.joints, tables, strict=True), 1):
        called |= {name.lower(): joint for name in (str(i), f"j{i}", table, joint.name)}
    for column in dataset.extras:
        match = _SPELLED.match(column)
        if match and match["joint"].lower() in called and torque_factor(dataset.extra_units[column]):
            yield called[match["joint"].lower()], column


PAYLOAD_SHARE = "payload_"


@dataclass(frozen=True)
class States:
    """Inputs of basis functions: columns of the poses by name, one value per pose, and their units.

    Listed in `columns`: joint names (rad or m), x y z (nominal tip in the mechanism's root frame, m), the loads of the
    mechanism (Nm, N), payload (kg, if the table has it), payload_torque_J2 (torque of the payload alone, if it varies),
    the extra columns of the table in their units, and row (from 1).

    Columns that are computed on demand and not listed: columns with memory of earlier poses (`past`), torques of each
    link (`weights`), the point in the frame of the instrument (`seen`), angles of ball joints (`turned`), torques of a
    constant payload (`carried`).

    past: columns of the whole table, if its rows are in the order of measurement.
    rows: row numbers in the whole table, so that a subset remembers poses outside the subset.
    loads: columns that are loads of the mechanism, computed or measured.
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str]
    past: Past | None = None
    weights: Derived | None = None
    seen: Seen | None = None
    carried: Derived | None = None
    turned: Derived | None = None
    rows: IntArray | None = None
    loads: frozenset[str] = frozenset()
    _known: dict[str, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def value(self, basis: Basis) -> Array:
        """Return the values of a basis function at the poses, cached, since a fit needs the values at every step.

        Raises InputError if a basis function that is no Expression does not return one value per pose.
        """
        text = str(basis)
        if not isinstance(basis, Expression):
            if np.shape(values := basis(self)) != (len(self),):
                raise InputError(
                    f"basis {text}: values of shape {np.shape(values)}; expected ({len(self)},), one a pose"
                )
            return values
        if text not in self._known:
            self._known[text] = basis(self)
        return self._known[text]

    def __getitem__(self, name: str) -> Array:
        if name in self.columns:
            return self.columns[name]
        for derived in (self.past, self.weights, self.seen, self.carried, self.turned):
            whole = derived.column(name) if derived else None
            if whole is not None:
                return whole if self.rows is None else whole[self.rows]
        if not self.past and memory.read_by(name):
            raise InputError(
                f"input '{name}' depends on earlier rows; expected --in-order (rows in the order in which the poses "
                "are taken), or a column of times that never decreases",
                "in_order",
            )
        raise InputError(
            f"input '{name}' is neither in the table nor computed; available: {choices(name, self.columns)}"
        )

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def unit(self, name: str) -> str:
        """Return the unit of a column, derived columns included. Raises InputError for an unknown column name."""
        if name in self.units:
            return self.units[name]
        self[name]
        derived = (self.past, self.weights, self.seen, self.carried, self.turned)
        return next(d.unit(name) for d in derived if d and d.column(name) is not None)

    def unit_of_constant(self, what: str, of: str) -> str:
        """Return the unit of the constant of a column with memory: for a lag the unit of the clock, else the unit of
        the source column `of`."""
        if what != "lag" or self.past is None:
            return self.unit(of)
        return "rows" if self.past.clock == "row" else self.units[self.past.clock]

    def subset(self, rows: IntArray | Mask) -> "States":
        """Return the state columns of the given poses. Columns with memory still depend on the whole table."""
        taken = np.arange(len(self))[rows] if self.rows is None else self.rows[rows]
        columns = MappingProxyType({k: v[rows] for k, v in self.columns.items()})
        return replace(self, columns=columns, rows=taken)

    def seen_at(self, points: Array) -> "States":
        """Compute the columns of the instrument (range, azimuth, ...) from points (poses, 3) in its frame, m."""
        return replace(self, columns=MappingProxyType({**self.columns, **seen_columns(points)}))

    def between(self, count: int = 2000) -> "Between":
        """Return `count` values of each column at random points on straight lines between pairs of poses."""
        rng = np.random.default_rng(0)
        first, second = rng.integers(0, len(self), (2, count))
        return Between(self, first, second, rng.random(count))


@dataclass(frozen=True)
class Between:
    """Columns interpolated between the poses `first` and the poses `second`, at the fraction `part` of the way."""

    states: States
    first: IntArray
    second: IntArray
    part: Array

    def __getitem__(self, name: str) -> Array:
        values = self.states[name]
        return values[self.first] + self.part * (values[self.second] - values[self.first])

    def __len__(self) -> int:
        return len(self.part)


def load_unit(name: str) -> str:
    """Return the unit of a load from the prefix of its column's name: N for forces, Nm for torques and moments."""
    return "N" if name.startswith("force_") else "Nm"


def tip_slots(mechanism: Mechanism, dataset: Dataset) -> IntArray:
    """Return the number of the frame that carries the measured tip of each row; for several chains by the label `tip`.

    Raises InputError for an unknown tip.
    """
    slots, tree = list(mechanism.slots), branched(mechanism)
    if tree is None:
        return np.full(len(dataset), len(slots) - 1)
    tips = {"": next(iter(tree.tips.values())), **tree.tips}
    for row, name in zip(dataset.row, dataset.label("tip").tolist(), strict=True):
        if name not in tips:
            message = f"'{name}' is no tip; expected {choices(name, tree.tips)}"
            raise InputError(f"{dataset.source}, column 'tip', row {row}: {message}")
    return np.array([slots.index(tips[name]) for name in dataset.label("tip").tolist()], dtype=np.int64)


def loads_at(mechanism: Mechanism, dataset: Dataset) -> dict[str, Array]:
    """Return the loads at the poses of a table, with the payload and the tool of each pose."""
    if isinstance(mechanism, LoadsByTool):
        return mechanism.loads_by_tool(dataset.q, dataset.payload, dataset.label("tool"))
    return mechanism.loads(dataset.q, dataset.payload)


def states_of(mechanism: Mechanism, dataset: Dataset, same: States | None = None) -> States:
    """Return all columns that a basis function may use for the poses of `dataset`.

    same: columns of equal poses with approximate joint values, whose columns with memory (of earlier poses) are reused.
    Raises InputError for a column of the table with the name of a computed column.
    """
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}

    def put(name: str, values: Array, unit: str) -> None:
        if name in columns:
            torque = ", or give it a unit of torque, as in [N*m]" if name.startswith("torque_") else ""
            raise InputError(
                f"{dataset.source}: column '{name}' [{unit}] has the name of a computed input; rename it{torque}"
            )
        columns[name], units[name] = np.asarray(values, dtype=float), unit

    for i, joint in enumerate(mechanism.joints):
        put(joint.name, dataset.q[:, i], "rad" if joint.kind == "revolute" else "m")
    frames = chain(mechanism.transforms(dataset.q))
    tip = frames[tip_slots(mechanism, dataset), np.arange(len(dataset)), :3, 3]
    for name, values in zip("xyz", tip.T, strict=True):
        put(name, values, "m")
    loads = loads_at(mechanism, dataset)
    instead = {f"torque_{joint.name}": column for joint, column in torque_columns(mechanism, dataset)}
    used = {f"torque_{joint}" for joint in measured_torques(mechanism, dataset)} | (set(instead) - set(loads))
    measured = {name: measured_torque(dataset, column) for name, column in instead.items() if name in used}
    for name, values in {**loads, **measured}.items():
        put(name, values, load_unit(name))
    if dataset.payload_given:
        put("payload", dataset.payload, "kg")
        if np.ptp(dataset.payload) > 0:
            for name, values in _carried(mechanism, dataset, loads).items():
                put(name, values, "Nm")
    torques = {column for _, column in torque_columns(mechanism, dataset)}
    for name, values in dataset.extras.items():
        if name not in torques:
            put(name, values, dataset.extra_units[name])
    put("row", dataset.row.astype(float), "1")
    states = replace(_remembering(columns, units, mechanism, dataset, same), loads=frozenset(loads) | set(measured))
    if not dataset.payload_given or np.ptp(dataset.payload) > 0:
        return states
    return replace(states, carried=Derived(partial(_carried, mechanism, dataset, loads), _of_the_payload, load_unit))


def _of_the_payload(name: str) -> bool:
    return name.startswith(PAYLOAD_SHARE)


def _carried(mechanism: Mechanism, dataset: Dataset, loads: Mapping[str, Array]) -> dict[str, Array]:
    """Return the joint torques of the payload alone, without the torques of the links.

    A varying payload's torques are listed columns. A constant payload's torques are computed on demand, for a model
    that was fitted with varying payloads.
    """
    bare = loads_at(mechanism, replace(dataset, payload=np.zeros(len(dataset))))
    torques = [f"torque_{joint.name}" for joint in mechanism.joints]
    return {f"{PAYLOAD_SHARE}{t}": loads[t] - bare.get(t, 0.0) for t in torques if t in loads}


def _remembering(
    columns: dict[str, Array], units: dict[str, str], mechanism: Mechanism, dataset: Dataset, same: States | None
) -> States:
    """Add columns that depend on earlier poses (`memory.standing`) to a table whose rows are in order."""
    if same:
        past, weights, seen, turned, rows = same.past, same.weights, same.seen, same.turned, same.rows
    else:
        past, weights, rows, measured = None, link_weights(mechanism, dataset.q), None, np.isfinite(dataset.position)
        seen = Seen(dataset.position, dataset.instrument) if measured.all(axis=1).any() else None
        turned = ball_angles(mechanism, dataset.q)
    clock = None if past else memory.clock_of(dataset)
    if clock is not None:
        past = Past(MappingProxyType(dict(columns)), MappingProxyType(dict(units)), clock)
    if past is not None:
        for name in memory.standing(past, [j.name for j in mechanism.joints]):
            whole = past.column(name)
            if whole is not None and name not in columns:
                columns[name], units[name] = whole if rows is None else whole[rows], past.unit(name)
    return States(MappingProxyType(columns), MappingProxyType(units), past, weights, seen, turned=turned, rows=rows)
