"""Notes on the content and the fit of a table, and on the next measurements; robust registration of the rows."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.comparison import CONDITION_LIMIT, linearised_at_nominal
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.unobservable import region_sentences, unobservable_sentences
from gpmodel.checks.warnings import orientation_left
from gpmodel.mechanism.branches import joint_range, random_poses
from gpmodel.mechanism.protocol import Mechanism, WithIgnoredParts, followers, unwrapped
from gpmodel.mechanism.source import choice_of
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.observation import Orientation, observations
from gpmodel.numerics import rank as ident
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.blocks import different_poses, repeats_drift
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.table.units import identifier, split_header
from gpmodel.wording import DRIFTING_REPEATS

POOR_SHARE, POOR_LENGTH = 0.02, 0.01
"""Residual of registration and tool, as a share of the workspace and as a length, m, from which other interpretations
of columns are tried: ten times the errors of a bad robot. The module `checks.weak_columns` tests smaller residuals."""
CLOSE = 0.01
"""RMS residual, m, below which registration and tool are not fitted again from another side of the flange."""
COARSE, FINE, FINER = 0.3, 1e-3, 0.3
"""First and last scale of the robust fit, m, and the factor between successive scales. Half or double the scale selects
equal rows; a last scale of 0.1 mm would reject rows because of geometric errors."""
STEPS = 4
"""Number of Gauss-Newton steps at each scale of the robust fit; with eight steps, equal rows are selected."""
QUARTER, SPREAD = 0.25, 12.0
"""Quantile of the position errors that good rows determine even if most rows are bad, and the multiple of the quantile
that no good row reaches: the lower quartile of the length of 3-D normal errors is 1.1 σ, and 13 σ never occur."""
SMALLEST = 5e-3
"""Least size of an error of a position that counts as gross, m."""


def flange(mechanism: Mechanism, q: Array, scale: float = 1.0) -> Array:
    """Return poses (poses, 4, 4) of the flange in the root frame at joint values q. scale: factor on all lengths."""
    transforms = np.array(mechanism.transforms(q))
    transforms[..., :3, 3] *= scale
    return np.asarray(se3.chain(transforms)[-1])


def spread_of(points: Array) -> float:
    """Return the RMS distance of points (rows) from their centre."""
    return root_mean_square(np.linalg.norm(points - points.mean(axis=0), axis=1))


@dataclass(frozen=True)
class Registered:
    """A fitted registration (rotation `turn`, translation `shift`, m) and tool point in the flange, m."""

    turn: Array
    shift: Array
    tool: Array

    @classmethod
    def of(cls, frames: Array, position: Array, tool: Array) -> "Registered":
        """Fit the registration for a given tool point, by least squares."""
        return cls(*se3.fit_rotation(tips(frames, tool), position), tool)

    def points(self, frames: Array) -> Array:
        """Return the predicted tool positions (poses, 3), m, in the frame of the instrument."""
        return np.asarray(tips(frames, self.tool) @ self.turn.T + self.shift)

    def errors(self, frames: Array, position: Array) -> Array:
        """Return the distance of each measured position from its predicted position, m."""
        return np.asarray(np.linalg.norm(position - self.points(frames), axis=1))


def tips(frames: Array, tool: Array) -> Array:
    """Return the tool point (poses, 3) in the root frame, m."""
    return np.asarray(frames[:, :3, 3] + frames[:, :3, :3] @ tool)


def registered(frames: Array, position: Array) -> Registered:
    """Fit registration and tool point by least squares, with starts on all sides of the flange.

    If the flange turns about one centre, a tool point on its wrong side is a local minimum of the residual.
    """

    def residual(point: Array) -> Array:
        reached = tips(frames, point)
        turn, shift = se3.fit_rotation(reached, position)
        return np.asarray((position - reached @ turn.T - shift).ravel())

    def derivative(point: Array) -> Array:
        reached = tips(frames, point)
        turn, _ = se3.fit_rotation(reached, position)
        return -se3.without_registration(reached @ turn.T, turn @ frames[:, :3, :3]).reshape(-1, 3)

    best, tool = np.inf, np.zeros(3)
    for start in np.vstack([np.zeros(3), 0.2 * np.eye(3), -0.2 * np.eye(3)]):
        found = optimize.least_squares(residual, start, derivative, x_scale=0.1, max_nfev=12)
        if (rms := float(np.sqrt(2 * found.cost / len(position)))) < best:
            best, tool = rms, found.x
        if best < CLOSE:
            break
    return Registered.of(frames, position, tool)


def least_misfit(frames: Array, position: Array) -> Array:
    """Return a lower bound, m, of the RMS residual of any registration and tool point.

    Positions (..., poses, 3) are fitted as any linear function of the flange frames (..., poses, 4, 4): of positions
    and all entries of rotations.
    """
    turns = frames[..., :3, :3].reshape(*frames.shape[:-2], 9)
    columns = np.linalg.qr(np.concatenate([np.ones_like(turns[..., :1]), frames[..., :3, 3], turns], axis=-1))[0]
    left = position - columns @ (np.swapaxes(columns, -1, -2) @ position)
    return np.asarray(np.sqrt(np.mean(np.sum(left**2, axis=-1), axis=-1)))


def consistent_rows(frames: Array, position: Array) -> tuple[Registered, Mask]:
    """Return registration and tool point of the largest consistent part of the rows, and a mask of these rows.

    A fit with a Cauchy loss, whose scale decreases from 0.3 m to 1 mm, starts from least-squares fits to all rows, to
    the first third and to the last third. Source: Blake and Zisserman (1987), graduated non-convexity.
    """
    third = max(len(frames) // 3, 6)
    found = [_robust(frames, position, part) for part in (slice(None), slice(third), slice(-third, None))]
    errors = [p.errors(frames, position) for p in found]
    best = int(np.argmin([np.quantile(e, QUARTER) for e in errors]))
    return found[best], np.asarray(errors[best] <= gross_error_limit(errors[best]))


def gross_error_limit(errors: Array) -> float:
    """Return the limit of gross position errors, m, computed from the smallest quarter of the errors."""
    return max(SMALLEST, SPREAD * float(np.quantile(errors, QUARTER)))


def _robust(frames: Array, position: Array, part: slice) -> Registered:
    """Fit registration and tool by Gauss-Newton with weights 1 / (1 + |residual|² / scale²), at decreasing scales."""
    now, scale = registered(frames[part], position[part]), COARSE
    while scale > FINE:
        for _ in range(STEPS):
            reached = tips(frames, now.tool) @ now.turn.T
            left = position - reached - now.shift
            weight = 1.0 / np.hypot(1.0, np.linalg.norm(left, axis=1) / scale)
            columns = np.concatenate(
                [-se3.hat(reached), np.broadcast_to(np.eye(3), (len(left), 3, 3)), now.turn @ frames[:, :3, :3]], axis=2
            )
            step = np.linalg.lstsq((columns * weight[:, None, None]).reshape(-1, 9), (left * weight[:, None]).ravel())[
                0
            ]
            turn = se3.exp(np.concatenate([np.zeros(3), step[:3]]))[:3, :3] @ now.turn
            now = Registered(turn, now.shift + step[3:6], now.tool + step[6:])
        scale *= FINER
    return now


RANK_POSES = 60
"""Number of random poses that tell how many constants are observable: 180 values, several per unknown."""


def measured_values(data: Dataset) -> int:
    """Count the measured values of a table, three per position."""
    return sum(int(kind.readings.sum()) for kind in observations(data))


def unknowns(mechanism: Mechanism, data: Dataset, effects: tuple[Effect, ...]) -> int:
    """Count the unknowns of a calibration: registration, tool, fixed ends of distances and geometric constants.

    The counted constants are the combinations that well spread poses distinguish: the rank of the sensitivity at the
    nominal geometry over random poses within the limits.
    """
    many = unmeasured(data.joints, random_poses(mechanism, RANK_POSES, np.random.default_rng(0)))
    nothing, something = many.position, np.zeros((RANK_POSES, 3))
    kinds = replace(
        many,
        position=something if np.isfinite(data.position).any() else nothing,
        rotation=something if data.has_rotation else nothing,
        distances={name: np.full(RANK_POSES, 1.0 + i) for i, name in enumerate(data.distances)},
    )
    problem = linearised_at_nominal(mechanism, tuple(e for e in effects if e.constant), kinds)
    placed, columns = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    kept = ident.rank(placed, columns).kept(CONDITION_LIMIT)
    setups, tools = len(data.codes("setup")[0]), len(data.codes("tool")[0])
    absolute = bool(np.isfinite(data.position).any() or data.has_rotation)
    more = 6 * (setups - 1) * absolute + (6 if data.has_rotation else 3) * (tools - 1)
    own = sum(len(names) for kind in observations(data)[2 + len(data.distances) :] for names in kind.own.values())
    return int(ident.orthonormal(placed).shape[1] + len(kept) + more + own)


ENOUGH_VALUES = 5.0
"""Sufficient number of measured values per unknown. With 5, errors at new poses are a tenth larger, √(1 + 1/5)."""

NARROW = 0.3
"""Fraction of a joint's range below which a note recommends a wider range of its values."""


