"""The error model: a mechanism with effects, its prediction and its columns."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, OpenLoopsError, choices
from gpmodel.mechanism.branches import assembled, branched, lineage
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Mechanism, closed, places
from gpmodel.model.effect import REGISTRATION, TOOL, Effect
from gpmodel.model.observation import Observation, Own, Tips, observations
from gpmodel.model.observed import Observed
from gpmodel.model.states import States, states_of, tip_slots
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Placement:
    """Where instrument and tool are, one entry a label of the table.

    registration: setup -> transform (4, 4) of the mechanism's root in the instrument's frame.
    tool: tool -> transform (4, 4) of the measured frame in the flange; only its point without rotations.
    anchors: own unknowns (k,) of observations, by key: of a distance, its anchor (3,) in the mechanism's root frame, m.
    """

    registration: Mapping[str, Array]
    tool: Mapping[str, Array]
    anchors: Mapping[str, Array]


@dataclass(frozen=True)
class Poses:
    """A dataset made ready for one mechanism: nominal relative transforms (S, N, 4, 4), states, and the slot (N,) that
    carries the tip of each row."""

    dataset: Dataset
    transforms: Array
    states: States
    tip_slot: IntArray

    def __len__(self) -> int:
        return len(self.dataset)

    def subset(self, rows: IntArray) -> "Poses":
        """Return the poses of some rows."""
        return Poses(self.dataset.subset(rows), self.transforms[:, rows], self.states.subset(rows), self.tip_slot[rows])


def prepare(mechanism: Mechanism, dataset: Dataset, same: States | None = None) -> Poses:
    """Nominal transforms and states of every pose, computed once. same: see `states_of`.

    Raises OpenLoopsError for the row of joint values at which closed loops do not meet.
    """
    with rows_named(dataset):
        states = states_of(mechanism, dataset, same)
        return Poses(dataset, mechanism.transforms(dataset.q), states, tip_slots(mechanism, dataset))


@contextmanager
def rows_named(dataset: Dataset) -> Iterator[None]:
    """Name the file and the row of joint values at which closed loops do not meet."""
    try:
        yield
    except OpenLoopsError as error:
        where = f"{dataset.source}, row {dataset.row[error.pose]}"
        raise OpenLoopsError(error.gap, error.pose, where) from None


@dataclass(frozen=True)
class ErrorModel:
    """T = E · T_register · Π_i T_i(q) exp(Σ_k θ_k φ_k e_k) · T_tool, one unknown θ_k an effect.

    E is the twist of the effects at the slot `instrument`, whose bases may read where the instrument sees the point.
    noise: standard deviation of one measured component, m, where it is known beforehand; None: what a fit leaves.
    Raises InputError for an effect at a slot the mechanism does not have.
    """

    mechanism: Mechanism
    effects: tuple[Effect, ...]
    noise: float | None = None

    def __post_init__(self) -> None:
        known = places(self.mechanism)
        for effect in self.effects:
            for slot in effect.slots:
                if slot not in known:
                    raise InputError(
                        f"effect '{effect.name}': slot '{slot}' is unknown; available: {choices(slot, known)}"
                    )

    def twists(self, poses: Poses, theta: Array) -> dict[int, Array]:
        """Error twists (N, 6), m and rad, by the index of the slot they act at; none where nothing acts."""
        out: dict[int, Array] = {}
        terms = ((t, v * t.weight) for e, v in zip(self.effects, theta, strict=True) if v != 0.0 for t in e.terms)
        for term, size in terms:
            if term.slot != INSTRUMENT:
                twist = out.setdefault(self.mechanism.slots.index(term.slot), np.zeros((6, len(poses))))
                twist[AXES.index(term.axis)] += size * poses.states.value(term.basis)
        return {at: twist.T for at, twist in out.items()}

    def of_the_mechanism(self, theta: Array) -> tuple["ErrorModel", Array]:
        """The model and its unknowns without what is the instrument's alone."""
        own = [i for i, effect in enumerate(self.effects) if not effect.of_the_instrument]
        return ErrorModel(self.mechanism, tuple(self.effects[i] for i in own)), theta[own]

    def instrument_twist(self, poses: Poses, theta: Array, points: Array) -> Array | None:
        """Twist (N, 6), m and rad, of the instrument's readings of `points` (N, 3), m, in its frame; None without."""
        acting = [(e, v) for e, v in zip(self.effects, theta, strict=True) if v != 0.0 and INSTRUMENT in e.slots]
        if not acting:
            return None
        states = poses.states.seen_at(points)
        whole = np.sum([value * effect.twist(states, INSTRUMENT) for effect, value in acting], axis=0)
        return np.asarray(whole - self.taken_up(poses, theta, REGISTRATION))

    def taken_up(self, poses: Poses, theta: Array, of: str) -> Array:
        """Twist (N, 6), m and rad, that the registration or the tool of each pose takes up of the effects."""
        out = np.zeros((len(poses), 6))
        for effect, value in zip(self.effects, theta, strict=True):
            for rigid in effect.taken_up:
                if rigid.of == of:
                    out[poses.dataset.label(of) == rigid.label] += value * np.array(rigid.twist)
        return out

    def frames(self, poses: Poses, theta: Array) -> Array:
        """Frames (S, N, 4, 4) of the slots in the root, each after its own error twist."""
        return self.frames_after(poses, self.twists(poses, theta))

    def frames_after(self, poses: Poses, twists: Mapping[int, Array]) -> Array:
        """Return the frames after known error twists (N, 6), keyed by the index of their slot."""
        if loops := closed(self.mechanism):
            with rows_named(poses.dataset):
                return loops.assembled(poses.dataset.q, twists)
        if tree := branched(self.mechanism):
            return assembled(tree, poses.transforms, {slot: se3.exp(twist) for slot, twist in twists.items()})
        relative = poses.transforms.copy()
        for slot, twist in twists.items():
            relative[slot] = relative[slot] @ se3.exp(twist)
        return se3.chain(relative)


