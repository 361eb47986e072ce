"""Monte Carlo error budget: what the tooling ball's position error will be, and whose fault it is.

For every pose the parameters are drawn anew and the exact extended kinematics give |X(θ, ε) - X(θ, 0)|; the share of
a parameter is its part of the mean squared error, Σ |c|² var over the poses, with c its column.
Source: Robertson (2003), 3.3.2, Figures 3.18 and 3.19.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.unmeasured_joints import eliminate, joint_columns
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.planning.poses import spread_poses
from gpmodel.table.dataset import unmeasured
from joints.passive_joint import (
    JOINTS,
    PARAMETERS,
    THESIS_PARAMETERS,
    PassiveJoint,
    parameter,
    tooling_ball_position,
    vector,
)
from joints.settings import Settings, load_settings, not_negative

STEPS, SETTLED = 50, 1e-10
"""Largest number of Gauss-Newton steps, and the change of every angle that ends them, rad: picometres at a lever."""
DIFFERENCE = 1e-5
"""Step of central differences, rad; their error is ten digits below the lever."""
IDLE = 1e-3
"""Least motion of the ball per radian over the lever for an angle that is adjusted. A turn about the lever moves the
ball by nothing."""


def realigned(q: Array, parameters: Array, tooling_ball: Array, held: Array, reach: float, stiffness: Array) -> Array:
    """Angles (..., 3), rad, of least strain energy within `reach` [rad] of q (..., 3).

    parameters: (..., 30) m and rad. tooling_ball: (3,) m. held: (..., 3) m. stiffness: K (3, 3), any unit, symmetric.
    With K of largest eigenvalue 1, what is minimised is 2 E + (IDLE |tooling_ball|)² |turn|², by Gauss-Newton steps of
    the angles that no bound holds. Raises InputError for a negative reach or stiffness.

        E = ½ (X(q, ε) - p)ᵀ K (X(q, ε) - p),   q within a range about the angles that the joint would have without
        errors

    X: the extended kinematics with the errors ε; p: where the ball is held; K: how stiffly. Free angles leave what
    changes the ball's distance from the centre alone; of stiffness along one line, as of a link, the part along it.
    """
    limit = float(not_negative("range of realignment", reach, "rad"))
    sizes, axes = np.linalg.eigh(stiffness)
    not_negative("stiffness", np.where(np.abs(sizes) < 1e-12 * np.abs(sizes).max(), 0.0, sizes), "N/m")
    root: Array = np.sqrt(np.maximum(sizes, 0.0) / sizes.max())[:, None] * axes.T
    idle, each = (IDLE * np.linalg.norm(tooling_ball)) ** 2, np.eye(len(JOINTS))

    def strained(turned: Array) -> Array:
        return (tooling_ball_position(q + turned, parameters, tooling_ball) - held) @ root.T

    turned = np.zeros(np.broadcast_shapes(q.shape, held.shape))
    for _ in range(STEPS):
        steps = DIFFERENCE * each
        columns = np.stack([strained(turned + d) - strained(turned - d) for d in steps], axis=-1) / (2 * DIFFERENCE)
        uphill = np.einsum("...ij,...i->...j", columns, strained(turned)) + idle * turned
        stopped = (np.abs(turned) >= limit) & (uphill * turned <= 0)
        curved = np.einsum("...ij,...ik->...jk", columns, columns) + idle * each
        curved = np.where(stopped[..., :, None] | stopped[..., None, :], each, curved)
        step = np.linalg.solve(curved, np.where(stopped, 0.0, uphill)[..., None])[..., 0]
        before, turned = turned, np.clip(turned - step, -limit, limit)
        if np.abs(turned - before).max() < SETTLED:
            break
    return q + turned


def thesis_columns(joint: PassiveJoint, q: Array, *, angles_known: bool = True) -> Array:
    """Columns (M, 30) of the position at q (N, 3), m a unit; three rows a pose, fewer with free angles."""
    data = unmeasured(JOINTS, q)
    effects = tuple(p.effect for p in THESIS_PARAMETERS)
    model, poses = ErrorModel(joint, effects), prepare(joint, data)
    observed = observe(model, poses, np.zeros(len(effects)), Placement({"": np.eye(4)}, {"": np.eye(4)}, {}))
    columns = effect_columns(effects, model, poses, observed)[:, :3]
    if angles_known:
        return columns.reshape(3 * len(q), -1)
    return eliminate(columns, np.zeros(columns.shape[:2]), joint_columns(joint, observed)[:, :3])[0]


MOST_DRAWS = 1_000_000
"""Largest number of draws over all poses: a quarter of a gigabyte."""
KINDS = ("systematic", "stochastic")
DISTRIBUTIONS = ("uniform", "normal")


@dataclass(frozen=True)
class ErrorSource:
    """One entry of a budget: thesis index, half range (m or rad), kind, distribution, and where it comes from."""

    index: int
    half_range: float
    kind: str
    distribution: str
    source: str

    def __post_init__(self) -> None:
        where = f"error budget, '{self.source}'"
        if not 1 <= self.index <= PARAMETERS:
            raise InputError(f"{where}: index {self.index}; expected 1 to {PARAMETERS}, as in Table 3.2")
        if not 0.0 <= self.half_range < np.inf:
            raise InputError(f"{where}: range {self.half_range:g}; expected a length or an angle of 0 or more")
        for value, allowed, name in ((self.kind, KINDS, "kind"), (self.distribution, DISTRIBUTIONS, "distribution")):
            if value not in allowed:
                raise InputError(f"{where}: {name} '{value}'; expected {' or '.join(allowed)}")

    @property
    def sigma(self) -> float:
        """Standard deviation, m or rad."""
        return self.half_range / (np.sqrt(3.0) if self.distribution == "uniform" else 3.0)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Values (shape), m or rad."""
        if self.distribution == "uniform":
            return rng.uniform(-self.half_range, self.half_range, shape)
        return self.sigma * rng.standard_normal(shape)


