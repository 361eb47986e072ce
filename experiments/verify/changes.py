"""Measure whether `gpmodel verify` notices a change of a machine, names the part, and repairs the model.

Machines of several types (every constant off by 0.3 mm or 0.3 mrad, compliances, an oval gear) are measured at 90
random poses with 0.02 mm a coordinate and calibrated with their true effects. Later each is measured with the
instrument at another place after one change of SIZES standard errors of the fitted model at ten random poses.
`verify --next` runs to its end, and measures the poses that its repaired model requests; `verify` tests 20 poses.
From the root of the repository: python -m experiments.verify.changes [--first 0] [--machines 10] [--same 5]
"""

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.arms import ARMS
from experiments.blind.files import urdf
from experiments.options import parsed
from gpmodel.api.verify import NextCheck
from gpmodel.application.possible_changes import DISPLACED, PossibleChange, possible_changes
from gpmodel.application.recheck import Recheck, recheck, settled
from gpmodel.application.usable import usable
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.errors import InputError
from gpmodel.families import catalogue
from gpmodel.families.candidate import without_phase
from gpmodel.families.load import MASS
from gpmodel.files import to_json, write_text
from gpmodel.formula.expression import ONE, Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank, se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.planning.simulate import Simulation, simulate
from gpmodel.table.dataset import Dataset, unmeasured

NOISE, POSES, BATCH, OTHERS, MOST, SOON = 2e-5, 90, 20, 100, 20, 10
TRUE, FARTHEST = 1.5e-4, 5e-3
LEVER = {"m": 1.0, "rad": 0.4}
"""Length, m, that a rotation of a crashed frame moves like a displacement."""
SIZES = (5.0, 10.0)
Row = dict[str, Any]
TYPES = ("irb6400r", "ur10", "panda", "scara", "gantry", "xarm7", "kuka_like", "four_axes", "rail_kuka", "ur5")
KINDS = (
    "zero", "tool slipped", "tool bent", "link length", "bent axis", "crash", "joint compliance", "base compliance",
    "payload", "gear", "backlash", "gear ratio", "thermal", "another machine",
)  # fmt: skip


@cache
def source(name: str) -> str:
    """Name or file of a mechanism."""
    if name not in ARMS:
        return name
    path = Path(tempfile.mkdtemp()) / f"{name}.urdf"
    path.write_text(urdf(ARMS[name]))
    return str(path)


@dataclass(frozen=True)
class Change:
    """A change of size one: effects with their values, twist of the tool in the flange, m and rad, payload, kg."""

    kind: str
    name: str
    effects: tuple[Effect, ...] = ()
    values: tuple[float, ...] = ()
    tool: tuple[float, ...] = (0.0,) * 6
    payload: float = 0.0


@dataclass(frozen=True)
class Machine:
    """A machine, its measurement, the names of its true effects and the model fitted to the measurement."""

    type: str
    seed: int
    made: Simulation
    names: tuple[str, ...]
    model: gp.Model

    @property
    def arm(self) -> Mechanism:
        return self.made.model.mechanism

    @cached_property
    def loaded(self) -> Mechanism:
        """The mechanism with its payload at the tool point."""
        return gp.load_mechanism(source(self.type), payload_com=self.made.placement.tool[""][:3, 3].tolist())

    @cached_property
    def others(self) -> Array:
        """Joint values of the poses of all comparisons."""
        return random_poses(self.arm, OTHERS, np.random.default_rng([self.seed, 5]))

    @cached_property
    def known(self) -> Mapping[str, PossibleChange]:
        """Possible changes at the poses of comparisons, by name."""
        return {c.name: c for c in possible_changes(self.tested(self.others, np.eye(4), None, 0.0))}

    def place(self, rng: np.random.Generator) -> Array:
        """A place of the instrument."""
        return se3.exp(np.concatenate([rng.normal(0.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)]))

    def points(self, q: Array, place: Array, change: Change | None, size: float) -> Array:
        """True points (N, 3) of a change of the given size."""
        made, more = self.made, Change("", "") if change is None else change
        arm, model = self.arm, made.model
        payload = None
        if more.payload:
            arm, payload = self.loaded, np.full(len(q), size * more.payload)
        truth = ErrorModel(arm, (*model.effects, *more.effects))
        theta = np.append(made.theta, size * np.array(more.values))
        placement = Placement({"": place}, {"": se3.exp(size * np.array(more.tool)) @ made.placement.tool[""]}, {})
        poses = prepare(arm, unmeasured([j.name for j in arm.joints], q, payload))
        return np.asarray(observe(truth, poses, theta, placement).tip[:, :3, 3])

    def table(self, q: Array, points: Array) -> Dataset:
        return replace(unmeasured([j.name for j in self.arm.joints], q), position=points, source="later")

    def tested(self, q: Array, place: Array, change: Change | None, size: float) -> Recheck:
        """Residuals without noise at poses (N, n)."""
        return recheck(settled(usable(self.model.saved), self.table(q, self.points(q, place, change, size))))

    def moved(self, q: Array, change: Change, size: float) -> Array:
        """Whitened residual per unit of a change at poses (N, n)."""
        place = np.eye(4)
        parts = [self.tested(q, place, c, size) for c in (change, None)]
        return (parts[0].z - parts[1].z) / size if len(parts[0].z) == len(parts[1].z) else np.zeros(1)