def closing(model: ErrorModel, data: Dataset, theta: Array) -> IntArray:
    """Select the rows (K,) at which the loops of a mechanism close, nominally and with its errors; all of a chain.

    theta: (E,) values of model.effects, SI. An error that remembers earlier rows changes when rows go, so the test is
    repeated on the rows that stay.
    """
    rows, loops = np.arange(len(data)), closed(model.mechanism)
    if loops:
        rows = rows[loops.closes(data.q)]
    while loops and len(rows):
        poses = prepare(model.mechanism, data.subset(rows))
        good = loops.closes(poses.dataset.q, model.twists(poses, theta))
        if good.all():
            break
        rows = rows[good]
    return rows


def observe(model: ErrorModel, poses: Poses, theta: Array, placement: Placement) -> Observed:
    """Predict the readings of the instrument at `poses`, T_register · Π T_i exp(Σ_k θ_k φ_k e_k) · T_tool, and the
    frames that move them.

    theta: (E,) values of model.effects, SI.
    placement: a registration for every set-up of the poses and a point for every tool. KeyError where one is missing.
    """
    data, tip_slot = poses.dataset, poses.tip_slot
    twists = model.twists(poses, theta)
    frames = model.frames_after(poses, twists)
    tool = np.stack([placement.tool[name] for name in data.label("tool").tolist()])
    by_tool = -model.taken_up(poses, theta, TOOL)
    if by_tool.any():
        tool = tool @ se3.exp(by_tool)
    register = np.stack([placement.registration[name] for name in data.label("setup").tolist()])
    tip, kinds = frames[tip_slot, np.arange(len(poses))] @ tool, observations(data)
    by_instrument = model.instrument_twist(poses, theta, (register @ tip)[:, :3, 3])
    own = np.broadcast_to(np.eye(4), register.shape)
    if by_instrument is not None:
        twists = {**twists, len(frames): by_instrument, len(frames) + 1: by_tool}
        own = se3.exp(by_instrument)
        register = own @ register
    seen, loops = np.concatenate([register[None] @ frames, own[None]]), closed(model.mechanism)
    tips = Tips(tip, register @ tip, frames)
    return Observed(
        tips, seen, twists, kinds, _completed(placement.anchors, kinds, tips), lineage(model.mechanism), tip_slot,
        loops.carried if loops else None,
    )  # fmt: skip


def _completed(known: Own, kinds: tuple[Observation, ...], tips: Tips) -> Own:
    """Add the observations' unknowns that the fit lacks, estimated from these poses.

    A point that only held-out poses touched is an example.
    """
    new = [kind for kind in kinds if not known.keys() >= kind.own.keys()]
    return {**{key: value for kind in new for key, value in kind.start(tips).items()}, **known} if new else known


def measured_minus(observed: Observed, dataset: Dataset) -> Array:
    """Measured minus predicted (N, m): m, rad (rotation vector of R_meas R_predᵀ), then each kind's unit; NaN where
    unmeasured."""
    return np.hstack([kind.residual(observed.tips, observed.own) for kind in observations(dataset)])


def pose_error(observed: Observed, dataset: Dataset) -> Array:
    """Length (N,) of each pose's measured-minus-predicted vector over all but its rotations, m."""
    lengths = (measured_minus(observed, dataset) * observed.scales(1.0))[:, ~observed.turns]
    return np.asarray(np.sqrt(np.nansum(lengths**2, axis=1)))


def turn_error(observed: Observed, dataset: Dataset) -> Array:
    """Angle (N,), rad, between each pose's measured and predicted orientation; NaN where none was measured."""
    vectors = measured_minus(observed, dataset)[:, observed.turns]
    return np.linalg.norm(vectors, axis=1) if observed.turns.any() else np.full(len(dataset), np.nan)
