"""Possible changes of a machine since its model was fitted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Literal

import numpy as np

from gpmodel.application.recheck import Recheck, kept_by
from gpmodel.application.uncatalogued import BREAK, uncatalogued
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.alternatives import ROW
from gpmodel.evidence.criteria import Criteria
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate, without_phase
from gpmodel.families.load import mass_at_tool, moments_at_tool
from gpmodel.families.session import arm_growth
from gpmodel.formula.expression import ONE, Expression
from gpmodel.mechanism.protocol import AXES, INSTRUMENT
from gpmodel.mechanism.source import choice_of
from gpmodel.model import lens
from gpmodel.model.effect import Effect, drive_effect, effect_at
from gpmodel.model.memory import clock_of
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank
from gpmodel.numerics.interval import log_chances_of_ratio

Kind = Literal["growth", "zero", "tool", "size", "geometry", "catalogue", "set-up"]
SET_UP: Kind = "set-up"
SHARES: dict[Kind, float] = {
    "growth": 1 / 24, "set-up": 1 / 12, "zero": 5 / 24, "tool": 1 / 6, "size": 1 / 6, "geometry": 1 / 6,
    "catalogue": 1 / 6,
}  # fmt: skip
"""Share of the significance level, and prior probability, of each kind of change, in the order of checks by a repairer.
Within a kind the shares are in proportion to exp(-penalty). Frequent causes (slips, crashes) get the largest shares."""
LEAST = 1e-3
"""Least share of a change's displacements that registration and tool do not absorb, for the change to be tested."""
STANDING = "base"
"""Name of the frame (slot) between the machine and its foundation."""
SLIP = "tool_slip"
"""Family of slips of the tool between two rows."""
PIXELS = lens.NAMES[:4]
"""Names of the lens parameters that are in pixels."""
DISPLACED = "displacement of"
"""First words of the name of a displacement of a frame: all its geometric constants change together."""
HALF_WAVES, POSES_A_WAVE = 6, 16
"""Largest number of half waves over the rows of a drifting set-up, and least number of poses per half wave."""


@dataclass(frozen=True)
class PossibleChange:
    """One possible change of a machine since its fit.

    columns: whitened derivatives of the measurements with respect to the change, in `unit`; for kind `size`, to a
    relative change. kind: `set-up` means that the instrument or a stationary object moved during the session, not the
    machine.
    share: share of the significance level, and prior probability, without that of the division of the rows. price:
    penalty of the description, nats; zero for a set-up, because its axes and rows are equally likely.
    division: penalty of the division of the rows, nats.
    effects: effects that the change adds to the model. at: columns of the linear problem that the change moves, if the
    change adds no effect.
    rows: rows of the table that have the changed value, if the other rows do not; empty for a change of all rows.
    """

    name: str
    kind: Kind
    unit: str
    columns: Array
    share: float = 1.0
    effects: tuple[Effect, ...] = ()
    at: tuple[int, ...] = ()
    price: float = 0.0
    rows: tuple[int, ...] = ()
    division: float = 0.0

    @property
    def log_share(self) -> float:
        """Log prior probability of the change, nats. The probability of a division of 2000 rows is 0 as a number."""
        return float(np.log(self.share)) - self.division

    def corrected(self, log_chance: float) -> float:
        """Return the p-value of the change over its share of the significance level; see `corrected`."""
        return float(corrected(np.array(log_chance), np.array(self.log_share)))

    @property
    def of_a_frame(self) -> bool:
        """True for a displacement of a whole frame, which includes the changes of single constants.

        A motion of the set-up between rows includes, for example, the two zeros of a first joint.
        """
        return len(self.effects) > 1 and (self.kind == "geometry" or (self.kind == SET_UP and bool(self.rows)))

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array]:
        u, s, v = np.linalg.svd(self.columns, full_matrices=False)
        kept = s > 1e-9 * max(s[0], np.finfo(float).tiny)
        return u[:, kept], s[kept], v[kept]

    def log_chance_beside(self, left: Recheck, z: Array) -> float:
        """Return the log probability that noise like the residual `left` makes the change as large as fitted to z.

        The noise may differ between poses and directions: with u the orthonormal columns of the change and e the
        residual, the covariance of the fitted parameters uᵀz is Σ (uᵀe)(uᵀe)ᵀ over the poses (Liang and Zeger 1986).
        """
        u, poses = self._parts[0], len(np.unique(left.pose))
        numbers = u.shape[1]
        if not 0 < numbers < poses:
            return 0.0
        of_pose = np.stack([np.bincount(left.pose, column * left.z) for column in u.T], axis=1)
        covariance = of_pose.T @ of_pose * poses / (poses - numbers)
        part = u.T @ z
        ratio = min(
            float(part @ np.linalg.pinv(covariance, hermitian=True) @ part),
            float(part @ part) * left.degrees / left.chi_square,
        )
        return float(log_chances_of_ratio(*(np.array(v) for v in (ratio / numbers, numbers, poses - numbers))))

    def part_of(self, z: Array) -> Array:
        """Return the part of the whitened residual z that the change explains."""
        return z - rank.remove(self._parts[0], z)

    def fits_an_outlier(self, left: Recheck) -> bool:
        """Return whether the change explains mainly one pose, and the other poses do not confirm the change."""
        limits, after = Criteria(), left.z - self.part_of(left.z)
        gained = np.asarray(np.bincount(left.pose, left.z**2 - after**2), dtype=float)
        if not limits.rests_on_one_pose(gained):
            return False
        its_rows = np.flatnonzero(left.pose == gained.argmax()) == np.arange(len(left.z))[:, None]
        others = left.without(rank.remove(left.basis, its_rows.astype(float)))
        u = self.beside(others)._parts[0]
        part, numbers, divides = u.T @ others.z, np.array(u.shape[1]), np.array(self.division > 0.0)
        return self.corrected(float(log_chances(others, part @ part, numbers, divides))) > limits.confirmation

    def fitted(self, z: Array) -> tuple[float, float]:
        """Return size and standard error of the change; size: length of the vector of its parameters in `unit`."""
        u, s, v = self._parts
        values = v.T @ ((u.T @ z) / s)
        its_unit = [not self.effects or effect.unit == self.unit for effect in self.effects or values]
        values = np.where(its_unit, values, 0.0)
        size = float(np.linalg.norm(values))
        along = values / size if size > 0 else v[0]
        deviation = float(np.linalg.norm((v @ along) / s))
        return (float(values[0]) if sum(its_unit) == 1 else size), deviation

    def beside(self, left: Recheck) -> "PossibleChange":
        """Return the change with the columns of the selected changes, `left.basis`, projected out; zero if only
        rounding errors remain."""
        columns = self.columns - left.basis @ (left.basis.T @ self.columns)
        little = np.linalg.norm(columns) < LEAST * np.linalg.norm(self.columns)
        return replace(self, columns=np.zeros_like(columns) if little else columns)


