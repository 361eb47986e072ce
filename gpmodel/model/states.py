"""Named columns with units, one value a pose, that a basis function may read."""

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
from gpmodel.mechanism.protocol import Joint, Mechanism, Weighed, ball_jointed
from gpmodel.model import memory
from gpmodel.model.memory import Past
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset, Specification
from gpmodel.table.units import torque_factor

PREFIX = "instrument_"
UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad", "x": "m", "y": "m", "z": "m"}


def seen_columns(points: Array) -> dict[str, Array]:
    """Columns (N,) of points (N, 3), m: instrument_range, _azimuth, _elevation, _x, _y, _z."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    values = (np.hypot(flat, z), np.arctan2(y, x), np.arctan2(z, flat), x, y, z)
    return {f"{PREFIX}{name}": column for name, column in zip(UNITS, values, strict=True)}


@dataclass(frozen=True, eq=False)
class Seen:
    """The points (N, 3) of a whole table as its instrument measured them, m; NaN where it did not. specification: of
    the instrument, where it is known."""

    points: Array
    specification: Specification | None = None

    @cached_property
    def columns(self) -> dict[str, Array]:
        """See `seen_columns`; where a point was not measured whole, those of the middle one."""
        whole: Mask = np.asarray(np.isfinite(self.points).all(axis=1))
        middle = np.median(self.points[whole], axis=0) if whole.any() else np.zeros(3)
        return seen_columns(np.where(whole[:, None], self.points, middle))

    def column(self, name: str) -> Array | None:
        """The column (N,) of that name, None where there is none."""
        return self.columns.get(name) if name.startswith(PREFIX) else None

    def unit(self, name: str) -> str:
        """m or rad."""
        return UNITS[name.removeprefix(PREFIX)]


@dataclass(frozen=True, eq=False)
class Derived:
    """Columns that one function makes of a whole table.

    made: them, (N,) by name. known: whether a name may be one of them, asked before they are made. unit: of a name.
    All three go to other processes: they are functions of a module.
    """

    made: Callable[[], Mapping[str, Array]]
    known: Callable[[str], bool]
    unit: Callable[[str], str]

    @cached_property
    def columns(self) -> Mapping[str, Array]:
        """All of them."""
        return self.made()

    def column(self, name: str) -> Array | None:
        """The column (N,) of that name, None where there is none."""
        return self.columns.get(name) if self.known(name) else None


def link_weights(mechanism: Mechanism, q: Array) -> Derived | None:
    """Return the joint torques of each link's weight, as `Weighed.unit_loads` gives them; None if they are unknown.

    In N·m; of a first moment of mass (`_of_J4_x`) in N·m a kg·m, which is m/s².
    """
    if not isinstance(mechanism, Weighed):
        return None
    return Derived(partial(mechanism.unit_loads, q), _of_a_link, _unit_of_weight)


def _of_a_link(name: str) -> bool:
    return "_of_" in name


def _unit_of_weight(name: str) -> str:
    return "m/s^2" if name[-2:] in ("_x", "_y", "_z") else "Nm"


def ball_angles(mechanism: Mechanism, q: Array) -> Derived | None:
    """Angles by which the balls of a mechanism turn, rad, but for those in the table; None without balls."""
    jointed = ball_jointed(mechanism)
    if jointed is None:
        return None
    names = {angle for ball in jointed.balls for angle in ball.angles}
    return Derived(partial(jointed.turned, q), names.__contains__, _unit_of_angle)


def _unit_of_angle(_: str) -> str:
    return "rad"


_SPELLED = re.compile(r"(?:measured_)?(?:torque|tau|effort|trq)_(?P<joint>\w+?)(?:_measured)?$", re.IGNORECASE)


def measured_torques(mechanism: Mechanism, dataset: Dataset) -> dict[str, str]:
    """Joint -> column of its measured torque, as `torque_J2`, `tau_2`, `effort_elbow_joint`, in any unit of torque (of
    force for a joint that slides); columns that are the same in all of several rows are none."""
    varies = {c for c, values in dataset.extras.items() if len(values) == 1 or np.ptp(values) > 0}
    return {j.name: c for j, c in torque_columns(mechanism, dataset) if c in varies}


def measured_torque(dataset: Dataset, column: str) -> Array:
    """The column (N,) in N·m or N, signed as the table has it: a drive at rest exerts minus what gravity does."""
    return dataset.extras[column] * (torque_factor(dataset.extra_units[column]) or 1.0)


def unused_torques(mechanism: Mechanism, dataset: Dataset) -> Iterator[str]:
    """One sentence for every column of torques that is not the load of a joint."""
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
                f"as the torque of {joint.name}; expected what the joint bears at each pose"
            )


def torque_columns(mechanism: Mechanism, dataset: Dataset) -> Iterator[tuple[Joint, str]]:
    """Each joint with its column of measured torques, by its name in mechanism or table or its number."""
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
    """Columns (N,) by name, and their units.

    Joint names (rad or m), x y z (nominal tip in the mechanism's root frame, m), the mechanism's loads (Nm, N),
    payload (kg, when the table has it; where it varies, payload_torque_J2 is what it alone exerts),
    the table's extra columns in their own units, and row (from 1). Where the rows are in the order of measurement also
    what a pose inherits from those before it: `past` knows the whole table, `rows` (N,) which of its rows these are, so
    that a subset remembers poses that are not in it. Any column of gpmodel.model.memory can then be read by its name,
    what each link weighs on each joint (`weights`) by the names of Weighed.unit_loads, and where the instrument saw the
    point (`seen`) by those of gpmodel.model.states, how far each ball joint is turned (`turned`) by those of its
    Ball, what a payload alone exerts (`carried`) where every row has the same. None of these is listed in `columns`.
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
        """Values (N,) of a basis here, computed once: a calibration asks for hundreds of them at every step. Raises
        InputError where a basis that is no expression gives another shape."""
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
                f"input '{name}' depends on the rows before; expected rows said to be in the order in which the poses "
                "are taken, or a column of times that never falls",
                "in_order",
            )
        raise InputError(f"input '{name}' is not known here; available: {choices(name, self.columns)}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def unit(self, name: str) -> str:
        """The unit of a column, also of one that is derived. Raises InputError where there is none of that name."""
        if name in self.units:
            return self.units[name]
        self[name]
        derived = (self.past, self.weights, self.seen, self.carried, self.turned)
        return next(d.unit(name) for d in derived if d and d.column(name) is not None)

    def unit_of_constant(self, what: str, of: str) -> str:
        """The unit of the constant of a remembered column: of a lag that of the clock, else that of the column."""
        if what != "lag" or self.past is None:
            return self.unit(of)
        return "rows" if self.past.clock == "row" else self.units[self.past.clock]

    def subset(self, rows: IntArray | Mask) -> "States":
        """Return the columns at some poses; memory columns still follow the whole table."""
        taken = np.arange(len(self))[rows] if self.rows is None else self.rows[rows]
        columns = MappingProxyType({k: v[rows] for k, v in self.columns.items()})
        return replace(self, columns=columns, rows=taken)

    def seen_at(self, points: Array) -> "States":
        """Return the states with the instrument's columns computed from points (N, 3) in its frame, m, not from
        measured ones.
        """
        return replace(self, columns=MappingProxyType({**self.columns, **seen_columns(points)}))

    def between(self, count: int = 2000) -> "Between":
        """Columns (count,) at random points on straight lines between pairs of poses."""
        rng = np.random.default_rng(0)
        first, second = rng.integers(0, len(self), (2, count))
        return Between(self, first, second, rng.random(count))


@dataclass(frozen=True)
class Between:
    """Columns (C,) a part of the way from the poses `first` (C,) to the poses `second` (C,)."""

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
    """The unit of a load by the prefix of its name: N for forces, Nm for torques and moments."""
    return "N" if name.startswith("force_") else "Nm"


def tip_slots(mechanism: Mechanism, dataset: Dataset) -> IntArray:
    """Index (N,) of the slot that carries what each row reads: of several chains that of its label `tip`.

    Raises InputError for a tip the mechanism does not have.
    """
    slots, tree = list(mechanism.slots), branched(mechanism)
    if tree is None:
        return np.full(len(dataset), len(slots) - 1)
    tips = {"": next(iter(tree.tips.values())), **tree.tips}
    for row, name in zip(dataset.row, dataset.label("tip").tolist(), strict=True):
        if name not in tips:
            said = f"'{name}' is no tip; expected {choices(name, tree.tips)}"
            raise InputError(f"{dataset.source}, column 'tip', row {row}: {said}")
    return np.array([slots.index(tips[name]) for name in dataset.label("tip").tolist()], dtype=np.int64)


def states_of(mechanism: Mechanism, dataset: Dataset, same: States | None = None) -> States:
    """Every column a basis may read for the poses of `dataset`.

    same: states of the same poses with approximate joint values, whose memory of a whole table is kept.
    Raises InputError for a column of the table with the name of a computed one.
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
    loads = mechanism.loads(dataset.q, dataset.payload)
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
    """Torques of the payload, in addition to the torques of the links: columns of their own where payloads differ, else
    derived, for a model that was fitted where they did."""
    bare = mechanism.loads(dataset.q, np.zeros(len(dataset)))
    torques = [f"torque_{joint.name}" for joint in mechanism.joints]
    return {f"{PAYLOAD_SHARE}{t}": loads[t] - bare.get(t, 0.0) for t in torques if t in loads}


def _remembering(
    columns: dict[str, Array], units: dict[str, str], mechanism: Mechanism, dataset: Dataset, same: States | None
) -> States:
    """The states of a table, with the standing columns of memory where its rows are in order."""
    if same:
        past, weights, seen, turned, rows = same.past, same.weights, same.seen, same.turned, same.rows
    else:
        past, weights, seen, rows = None, link_weights(mechanism, dataset.q), _seen(dataset), None
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


def _seen(dataset: Dataset) -> Seen | None:
    return Seen(dataset.position, dataset.instrument) if np.isfinite(dataset.position).all(axis=1).any() else None
