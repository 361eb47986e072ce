"""Loads that a description or a table states wrongly: an undeclared payload, a wrong direction of gravity.

Joint j and the base deflect by c_j (T_j + Σ_k x_k U_jk). T_j: declared load. U_jk: load by a unit of change k of
payload or gravity; x_k: its size. All compliances c_j share the changes x_k, which variable projection estimates (Golub
and Pereyra 1973).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from gpmodel.arrays import Array
from gpmodel.calibration.overall_scale import without_positions
from gpmodel.evidence.residual import Residual
from gpmodel.formula.expression import Columns
from gpmodel.mechanism.protocol import ChangeableLoads, Mechanism
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.states import loads_at, measured_torques
from gpmodel.numerics import rank as ident
from gpmodel.table.dataset import Dataset

Loads = Mapping[str, Array]

FARTHEST = 1.0
"""Largest distance of the centre of mass of a payload from the measured frame, m, as for a tool point."""
LEAST_NATS = 18.0
"""Least gain in log evidence of loads other than declared, nats, beyond ln n / 2 per fitted constant: the penalty of
two compliances."""
FIRST = (-0.4, 0.4, -3.0, 3.0)
"""Initial changes of a load, relative to the change whose effect on the measurements is as large as the declared
load's."""
TURNS, AGAIN = 8, 0.5
"""Largest number of fits of gravity and payload in turn, and least gain in log evidence of a further fit, nats."""
SHORTEST = 1e-6
"""Norm of a joint's load, relative to the largest norm, below which the joint counts as unloaded."""


@dataclass(frozen=True)
class OtherLoads:
    """Loads that explain a residual better than the declared loads.

    mechanism: mechanism with the fitted loads. gain: gain in log evidence over the declared loads, nats.
    constants: number of fitted constants of the loads. said: fitted loads as text, by kind.
    stderr: standard errors of the constants by kind; of a payload mass, kg, and first moments (3,), kg m.
    """

    mechanism: LoadedMechanism
    said: Mapping[str, str] = field(default_factory=dict)
    gain: float = 0.0
    constants: int = 0
    stderr: Mapping[str, Array] = field(default_factory=dict)

    @property
    def in_words(self) -> str:
        """The fitted loads in words, with standard errors."""
        return " and ".join(self.said.values())


@dataclass(frozen=True, eq=False)
class _Values:
    """Basis function with given values, one per pose. Two instances are never equal."""

    values: Array
    inputs: tuple[str, ...] = ()

    def __call__(self, states: Columns) -> Array:
        return self.values


def other_loads(residual: Residual, mechanism: LoadedMechanism) -> OtherLoads | None:
    """Return the loads that explain a residual best, or None if the declared loads explain it nearly as well.

    Gravity and payload are fitted in turn, each given the other.
    residual: residual of a model without effects that follow loads. mechanism: mechanism with the declared loads; the
    result is None if its torques are measured.
    """
    data, problem = residual.poses.dataset, residual.problem
    if problem.reduced is not None or without_positions(problem):
        return None
    loads = loads_at(mechanism, data)
    if measured_torques(mechanism, data) or not any(np.any(v) for v in loads.values()):
        return None
    here = declared = OtherLoads(mechanism)
    for _ in range(TURNS):
        found = [_fitted(residual, here, data, change) for change in _changes(here.mechanism, data)]
        best = max((f for f in found if f is not None), key=lambda f: f.gain, default=None)
        if best is None:
            break
        here = best
    return None if here is declared else here


def compliances(mechanism: Mechanism, loads: Loads, poses: int) -> tuple[Effect, ...]:
    """Return the compliances of all joints and of the base under given loads, one value per pose."""
    nothing = np.zeros(poses)
    effects = (
        drive_effect(j.name, j, _Values(loads.get(f"torque_{j.name}", nothing)), "rad/Nm") for j in mechanism.joints
    )
    tilt = tuple(Term("base", f"R{a}", _Values(loads.get(f"moment_base_{a}", nothing))) for a in "xy")
    return (*effects, Effect("base", tilt, "rad/Nm"))


def _columns(residual: Residual, loads: Loads) -> Array:
    """Return the columns of the compliances of all joints and of the base under some loads, without the model."""
    effects = compliances(residual.calibration.model.mechanism, loads, len(residual.poses))
    out = np.zeros((len(residual.values), len(effects)))
    out[: residual.measured] = residual.columns(effects)
    return residual.span.remove(out)


@dataclass(frozen=True)
class _Change:
    """A change of the loads: its kind, the loads per unit of change, and the changed mechanism with a text."""

    kind: str
    units: tuple[Loads, ...]
    made: Callable[[Array, Array, bool], tuple[LoadedMechanism, str] | None]