@dataclass(frozen=True)
class Drawn:
    """Joints at poses: q (poses, 1, 3) rad, parameters (poses, draws, 30), m and rad, tooling_ball (3,) m."""

    q: Array
    parameters: Array
    tooling_ball: Array

    def distances(self, reach: float = 0.0) -> Array:
        """Return the distance of the ball from its nominal place (poses, draws), m.

        reach: angle by which each angle may turn to realign, rad.
        """
        place, angles = tooling_ball_position(self.q, np.zeros(PARAMETERS), self.tooling_ball), self.q
        if reach:
            angles = realigned(angles, self.parameters, self.tooling_ball, place, reach, np.eye(3))
        away: Array = np.linalg.norm(tooling_ball_position(angles, self.parameters, self.tooling_ball) - place, axis=2)
        return away


@dataclass(frozen=True)
class Budget:
    """distances: (poses, draws) m. shares: one a source, adding to 1, in their order. joints: that were drawn."""

    kind: str
    distances: Array
    sources: tuple[ErrorSource, ...]
    shares: tuple[float, ...]
    joints: Drawn

    def realigned(self, reach: float, every: int = 1) -> "Budget":
        """Return the remaining budget if the ball is held and each angle turns by up to `reach`, rad; uses every
        `every`-th draw."""
        fewer = replace(self.joints, parameters=self.joints.parameters[:, ::every])
        return replace(self, distances=fewer.distances(reach), joints=fewer)

    @property
    def mean(self) -> float:
        """Mean distance, m."""
        return float(self.distances.mean())

    @property
    def worst_case(self) -> float:
        """Mean plus three standard deviations, m, as in the thesis."""
        return float(self.distances.mean() + 3.0 * self.distances.std())

    def histogram(self, bins: int = 40) -> tuple[Array, Array]:
        """Share of the draws in each bin, and the bins' edges, m."""
        counts, edges = np.histogram(self.distances, bins=bins)
        return counts / self.distances.size, edges


def read_budget(path: Path | None = None) -> tuple[tuple[ErrorSource, ...], Settings]:
    """Sources and settings of the TOML table at `path` laid over the default one. Raises InputError, one line."""
    s = load_settings("budget", path)
    return sources_of(s), s


def sources_of(s: Settings) -> tuple[ErrorSource, ...]:
    """The sources that settings list. Raises InputError for an index that is no translation, or no rotation."""
    entries = [(e, want) for want in ("translation", "rotation") for e in s[want]]
    for e, want in entries:
        if 1 <= e["index"] <= PARAMETERS and parameter(e["index"]).axis.startswith("R") != (want == "rotation"):
            raise InputError(f"error budget: [[{want}]] index {e['index']} is {parameter(e['index']).name}")
    return tuple(ErrorSource(e["index"], e["range"], e["kind"], e["distribution"], e["source"]) for e, _ in entries)


def error_budget(
    joint: PassiveJoint, sources: tuple[ErrorSource, ...], kind: str, rng: np.random.Generator,
    poses: int = 100, draws: int = 1000,
) -> Budget:  # fmt: skip
    """Compute the error budget of one kind over poses spread by the equal distribution criterion.

    Raises InputError where no source is of that kind, and for no poses or draws or too many.
    """
    chosen = tuple(s for s in sources if s.kind == kind)
    if not chosen or poses < 1 or draws < 1 or poses * draws > MOST_DRAWS:
        said = f"{len(chosen)} {kind} sources, {poses} poses, {draws} draws"
        raise InputError(f"error budget: {said}; expected some, {MOST_DRAWS} of all poses at most")
    q = spread_poses(joint, poses, rng)
    parameters = np.zeros((poses, draws, PARAMETERS))
    for source in chosen:
        parameters[:, :, source.index - 1] += source.draw((poses, draws), rng)
    columns = thesis_columns(joint, q)
    squared = np.array([s.sigma**2 * np.sum(columns[:, s.index - 1] ** 2) for s in chosen])
    total = squared.sum()
    shares = squared / total if total > 0 else squared
    joints = Drawn(q[:, None], parameters, np.asarray(joint.tooling_ball))
    return Budget(kind, joints.distances(), chosen, tuple(float(x) for x in shares), joints)


def budget_joint(joint: PassiveJoint, settings: Settings) -> PassiveJoint:
    """The joint with the tooling ball of a budget's table."""
    return replace(joint, tooling_ball=vector(settings["tooling_ball"]))