def notes(
    mechanism: Mechanism, poses: Poses, fits: tuple[Calibration, Calibration], floor: float | None
) -> Iterator[str]:
    """Yield one sentence each on the residuals, values per unknown, loads, ignored columns, noise floor and next
    measurements.

    fits: fit of registration and tool alone, and fit of the standard model.
    floor: noise floor, RMS of repeats, m; None without repeats.
    """
    (bare, fit), data = fits, poses.dataset
    if any(kind.readings.any() for kind in observations(data) if not isinstance(kind, Orientation)):
        yield (
            f"residual of the fitted poses: registration and tool {1e3 * root_mean_square(bare.fitted_error):.4g} "
            f"mm RMS, standard model {1e3 * root_mean_square(fit.fitted_error):.4g} mm"
        )
    if np.isfinite(turned := orientation_left(fit, poses)):
        first = orientation_left(bare, poses)
        yield f"residual of the orientations: {1e3 * first:.3g} and {1e3 * turned:.3g} mrad RMS"
    different, values = different_poses(data), measured_values(data)
    each = f"{values / fit.rank:.1f} each"
    yield f"{different} different poses and {values} measured values for {fit.rank} unknowns: {each}"
    yield _loads(mechanism, data)
    yield from region_sentences(fit, poses)
    yield from unobservable_sentences(observations(data))
    unknown = [name for name in data.ignored if split_header(name)[1] is not None]
    if texts := [n for n in data.ignored if n not in unknown and identifier(n) not in followers(mechanism)]:
        yield f"columns of text that are not used: {', '.join(texts)}"
    if unknown:
        yield f"columns of no known unit, left out: {', '.join(unknown)}; expected for example [degC], [s] or [1]"
    yield from not_read(mechanism, data)
    if data.empty_rows:
        yield f"{data.empty_rows} rows without a single cell are left out"
    else_read = np.any([np.zeros(len(data)), *(o.readings.any(axis=1) for o in observations(data)[2:])], axis=0)
    cut = np.isfinite(data.position).any() & ~np.isfinite(data.position).all(axis=1) & ~else_read
    if cut.any():
        rows = ", ".join(map(str, data.row[cut][:8].tolist()))
        yield f"{int(cut.sum())} rows lack some of x, y, z: {rows}{' ...' if cut.sum() > 8 else ''}"
    if repeats_drift(data):
        floor = None
        yield f"{DRIFTING_REPEATS}: the noise floor is unknown"
    elif floor is None:
        yield "no repeated poses: the noise floor is unknown"
    else:
        yield f"noise floor {1e3 * floor:.4f} mm RMS"
    if data.instrument is not None:
        stated = f"the instrument's specification, {data.instrument}, implies a noise of one coordinate of"
        expected = 1e3 * data.instrument.noise(data.position)
        yield f"{stated} {expected:.4f} mm; the residual of the standard model is {1e3 * fit.sigma:.4f} mm"
    if wanted := list(_wanted(mechanism, data, (values, fit.rank), floor)):
        yield f"to measure next: {'; '.join(wanted)}"