def machine(name: str, seed: int) -> Machine:
    """A machine with true effects that each move the tool by TRUE, m RMS, and its model."""
    arm, rng = gp.load_mechanism(source(name)), np.random.default_rng([seed, len(name)])
    q = random_poses(arm, POSES, rng)
    poses = prepare(arm, unmeasured([j.name for j in arm.joints], q))
    bare = ErrorModel(arm, ())
    observed = observe(bare, poses, np.zeros(0), Placement({"": np.eye(4)}, {"": np.eye(4)}, {}))
    texts, names = [], []
    for family, count in (("base_compliance", 1), ("joint_compliance", 2), ("gear_harmonic", 1)):
        offered = list(catalogue.of_family(family, arm, poses.states))
        for k in rng.permutation(len(offered))[:count]:
            own = offered[k]
            moves = effect_columns(own.effects, bare, poses, observed)[:, :3]
            size = float(np.sqrt(np.mean(np.sum(moves**2, axis=(1, 2)))))
            if size > 1e-9:
                names.append(own.name)
                texts.append(f"{own.name}={TRUE / size:.6g}")
    made = simulate(arm, q, texts, rng, noise=NOISE, geometry_sigma=3e-4)
    return Machine(name, seed, made, tuple(names), gp.calibrate(arm, made.dataset, names, holdout=0.0).model)


def drawn(own: Machine, kind: str, rng: np.random.Generator) -> Iterator[Change]:
    """Yield all changes of a kind on a machine, of size one, in random order."""
    arm, states = own.arm, prepare(own.arm, own.made.dataset).states
    zeros = {j.name: drive_effect(f"zero of {j.name}", j, ONE) for j in arm.joints}
    constants = [e for e in geometric_effects(arm) if e.terms not in {z.terms for z in zeros.values()}]
    if kind == "zero":
        found = [Change(kind, e.name, (e,), (1.0,)) for e in zeros.values()]
    elif kind in ("link length", "bent axis"):
        found = [Change(kind, e.name, (e,), (1.0,)) for e in constants if (e.unit == "m") == (kind == "link length")]
    elif kind == "crash":
        frames = dict.fromkeys(tuple(e for e in geometric_effects(arm) if e.slots == c.slots) for c in constants)
        found = [
            Change(kind, f"{DISPLACED} {its[0].name.rsplit(' ', 1)[0]}", its, _displacement(rng, its))
            for its in frames if len(its) > 1
        ]  # fmt: skip
    elif kind == "tool slipped":
        found = [Change(kind, "tool point", tool=(*rng.normal(size=3), 0.0, 0.0, 0.0))]
    elif kind == "tool bent":
        found = [Change(kind, "tool point", tool=(0.0, 0.0, 0.0, *rng.normal(size=3)))]
    elif kind == "payload":
        found = [Change(kind, MASS, payload=1.0)]
    elif kind == "thermal":
        found = [Change(kind, "scale of the machine", (_growth(arm),), (1.0,))]
    else:
        families = {"gear": ("eccentricity", "gear_harmonic"), "backlash": ("backlash_load",)}
        found = [
            Change(kind, without_phase(c.name), c.effects, tuple(_unit(rng, len(c.effects))))
            for family in families.get(kind, (kind.replace(" ", "_"),))
            for c in catalogue.of_family(family, arm, states)
        ]
    yield from (found[k] for k in rng.permutation(len(found)))


def _unit(rng: np.random.Generator, count: int) -> Array:
    values = rng.normal(size=count)
    return values / np.linalg.norm(values) if count > 1 else np.ones(count)


def _displacement(rng: np.random.Generator, constants: Sequence[Effect]) -> tuple[float, ...]:
    return tuple(float(rng.normal()) / LEVER[e.unit] for e in constants)


