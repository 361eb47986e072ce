"""Unobservable errors: effects that unmeasured joints absorb, and constants that stay at their nominal values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.overall_scale import TOLERANCE, nominal_constants, shows_size, without_frame, without_positions
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.start import placement_columns
from gpmodel.calibration.undeclared import Undeclared
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.errors import LISTED
from gpmodel.families import catalogue
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, closing, observe, prepare
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, Orientation, Point
from gpmodel.model.pixel import Pixels
from gpmodel.model.sites import geometric_effects, names_of, translate
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset

HELD = 0.9
"""Share of the measured points inside the ball that bounds the measured region; outlying points are ignored."""
DRAWN = 400
"""Number of random poses over which the error inside and outside the measured region is averaged."""


@dataclass(frozen=True)
class Region:
    """Measured region: a ball about the median of the measured points, with its middle and radius, m."""

    middle: Array
    radius: float

    @classmethod
    def of(cls, points: Array) -> "Region":
        """Return the ball about the median of points, m, that contains 90 % of the points."""
        middle = np.median(points, axis=0)
        return cls(middle, float(np.quantile(np.linalg.norm(points - middle, axis=1), HELD)))

    def holds(self, points: Array) -> Mask:
        """Return a mask of the points, m, inside the ball of the measured region."""
        return np.asarray(np.linalg.norm(points - self.middle, axis=1) <= self.radius)


def random_rows(mechanism: Mechanism, dataset: Dataset) -> Dataset:
    """Return 400 table rows at random joint values within the limits, without measurements."""
    rng = np.random.default_rng(0)
    rows = rng.integers(len(dataset), size=DRAWN)
    bare = replace(dataset, observations=(), in_order=False).subset(rows)
    return replace(bare, q=random_poses(mechanism, DRAWN, rng))


def nominal_points(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the nominal position of each row's measured link, m, in the root frame, without a tool."""
    frames = ErrorModel(mechanism, ()).frames(poses, np.zeros(0))
    return np.asarray(frames[poses.tip_slot, np.arange(len(poses)), :3, 3])


def unobservable_effects(calibration: Calibration, poses: Poses, effects: Sequence[Effect]) -> tuple[bool, ...]:
    """Return a mask of the effects whose displacements unmeasured joints absorb at all poses of a table."""
    if not free_joints(calibration.model.mechanism) or not effects:
        return (False,) * len(effects)
    problem = problem_at(calibration, poses)
    columns = effect_columns(tuple(effects), calibration.model, problem.poses, problem.observed)
    return tuple(not np.any(column) for column in problem.weigh(columns).T)


def unobservable_families(calibration: Calibration, poses: Poses) -> tuple[str, ...]:
    """Return the names of constant effects and of catalogue families that unmeasured joints absorb completely."""
    if not free_joints(calibration.model.mechanism):
        return ()
    pool = catalogue.candidates(calibration.model.mechanism, poses.states)
    hidden = iter(unobservable_effects(calibration, poses, [e for c in pool for e in c.effects]))
    families: dict[str, bool] = {}
    for candidate in pool:
        gone = [next(hidden) for _ in candidate.effects]
        families[candidate.family] = families.get(candidate.family, True) and all(gone)
    constant = [e for e in calibration.model.effects if e.constant]
    of_constant = unobservable_effects(calibration, poses, constant)
    names = [e.name for e, gone in zip(constant, of_constant, strict=True) if gone]
    return (*names, *(name.replace("_", " ") for name, gone in families.items() if gone))