def _changes(mechanism: LoadedMechanism, data: Dataset) -> Iterator[_Change]:
    """Yield the changes of gravity and of a mass at the tool that is equal at all poses."""
    bare, declared = mechanism.bare, float(np.mean(data.payload))
    if not isinstance(bare, ChangeableLoads):
        return
    com, down = np.asarray(bare.payload_com), np.asarray(bare.gravity)
    size = float(np.linalg.norm(down))
    across = np.linalg.svd(down[None] / size)[2][1:]

    def turned(x: Array, stderr: Array, upside_down: bool) -> tuple[LoadedMechanism, str]:
        way = (down + size * x @ across) * (-1.0 if upside_down else 1.0)
        way /= np.linalg.norm(way)
        said = f"gravity along ({', '.join(f'{v:.3f}' for v in way)}) of the root frame"
        return mechanism.with_gravity(size * way), said

    units = [loads_at(mechanism.with_gravity(size * v), data) for v in across]
    yield _Change("gravity", tuple(units), turned)
    now = loads_at(mechanism, data)
    units = [loads_at(mechanism.with_mass(1.0, moment), data) for moment in (np.zeros(3), *np.eye(3))]
    mass = {name: v - now.get(name, 0.0) for name, v in units[0].items()}
    moments = [{name: v - units[0][name] for name, v in unit.items()} for unit in units[1:]]

    def loaded(x: Array, stderr: Array, upside_down: bool) -> tuple[LoadedMechanism, str] | None:
        added = (mechanism.choice.added_mass or 0.0) + float(x[0])
        total = declared + added
        point = (declared * com + (mechanism.choice.added_moment or 0.0) + x[1:]) / total
        if upside_down or not total > 0.0 or not np.linalg.norm(point) <= FARTHEST:
            return None
        there = ", ".join(f"{1e3 * v:.0f} ± {1e3 * e / total:.0f}" for v, e in zip(point, stderr[1:], strict=True))
        instead = f", {declared:.4g} kg of it declared," if declared else ""
        said = f"a payload of {total:.1f} ± {stderr[0]:.1f} kg{instead} with its centre of mass at ({there}) mm"
        return mechanism.with_mass(float(x[0]), x[1:]), said

    yield _Change("payload", (mass, *moments), loaded)


def _fitted(residual: Residual, here: OtherLoads, data: Dataset, change: _Change) -> OtherLoads | None:
    """Fit a change of payload or gravity; return the changed loads, or None without sufficient gain.

    The columns are reduced to their triangular factor, which keeps the length of every residual.
    """
    loads = loads_at(here.mechanism, data), *change.units
    columns = np.column_stack([*(_columns(residual, one) for one in loads), residual.values])
    triangle = np.asarray(np.linalg.qr(columns, mode="r"))
    target, (first, *further) = triangle[:, -1] / residual.rms, np.split(triangle[:, :-1], len(loads), axis=1)
    length = np.max([np.linalg.norm(u, axis=0) for u in (first, *further)], axis=0)
    live = length > SHORTEST * length.max()
    first, further = first[:, live], [u[:, live] for u in further]
    size = np.array([np.linalg.norm(first) / max(float(np.linalg.norm(u)), ident.NEGLIGIBLE) for u in further])

    def loaded(x: Array) -> Array:
        return np.asarray(first + sum(a * u for a, u in zip(size * x, further, strict=True)))

    def fitted(x: Array) -> tuple[Array, Array]:
        at = loaded(x)
        scale = np.maximum(np.linalg.norm(at, axis=0), ident.NEGLIGIBLE)
        found = np.linalg.lstsq(at / scale, target, rcond=SHORTEST)[0]
        return found * np.abs(found), target - at @ (found / scale)

    nothing, new = np.zeros(len(size)), 0 if change.kind in here.said else len(size)
    before, count = float(np.sum(fitted(nothing)[1] ** 2)), residual.freedom

    def gained(squares: float) -> float:
        with np.errstate(divide="ignore"):
            return 0.5 * count * float(np.log(before / np.float64(squares))) - 0.5 * new * float(np.log(count))

    least = LEAST_NATS if new else AGAIN
    if gained(float(np.sum((triangle[columns.shape[1] - 1 :, -1] / residual.rms) ** 2))) < least:
        return None  # not even if each compliance had loads of its own, which is a linear problem
    starts = [nothing, *(share * axis for axis in np.eye(len(size)) for share in FIRST)]
    ends = [least_squares(lambda x: fitted(x)[1], start, max_nfev=20) for start in starts]
    best = min(ends, key=lambda end: float(end.cost))
    if (gain := gained(2.0 * best.cost)) < least:
        return None
    stderr = size * np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * 2.0 * best.cost / count)
    made = change.made(size * best.x, stderr, bool(fitted(best.x)[0].sum() < 0.0))
    if made is None:
        return None
    mechanism, said = made
    told, errors = {**here.said, change.kind: said}, {**here.stderr, change.kind: stderr}
    return OtherLoads(mechanism, told, here.gain + gain, here.constants + new, errors)