def _growth(arm: Mechanism) -> Effect:
    """Return the growth of all links and travels."""
    fixed, slots = arm.transforms(np.zeros((1, len(arm.joints))))[:, 0], arm.slots
    terms = [
        Term(slot, f"T{a}", ONE, float(v))
        for k, slot in enumerate(slots[:-1]) if slot.endswith(".moving")
        for a, v in zip("xyz", fixed[k + 1][:3, 3], strict=True) if v
    ]  # fmt: skip
    for joint in arm.joints:
        if joint.kind == "prismatic":
            terms += [Term(s, a, Expression(joint.name), w) for s, a, w in joint.drive]
    return Effect("scale of the machine", tuple(terms), "1")


def sized(own: Machine, kind: str, sigmas: float, rng: np.random.Generator) -> tuple[Change, float] | None:
    """Draw a change of a kind, and its size: `sigmas` standard errors of the model at ten random poses of its fit."""
    ten = own.made.dataset.q[rng.choice(POSES, 10, replace=False)]
    for change in drawn(own, kind, rng):
        before, step = own.points(ten, np.eye(4), None, 0.0), 1e-7
        lever = root_mean_square(np.linalg.norm(own.points(ten, np.eye(4), change, step) - before, axis=1)) / step
        if not lever:
            continue
        seen = np.linalg.norm(own.moved(ten, change, 1e-5 / lever))
        if seen > 0 and sigmas / seen * lever < FARTHEST:
            return change, sigmas / float(seen)
    return None


def checked(own: Machine, q: Array, read: "Reader") -> tuple[NextCheck, Array, int | None]:
    """The check to its end, its poses, and after how many poses it first noticed a change."""
    found, noticed = gp.verify_next(own.model, read(q) if len(q) else None), None
    while found.next is not None and len(q) < MOST:
        q = np.vstack([q, _values(own, found.next)])
        found = gp.verify_next(own.model, read(q))
        if noticed is None and found.judged is not None and not found.judged.holds:
            noticed = len(q)
    return found, q, noticed


def _values(own: Machine, frame: pd.DataFrame) -> Array:
    turns = np.array([j.kind == "revolute" for j in own.arm.joints])
    return np.where(turns, np.radians(frame.to_numpy(dtype=float)), 1e-3 * frame.to_numpy(dtype=float))


class Reader:
    """An instrument that reads a changed machine: equal rows at each call."""

    def __init__(self, own: Machine, change: Change | None, size: float, rng: np.random.Generator) -> None:
        self.own, self.change, self.size = own, change, size
        self.place, self.noise = own.place(rng), rng.normal(0.0, NOISE, (1000, 3))

    def __call__(self, q: Array, first: int = 0, noise: bool = True) -> Dataset:
        points = self.own.points(q, self.place, self.change, self.size)
        return self.own.table(q, points + noise * self.noise[first : first + len(q)])


def same_part(own: Machine, change: Change, size: float, names: list[str], q: Array) -> bool:
    """Return whether a name is that of the change, or of one that 100 poses do not distinguish from it."""
    if change.name in names:
        return True
    whole = own.moved(q, change, size)
    known = own.known
    if len(whole) == 1:
        return False
    left = [rank.remove(rank.orthonormal(known[n].columns), whole) for n in names if n in known]
    return any(float(v @ v) < 0.01 * float(whole @ whole) for v in left)


def error(model: gp.Model, others: Dataset) -> float:
    """RMS error, mm, of a model at poses without noise, less a registration."""
    return 1e3 * root_mean_square(settled(usable(model.saved), others).errors)


def repairs(own: Machine, found: NextCheck, q: Array, read: Reader, others: Array) -> Row:
    """Errors, mm, of the repaired model, at the end of the check and at last, and of a calibration from nothing."""
    rng, change = np.random.default_rng([own.seed, 7]), read.change
    there = read(others, noise=False)
    extra = [c for c in ([change.name] if change and change.kind in CATALOGUE else []) if c not in own.names]
    again = read(random_poses(own.arm, POSES, rng), 500)
    try:
        anew = error(gp.calibrate(own.arm, again, [*own.names, *extra], holdout=0.0).model, there)
    except InputError:
        anew = error(gp.calibrate(own.arm, again, own.names, holdout=0.0).model, there)
    rounds: list[Row] = []
    while found.repaired is not None and len(rounds) < 3:
        rounds.append({"poses": len(q), "mm": error(found.repaired.model, there),
                       "expected_mm": 1e3 * found.repaired.found.expected})  # fmt: skip
        if found.repaired.more is None or not len(found.repaired.more):
            break
        q = np.vstack([q, _values(own, found.repaired.more)])
        found, q, _ = checked(own, q, read)
    return {"anew_mm": anew, "unrepaired_mm": error(own.model, there), "rounds": rounds}


CATALOGUE = ("joint compliance", "base compliance", "gear", "backlash", "gear ratio")


