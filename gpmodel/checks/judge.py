"""Check a measured table for errors before any search."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, resolved, without_outlier_marks
from gpmodel.calibration.unmeasured_joints import free_joints, points_flaw
from gpmodel.checks.late import measured_late
from gpmodel.checks.lenses import ADVICE, another_lens, with_fitted_lenses
from gpmodel.checks.mixed_up import mixed_up, rotations_flaw, row_faults
from gpmodel.checks.notes import measured_values, not_read, notes, spread_of, unknowns
from gpmodel.checks.rounding import computed, rounded, written_to_a_digit
from gpmodel.checks.scales import scaled
from gpmodel.checks.smooth_errors import unexplained
from gpmodel.checks.two_machines import two_machines
from gpmodel.checks.warnings import POOR, built_wrong, poor_fit, warnings_of
from gpmodel.checks.weak_columns import misread_column
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.observation import Distance, Observation
from gpmodel.model.observed import Observed
from gpmodel.model.pixel import Pixels
from gpmodel.model.sites import geometric_effects
from gpmodel.model.touches import Touches
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.progress import Reporter
from gpmodel.table.blocks import SAME_JOINT, USUAL, different_poses, different_readings, noise_floor
from gpmodel.table.dataset import Dataset

NOBODY = Reporter()
MOST_FITTED, STRETCH = 2000, 50
"""Number of rows that are fitted to check a table, and length of each stretch of adjacent rows. A fit of 2000 rows
takes a second, and the relative error of its RMS is 1 / √(6 · 2000)."""
LIMIT_TOLERANCE = 1e-3
"""Accepted distance of a joint value beyond the joint's limit, rad or m, by play of the stop and rounding."""
MINIMUM_READINGS, UNLIKE = 12, 0.2
"""Least number of measurements for a check, and largest residual of registration and tool as a share of the spread of
the points, or of the pixels. Unrelated data have a larger residual; suitable measurements have about a hundredth."""


@dataclass(frozen=True)
class Remark:
    """One error, warning or note on a measured table.

    severity: "error" (the table cannot be fitted), "warning" or "note".
    unfit: short reason why a calibration with the table would be wrong, or empty.
    """

    severity: str
    text: str
    unfit: str = ""


def check_dataset(
    mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...] | None = None, tell: Reporter = NOBODY
) -> list[Remark]:
    """List the errors, warnings and notes of a table, errors first.

    standard: the geometric constants to fit (default: all). With more than 2000 rows, fits use stretches of rows spread
    evenly over the table, and a note states their number. Errors: joint values beyond limits, wrong units
    or columns, equal poses, fewer measured values than unknowns, computed positions, two machines. Warnings: see
    `another_lens` and `warnings_of`; `built_wrong` and `poor_fit` if no lens is wrong. Notes on the table: see the
    function `notes`.
    """
    standard = geometric_effects(mechanism) if standard is None else standard
    many = len(data) > MOST_FITTED
    if many:
        tell(f"{len(data)} rows: limits, units, repeats")
    errors = [Remark("error", text) for text in _errors(mechanism, data, standard)]
    if errors:
        return errors
    rows = evenly(len(data))
    poses = prepare(mechanism, data.subset(rows) if many else data)
    if unsound := [Remark("error", text) for text in _unsound(mechanism, poses)]:
        return unsound
    if many:
        tell(f"fitting registration and the standard model to {len(rows)} rows")
    bare = calibrate(ErrorModel(mechanism, ()), poses)
    fit = calibrate(ErrorModel(mechanism, standard), poses, start=without_outlier_marks(bare))
    if several := [Remark("error", f"{data.source}: {text}") for text in two_machines(fit, poses)]:
        return several
    another = f"the description of {mechanism.name} does not match the measurements"
    if lens := another_lens(fit, poses):
        wrong = [Remark("warning", lens, "a lens does not match the images" if [*poor_fit(fit)] else "")]
    else:
        wrong = [Remark("warning", text, another) for text in built_wrong(fit, poses)]
        wrong += [Remark("warning", *said) for said in _poor(fit, poses)]
    wrong += [Remark("warning", text, "too few poses") for text in _too_few_held(mechanism, poses.dataset, standard)]
    sizes = [Remark(*said) for said in scaled(fit, poses)]
    warnings = [Remark("warning", text) for text in (*warnings_of(mechanism, poses, fit), *rounding_of(fit, poses))]
    said = notes(mechanism, poses, (bare, fit), noise_floor(data))
    sampled = (f"tested on {len(rows)} of {len(data)} rows, in equally spaced blocks",) if many else ()
    remarks = [*wrong, *sizes, *warnings, *(Remark("note", text) for text in (*sampled, *said))]
    return sorted(remarks, key=lambda remark: remark.severity == "note")


