"""Monte Carlo error budget: the distribution of the tooling ball's position error, and the share of each error source.

For every pose the parameters ε are drawn, and the exact extended kinematics X give the error |X(θ, ε) - X(θ, 0)|. The
share of a parameter is its part of the mean squared error, Σ |c|² var over the poses, with c = dX/dε of the parameter.
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
"""Largest number of Gauss-Newton steps; change of an angle, rad, below which the steps end: picometres at the lever."""
DIFFERENCE = 1e-5
"""Step of central differences, rad; the relative error is 1e-10 of the lever."""
IDLE = 1e-3
"""Least motion of the ball per radian, relative to the lever, at which an angle is adjusted. A rotation about the lever
does not move the ball."""


def realigned(q: Array, parameters: Array, tooling_ball: Array, held: Array, reach: float, stiffness: Array) -> Array:
    """Return the angles (..., 3), rad, of least strain energy within `reach` [rad] of q (..., 3).

    parameters: (..., 30) m and rad. tooling_ball: (3,) m. held: (..., 3) m, position at which the ball is held.
    stiffness: K (3, 3) of the holder, any unit, symmetric.
        E = ½ (X(q, ε) - p)ᵀ K (X(q, ε) - p)
    X: extended kinematics with errors ε; p: `held`. The angles may differ by `reach` from the joint's
    angles without errors. With K scaled to a largest eigenvalue of 1, 2 E + (IDLE |tooling_ball|)² |turn|² is minimised
    by Gauss-Newton steps over the angles that are not at a bound. With free angles the remaining error is the change of
    the ball's distance from the centre; with stiffness along one line, as of a link, the part of this change along the
    line. Raises InputError for a negative reach or stiffness.
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
    """Return the derivatives (M, 30) of the position, m per unit, by the thesis parameters, at q (N, 3).
    There are three rows per pose; fewer rows if the angles are free, because free angles are eliminated."""
    data = unmeasured(JOINTS, q)
    effects = tuple(p.effect for p in THESIS_PARAMETERS)
    model, poses = ErrorModel(joint, effects), prepare(joint, data)
    observed = observe(model, poses, np.zeros(len(effects)), Placement({"": np.eye(4)}, {"": np.eye(4)}, {}))
    columns = effect_columns(effects, model, poses, observed)[:, :3]
    if angles_known:
        return columns.reshape(3 * len(q), -1)
    return eliminate(columns, np.zeros(columns.shape[:2]), joint_columns(joint, observed)[:, :3])[0]


MOST_DRAWS = 1_000_000
"""Largest number of draws over all poses, which need a quarter of a gigabyte."""
KINDS = ("systematic", "stochastic")
DISTRIBUTIONS = ("uniform", "normal")


@dataclass(frozen=True)
class ErrorSource:
    """One error source of a budget.

    index: index of the parameter in the thesis.
    half_range: half the range of the error, m or rad.
    kind: systematic or stochastic.
    source: origin of the value of half_range.
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
        """Standard deviation, m or rad."""
        return self.half_range / (np.sqrt(3.0) if self.distribution == "uniform" else 3.0)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Draw random values of the given shape, m or rad."""
        if self.distribution == "uniform":
            return rng.uniform(-self.half_range, self.half_range, shape)
        return self.sigma * rng.standard_normal(shape)


@dataclass(frozen=True)
class Drawn:
    """Joints with random errors. q: (poses, 1, 3) rad. parameters: (poses, draws, 30), m and rad.
    tooling_ball: (3,) m."""

    q: Array
    parameters: Array
    tooling_ball: Array

    def distances(self, reach: float = 0.0) -> Array:
        """Return the distance (poses, draws), m, of the ball from its nominal position.
        reach: largest change of each angle by which the joint realigns, rad."""
        place, angles = tooling_ball_position(self.q, np.zeros(PARAMETERS), self.tooling_ball), self.q
        if reach:
            angles = realigned(angles, self.parameters, self.tooling_ball, place, reach, np.eye(3))
        away: Array = np.linalg.norm(tooling_ball_position(angles, self.parameters, self.tooling_ball) - place, axis=2)
        return away


@dataclass(frozen=True)
class Budget:
    """Result of an error budget.

    distances: position errors (poses, draws), m.
    shares: share of the mean square of each source, adding up to 1.
    joints: the random joints.
    """

    kind: str
    distances: Array
    sources: tuple[ErrorSource, ...]
    shares: tuple[float, ...]
    joints: Drawn

    def realigned(self, reach: float, every: int = 1) -> "Budget":
        """Return the budget if the ball is held and each angle realigns by up to `reach`, rad; uses every `every`-th
        draw."""
        fewer = replace(self.joints, parameters=self.joints.parameters[:, ::every])
        return replace(self, distances=fewer.distances(reach), joints=fewer)

    @property
    def mean(self) -> float:
        """Mean distance, m."""
        return float(self.distances.mean())

    @property
    def worst_case(self) -> float:
        """Mean plus three standard deviations of the distance, m, as in the thesis."""
        return float(self.distances.mean() + 3.0 * self.distances.std())

    def histogram(self, bins: int = 40) -> tuple[Array, Array]:
        """Return the share of draws in each bin, and the edges of the bins, m."""
        counts, edges = np.histogram(self.distances, bins=bins)
        return counts / self.distances.size, edges


def read_budget(path: Path | None = None) -> tuple[tuple[ErrorSource, ...], Settings]:
    """Read error sources and settings from the TOML table at `path`, with defaults for missing
    keys. Raises InputError."""
    s = load_settings("budget", path)
    return sources_of(s), s


def sources_of(s: Settings) -> tuple[ErrorSource, ...]:
    """Return the error sources in settings.
    Raises InputError for an index that is not a translation, or not a rotation."""
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
    """Compute the error budget of one kind over poses spread by the equal distribution criterion.

    Raises InputError if no source is of that kind, or the number of poses or draws is zero or too large.
    """
    chosen = tuple(s for s in sources if s.kind == kind)
    if not chosen or poses < 1 or draws < 1 or poses * draws > MOST_DRAWS:
        said = f"{len(chosen)} {kind} sources, {poses} poses, {draws} draws"
        raise InputError(
            f"error budget: {said}; expected at least one of each, and at most {MOST_DRAWS} draws over all poses"
        )
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
    """Return the joint with the tooling ball of a budget's settings."""
    return replace(joint, tooling_ball=vector(settings["tooling_ball"]))