def trial(own: Machine, kind: str, sigmas: float, number: int, other: Machine | None = None) -> Row | None:
    """One change of one machine, by `verify --next`, by its repair, and by `verify` on a batch."""
    rng = np.random.default_rng([own.seed, len(own.type), KINDS.index(kind) if kind in KINDS else 99, number])
    change, size, begin = None, 0.0, time.time()
    if kind not in ("same", "another machine"):
        found = sized(own, kind, sigmas, rng)
        if found is None:
            return None
        change, size = found
    seen = own if other is None else other
    read, others = Reader(seen, change, size, rng), own.others
    end, q, noticed = checked(own, np.zeros((0, len(own.arm.joints))), read)
    batch = own.model.verify(read(random_poses(own.arm, BATCH, rng), 300))
    row: Row = {
        "type": own.type, "seed": own.seed, "kind": kind, "change": change.name if change else "", "size": size,
        "sigmas": sigmas, "noticed": noticed, "poses": end.poses, "holds": end.holds,
        "batch_holds": batch.holds, "batch": batch.record.verdict,
        "verdict": end.judged.record.verdict if end.judged else None,
    }  # fmt: skip
    for prefix, record in (("", end.judged.record if end.judged else None), ("batch_", batch.record)):
        named = record.changes if record else ()
        row[f"{prefix}named"] = [c.name for c in named]
        row[f"{prefix}rivals"] = list(named[0].rivals) if named else []
        if change is not None:
            sets = ([c.name for c in named[:1]], [n for c in named[:1] for n in (c.name, *c.rivals)])
            first, within = (same_part(own, change, size, s, others) if s else False for s in sets)
            row[f"{prefix}first"], row[f"{prefix}in_set"] = first, within
        elif kind == "another machine":
            row[f"{prefix}first"] = row[f"{prefix}in_set"] = bool(record and record.verdict == kind)
    if change is not None and end.repaired is not None:
        row |= repairs(own, end, q, read, others)
    return {**row, "seconds": time.time() - begin}


def summary(rows: list[Row]) -> Iterator[str]:
    """Yield a line per kind of change, for all changes of each size, for other machines and for unchanged ones."""
    changed = [row for row in rows if row["change"]]
    for kind in KINDS[:-1]:
        yield _line(kind, [row for row in changed if row["kind"] == kind])
    for size in SIZES:
        yield _line(f"all, {size:.0f} σ", [row for row in changed if row["sigmas"] == size])
    yield _line("all", changed)
    others, same = ([row for row in rows if row["kind"] == kind] for kind in (KINDS[-1], "same"))
    right, batch = (sum(row[name] for row in others) for name in ("first", "batch_first"))
    yield f"another machine, of {len(others)}: {right}; batch {batch}"
    alarms, batch = sum(row["holds"] is False for row in same), sum(not row["batch_holds"] for row in same)
    poses = [row["poses"] for row in same] or [0]
    yield (
        f"unchanged, of {len(same)}: false alarms {alarms}; batch {batch}; "
        f"poses median {np.median(poses):.0f}, at most {max(poses)}"
    )


def _line(title: str, rows: list[Row]) -> str:
    seen = [row for row in rows if row["noticed"] is not None and row["noticed"] <= SOON and row["holds"] is not True]
    fixed = [row["rounds"] and [r["mm"] / row["anew_mm"] for r in row["rounds"]] for row in rows if row.get("rounds")]
    first, last = ([ratios[k] for ratios in fixed] or [np.nan] for k in (0, -1))
    batch = [sum(row[name] for row in rows) for name in ("batch_first", "batch_in_set")]
    return (
        f"{title:<18} of {len(rows):>3}: noticed {len(seen):>3}, named {sum(row['first'] for row in seen):>3}, "
        f"in the set {sum(row['in_set'] for row in seen):>3}; repaired {len(fixed):>3}, "
        f"over a calibration {np.median(first):.2f}, at last {np.median(last):.2f}, mean {np.mean(last):.2f}; batch "
        f"{sum(not row['batch_holds'] for row in rows):>3}, named {batch[0]:>3}, in the set {batch[1]:>3}"
    )


def main() -> None:
    out = Path(__file__).with_name("changes.json")
    asked = parsed(__doc__, first=0, machines=10, same=5, types=",".join(TYPES), kinds=",".join(KINDS), out=out)
    types, rows = asked.types.split(","), []
    for k in range(asked.first, asked.first + asked.machines):
        own = machine(types[k % len(types)], k)
        for i, kind in enumerate([*asked.kinds.split(","), *["same"] * asked.same]):
            other = machine(own.type, 1000 + k) if kind == "another machine" else None
            row = trial(own, kind, SIZES[(k // len(types) + i) % len(SIZES)], i, other)
            if row:
                rows.append(row)
            write_text(asked.out, to_json({"rows": rows}))
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