def region_sentences(fit: Calibration, poses: Poses, *, searched: bool = False) -> Iterator[str]:
    """Yield sentences on the expected error inside and outside the measured region, on undeclared effects, and on
    constants that the measurements do not determine.

    Yields nothing if a measurement is in an instrument's frame. searched: True if missing effects were searched for. A
    constant counts as not determined if its standard error without priors, σ / (|c| share), is above 1 mm or 1 mrad, or
    if no measurement is sensitive to the constant.
    """
    problem = problem_at(fit, poses)
    if not without_positions(problem) or not np.any(fit.free & nominal_constants(fit.model)):
        return
    unknown = Undeclared.estimated(problem, fit.model, fit.theta)
    radius, inside, outside = errors_by_region(fit, poses, unknown)
    yield (
        f"expected error of a predicted point: {1e3 * inside:.2g} mm RMS within {radius:.2g} m of the middle of the "
        f"measured points, {1e3 * outside:.2g} mm outside; the residual does not indicate these errors"
    )
    if unknown.significant:
        cause = "" if searched else "; gpmodel discover searches for the causes"
        yield (
            f"the residual of the constants exceeds the noise: smooth functions of the joint values, part of the "
            f"model, reduce the residual to {1e3 * unknown.noise:.2g} mm per measurement{cause}"
        )
    unseen = np.isfinite(fit.prior_errors)
    at = np.flatnonzero(unseen | (fit.free & nominal_constants(fit.model)))
    weak = unseen[at] | (fit.sigma > TOLERANCE * problem.sizes[problem.placement + at] * fit.unique_share[at])
    if weak.any():
        called = names_of(poses.dataset)
        names = [translate(fit.model.effects[i].name, called) for i in at[weak]]
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        lengths = np.array([fit.model.effects[i].unit == "m" for i in at])
        yield (
            f"these measurements do not determine {int((weak & lengths).sum())} of {int(lengths.sum())} lengths and "
            f"{int((weak & ~lengths).sum())} of {int((~lengths).sum())} angles to 1 mm or 1 mrad, which stay near the "
            f"description: {', '.join(names[:LISTED])}{more}"
        )


def errors_by_region(fit: Calibration, poses: Poses, unknown: Undeclared) -> tuple[float, float, float]:
    """Return the radius of the measured region, m, and the RMS error of a predicted point, m, inside and outside.

    The variance includes constants, registration, tool, and the posterior variance of undeclared effects.
    """
    model = fit.model
    drawn = random_rows(model.mechanism, poses.dataset)
    there = prepare(model.mechanism, drawn.subset(closing(model, drawn, fit.theta)))
    seen = observe(model, there, fit.theta, fit.placement)
    bare = replace(seen, kinds=(Point(np.zeros((len(there), 3))),))
    blocks, names = placement_columns(there, bare, fit.placement)
    placement = list(fit.covariance.placement)
    own = [k for k, name in enumerate(names) if name in placement]
    columns = np.zeros((len(there), 3, len(fit.covariance.values)))
    columns[:, :, [placement.index(names[k]) for k in own]] = np.concatenate(blocks, axis=2)[:, :, own]
    columns[:, :, len(placement) :] = effect_columns(model.effects, model, there, bare)
    axes = effect_columns(geometric_effects(model.mechanism), model, there, bare)
    fitted = problem_at(fit, poses)
    error = np.sqrt(unknown.covariance(fitted, model).posterior_variance(there.dataset.q, axes, columns, fit, fitted))
    region = Region.of(nominal_points(model.mechanism, poses))
    within = region.holds(nominal_points(model.mechanism, there))
    inside, outside = (root_mean_square(error[part]) if part.any() else np.nan for part in (within, ~within))
    return region.radius, inside, outside


def unobservable_sentences(kinds: tuple[Observation, ...]) -> Iterator[str]:
    """Yield sentences on parameters that the instruments cannot determine; none with positions in their own frame."""
    read = [kind for kind in kinds if kind.readings.any()]
    if not without_frame(read):
        return
    axes = ["xyz"[k] for kind in read if isinstance(kind, Point) for k in np.flatnonzero(kind.readings.any(axis=0))]
    what = f"the measurements ({', '.join(axes + [kind.name for kind in read if not isinstance(kind, Point)])})"
    if all(kind.unit == "rad" for kind in read):
        yield f"{what} are angles: in all errors, 1 mm stands for 1 mrad"
    if not any(map(shows_size, read)):
        yield (
            f"{what} do not determine the scale of the machine, which is that of the description; a bar, a "
            "ball of known diameter, an artefact or a camera with a board would determine the scale"
        )
    if all(isinstance(kind, Pixels | Inclination | Orientation) for kind in read):
        yield f"{what} do not determine the tool point, which stays at the flange; touches of one point would do so"
    pose, frame = "pose", "are in the frame of the root"
    if len(axes) == 1 and not any(isinstance(kind, Orientation) for kind in read):
        frame = "have an arbitrary origin and rotation about this axis"
    elif any(kind.absolute for kind in read):
        pose, frame = "position", "have an arbitrary origin"
    yield (
        f"{what} do not determine the {pose} of the base: predictions {frame}; three "
        f"or more points of a tracker would determine the {pose}"
    )