def _poor(fit: Calibration, poses: Poses) -> Iterator[tuple[str, str]]:
    """Yield the causes of a large residual, each with the reason why the table is not fit for calibration.

    The reason for unfitness is empty if compliances and smooth errors of the joints explain the residual.
    """
    for text in poor_fit(fit):
        left = unexplained(fit, poses)
        if left > POOR:
            rows = row_faults(fit.model.mechanism, poses.dataset, left)
            yield "; ".join(filter(None, (text, rows))), "the residual of the standard model is too large"
        else:
            yield f"{text}. With compliances and smooth errors of the joints, {1e3 * left:.3g} mm remain", ""


def rounding_of(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Yield a warning if rounding of the table explains the residual of a fit."""
    mechanism, seen = fit.model.mechanism, resolved(fit, poses)
    values = measured_values(seen.dataset)
    freedom = max(values - unknowns(mechanism, seen.dataset, fit.model.effects), 1)
    left = root_mean_square(fit.fitted_error) * np.sqrt(values / freedom)
    yield from rounded(mechanism, observe(fit.model, seen, fit.theta, fit.placement), seen.dataset, left, freedom)


def rounding_of_table(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...]) -> str:
    """Return a sentence if rounding explains the residual of the standard model, or an empty text; as in a check."""
    part = poses.subset(evenly(len(poses)))
    said = rounding_of(calibrate(ErrorModel(mechanism, standard), part), part)
    return " ".join(f"{poses.dataset.source}: {text}." for text in said)


def evenly(count: int) -> IntArray:
    """Return the indices of the rows that are fitted: all `count` rows, or 2000 in evenly spaced stretches."""
    if count <= MOST_FITTED:
        return np.arange(count)
    starts = np.linspace(0, count - STRETCH, MOST_FITTED // STRETCH).astype(np.int64)
    return (starts[:, None] + np.arange(STRETCH)).ravel()


def refuse(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...] | None = None) -> None:
    """Raise InputError with the first error of the table that check_dataset finds."""
    standard = geometric_effects(mechanism) if standard is None else standard
    for text in chain(_errors(mechanism, poses.dataset, standard), _unsound(mechanism, poses)):
        raise InputError(text)
    part = poses.subset(evenly(len(poses)))
    bare = calibrate(ErrorModel(mechanism, ()), part)
    fit = calibrate(ErrorModel(mechanism, standard), part, start=without_outlier_marks(bare))
    for text in two_machines(fit, part):
        raise InputError(f"{poses.dataset.source}: {text}")


def _unsound(mechanism: Mechanism, poses: Poses) -> Iterator[str]:
    """Yield the errors of a table that a fit of registration and tool point reveals."""
    yield from _unlike_readings(mechanism, poses)
    yield from computed_positions(mechanism, poses)


def computed_positions(mechanism: Mechanism, poses: Poses) -> Iterator[str]:
    """Yield an error if positions were computed with the nominal mechanism, not measured; tested if rounded."""
    if not written_to_a_digit(poses.dataset):
        return
    part = poses.subset(evenly(len(poses)))
    fit = calibrate(ErrorModel(mechanism, ()), part, robust=False)
    yield from (
        f"{poses.dataset.source}: {text}" for text in computed(root_mean_square(fit.fitted_error), part.dataset)
    )


def _errors(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Iterator[str]:
    """Yield errors of a table. A kind of error is tested only if no error of an earlier kind was found."""
    beyond = list(_beyond_limits(mechanism, data))
    if alike := _all_alike(data):
        yield alike
        return
    if mixed := mixed_up(mechanism, data):
        yield "; ".join([f"{data.source}: {mixed}", *not_read(mechanism, data)])
        return
    if beyond:
        yield from beyond
        return
    flaws = (misread_column, lambda arm, table, _: rotations_flaw(arm, table), measured_late)
    for told in (flaw(mechanism, data, standard) for flaw in flaws):
        if told:
            yield f"{data.source}: {told}"
            return
    if free_joints(mechanism) and (flaw := points_flaw(data)):
        yield flaw
        return
    yield from _too_few(mechanism, data, standard)


def _beyond_limits(mechanism: Mechanism, data: Dataset) -> Iterator[str]:
    for i, joint in enumerate(mechanism.joints):
        values = data.q[:, i]
        bad = (values < joint.lower - LIMIT_TOLERANCE) | (values > joint.upper + LIMIT_TOLERANCE)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            more = f" and {int(bad.sum()) - 1} more rows" if bad.sum() > 1 else ""
            lower, upper = (_shown(joint.kind, limit) for limit in (joint.lower, joint.upper))
            yield (
                f"{data.source}, column '{joint.name}', row {data.row[row]}{more}: "
                f"{_shown(joint.kind, values[row])} is beyond its limits; expected {lower} to {upper}"
            )


def _shown(kind: str, value: float) -> str:
    return f"{np.degrees(value):.6g} deg" if kind == "revolute" else f"{1e3 * value:.6g} mm"


def _all_alike(data: Dataset) -> str | None:
    if np.ptp(data.q, axis=0).max() <= SAME_JOINT:
        count = f"all {len(data)} poses are equal" if len(data) > 1 else "there is only one pose"
        return f"{data.source}: {count}; expected joint values that differ from row to row"
    return None


def _too_few(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Iterator[str]:
    values = measured_values(different_readings(data))
    needed = unknowns(mechanism, data, standard)
    if values <= needed:
        yield (
            f"{data.source}: {different_poses(data)} distinct poses give {values} measured values for {needed} "
            f"unknowns; expected more poses than that (or fewer parameters of the standard model)"
        )


def _too_few_held(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Iterator[str]:
    """Yield a warning if the values of all poses suffice for the unknowns, but those of training poses do not."""
    values, needed = measured_values(different_readings(data)), unknowns(mechanism, data, standard)
    if values * (1.0 - USUAL) <= needed:
        yield (
            f"{values} measured values for {needed} unknowns: with {100 * USUAL:.0f} % of the poses held out too few "
            "are left to calibrate; measure more, hold none out (--holdout 0) or fit fewer parameters (--standard)"
        )


IMAGES = "; possible causes: rows and columns of a board, the numbers of its markers, the link of a camera or a board"


def _nominal(mechanism: Mechanism, poses: Poses) -> Observed:
    """Return the predicted measurements of the nominal mechanism with fitted registration and tool."""
    fit = calibrate(ErrorModel(mechanism, ()), poses, robust=False)
    return observe(fit.model, resolved(fit, poses), fit.theta, fit.placement)


def _left(observed: Observed, kind: Observation) -> float:
    """Return the RMS residual of the measurements of one kind, such as pixels."""
    return root_mean_square(kind.residual(observed.tips, observed.own)[kind.readings])


def _images_fit(mechanism: Mechanism, poses: Poses, spread: float) -> bool:
    """Return whether registration and tool explain the pixels of a table."""
    observed = _nominal(mechanism, poses)
    return all(_left(observed, kind) < UNLIKE * spread for kind in observed.kinds if isinstance(kind, Pixels))


def _unlike_readings(mechanism: Mechanism, poses: Poses) -> Iterator[str]:
    """Yield an error for distances, touches and pixels that a fit of registration and tool hardly explains."""
    data = poses.dataset
    if len(data) < MINIMUM_READINGS or not (data.distances or data.observations):
        return
    observed = _nominal(mechanism, poses)
    for kind in observed.kinds:
        tips = observed.tip[kind.readings.any(axis=1), :3, 3]
        if isinstance(kind, Distance):
            of, expected = tips, "distances of the tool point from one fixed point"
        elif isinstance(kind, Touches):
            of, expected = tips, "touches of the tool point at these poses"
        elif isinstance(kind, Pixels):
            of, expected = kind.values[kind.readings.all(axis=1)], "images of these boards by these cameras"
        else:
            continue
        left, spread = _left(observed, kind), spread_of(of)
        if left > UNLIKE * spread:
            if isinstance(kind, Pixels):
                turned = replace(kind, values=kind.values[:, ::-1])
                others = tuple(turned if isinstance(one, Pixels) else one for one in data.observations)
                solved = with_fitted_lenses(poses)
                if _images_fit(mechanism, replace(poses, dataset=replace(data, observations=others)), spread):
                    expected += ": u and v look exchanged"
                elif solved is not None and _images_fit(mechanism, solved, spread):
                    expected += f": the lens of a camera is not the described one; {ADVICE}"
                else:
                    expected += IMAGES
            scale, unit = (1e3, "mm") if kind.unit == "m" else (1.0, kind.unit)
            yield (
                f"{data.source}, column '{kind.name}': does not fit {mechanism.name}: the residual is "
                f"{scale * left:.3g} {unit}, "
                f"with a spread of {scale * spread:.3g} {unit}; expected {expected}"
            )
