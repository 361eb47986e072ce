"""Monte Carlo error budget: the distribution of the tooling ball's position error, and the share of each error source.

For every pose θ the errors ε of the joint's parameters are drawn at random; with X(θ, ε) the exact position of the
tooling ball, the position error is |X(θ, ε) - X(θ, 0)|. A parameter with error ε of variance var(ε) has the share Σ
|dX/dε|² var(ε), a sum over the poses, of the mean squared position error.
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
"""Largest number of Gauss-Newton steps for joint angles; change of an angle [rad] below which they end (picometres)."""
DIFFERENCE = 1e-5
"""Step, rad, of central differences of the ball's position by an angle; their relative error is 1e-10."""
IDLE = 1e-3
"""Least motion of the tooling ball per radian, relative to its distance from the joint's centre, at which realignment
adjusts an angle. A rotation about the line from the centre to the tooling ball does not move the ball."""


def realigned(q: Array, parameters: Array, tooling_ball: Array, held: Array, reach: float, stiffness: Array) -> Array:
    """Return the joint angles of least strain energy, rad, each within `reach` [rad] of the angle in q.

    q: joint angles (..., 3), rad. parameters: errors ε (..., 30) of the joint, m and rad. tooling_ball: nominal
    position (3,) of the ball, m. held: position p (..., 3), m, at which a holder keeps the ball. stiffness: matrix K
    (3, 3) of the holder, any unit, symmetric. The ball's position X(q, ε) by the extended kinematics gives the strain
    energy:
        E = ½ (X(q, ε) - p)ᵀ K (X(q, ε) - p)
    With K scaled to a largest eigenvalue of 1, Gauss-Newton steps over the angles that are not at a bound minimise 2 E
    + (IDLE |tooling_ball|)² |change of the angles|². With a large `reach`, only the change of the ball's distance from
    the joint's centre remains, or its part along a line if the holder is stiff along that line alone, as a link is.
    Raises InputError for a negative reach or stiffness.
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
    """Return the derivatives (rows, 30) of the position [m] with respect to the thesis parameters at angles q (poses,
    3), rad. A pose has three rows, or fewer if its joint angles are unknown and therefore eliminated."""
    data = unmeasured(JOINTS, q)
    effects = tuple(p.effect for p in THESIS_PARAMETERS)
    model, poses = ErrorModel(joint, effects), prepare(joint, data)
    observed = observe(model, poses, np.zeros(len(effects)), Placement({"": np.eye(4)}, {"": np.eye(4)}, {}))
    columns = effect_columns(effects, model, poses, observed)[:, :3]
    if angles_known:
        return columns.reshape(3 * len(q), -1)
    return eliminate(columns, np.zeros(columns.shape[:2]), joint_columns(joint, observed)[:, :3])[0]


MOST_DRAWS = 1_000_000
"""Largest number of random draws over all poses; more would need over a quarter of a gigabyte."""
KINDS = ("systematic", "stochastic")
DISTRIBUTIONS = ("uniform", "normal")


@dataclass(frozen=True)
class ErrorSource:
    """One error source of an error budget.

    index: number of the error parameter in the thesis, 1 to 30 (Table 3.2).
    half_range: half the range of the error, m or rad.
    kind: `systematic` or `stochastic` error.
    source: text that names the origin of half_range.
    """

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
        """Standard deviation of the error, m or rad."""
        return self.half_range / (np.sqrt(3.0) if self.distribution == "uniform" else 3.0)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Draw random errors of an error source, m or rad, in an array of the given shape."""
        if self.distribution == "uniform":
            return rng.uniform(-self.half_range, self.half_range, shape)
        return self.sigma * rng.standard_normal(shape)


