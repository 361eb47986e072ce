"""A later session: the same model, an instrument that stands somewhere else."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.kinematics import tips
from gpmodel.application.matching import matched, matched_with_readings
from gpmodel.application.model_file import SavedModel
from gpmodel.application.predict import batches
from gpmodel.application.usable import check_finite
from gpmodel.arrays import Array, Mask
from gpmodel.calibration.gauss_newton import without_outliers
from gpmodel.calibration.iterate import Fitting, iterate
from gpmodel.calibration.linearise import Linearised, linearise
from gpmodel.calibration.placing import placement_after
from gpmodel.calibration.size import without_frame
from gpmodel.calibration.uncertainty import uncertainty
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.errors import InputError
from gpmodel.model.error_model import Placement, Poses, observe, pose_error, prepare
from gpmodel.model.observation import Observation, observations
from gpmodel.model.observed import Observed
from gpmodel.numerics import se3
from gpmodel.table.bundles import sharing
from gpmodel.table.dataset import Dataset

PASSES = 8
"""Steps of Gauss-Newton for the registration, each without what then stands far out: three settle it."""


@dataclass(frozen=True)
class Session:
    """A model with the registration of another session. use: (N,) the poses that count, without outliers. tool: whether
    the tool point is found anew as well."""

    saved: SavedModel
    poses: Poses
    use: Mask
    tool: bool = False

    @property
    def problem(self) -> Linearised:
        """The linear problem of registration, tool, anchors and every effect at the poses that count."""
        saved = self.saved
        return linearise(saved.model, self.poses, saved.theta, saved.placement, saved.rotation_weight, self.use)

    @property
    def observed(self) -> Observed:
        """Predicted readings of every pose."""
        return observe(self.saved.model, self.poses, self.saved.theta, self.saved.placement)

    @property
    def errors(self) -> Array:
        """3-D distance (N,), m, between measured and predicted point, those of outliers too."""
        return pose_error(self.observed, self.poses.dataset)

    def anew(self, problem: Linearised) -> Mask:
        """Return the columns (P + E,) that this session fits: registration and stationary objects; the tool and
        carried objects where they are free.

        Effects and lenses are held at the model's values.
        """
        held = {name for name in problem.placement_names if name.split(" ", 1)[0] == "tool"}
        for kind, key in kept_by(self.saved, self.poses.dataset):
            held |= {f"{key} {own}" for own in kind.own[key]}
        free = [name not in held or (self.tool and not name.startswith("lens ")) for name in problem.placement_names]
        return np.array(free + [False] * (problem.columns.shape[1] - len(free)), dtype=bool)

    def moved(self, problem: Linearised, step: Array) -> "Session":
        """With a step (P,) of the placement, m and rad."""
        placement = placement_after(problem.observed, self.saved.placement, step)
        return replace(self, saved=replace(self.saved, placement=placement))


def kept_by(saved: SavedModel, dataset: Dataset) -> list[tuple[Observation, str]]:
    """Observations of a dataset, each with every key of its own unknowns that outlasts a session and that the model
    has."""
    known, there = set(saved.covariance.placement), saved.placement.anchors
    return [
        (kind, key)
        for kind in observations(dataset)
        for key in kind.kept
        if key in there and all(f"{key} {own}" in known for own in kind.own[key])
    ]


def settled(saved: SavedModel, dataset: Dataset, start: Placement | None = None) -> Session:
    """The model with the registration that these poses give it. saved: as it is to be used. start: where registration
    and tool point are to be found from; without it the tool point is the model's.

    Raises InputError as `matched_with_readings`, for a tool the model does not know, and for fewer than three poses of
    a set-up.
    """
    setups = dict.fromkeys(dataset.label("setup").tolist(), np.eye(4))
    saved = replace(saved, placement=replace(saved.placement, registration=setups))
    dataset = matched_with_readings(saved, dataset)
    poses = prepare(saved.mechanism, dataset)
    check_finite(saved, poses)
    placed = _placed(saved, dataset) if start is None else replace(saved, placement=start)
    everything = np.ones(len(dataset), dtype=bool)
    session = Session(placed, poses, everything, tool=start is not None)
    for _ in range(PASSES):
        problem = session.problem
        free, step = session.anew(problem), np.zeros(problem.placement)
        columns = problem.columns[:, free]
        step[free[: problem.placement]] = np.linalg.lstsq(columns, problem.residual, rcond=1e-12)[0]
        session = session.moved(problem, step)
        session = replace(session, use=without_outliers(session.observed, session.poses.dataset, everything))
    return session


def _placed(saved: SavedModel, dataset: Dataset) -> SavedModel:
    """With the registration by Kabsch of the predicted points; what observations find of themselves starts from it."""
    root = tips(saved, dataset, nominal=False)[1].tip
    measured = np.isfinite(dataset.position).all(axis=1)
    registration = dict(saved.placement.registration)
    for name in registration if measured.any() else ():
        rows = measured & (dataset.label("setup") == name)
        if rows.sum() < 3:
            where = f"{dataset.source}, setup '{name}'" if name else dataset.source
            raise InputError(f"{where}: {rows.sum()} poses with x, y and z; registration needs at least 3")
        turn, shift = se3.fit_rotation(root[rows, :3, 3], dataset.position[rows])
        registration[name] = np.block([[turn, shift[:, None]], [np.zeros(3), np.ones(1)]])
    kept = {key: saved.placement.anchors[key] for _, key in kept_by(saved, dataset)}
    return replace(saved, placement=Placement(registration, saved.placement.tool, kept))


def as_its_rows_show(saved: SavedModel, dataset: Dataset) -> SavedModel:
    """Refit the constants to the model's own rows, where neither these nor later ones are in an instrument's frame.

    Constants of such a model are fitted apart from undeclared effects. In the measured region these act as they did.
    """
    known = None if saved.measured is None else saved.measured.dataset
    if (
        known is None
        or free_joints(saved.mechanism)
        or not all(without_frame(observations(d)) for d in (known, dataset))
    ):
        return saved
    poses, kept = prepare(saved.mechanism, known), np.isfinite(saved.stderr)
    observed = observe(saved.model, poses, saved.theta, saved.placement)
    use = without_outliers(observed, known, np.ones(len(poses), dtype=bool))
    fitting = Fitting(saved.model, poses, use, saved.rotation_weight, sharing(known))
    found = iterate(fitting, saved.theta, saved.placement, kept)
    told = uncertainty(fitting, found, kept)
    return replace(
        saved, theta=found.theta, placement=found.placement, stderr=told.stderr, covariance=told.covariance,
        sigma=told.sigma, freedom=told.freedom,
    )  # fmt: skip


def errors_at(session: Session, dataset: Dataset) -> Array:
    """3-D distance (N,), m, of every point of a table from the model, in the registration that a session found by some
    of them. Raises InputError as `matched`."""
    saved = session.saved
    poses, parts = prepare(saved.mechanism, matched(saved, dataset)), []
    for rows in batches(len(poses)):
        part = poses.subset(rows)
        parts.append(pose_error(observe(saved.model, part, saved.theta, saved.placement), part.dataset))
    return np.concatenate(parts)
