"""Measured tables with known truth, from the error model itself."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.families.by_name import one_effect_named
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import MOST_DRAWS, random_poses
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, closing, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States
from gpmodel.numerics import se3
from gpmodel.planning.readings import Real, read_in
from gpmodel.planning.scenes import Scene
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.table.units import convert

INSTRUMENT_DISTANCE = 3.0
TOOL_OFFSET = 0.15
LEVER = 1.0
"""Metres, the standard deviation of each coordinate of the instrument's place; metres a tool point is off the flange;
and metres at which a radian of geometry counts as a metre."""
FARTHEST = 1.0
"""Metres, or radians, that errors may move a frame by: beyond, it is another machine."""


@dataclass(frozen=True)
class Simulation:
    """A table and the truth behind it. theta: (E,) values of model.effects in their own SI units."""

    dataset: Dataset
    model: ErrorModel
    theta: Array
    placement: Placement
    noise: float


def planted(
    text: str, mechanism: Mechanism, states: States, rng: np.random.Generator
) -> tuple[tuple[Effect, ...], Array]:
    """Effects of `NAME=VALUE UNIT` and their values, in the effects' own units.

    NAME is a catalogue name (`gear_harmonic J4`) or `slot:axis:expression`. Of effects that come in pairs, sine and
    cosine, VALUE is the amplitude and the phase is random. Raises InputError for what cannot be read.
    """
    name, found, value = text.rpartition("=")
    if not found or not name.strip():
        raise InputError(f"'{text}', expected NAME=VALUE UNIT, as in 'gear_harmonic J4=20 arcsec'", "effects")
    effects = one_effect_named(name.strip(), mechanism, states)
    size = convert(value, effects[0].unit, f"effect '{text}'")
    direction = rng.normal(size=len(effects))
    return effects, size * (direction / np.linalg.norm(direction) if len(effects) > 1 else np.ones(1))


def random_tool_point(rng: np.random.Generator) -> Array:
    """A tool point (3,) off the flange's axes, m."""
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
    """Measure `mechanism` at q (N, n) with an instrument at a random place and a random tool point.

    effects: as `planted` reads them. noise: standard deviation of each of x, y, z, m. geometry_sigma: standard
    deviation of every constant error twist, m, and rad at a lever of 1 m. payload: (N,) kg. inputs: further columns
    (N,) in `input_units`. tool_point: (3,) in the flange, m, drawn where None. scene: of an
    instrument that reads no points, whose noise is in the unit of its readings. drawn: q is random; poses at which
    loops do not close with the errors are replaced by others.
    Raises InputError for an effect that cannot be read or is not finite, or for poses at which loops do not close.
    """
    bare = unmeasured([j.name for j in mechanism.joints], q, payload)
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
        added, values = planted(text, mechanism, poses.states, rng)
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
        seen, placement = read_in(scene, Real(model, values, placement), empty, noise, rng)
        return Simulation(seen, model, values, placement, noise)
    empty = _closed(model, empty, values, rng if drawn else None)
    tip = observe(model, prepare(mechanism, empty), values, placement).tip[:, :3, 3]
    position = tip + rng.normal(0.0, noise, tip.shape) if noise else tip
    return Simulation(replace(empty, position=position), model, values, placement, noise)


def _closed(model: ErrorModel, data: Dataset, theta: Array, rng: np.random.Generator | None) -> Dataset:
    """Replace poses at which loops do not close with the errors by random ones.

    Raises InputError without a generator, or where hardly any pose closes.
    """
    for _ in range(MOST_DRAWS):
        open_rows = np.setdiff1d(np.arange(len(data)), closing(model, data, theta))
        if not len(open_rows):
            return data
        if rng is None:
            where = f"at {len(open_rows)} of {len(data)} poses, first at pose {open_rows[0] + 1}"
            said = f"the loops do not close with these errors {where}; expected poses farther inside the limits"
            raise InputError(said, "poses")
        q = data.q.copy()
        q[open_rows] = random_poses(model.mechanism, len(open_rows), rng)
        data = replace(data, q=q)
    raise InputError("with these errors the loops close at hardly any pose; expected smaller errors", "effects")
