"""Simulated tables of measurements with known errors: targets or touched surfaces, poses, measured values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.linearise import effect_columns
from gpmodel.errors import InputError
from gpmodel.families.by_name import one_effect_named
from gpmodel.formula.expression import ONE
from gpmodel.mechanism.branches import MOST_DRAWS, branched, random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, closing, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import numbers_of
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.table.units import convert

INSTRUMENTS = ("tracker", "camera", "hand camera", "planes", "spheres", "points", "bar", "inclinometer")
NOISE = {"camera": ("pixels", "0.1 px"), "hand camera": ("pixels", "0.1 px"), "inclinometer": ("angle", "0.002 deg")}
"""Dimension and usual standard deviation of the noise of some instruments. The default is that of a laser tracker."""
POOL = 60
"""Number of random poses drawn for each simulated pose. The camera can see the board in one of ten random poses."""
FOCAL, IMAGE, BOARD, PITCH = 2400.0, (2448.0, 2048.0), (5, 4), 0.02
"""A simulated camera of 5 megapixels and a board: focal length and image size, px; columns and rows of corners;
distance between corners, m."""
TILTED = np.cos(np.radians(55.0))
"""Cosine of the largest tilt of a calibration board at which its corners are located well in an image."""
BAR, BALL, TOUCHES = 0.3, 0.025, 4
"""Length of a simulated bar and radius of a simulated sphere, m; number of touches of a shared point."""
NEARBY = 30
"""Number of random poses from which a pose near a touched target is selected."""


@dataclass(frozen=True)
class Scene:
    """Poses and targets of a simulated measurement. With several arms, the poses belong to the arms in turn.

    q: joint values (poses, joints) of the initial poses.
    labels: {label column: name of the touched object at each pose}.
    spare: joint values of further starting poses; points: tool points (arms, poses, 3) of `spare` for every arm, m.
    aims: function from tool points (poses, 3) to the points to be touched, m, in the root frame.
    described: description of cameras and boards, as in their TOML files.
    own: true poses of cameras and boards by name, six numbers each, m and rad.
    """

    instrument: str
    q: Array
    labels: Mapping[str, NDArray[np.str_]]
    spare: Array
    points: Array
    aims: Callable[[Array], Array] | None = None
    described: Mapping[str, Mapping[str, object]] | None = None
    own: Mapping[str, Array] | None = None


def scene_of(
    instrument: str, mechanism: Mechanism, pool: Array, count: int, tool_point: Array, rng: np.random.Generator
) -> Scene:
    """Select `count` poses of a pool (poses, joints) that an instrument can measure, and the targets of the poses.
    Raises InputError if too few poses can be measured."""
    slots, tree = se3.chain(mechanism.transforms(pool)), branched(mechanism)
    if tree is not None:
        tips = slots[[mechanism.slots.index(slot) for slot in tree.tips.values()]]
        return _two_armed(instrument, pool, tips[..., :3, 3] + tips[..., :3, :3] @ tool_point, count, rng)
    frames = slots[-1]
    points = frames[:, :3, 3] + frames[:, :3, :3] @ tool_point
    if instrument in ("camera", "hand camera"):
        return _seen_scene(instrument == "camera", pool, frames, count, rng)
    if instrument == "inclinometer":
        link = mechanism.joints[-1].name
        return Scene(instrument, pool[:count], {"link": np.full(count, link)}, pool, points[None])
    return _touched(instrument, pool, points, count, rng)


def _touched(instrument: str, pool: Array, points: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place surfaces, shared points or bars near the middle of the tool points (poses, 3), m."""
    near = np.argsort(np.linalg.norm(points - np.median(points, axis=0), axis=1))[: POOL // 4 * count]
    chosen = rng.choice(near, count, replace=False)
    q, there, own = pool[chosen], points[chosen], np.arange(count)
    middle = target = np.median(there, axis=0)

    def aims(p: Array) -> Array:
        return np.asarray(target)

    if instrument == "planes":
        axis = own % 3
        turn = se3.exp(np.concatenate([np.zeros(3), rng.normal(0.0, 0.3, 3)]))[:3, :3]

        def flat(p: Array) -> Array:
            normal = turn.T[axis]
            return np.asarray(p - np.sum((p - middle) * normal, axis=1, keepdims=True) * normal)

        labels, aims = {"on_plane": np.array(["A", "B", "C"])[axis]}, flat
    elif instrument == "spheres":
        ball = own % 3
        away = rng.normal(size=(count, 3))
        target = there[:3][ball] + BALL * away / np.linalg.norm(away, axis=1, keepdims=True)
        labels = {"on_sphere": np.array(["A", "B", "C"])[ball]}
    else:
        group = own // (2 if instrument == "bar" else TOUCHES)
        target = there[np.flatnonzero(np.append(True, np.diff(group) > 0))][group]
        label, letter = ("pair", "B") if instrument == "bar" else ("same_point", "P")
        labels = {label: np.array([f"{letter}{g}" for g in group])}
    if instrument == "bar":
        first = target[::2]
        length = np.linalg.norm(points[near][None] - first[:, None], axis=2)
        other = np.argsort(np.abs(length - BAR), axis=1)[np.arange(len(first)), rng.integers(NEARBY, size=len(first))]
        along = points[near][other] - first
        along *= BAR / np.linalg.norm(along, axis=1, keepdims=True)
        target = target + along[group] * (own % 2)[:, None]
    return Scene(instrument, q, labels, pool[near], points[None, near], aims)


def _two_armed(instrument: str, pool: Array, points: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place shared points that every arm touches in turn, near tool points (arms, poses, 3), m."""
    if instrument != "points":
        raise InputError(f"{instrument} is of one arm; expected tracker or points of several", "instrument")
    own, known = np.arange(count), [cKDTree(arm) for arm in points]
    apart = np.max([tree.query(points[0])[0] for tree in known], axis=0)
    within = np.argsort(apart)[: POOL // 4 * (1 + count // TOUCHES)]
    target = points[0][rng.choice(within, 1 + count // TOUCHES, replace=False)][own // TOUCHES]
    start = [int(known[k % len(points)].query(target[k], TOUCHES)[1][k % TOUCHES]) for k in own]
    labels = {"same_point": np.array([f"P{k // TOUCHES}" for k in own])}
    return Scene(instrument, pool[start], labels, pool, points, lambda p: target)


def _seen_scene(outside: bool, pool: Array, frames: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place a camera in the world and a board in the hand (`outside`), or the reverse, facing along the flange's z
    axis."""
    middle = np.median(frames[:, :3, 3], axis=0)
    distance = 2.5 * float(np.median(np.linalg.norm(frames[:, :3, 3] - middle, axis=1))) + 0.3
    z = frames[rng.integers(len(frames)), :3, 2]
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    stands = se3.frame(np.column_stack([x, -np.cross(z, x), -z]), middle + distance * z)
    held = se3.exp(np.concatenate([rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.05, 3)]))
    camera, board = (stands, frames @ held) if outside else (frames @ held, stands)
    seen = np.linalg.inv(camera) @ board
    facing = np.abs(seen[:, 2, 2]) > TILTED if outside else -seen[:, 2, 2] > TILTED
    good = np.flatnonzero(facing & _inside(seen))
    if len(good) < count:
        raise InputError(
            f"only {len(good)} of {len(pool)} random poses show the board; expected at most that many poses"
        )
    names = ("world", "tool") if outside else ("tool", "world")
    lens = {"focal_px": [FOCAL, FOCAL], "centre_px": [v / 2 for v in IMAGE]}
    described: dict[str, Mapping[str, object]] = {
        "cameras": {"camera": {"C": {"link": names[0], **lens}}},
        "board": {"board": {"B": {"link": names[1], "columns": BOARD[0], "rows": BOARD[1], "pitch_mm": 1e3 * PITCH}}},
    }
    placed = map(numbers_of, (stands, held) if outside else (held, stands))
    own = dict(zip(("camera C", "board B"), placed, strict=True))
    return Scene("camera", pool[good[:count]], {}, pool, frames[None, :, :3, 3], described=described, own=own)


def _inside(seen: Array) -> Mask:
    """Return for poses of a board (poses, 4, 4) in the camera frame whether all its corners are in the image."""
    grid = PITCH * np.array([[i, j, 0.0] for j in range(BOARD[1]) for i in range(BOARD[0])])
    points = np.einsum("pij,cj->pci", seen[:, :3, :3], grid) + seen[:, None, :3, 3]
    ahead = points[:, :, 2] > 0.1
    image = FOCAL * points[:, :, :2] / np.where(ahead, points[:, :, 2], 1.0)[:, :, None]
    return np.asarray((ahead & (np.abs(image) < 0.5 * np.array(IMAGE)).all(axis=2)).all(axis=1))


CLOSE, STEPS, REDRAWN = 1e-9, 25, 12
"""Largest distance of a simulated touch from its surface, m; steps from an initial pose; number of initial poses."""


@dataclass(frozen=True)
class TrueMechanism:
    """A mechanism with known errors. theta: values of the effects of `model`. placement: registration, tool point."""

    model: ErrorModel
    theta: Array
    placement: Placement


def read_in(
    scene: Scene, real: TrueMechanism, empty: Dataset, noise: float, rng: np.random.Generator
) -> tuple[Dataset, Placement]:
    """Simulate the measurements of a mechanism with known errors.

    Return the table, and registration and tool point with the poses of cameras, boards and inclinometers.
    empty: dataset of the poses, without measurements.
    noise: standard deviation of one measured value, m, px or rad.
    """
    mechanism = real.model.mechanism
    if scene.aims is not None:
        labels = {**empty.labels, **scene.labels}
        q = _reached(scene, real, empty, noise, rng)
        lengths = {"length": np.full(len(q), BAR)} if scene.instrument == "bar" else {}
        data = replace(empty, q=q, labels=labels, readings=lengths)
        return with_observations(data, mechanism), real.placement
    corners = BOARD[0] * BOARD[1] if scene.own else 1
    data = empty.subset(np.repeat(np.arange(len(empty)), corners))
    data = replace(data, row=np.arange(1, len(data) + 1), described=scene.described or {})
    columns = ("u", "v") if scene.own else ("inclination_x", "inclination_y")
    labels = {k: np.repeat(v, corners) for k, v in scene.labels.items()}
    if scene.own:
        labels = {"camera": np.full(len(data), "C"), "marker": np.tile(np.arange(corners).astype(str), len(empty))}
    data = replace(data, labels={**data.labels, **labels}, readings=dict.fromkeys(columns, np.zeros(len(data))))
    own = scene.own or _mounted(scene, rng)
    there = replace(real.placement, anchors={**real.placement.anchors, **own})
    data = with_observations(data, mechanism)
    read = -measured_minus(observe(real.model, prepare(mechanism, data), real.theta, there), data)[:, 6:]
    read = read + noise * rng.normal(size=read.shape)
    data = replace(data, readings=dict(zip(columns, read.T, strict=True)))
    return with_observations(data, mechanism), there


def _mounted(scene: Scene, rng: np.random.Generator) -> dict[str, Array]:
    link = scene.labels["link"][0]
    return {"vertical": np.array([0.0, 0.0, 1.0]), f"inclinometer {link}": rng.normal(0.0, 0.3, 3)}


def _reached(scene: Scene, real: TrueMechanism, empty: Dataset, noise: float, rng: np.random.Generator) -> Array:
    """Return joint values (poses, joints) at which the true tool point is on its target, up to contact noise."""
    assert scene.aims is not None
    mechanism, q = real.model.mechanism, scene.q.copy()
    limits = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    drives = tuple(drive_effect(j.name, j, ONE) for j in mechanism.joints)
    slip = noise * rng.normal(size=(len(q), 3))
    points, short = np.zeros((len(q), 3)), np.arange(len(q))
    for step in range(1, STEPS * REDRAWN + 1):
        poses = prepare(mechanism, replace(empty.subset(short), q=q[short].copy()))
        observed = observe(real.model, poses, real.theta, real.placement)
        points[short] = observed.tips.root[:, :3, 3]
        miss = (scene.aims(points - slip) + slip - points)[short]
        off = np.linalg.norm(miss, axis=1) > CLOSE
        reach = np.swapaxes(observed.tips.turn, 1, 2) @ effect_columns(drives, real.model, poses, observed)[:, :3]
        short, miss, reach = short[off], miss[off], reach[off]
        if not len(short):
            return q
        if step % STEPS == 0:
            some = rng.integers(len(scene.spare), size=(len(short), NEARBY))
            arm = short % len(scene.points)
            far = np.linalg.norm(scene.points[arm[:, None], some] - (points[short] + miss)[:, None], axis=2)
            q[short] = scene.spare[some[np.arange(len(some)), np.argmin(far, axis=1)]]
            continue
        gram = reach @ np.swapaxes(reach, 1, 2) + 1e-9 * np.eye(3)
        move = np.einsum("nij,ni->nj", reach, np.linalg.solve(gram, miss[:, :, None])[:, :, 0])
        move *= np.minimum(1.0, 0.3 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q[short] = np.clip(q[short] + move, *limits)
    raise InputError("some poses do not reach the touched surface; expected another seed or more poses")


INSTRUMENT_DISTANCE = 3.0
TOOL_OFFSET = 0.15
LEVER = 1.0
"""Length in metres that is the standard deviation of each coordinate of the simulated instrument's position, the
distance of the tool point from the flange, and the geometric error that weighs as much as a radian."""
FARTHEST = 1.0
"""Largest motion of a frame by simulated errors, m or rad."""


@dataclass(frozen=True)
class Simulation:
    """A simulated table and its true errors. theta: values of the effects of `model`, SI units. noise: standard
    deviation of one measured value, as in `simulate`."""

    dataset: Dataset
    model: ErrorModel
    theta: Array
    placement: Placement
    noise: float


def parse_true_effects(
    text: str, mechanism: Mechanism, states: States, rng: np.random.Generator
) -> tuple[tuple[Effect, ...], Array]:
    """Parse `NAME=VALUE UNIT` into effects and their values, in the unit of the effects.

    NAME is a catalogue name (`gear_harmonic J4`) or `slot:axis:expression`. If NAME has two effects or more, as sine
    and cosine, VALUE is the amplitude and the phase is random. A motion, as in 10 urad, is the motion per unit of the
    column that the effect reads. Raises InputError if the text cannot be parsed.
    """
    name, found, value = text.rpartition("=")
    if not found or not name.strip():
        raise InputError(f"'{text}', expected NAME=VALUE UNIT, as in 'gear_harmonic J4=20 arcsec'", "effects")
    effects = one_effect_named(name.strip(), mechanism, states)
    unit, where = effects[0].unit, f"effect '{text}'"
    motion, _, per = unit.partition("/")
    columns = {states.units.get(name) for name in effects[0].inputs if name not in states.loads}
    try:
        size = convert(value, unit, where)
    except InputError:
        if per not in columns:
            raise
        size = convert(value, motion, where)
    direction = rng.normal(size=len(effects))
    return effects, size * (direction / np.linalg.norm(direction) if len(effects) > 1 else np.ones(1))


def random_tool_point(rng: np.random.Generator) -> Array:
    """Return a random tool point (3,) off the axes of the flange, m."""
    return np.asarray(rng.uniform(0.3, 1.0, 3) * TOOL_OFFSET * rng.choice([-1.0, 1.0], 3))


def simulate(
    mechanism: Mechanism,
    q: Array,
    effects: Sequence[str],
    rng: np.random.Generator,
    *,
    noise: float = 0.0,
    geometry_sigma: float = 0.0,
    payload: Array | None = None,
    inputs: Mapping[str, Array] | None = None,
    input_units: Mapping[str, str] | None = None,
    tool_point: Array | None = None,
    scene: Scene | None = None,
    drawn: bool = False,
) -> Simulation:
    """Simulate measurements of `mechanism` at joint values q (poses, joints), with an instrument at a random place.

    effects: texts as `parse_true_effects` parses them.
    noise: standard deviation of each of x, y, z, m, or of one value in the unit of the instrument of `scene`.
    geometry_sigma: standard deviation of every geometric constant, m, and rad at a lever of 1 m.
    payload: mass at the tool at each pose, kg.
    inputs: further columns of the table in `input_units`.
    tool_point: position (3,) in the flange frame, m; random if None.
    scene: instrument that does not measure points; None for a tracker.
    drawn: True if q is random; poses at which loops do not close with the errors are replaced by random poses.
    Raises InputError for an effect that cannot be parsed or is not finite, or for poses at which loops do not close.
    """
    bare = unmeasured([j.name for j in mechanism.joints], q, payload, [j.kind for j in mechanism.joints])
    tree = branched(mechanism)
    tips = [""] if tree is None else [*tree.tips]
    arms = {} if tree is None else dict.fromkeys(("tip", "tool"), np.array(tips)[np.arange(len(q)) % len(tips)])
    empty = replace(bare, extras=inputs or {}, extra_units=input_units or {}, labels=arms, source="simulation")
    poses = prepare(mechanism, empty)
    registration = se3.exp(np.concatenate([rng.normal(0.0, INSTRUMENT_DISTANCE, 3), rng.uniform(-1.5, 1.5, 3)]))
    tool = se3.shift(random_tool_point(rng) if tool_point is None else tool_point)
    placement = Placement({"": registration}, dict.fromkeys(tips, tool), {})
    geometry = geometric_effects(mechanism) if geometry_sigma else ()
    scale = np.array([1.0 if e.unit == "m" else 1.0 / LEVER for e in geometry])
    theta = [geometry_sigma * scale * rng.normal(size=len(geometry))]
    chosen = list(geometry)
    for text in effects:
        added, values = parse_true_effects(text, mechanism, poses.states, rng)
        chosen += added
        theta.append(values)
    model = ErrorModel(mechanism, tuple(chosen))
    values = np.concatenate(theta)
    with np.errstate(over="ignore", invalid="ignore"):
        largest = max((float(np.abs(twist).max()) for twist in model.twists(poses, values).values()), default=0.0)
    if not largest <= FARTHEST:
        raise InputError(
            f"errors that move a frame by {largest:g} m or rad, expected at most {FARTHEST:g}; a unit may be wrong",
            "effects",
        )
    if scene is not None:
        seen, placement = read_in(scene, TrueMechanism(model, values, placement), empty, noise, rng)
        return Simulation(seen, model, values, placement, noise)
    empty = _closed(model, empty, values, rng if drawn else None)
    tip = observe(model, prepare(mechanism, empty), values, placement).tip[:, :3, 3]
    position = tip + rng.normal(0.0, noise, tip.shape) if noise else tip
    return Simulation(replace(empty, position=position), model, values, placement, noise)


def _closed(model: ErrorModel, data: Dataset, theta: Array, rng: np.random.Generator | None) -> Dataset:
    """Replace poses at which the kinematic loops do not close with the errors by random poses.

    Raises InputError without a random generator, or if the loops close at hardly any pose.
    """
    for _ in range(MOST_DRAWS):
        open_rows = np.setdiff1d(np.arange(len(data)), closing(model, data, theta))
        if not len(open_rows):
            return data
        if rng is None:
            where = f"at {len(open_rows)} of {len(data)} poses, first at pose {open_rows[0] + 1}"
            message = f"the loops do not close with these errors {where}; expected poses farther inside the limits"
            raise InputError(message, "poses")
        q = data.q.copy()
        q[open_rows] = random_poses(model.mechanism, len(open_rows), rng)
        data = replace(data, q=q)
    raise InputError("with these errors the loops close at hardly any pose; expected smaller errors", "effects")