def zero_of(joint: str) -> str:
    """Return the name of the change of a joint's zero."""
    return f"zero of {joint}"


def possible_changes(found: Recheck) -> tuple[PossibleChange, ...]:
    """Return all changes that the later poses could reveal, each with its share of the significance level."""
    raw = [
        *_growth(found), *_zeros(found), *_tools(found), *_sizes(found), *_geometry(found), *_causes(found),
    ]  # fmt: skip
    return with_shares(found, raw)


def with_shares(found: Recheck, raw: Sequence[PossibleChange]) -> tuple[PossibleChange, ...]:
    """Whiten the columns of possible changes, and give each its share; changes that the poses cannot reveal are
    omitted."""
    ends = np.cumsum([change.columns.shape[1] for change in raw])
    whole = found.spread.whiten(found.blocks.means(np.hstack([change.columns for change in raw])))
    columns = rank.remove(found.basis, whole)
    starts = np.append(0, ends[:-1])
    alone, left = (np.sqrt(np.add.reduceat(np.einsum("ij,ij->j", v, v), starts)) for v in (whole, columns))
    kept = np.flatnonzero((left > LEAST * alone) & np.isfinite(left)).tolist()
    likely, sums = [float(np.exp(-change.price)) for change in raw], dict.fromkeys(SHARES, 0.0)
    for k in kept:
        sums[raw[k].kind] += likely[k]
    shares = {k: SHARES[raw[k].kind] * likely[k] / sums[raw[k].kind] for k in kept}
    return tuple(replace(raw[k], columns=columns[:, starts[k] : ends[k]], share=shares[k]) for k in kept)


def constants(found: Recheck) -> Iterator[PossibleChange]:
    """Yield the changes of one constant of the machine, or of the load, that a model can contain as effects."""
    model, theta = found.session.saved.model, found.session.saved.theta
    tool = tuple(effect_at(f"tool point {axis}", "tool", axis) for axis in AXES[:3])
    yield PossibleChange("tool point", "tool", "m", found.rows_of(tool), effects=tool)
    yield from chain(_growth(found), _zeros(found), _mass(found))
    for change in _sizes(found):
        if change.kind == "size":
            own = [k - found.problem.placement for k in change.at]
            terms = [replace(t, weight=t.weight * theta[k]) for k in own for t in model.effects[k].terms]
            yield replace(change, effects=(Effect(change.name, tuple(terms), change.unit),), at=())
    yield from (change for change in _geometry(found) if not change.of_a_frame)


