"""Where to start: registration and tool point in closed form, then what each observation has to find of itself."""

import numpy as np
from scipy import optimize

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.model.error_model import Placement, Poses
from gpmodel.model.observation import Tips, observations
from gpmodel.numerics import se3

START_POSES = 400
"""Poses that the start is found from; all of them take part in the fit that follows."""

TOOL_PULL = 1e-4
"""Metres of error that a tool point a metre off the flange counts as: what decides where the poses leave it open."""

GOOD_START = 1e-4
"""Metres RMS below which no other start is tried; poses in one plane have a mirrored one that fits far worse."""


def start_placement(poses: Poses) -> Placement:
    """Registration by Kabsch for every tool point tried, the tool points by least squares over what is left.

    Every observation starts its own unknowns from the tips that these give. Raises InputError when a setup has
    fewer than 3 measured poses, or an observation too little for its own.
    """
    data = poses.dataset
    slots = se3.chain(poses.transforms)
    frames = slots[poses.tip_slot, np.arange(len(poses))]
    setups, setup = data.codes("setup")
    tools, tool = data.codes("tool")
    measured: Mask = np.isfinite(data.position).all(axis=1)  # type: ignore[assignment]
    if not measured.any():
        registration = {name: np.eye(4) for name in setups}
        points = np.zeros((len(tools), 3))
    else:
        for i, name in enumerate(setups):
            if (count := int(measured[setup == i].sum())) < 3:
                label = f"{data.source}, setup '{name}'" if name else data.source
                raise InputError(f"{label}: {count} poses with x, y and z; registration needs at least 3")
        rows = np.flatnonzero(measured)
        fit_rows = rows[:: max(1, len(rows) // START_POSES)]
        points = _tool_points(frames, data.position, setup, tool, fit_rows, len(tools))
        tips = _tips(frames, points, tool)
        registration = {}
        for i, name in enumerate(setups):
            chosen = measured & (setup == i)
            turn, shift = se3.fit_rotation(tips[chosen], data.position[chosen])
            registration[name] = se3.frame(turn, shift)
    tool_frames = {name: se3.shift(point) for name, point in zip(tools, points, strict=True)}
    if data.has_rotation:
        tool_frames = _turn_tools(poses, frames, registration, tool_frames)
    root = frames @ np.stack([tool_frames[name] for name in data.label("tool").tolist()])
    register = np.stack([registration[name] for name in data.label("setup").tolist()])
    predicted = Tips(root, register @ root, slots)
    own = {key: value for kind in observations(data) for key, value in kind.start(predicted).items()}
    return Placement(registration, tool_frames, own)


def _tips(frames: Array, points: Array, tool: IntArray) -> Array:
    return frames[:, :3, 3] + (frames[:, :3, :3] @ points[tool][:, :, None])[..., 0]


def _tool_points(frames: Array, position: Array, setup: IntArray, tool: IntArray, rows: IntArray, count: int) -> Array:
    def misfit(flat: Array) -> Array:
        tips = _tips(frames[rows], flat.reshape(count, 3), tool[rows])
        out = np.empty_like(tips)
        for i in np.unique(setup[rows]):
            chosen = setup[rows] == i
            turn, shift = se3.fit_rotation(tips[chosen], position[rows][chosen])
            out[chosen] = position[rows][chosen] - tips[chosen] @ turn.T - shift
        return np.append(out.ravel(), TOOL_PULL * flat)

    starts = [np.zeros(3 * count)]
    starts += [np.tile(0.15 * sign * axis, count) for axis in np.eye(3) for sign in (1.0, -1.0)]
    best = None
    for start in starts:
        found = optimize.least_squares(misfit, start, method="trf", x_scale=0.1, max_nfev=30)
        if best is None or found.cost < best.cost:
            best = found
        if np.sqrt(2 * best.cost / len(rows)) < GOOD_START:
            break
    assert best is not None
    return best.x.reshape(count, 3)


def _turn_tools(
    poses: Poses, frames: Array, registration: dict[str, Array], tools: dict[str, Array]
) -> dict[str, Array]:
    data = poses.dataset
    seen = np.isfinite(data.rotation).all(axis=1)
    out = {}
    for name, frame in tools.items():
        chosen = seen & (data.label("tool") == name)
        register = np.stack([registration[s] for s in data.label("setup")[chosen].tolist()])
        flange = register[:, :3, :3] @ frames[chosen, :3, :3]
        twists = np.hstack([np.zeros((int(chosen.sum()), 3)), data.rotation[chosen]])
        mean = (np.swapaxes(flange, 1, 2) @ se3.exp(twists)[:, :3, :3]).mean(axis=0)
        out[name] = se3.frame(se3.nearest_rotation(mean), frame[:3, 3])
    return out
