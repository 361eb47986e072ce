"""The error model: a mechanism with effects, its prediction and its columns."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.states import States, states_of
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Placement:
    """Where instrument and tool are, one entry a label of the table.

    registration: setup -> transform (4, 4) of the mechanism's root in the instrument's frame.
    tool: tool -> transform (4, 4) of the measured frame in the flange; only its point without rotations.
    anchors: distance column -> point (3,) in the mechanism's root frame, m.
    """

    registration: Mapping[str, Array]
    tool: Mapping[str, Array]
    anchors: Mapping[str, Array]


@dataclass(frozen=True)
class Poses:
    """A dataset made ready for one mechanism: nominal relative transforms (S, N, 4, 4) and states."""

    dataset: Dataset
    transforms: Array
    states: States

    def __len__(self) -> int:
        return len(self.dataset)

    def subset(self, rows: IntArray) -> "Poses":
        return Poses(self.dataset.subset(rows), self.transforms[:, rows], self.states.subset(rows))


def prepare(mechanism: Mechanism, dataset: Dataset) -> Poses:
    """Nominal transforms and states of every pose, computed once."""
    return Poses(dataset, mechanism.transforms(dataset.q), states_of(mechanism, dataset))


@dataclass(frozen=True)
class ErrorModel:
    """T = T_register · Π_i T_i(q) exp(Σ_k θ_k φ_k e_k) · T_tool, one unknown θ_k an effect.

    Raises InputError for an effect at a slot the mechanism does not have.
    """

    mechanism: Mechanism
    effects: tuple[Effect, ...]

    def __post_init__(self) -> None:
        known = self.mechanism.slots
        for effect in self.effects:
            for slot in effect.slots:
                if slot not in known:
                    raise InputError(f"effect '{effect.name}': slot '{slot}' is unknown; available: {', '.join(known)}")

    def frames(self, poses: Poses, theta: Array) -> Array:
        """Frames (S, N, 4, 4) of the slots in the root, each after its own error twist."""
        relative = poses.transforms.copy()
        twists: dict[str, Array] = {}
        for effect, value in zip(self.effects, theta, strict=True):
            if value != 0.0:
                for slot in effect.slots:
                    twists[slot] = twists.get(slot, 0.0) + value * effect.twist(poses.states, slot)
        for slot, twist in twists.items():
            i = self.mechanism.slots.index(slot)
            relative[i] = relative[i] @ se3.exp(twist)
        return se3.chain(relative)


@dataclass(frozen=True)
class Observed:
    """Predicted observations and what moves them.

    values: predicted tip pose (N, 4, 4) in the instrument's frame. lever: sensitivities are computed from
    `frames` (S, N, 4, 4) in the instrument's frame. distances: (N, D) m, with directions (N, D, 3).
    """

    tip: Array
    frames: Array
    distances: Array
    directions: Array

    @property
    def components(self) -> int:
        """Scalar observations a pose: 3 of position, 3 of rotation, one a distance column."""
        return 6 + self.distances.shape[1]

    def sensitivity(self, slot: int) -> Array:
        """Change (N, m, 6) of the m components per unit twist in the frame of a slot.

        Position: R e for a translation, (R e) × (p_tip - p_slot) for a rotation; rotation: R e.
        """
        turn = self.frames[slot][:, :3, :3]
        arm = self.tip[:, :3, 3] - self.frames[slot][:, :3, 3]
        return self._assemble(turn, -se3.hat(arm) @ turn, turn)

    def tool_sensitivity(self) -> Array:
        """The same per unit twist of the tool frame: (N, m, 6)."""
        turn = self.tip[:, :3, :3]
        return self._assemble(turn, np.zeros_like(turn), turn)

    def registration_sensitivity(self, centre: Array) -> Array:
        """The same per unit twist of the registration about `centre`, in the instrument's axes."""
        eye = np.broadcast_to(np.eye(3), (len(self.tip), 3, 3))
        out = self._assemble(eye, -se3.hat(self.tip[:, :3, 3] - centre), eye)
        out[:, 6:] = 0.0
        return out

    def _assemble(self, moves: Array, swings: Array, turns: Array) -> Array:
        out = np.zeros((len(self.tip), self.components, 6))
        out[:, :3, :3], out[:, :3, 3:], out[:, 3:6, 3:] = moves, swings, turns
        out[:, 6:, :3], out[:, 6:, 3:] = self.directions @ moves, self.directions @ swings
        return out


def observe(model: ErrorModel, poses: Poses, theta: Array, placement: Placement) -> Observed:
    """What the instrument would read at `poses`."""
    data = poses.dataset
    frames = model.frames(poses, theta)
    tool = np.stack([placement.tool[name] for name in data.label("tool").tolist()])
    register = np.stack([placement.registration[name] for name in data.label("setup").tolist()])
    tip_root = frames[-1] @ tool
    frames = register[None] @ frames
    tip = register @ tip_root
    rays = [tip_root[:, :3, 3] - placement.anchors[name] for name in data.distances]
    distances = np.stack([np.linalg.norm(r, axis=1) for r in rays], axis=1) if rays else np.zeros((len(data), 0))
    units = [r / d[:, None] for r, d in zip(rays, distances.T, strict=True)]
    directions = np.stack(units, axis=1) if rays else np.zeros((len(data), 0, 3))
    directions = directions @ np.swapaxes(register[:, :3, :3], 1, 2)
    return Observed(tip, frames, distances, directions)


def measured_minus(observed: Observed, dataset: Dataset) -> Array:
    """Measured minus predicted (N, m): metres, radians (rotation vector of R_meas R_predᵀ), metres; NaN unmeasured."""
    out = np.full((len(dataset), observed.components), np.nan)
    out[:, :3] = dataset.position - observed.tip[:, :3, 3]
    rows = np.isfinite(dataset.rotation).all(axis=1)
    if rows.any():
        measured = se3.exp(np.hstack([np.zeros((rows.sum(), 3)), dataset.rotation[rows]]))[:, :3, :3]
        out[rows, 3:6] = se3.rotation_vector(measured @ np.swapaxes(observed.tip[rows, :3, :3], 1, 2))
    for i, values in enumerate(dataset.distances.values()):
        out[:, 6 + i] = values - observed.distances[:, i]
    return out