def _growth(found: Recheck) -> Iterator[PossibleChange]:
    """Yield the thermal growth of all lengths as a possible change, at a temperature that the table need not state."""
    for effect in arm_growth("scale of the machine", found.session.saved.mechanism, ONE, "1", "thermal_growth"):
        raw = found.rows_of([effect])
        yield PossibleChange(effect.name, "growth", effect.unit, raw, effects=(effect,))


def _zeros(found: Recheck) -> Iterator[PossibleChange]:
    joints = found.session.saved.mechanism.joints
    effects = [drive_effect(zero_of(joint.name), joint, ONE) for joint in joints]
    raw = found.rows_of(effects)
    for k, effect in enumerate(effects):
        yield PossibleChange(effect.name, "zero", effect.unit, raw[:, [k]], effects=(effect,))


def _tools(found: Recheck) -> Iterator[PossibleChange]:
    names, columns = found.problem.placement_names, found.problem.columns
    for label in () if found.session.tool else found.session.saved.placement.tool:
        title = f"tool{f' {label}' if label else ''}"
        at = [k for k, name in enumerate(names) if name.rsplit(" ", 1)[0] == title and " T" in name[len(title) :]]
        if at:
            yield PossibleChange(f"{title} point", "tool", "m", columns[:, at], at=tuple(at))
    yield from _carried(found)
    yield from _mass(found)


def _mass(found: Recheck) -> Iterator[PossibleChange]:
    """Yield a change of the mass at the tool, which displaces every compliant joint of the model.

    Without a declared centre of mass, the first moments of the mass about the tool point are unknown too.
    """
    saved, states = found.session.saved, found.session.poses.states
    point = np.mean([frame[:3, 3] for frame in saved.placement.tool.values()], axis=0)
    stated = choice_of(saved.mechanism).payload_com is not None
    carrying = saved.mechanism, states, saved.model.effects, saved.theta
    effect = mass_at_tool(*carrying, None if stated else point)
    if effect is not None:
        effects = (effect, *(() if stated else moments_at_tool(*carrying)))
        raw = found.rows_of(effects)
        yield PossibleChange(effect.name, "tool", effect.unit, raw, effects=effects)


def _carried(found: Recheck) -> Iterator[PossibleChange]:
    """Yield changes of position and orientation of objects on links (camera, board, inclinometer), and of parameters of
    a lens."""
    session, names, raw = found.session, found.problem.placement_names, found.problem.columns
    for kind, key in kept_by(session.saved, session.poses.dataset):
        of_a_lens = not set(kind.own[key]) <= set(AXES)
        if session.tool and not of_a_lens:
            continue
        at = {own: names.index(f"{key} {own}") for own in kind.own[key]}
        for name, unit, axes in (("place", "m", AXES[:3]), ("angle", "rad", AXES[3:])):
            if own := tuple(at[axis] for axis in axes if axis in at):
                yield PossibleChange(f"{name} of {key}", "tool", unit, raw[:, own], at=own)
        for number, k in at.items() if of_a_lens else ():
            unit = "px" if number in PIXELS else "1"
            yield PossibleChange(f"{key} {number}", "tool", unit, raw[:, [k]], at=(k,))


def _sizes(found: Recheck) -> Iterator[PossibleChange]:
    """Yield the size of each effect of the model as a possible change, and of a sine and cosine amplitude and phase."""
    model, theta = found.session.saved.model, found.session.saved.theta
    groups: dict[str, list[int]] = {}
    for k, effect in enumerate(model.effects):
        if not effect.constant and theta[k]:
            groups.setdefault(without_phase(effect.name), []).append(k)
    for name, at in groups.items():
        raw, unit = found.rows_of([model.effects[k] for k in at]), model.effects[at[0]].unit
        columns = tuple(found.problem.placement + k for k in at)
        yield PossibleChange(name, "size", "1", raw @ theta[at, None], at=columns)
        if len(at) > 1 and name != model.effects[at[0]].name:
            yield PossibleChange(f"amplitude and phase of {name}", "catalogue", unit, raw, at=columns)


def _geometry(found: Recheck) -> Iterator[PossibleChange]:
    """Yield changes of the geometric constants other than joint zeros, and displacements of frames, as by a crash."""
    mechanism = found.session.saved.mechanism
    zeros = {drive_effect("", joint, ONE).terms for joint in mechanism.joints}
    effects = geometric_effects(mechanism)
    raw = found.rows_of(effects)
    together: dict[tuple[str, ...], list[int]] = {}
    for k, effect in enumerate(effects):
        together.setdefault(effect.slots, []).append(k)
        if effect.terms not in zeros:
            yield PossibleChange(effect.name, "geometry", effect.unit, raw[:, [k]], effects=(effect,))
    for at in together.values():
        its = tuple(effects[k] for k in at)
        if len(its) > 1:
            name = f"{DISPLACED} {its[0].name.rsplit(' ', 1)[0]}"
            yield PossibleChange(name, "geometry", its[0].unit, raw[:, at], effects=its, price=catalogue.PLAIN_COST)