def not_read(mechanism: Mechanism, data: Dataset) -> Iterator[str]:
    """Yield notes on columns of coupled joints, and on ignored parts of the mechanism's description."""
    following = followers(mechanism)
    for name in data.ignored:
        if (joint := identifier(name)) in following:
            yield f"{joint} follows {following[joint]}; the column of {joint} is ignored"
    described = unwrapped(mechanism)
    if isinstance(described, WithIgnoredParts):
        yield from (f"ignored in the description of {mechanism.name}: {text}" for text in described.not_read)


def _loads(mechanism: Mechanism, data: Dataset) -> str:
    """State in a note the known masses of the mechanism and of the payload."""
    lightest, heaviest = float(data.payload.min()), float(data.payload.max())
    carried = f"{lightest:g} kg" if lightest == heaviest else f"{lightest:g} to {heaviest:g} kg"
    known = bool(mechanism.loads(data.q[:1], np.zeros(1)))
    masses = "masses of the links are known" if known else "no masses of the links are known"
    choice, several = choice_of(mechanism), heaviest and len(data.codes("tool")[0]) > 1
    stated = choice.payload_com is not None and not choice.tool_coms
    shared = ", whose centre of mass is the stated point for all tools" if stated and several else ""
    return f"{masses}; the tool carries {carried}{shared}"


def _wanted(mechanism: Mechanism, data: Dataset, counts: tuple[int, int], floor: float | None) -> Iterator[str]:
    """Yield proposals for the next measurements. counts: numbers of measured values and of unknowns."""
    values, unknowns = counts
    if floor is None:
        yield "a few poses three times each in succession, spread over the session, for the noise floor"
    if values < ENOUGH_VALUES * unknowns:
        more = int(np.ceil((ENOUGH_VALUES * unknowns - values) / max(values / len(data), 1.0)))
        yield f"about {more} more pose{'s' * (more > 1)}"
    narrow = [
        joint.name
        for joint, span in zip(mechanism.joints, np.ptp(data.q, axis=0), strict=True)
        if span < NARROW * (joint_range(joint)[1] - joint_range(joint)[0])
    ]
    if narrow:
        yield f"poses over more of the range of {', '.join(narrow)}"
