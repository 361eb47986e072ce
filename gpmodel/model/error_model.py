"""The error model: a mechanism with error effects, and its predicted measurements."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, OpenLoopsError, choices
from gpmodel.mechanism.branches import assembled, branched, moves_with
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Mechanism, closed, places
from gpmodel.model.effect import REGISTRATION, TOOL, Effect
from gpmodel.model.observation import Observation, Own, Tips, Weights, observations
from gpmodel.model.observed import Observed
from gpmodel.model.states import States, states_of, tip_slots
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Placement:
    """Fitted registrations (poses of the robot's root) and tool points, by the labels of the table.

    registration: {set-up: pose (4, 4) of the mechanism's root in the frame of the instrument, m}.
    tool: {tool: pose (4, 4) of the measured frame in the flange, m}; without measured rotations only its point counts.
    anchors: {key: unknowns of measuring equipment}, such as the fixed end (3,) of a distance in the root frame, m.
    """

    registration: Mapping[str, Array]
    tool: Mapping[str, Array]
    anchors: Mapping[str, Array]

    def roots(self, data: Dataset) -> Array:
        """Return for every row the pose (4, 4) of the root frame in the frame of the instrument, m."""
        return np.stack([self.registration[setup] for setup in data.label("setup").tolist()])


@dataclass(frozen=True)
class Poses:
    """A table prepared for one mechanism: nominal transforms between frames, columns, and tip frames of every pose.

    tip_slot: index of the frame of the chain (slot) that carries the measured tip, for each row.
    """

    dataset: Dataset
    transforms: Array
    states: States
    tip_slot: IntArray

    def __len__(self) -> int:
        return len(self.dataset)

    def subset(self, rows: IntArray) -> "Poses":
        """Return the poses with the given row numbers."""
        return Poses(self.dataset.subset(rows), self.transforms[:, rows], self.states.subset(rows), self.tip_slot[rows])


def prepare(mechanism: Mechanism, dataset: Dataset, same: States | None = None) -> Poses:
    """Compute the nominal transforms and the columns of every pose once. same: known columns of equal poses.

    Raises OpenLoopsError, naming the row, if closed loops do not meet at the joint values of a row.
    """
    with rows_named(dataset):
        states = states_of(mechanism, dataset, same)
        return Poses(dataset, mechanism.transforms(dataset.q), states, tip_slots(mechanism, dataset))


@contextmanager
def rows_named(dataset: Dataset) -> Iterator[None]:
    """Add the file and the row to the message of an OpenLoopsError."""
    try:
        yield
    except OpenLoopsError as error:
        where = f"{dataset.source}, row {dataset.row[error.pose]}"
        raise OpenLoopsError(error.gap, error.pose, where) from None


@dataclass(frozen=True)
class ErrorModel:
    """Error model of a mechanism: nominal transforms between frames, followed by the error twists of the frames.

    The measured pose is E · T_register · Π_i T_i(q) exp(Σ_k θ_k φ_k e_k) · T_tool, with registration T_register,
    nominal transform T_i of slot i, coefficient θ_k, basis function φ_k and axis e_k of effect k, tool T_tool, and the
    twist E of the effects at the slot `instrument`, whose basis functions may depend on the point in the instrument's
    frame.

    noise: standard deviation of one measured coordinate, m, if known beforehand. With noise = None the noise is
    estimated from the residual.
    Raises InputError for an effect at an unknown frame (slot).
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
        """Return {frame number: error twist (poses, 6), m and rad}, without frames that have no error."""
        out: dict[int, Array] = {}
        terms = ((t, v * t.weight) for e, v in zip(self.effects, theta, strict=True) if v != 0.0 for t in e.terms)
        for term, size in terms:
            if term.slot != INSTRUMENT:
                twist = out.setdefault(self.mechanism.slots.index(term.slot), np.zeros((6, len(poses))))
                twist[AXES.index(term.axis)] += size * poses.states.value(term.basis)
        return {at: twist.T for at, twist in out.items()}

    def of_the_mechanism(self, theta: Array) -> tuple["ErrorModel", Array]:
        """Return the error model and its coefficients without the effects of the instrument."""
        own = [i for i, effect in enumerate(self.effects) if not effect.of_the_instrument]
        return ErrorModel(self.mechanism, tuple(self.effects[i] for i in own)), theta[own]

    def instrument_twist(self, poses: Poses, theta: Array, points: Array) -> Array | None:
        """Return the twist (poses, 6), m and rad, of measured `points` (poses, 3), m, in the frame of the instrument.

        Without an effect of the instrument the twist is None.
        """
        acting = [(e, v) for e, v in zip(self.effects, theta, strict=True) if v != 0.0 and INSTRUMENT in e.slots]
        if not acting:
            return None
        states = poses.states.seen_at(points)
        whole = np.sum([value * effect.twist(states, INSTRUMENT) for effect, value in acting], axis=0)
        return np.asarray(whole - self.taken_up(poses, theta, REGISTRATION))

    def taken_up(self, poses: Poses, theta: Array, of: str) -> Array:
        """Return the rigid motion (twist (poses, 6), m and rad) of registration or tool that is subtracted from the
        effects."""
        out = np.zeros((len(poses), 6))
        for effect, value in zip(self.effects, theta, strict=True):
            for rigid in effect.taken_up:
                if rigid.of == of:
                    out[poses.dataset.label(of) == rigid.label] += value * np.array(rigid.twist)
        return out

    def frames(self, poses: Poses, theta: Array) -> Array:
        """Return the poses (frames, poses, 4, 4) of all frames in the root frame, m, each after its error twist."""
        return self.frames_after(poses, self.twists(poses, theta))

    def frames_after(self, poses: Poses, twists: Mapping[int, Array]) -> Array:
        """Return the poses (frames, poses, 4, 4) of all frames after error twists {frame number: (poses, 6)}, m."""
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
    """Return the numbers of the rows at which the kinematic loops of a mechanism close, nominally and with its errors.
    A serial chain closes at all rows.

    theta: values of model.effects, SI units. Effects with memory (of earlier poses) change when rows are removed, so
    that the test is repeated without the rows.
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
    """Predict the measurements and all frames of the mechanism at `poses`, by the equation of ErrorModel.

    theta: values θ_k of model.effects, SI units.
    placement: registration of every set-up of the poses and point of every tool. KeyError without them.
    """
    data, tip_slot = poses.dataset, poses.tip_slot
    twists = model.twists(poses, theta)
    frames = model.frames_after(poses, twists)
    tool = np.stack([placement.tool[name] for name in data.label("tool").tolist()])
    by_tool = -model.taken_up(poses, theta, TOOL)
    if by_tool.any():
        tool = tool @ se3.exp(by_tool)
    register = placement.roots(data)
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
        tips, seen, twists, kinds, _completed(placement.anchors, kinds, tips), moves_with(model.mechanism), tip_slot,
        loops.carried if loops else None,
    )  # fmt: skip


def _completed(known: Own, kinds: tuple[Observation, ...], tips: Tips) -> Own:
    """Add missing unknowns of the measurements, estimated from the given poses, to the unknowns of a fit.

    An example of a missing unknown is a point that only held-out poses touched.
    """
    new = [kind for kind in kinds if not known.keys() >= kind.own.keys()]
    return {**{key: value for kind in new for key, value in kind.start(tips).items()}, **known} if new else known


def measured_minus(observed: Observed, dataset: Dataset) -> Array:
    """Return measured minus predicted values (poses, components), m, rad (rotation vectors), then other units.

    Unmeasured components are NaN.
    """
    return np.hstack([kind.residual(observed.tips, observed.own) for kind in observations(dataset)])


def pose_error(observed: Observed, dataset: Dataset, weights: Weights) -> Array:
    """Return the length of the weighted error (measured minus predicted) of each pose, m, without rotations.

    If a table has orientations alone, the error is that of orientations.
    """
    errors = measured_minus(observed, dataset) * observed.scales(weights)
    alone = not np.isfinite(errors[:, ~observed.turns]).any()
    return np.asarray(np.sqrt(np.nansum(errors[:, observed.turns == alone] ** 2, axis=1)))


def turn_error(observed: Observed, dataset: Dataset) -> Array:
    """Return the angle, rad, between the measured and predicted orientation of each pose; NaN if unmeasured."""
    vectors = measured_minus(observed, dataset)[:, observed.turns]
    return np.linalg.norm(vectors, axis=1) if observed.turns.any() else np.full(len(dataset), np.nan)