def _causes(found: Recheck) -> Iterator[PossibleChange]:
    """Yield possible changes: catalogue effects that the model lacks, of one number, or amplitude and phase, and causes
    that the catalogue lacks.

    Slips of the tool during the session are also possible along all axes together.
    """
    model, poses = found.session.saved.model, found.problem.poses
    own, clock = {effect.name for effect in model.effects}, clock_of(poses.dataset)
    offered = [
        (kind, c)
        for c in chain(catalogue.candidates(model.mechanism, poses.states), uncatalogued(model.mechanism, poses.states))
        if (kind := _kind_of(c, {ROW, clock})) and own.isdisjoint(e.name for e in c.effects)
    ]  # fmt: skip
    if not offered:
        return
    raw = found.rows_of([e for _, c in offered for e in c.effects])
    ends = np.cumsum([len(c.effects) for _, c in offered])[:-1]
    for (kind, candidate), columns in zip(offered, np.split(raw, ends, axis=1), strict=True):
        price = 0.0 if kind == SET_UP else candidate.cost
        yield PossibleChange(
            candidate.name, kind, candidate.effects[0].unit, columns, effects=candidate.effects, price=price
        )


def _kind_of(candidate: Candidate, clocks: set[str | None]) -> Kind | None:
    """Return the kind of change that a catalogue candidate is; None for a candidate that sums functions."""
    if candidate.family not in (SLIP, BREAK) and candidate.kind not in ("single", "harmonic"):
        return None
    effects = candidate.effects
    aside = all(e.of_the_instrument or (e.slots == (STANDING,) and set(e.inputs) <= clocks) for e in effects)
    return SET_UP if aside else "catalogue"


def wander(found: Recheck) -> Array:
    """Return whitened columns of a slow drift of the set-up: cosines of half waves over the rows, for each axis of
    motion."""
    rows = found.problem.poses.dataset.row
    waves = min(HALF_WAVES, len(rows) // POSES_A_WAVE)
    along = f"(row - {rows.min()})/{max(int(np.ptp(rows)), 1)}"
    bases = [Expression(f"cos({np.pi * k:.9g}*{along})") for k in range(1, waves + 1)]
    effects = [effect_at(f"{basis} {axis}", INSTRUMENT, axis, basis) for basis in bases for axis in AXES]
    return found.whitened(found.rows_of(effects))


def log_likelihood(left: Recheck, explained: Array) -> Array:
    """Return the log likelihood, nats, of a residual if parts of its chi-square are explained."""
    return student(np.maximum(left.chi_square - explained, 0.0), left.degrees, left.freedom)


def student(chi_square: Array, degrees: int, freedom: float) -> Array:
    """Return Student's log likelihood, nats, of a chi-square of `degrees` values if σ has `freedom` degrees."""
    rest = chi_square if np.isinf(freedom) else (freedom + degrees) * np.log1p(chi_square / freedom)
    return -0.5 * np.asarray(rest, dtype=float)


def log_chances(left: Recheck, scores: Array, numbers: IntArray, divides: Mask) -> Array:
    """Return the log probabilities that `numbers` fitted parameters explain at least `scores` of the chi-square of
    noise alone.

    divides: changes that pay for a division of the rows. Their price grows with the rows, beyond what the freedom ν of
    the fitted σ can prove. The variance of their noise is estimated from the fit and from the residual that the change
    leaves: (ν + χ² - score) / (ν + degrees - numbers). The test is then that of the likelihood ratio of the residual
    with and without the change.
    """
    fitted, freedoms = np.maximum(numbers, 1), np.full(np.shape(scores), left.freedom)
    variances = np.ones(np.shape(scores))
    if np.isfinite(left.freedom):
        freedoms = freedoms + divides * (left.degrees - fitted)
        variances = np.where(divides, (left.freedom + np.maximum(left.chi_square - scores, 0.0)) / freedoms, 1.0)
    return np.where(numbers > 0, log_chances_of_ratio(scores / fitted / variances, fitted, freedoms), 0.0)


def corrected(log_chances: Array, log_shares: Array) -> Array:
    """Return p-values over the shares of the significance level, both as logarithms, nats; at most e^100."""
    return np.asarray(np.exp(np.minimum(log_chances - log_shares, 100.0)))