@dataclass(frozen=True)
class Drawn:
    """Joints with random errors. q: joint angles (poses, 1, 3), rad. parameters: errors (poses, draws, 30), m and rad.
    tooling_ball: nominal position (3,) of the tooling ball, m."""

    q: Array
    parameters: Array
    tooling_ball: Array

    def distances(self, reach: float = 0.0) -> Array:
        """Return the distance (poses, draws), m, of the tooling ball from its nominal position.
        reach: largest change of each joint angle, rad, by which the joint realigns."""
        place, angles = tooling_ball_position(self.q, np.zeros(PARAMETERS), self.tooling_ball), self.q
        if reach:
            angles = realigned(angles, self.parameters, self.tooling_ball, place, reach, np.eye(3))
        away: Array = np.linalg.norm(tooling_ball_position(angles, self.parameters, self.tooling_ball) - place, axis=2)
        return away


@dataclass(frozen=True)
class Budget:
    """Result of a Monte Carlo error budget.

    distances: position errors (poses, draws), m.
    shares: share of each error source in the mean squared error; the shares add up to 1.
    joints: the joints with random errors.
    """

    kind: str
    distances: Array
    sources: tuple[ErrorSource, ...]
    shares: tuple[float, ...]
    joints: Drawn

    def realigned(self, reach: float, every: int = 1) -> "Budget":
        """Return the budget of every n-th draw, with a held ball and angles that realign by up to `reach`, rad."""
        fewer = replace(self.joints, parameters=self.joints.parameters[:, ::every])
        return replace(self, distances=fewer.distances(reach), joints=fewer)

    @property
    def mean(self) -> float:
        """Mean position error of the tooling ball, m."""
        return float(self.distances.mean())

    @property
    def worst_case(self) -> float:
        """Mean plus three standard deviations of the position error, m, as in the thesis."""
        return float(self.distances.mean() + 3.0 * self.distances.std())

    def histogram(self, bins: int = 40) -> tuple[Array, Array]:
        """Return the fraction of the position errors in each bin, and the edges of the bins, m."""
        counts, edges = np.histogram(self.distances, bins=bins)
        return counts / self.distances.size, edges


def read_budget(path: Path | None = None) -> tuple[tuple[ErrorSource, ...], Settings]:
    """Read the error sources and settings of a budget from the TOML table at `path`; a missing key gets its default.
    Raises InputError for an invalid table."""
    s = load_settings("budget", path)
    return sources_of(s), s


def sources_of(s: Settings) -> tuple[ErrorSource, ...]:
    """Return the error sources in the settings of a budget.
    Raises InputError if the index of a source in the list `translation` is that of a rotation, or the reverse."""
    entries = [(e, want) for want in ("translation", "rotation") for e in s[want]]
    for e, want in entries:
        if 1 <= e["index"] <= PARAMETERS and parameter(e["index"]).axis.startswith("R") != (want == "rotation"):
            raise InputError(
                f"error budget: [[{want}]] index {e['index']} is {parameter(e['index']).name}, expected a {want}"
            )
    return tuple(ErrorSource(e["index"], e["range"], e["kind"], e["distribution"], e["source"]) for e, _ in entries)


def error_budget(
    joint: PassiveJoint, sources: tuple[ErrorSource, ...], kind: str, rng: np.random.Generator,
    poses: int = 100, draws: int = 1000,
) -> Budget:  # fmt: skip
    """Compute the error budget of one kind (systematic or stochastic) for poses spread by the equal distribution
    criterion.
    Raises InputError if the budget has no source of the kind, or the number of poses or draws is zero or too large.
    """
    chosen = tuple(s for s in sources if s.kind == kind)
    if not chosen or poses < 1 or draws < 1 or poses * draws > MOST_DRAWS:
        message = f"{len(chosen)} {kind} sources, {poses} poses, {draws} draws"
        expected = f"at least 1 source, 1 pose, 1 draw, and poses times draws at most {MOST_DRAWS}"
        raise InputError(f"error budget: {message}; expected {expected}")
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
    """Return the joint with the tooling ball that the settings of an error budget define."""
    return replace(joint, tooling_ball=vector(settings["tooling_ball"]))
