"""Propose measurement poses, before any measurement or after a calibration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from gpmodel.api.arguments import (
    NOISIEST,
    MechanismLike,
    box_limits,
    check_bool,
    check_choice,
    check_function,
    check_integer,
    check_number,
    file_path,
    mechanism_of,
    to_point,
    to_si,
)
from gpmodel.api.calibrate import fleet_at
from gpmodel.api.model import Model, read_result
from gpmodel.api.table import Shown, TableLike, frame_to_extend
from gpmodel.application.compensate import beyond_limits, targets_in
from gpmodel.application.exports.sample import measured_table
from gpmodel.application.model_file import SavedModel
from gpmodel.application.next_poses import Alternatives, PlanningContext, closing_pool
from gpmodel.application.usable import at_end, usable
from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.families.candidate import without_phase
from gpmodel.files import write_text
from gpmodel.hierarchy.record import FleetPart, prior_model
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.sites import names_of, translate
from gpmodel.planning.design import (
    Aim,
    Constraints,
    Design,
    Sight,
    best_deviation,
    choose_for_all,
    decided_after,
    deviations,
    has_collision_shape,
    in_units_of,
)
from gpmodel.planning.poses import (
    GOALS,
    geometric_problem,
    least_deviation,
    pool_of,
    spacing,
    spread_among,
    type_problem,
)
from gpmodel.progress import Reporter, Say, silent
from gpmodel.report.schema import Report
from gpmodel.table.cells import CONTROLLER_DECIMALS, joint_table, table_text
from gpmodel.table.convention import pose_table
from gpmodel.wording import wrapped

POOLED = 40
"""Largest number of selected poses if the user gives no number."""
TOLD_APART = 2.0
"""Least distance of two explanations, in standard deviations over all candidate poses, for further poses to be selected
that distinguish the two."""
WITHIN = 1.2
"""Target standard error at the poses of a task, relative to that with all candidate poses measured."""
MOST_RIVALS = 3
"""Largest number of alternatives of each finding, the closest first. Poses that distinguish the closest alternatives
also distinguish further ones."""


def design_problems(
    saved: SavedModel, record: Report | None, pool: Array, criterion: str | None, rng: np.random.Generator
) -> Aim:
    """Return the experimental-design problem of selecting further poses among candidate joint values `pool`.

    criterion: "rivals", "effect", "i-optimal" or "spread"; None for the first applicable criterion. Raises InputError
    for a criterion that is not applicable.
    """
    outlook = PlanningContext.from_joint_values(saved, pool, rng)
    of_point = outlook.point_problem()
    point = Aim("i-optimal", (of_point,), (of_point,), "± of the predicted point over the workspace [mm]", 1e3)
    if criterion == "spread":
        return replace(point, text="spread, away from the measured poses", choose=(), taken=outlook.measured.dataset.q)
    if criterion == "i-optimal":
        return point
    findings, (told, alike) = findings_of(outlook, record), _rivals(outlook, record)
    if told and criterion in (None, "rivals"):
        said = f"rivals: {'; '.join(told)}" + (f"; no poses separate {alike}" if alike else "")
        apart = tuple(question for question, _ in told.values())
        return Aim(said, apart, apart, "separation of the closest alternatives [sigma]", inverse=True, pairs=told)
    if criterion == "rivals":
        none = f"no poses separate {alike}" if alike else "no finding has an alternative cause in the catalogue"
        raise InputError(f"rivals: {none}", "criterion")
    if not findings and criterion == "effect":
        raise InputError("effect: the model has geometric constants only; expected a model with effects", "criterion")
    if not findings:
        return point
    sizes: tuple[Design, ...] = tuple(outlook.finding_problem(finding) for finding in findings)
    said = f"effect: {'; '.join(f.name for f in findings)}" + (f"; no poses separate {alike}" if alike else "")
    return Aim(said, sizes, sizes, "± of the worst known effect [%]", 100.0)


def _rivals(outlook: PlanningContext, record: Report | None) -> tuple[dict[str, tuple[Design, float]], str]:
    """Return {pair of causes: (design problem, odds)}, and in words the pairs that the pool cannot distinguish."""
    asked = [*findings_of(outlook, record), *constants_of(outlook, record)]
    pairs = {f"{f.name} or {name}": (outlook.separation(f, e), odds) for f in asked for name, e, odds in f.rivals}
    told = {said: pair for said, pair in pairs.items() if best_deviation(pair[0]) < 1.0 / TOLD_APART}
    return told, "; ".join(said for said in pairs if said not in told)


def of_task(model: Model, record: Report | None, pool: Array, task: TableLike, rng: np.random.Generator) -> Aim:
    """Return the experimental design that lowers the error at the poses of a task and distinguishes alternative causes.

    pool: joint values of candidate poses. A pose is selected for the goal farthest from its target: standard error
    (WITHIN) or distance of explanations (TOLD_APART). Raises InputError for an invalid or unreachable target.
    """
    saved, arm = model.saved, model.mechanism
    _, text, path = frame_to_extend(task, arm, "task", saved.convention)
    targets = targets_in(at_end(usable(saved)), text, path, rng, in_order=False)
    beyond = np.flatnonzero(beyond_limits(arm, targets.dataset.q))
    for lost, how in ((targets.unreachable, "out of reach"), (beyond, "beyond a joint limit")):
        if len(lost):
            more = f" ({len(lost)} targets in all)" if len(lost) > 1 else ""
            where = f"{path.name}, row {targets.dataset.row[lost[0]]}"
            raise InputError(f"{where}: the target is {how}{more}; expected poses that {arm.name} can reach", "task")
    outlook = PlanningContext.from_joint_values(saved, pool, rng)
    there = outlook.point_problem(outlook.task_poses(targets.dataset, rng))
    told, alike = _rivals(outlook, record)
    others = (in_units_of(1.0 / TOLD_APART, question) for question, _ in told.values())
    chosen = (in_units_of(WITHIN * best_deviation(there), there), *others)
    said = "; ".join([f"task: {len(targets.dataset)} targets of {path.name}", *told])
    said += f"; no poses separate {alike}" if alike else ""
    return Aim(said, chosen, (there,), "± of the predicted point at the task [mm]", 1e3, pairs=told)


def of_rejected(saved: SavedModel, record: Report | None, pool: Array, number: int, rng: np.random.Generator) -> Aim:
    """Return the experimental design of further poses among `pool` that decide on a rejected candidate effect.

    number: number of the candidate, from 1. Raises InputError for an invalid number or a candidate without a name.
    """
    rejected = record.rejected if record else ()
    if not 1 <= number <= len(rejected):
        there = f"1 to {len(rejected)}" if rejected else "a result of discover that lists rejected candidates"
        raise InputError(f"{number}, expected {there}", "rejected")
    outlook = PlanningContext.from_joint_values(saved, pool, rng)
    names, name = names_of(outlook.measured.dataset), rejected[number - 1].name
    effects = next((e for c, e in outlook.candidates.items() if translate(c, names) == name), None)
    if effects is None:
        raise InputError(f"{number}, {name}, is not in the catalogue; expected one of its candidates", "rejected")
    question = outlook.effects_problem(effects)
    return Aim(f"rejected candidate: {name}", (question,), (question,), "± of the displacement [mm]", 1e3)


def tellable_causes(model: Model, record: Report) -> frozenset[str]:
    """Return the names of alternative causes that further poses could distinguish from the findings."""
    rng, reach = np.random.default_rng(0), Constraints(measured=measured_table(model.saved).q)
    outlook = PlanningContext.from_joint_values(model.saved, pool_of(model.mechanism, POOLED, rng, reach), rng)
    asked = ((name, outlook.separation(f, own)) for f in findings_of(outlook, record) for name, own, _ in f.rivals)
    return frozenset(name for name, question in asked if best_deviation(question) < 1.0 / TOLD_APART)


def findings_of(outlook: PlanningContext, record: Report | None) -> list[Alternatives]:
    """Return the findings of a report with their alternative causes; without a report, all effects but constants."""
    saved = outlook.saved
    effects = saved.model.effects
    names = names_of(outlook.measured.dataset)
    if record is None or record.kind != "discover" or not record.effects:
        stems: dict[str, list[int]] = {}
        for i in (i for i, e in enumerate(effects) if not e.constant and saved.theta[i]):
            stems.setdefault(without_phase(effects[i].name), []).append(i)
        return [Alternatives(translate(name, names), np.array(own)) for name, own in stems.items()]
    by_mechanism = {translate(c, names): c for c in outlook.candidates}
    found = []
    for effect in record.effects:
        called = [translate(e.name, names) for e in effects]
        mine = [name == effect.name or name.startswith(f"{effect.name},") for name in called]
        own = np.flatnonzero(np.logical_and(mine, saved.theta)).tolist()
        others = [(by_mechanism[c.names[0]], c.probability) for c in effect.others if c.names[0] in by_mechanism]
        rivals = tuple(
            (translate(name, names), outlook.candidates[name], (effect.probability or p) / p)
            for name, p in others[:MOST_RIVALS]
        )
        if own:
            found.append(Alternatives(effect.name, np.array(own), rivals))
    return found


def constants_of(outlook: PlanningContext, record: Report | None) -> list[Alternatives]:
    """Return the constants of a report that an alternative effect could replace, and the alternative of each."""
    names = names_of(outlook.measured.dataset)
    own = {translate(e.name, names): i for i, e in enumerate(outlook.saved.model.effects)}
    rivals = {translate(name, names): effects for name, effects in outlook.candidates.items()} if record else {}
    return [
        Alternatives(mimic.constant, np.array([own[mimic.constant]]), ((mimic.rival, rivals[mimic.rival], 1.0),))
        for mimic in (record.mimics if record else ())
        if mimic.constant in own and mimic.rival in rivals
    ]


Criterion = Literal["spread", "d-optimal", "e-optimal", "i-optimal", "effect", "rivals", "observability"]
ALIASES = {"observability": "d-optimal"}
BEFORE = ("spread", *GOALS, *ALIASES)
AFTER = ("rivals", "effect", "i-optimal", "spread")
CONE = 30.0
"""Half-angle of the acceptance cone of a corner-cube reflector, degrees."""
DRAWS = 5
"""Number of random sets of candidate poses, whose mean precision is printed for comparison."""
MOST = 10_000
"""Largest number of poses that may be requested: twice the number of poses that is selected in a minute."""
ROWS = 9
"""Number of rows of the printed table of precision against number of poses."""


@dataclass(frozen=True, repr=False)
class PosesResult(Shown):
    """Proposed measurement poses. q: joint values, rad and m, the most informative first. said: purpose, as text.
    spacing: distance of the two most similar poses, as a share of joint ranges. curve: standard error after each pose.
    limit: lower bound of the standard error for any set of as many candidate poses, in the unit of `curve`. after:
    the fitted model, if any. decided: for the names of two explanations, number of poses after which one explanation is
    95 % probable in 19 of 20 cases; None if the proposed poses do not suffice to decide.
    """

    mechanism: Mechanism
    q: Array
    spacing: float
    curve: pd.DataFrame
    said: str
    limit: float
    after: Model | None
    decided: Mapping[str, int | None] = field(default_factory=dict)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per pose, with the headers of a measured table; controller_AXIS: signs of the controller."""
        if self.after is None:
            return joint_table(self.mechanism, self.q)
        return pose_table(self.mechanism, self.q, self.after.saved.columns, self.after.saved.convention)

    def to_csv(self) -> str:
        """Return the table of proposed poses as text, with the decimals of a robot controller."""
        return table_text(self.to_dataframe(), CONTROLLER_DECIMALS)

    def summary(self) -> str:
        """Return text on the proposed poses: number, purpose, and precision against the number of poses."""
        apart = f", no two closer than {self.spacing:.2f} of a range" if len(self.q) > 1 else ""
        lines = [f"{len(self.q)} poses of {self.mechanism.name}{apart}", wrapped(self.said, 0)]
        if not has_collision_shape(self.mechanism):
            lines.append("the shapes of the links are not known: check each pose for collisions before moving")
        rows = np.unique(np.linspace(0, len(self.curve) - 1, min(ROWS, len(self.curve))).round().astype(int))
        few = self.curve.iloc[rows].set_axis(["poses", "chosen", "random"], axis=1)
        lines.append(f"{self.curve.columns[1]}:")
        lines.append(few.to_string(index=False, na_rep="-", float_format="{:.4g}".format))
        for pair, n in self.decided.items():
            when = f"not separated by {len(self.q)}" if n is None else f"separated by the first {n}"
            lines.append(wrapped(f"{when} poses: {pair}", 0))
        return "\n".join([*lines, f"no set of {len(self.q)} poses can be below {self.limit:.4g}"])

    def save(self, file: str | Path) -> None:
        """Write the poses as .csv, their precision as .curve.csv. Raises InputError if a file cannot be written."""
        path = file_path(file, "file")
        write_text(path, self.to_csv())
        write_text(path.with_suffix(".curve.csv"), self.curve.to_csv(index=False, lineterminator="\n"))

    def __repr__(self) -> str:
        return f"<{len(self.q)} poses of {self.mechanism.name}: {self.said}>"


def choose_poses(
    mechanism: MechanismLike | None = None, count: int | None = None, *, criterion: Criterion | None = None,
    after: Model | str | Path | None = None, rejected: int | None = None, task: TableLike | None = None,
    like: str | Path | FleetPart | None = None,
    above: str | float | None = None, box: str | Sequence[Sequence[float]] | None = None,
    instrument: str | Sequence[float] | None = None, normal: Sequence[float] = (0.0, 0.0, 1.0),
    cone: float | None = None, tool_point: str | Sequence[float] | None = None, collisions: bool = True,
    noise: str | float = "0.03 mm", seed: int = 0, progress: Say = silent,
) -> PosesResult:  # fmt: skip
    """Choose informative measurement poses within the joint limits, before any measurement or after a result.

    criterion: "spread" (default), poses as different as possible (Robertson 2003, 3.3.3); "d-optimal" (or
    "observability"), all geometric errors together best determined (Borm and Menq 1991); "e-optimal", the worst
    determined combination of errors; "i-optimal", the mean standard error of the point over the workspace. With
    `after`: "rivals" (default), to distinguish findings and constants from alternatives; "effect", to lower the
    standard error of the worst known effect; "i-optimal"; "spread". after: a Model or a result folder; poses are
    selected in addition to the measured poses.
    Three arguments replace the criterion. rejected: number of a rejected candidate of `after`, to be decided. task:
    targets as in `Model.compensate`, to lower the mean standard error at the targets and to distinguish alternatives.
    like: folder, file or record of a `fleet`, for a further machine of the type before any measurement.
    above: lowest height of the tool point in the root frame, "200 mm". box: "800:1200,-200:200,300:700mm". instrument:
    position of the instrument in the root frame, "3000,0,1500mm" or m; the line of sight must be free and within `cone`
    degrees (30) of the target's `normal` in the measured frame. tool_point: tool point in the measured frame.
    collisions: exclude poses in which the arm collides with itself, if its URDF has geometry. noise: standard deviation
    of one coordinate, for the curve before a result. count: None for 40, or as many as a decision needs.
    Raises InputError for too few poses for the criterion, too few admissible poses, or an unreachable target.
    """
    check_function(progress, "progress")
    wanted = POOLED if count is None else check_integer(count, "count", 1, MOST)
    tell, rng = Reporter(progress), np.random.default_rng(check_integer(seed, "seed"))
    model, record = (None, None) if after is None else read_result(after)
    _one_of(model, criterion=criterion, rejected=rejected, task=task, like=like)
    if model is None and mechanism is None:
        raise InputError("missing, expected a mechanism, or a result in `after`", "mechanism")
    arm, collides = mechanism_of(mechanism) if model is None else model.mechanism, check_bool(collisions, "collisions")
    seen = model.saved.measured.dataset.q if model and model.saved.measured else None
    reach = Constraints(_box(above, box), _tool(tool_point, model), _sight(instrument, normal, cone), collides, seen)
    spread_of = to_si(noise, "length", "noise", positive=True, most=NOISIEST)
    kind = None if criterion is None else check_choice(criterion, BEFORE if model is None else AFTER, "criterion")
    tell(f"{wanted} poses of {arm.name}", passing=True)
    pool = closing_pool(None if model is None else model.saved, pool_of(arm, wanted, rng, reach))
    if like is not None:
        asked = _of_type(fleet_at(like, "like"), arm, pool)
    elif model is None:
        asked = _before(arm, pool, wanted, ALIASES.get(kind or "spread", kind or "spread"), spread_of)
    elif rejected is not None:
        asked = of_rejected(model.saved, record, pool, check_integer(rejected, "rejected", 1), rng)
    elif task is not None:
        asked = of_task(model, record, pool, task, rng)
    else:
        asked = design_problems(model.saved, record, pool, kind, rng)
    order = spread_among(arm, pool, wanted, asked.taken) if not asked.choose else choose_for_all(asked.choose, wanted)
    decided = {pair: decided_after(question, order, odds) for pair, (question, odds) in asked.pairs.items()}
    if count is None and asked.inverse and None not in decided.values():
        order = order[: (wanted := max(n or 0 for n in decided.values()))]
    tell("lower bound over all sets of poses", passing=True)
    limit = float(asked.to_curve_unit(np.array(least_deviation(asked.measure, wanted))))
    q, curve = pool[order], _curve(asked, order, len(pool), rng)
    return PosesResult(arm, q, spacing(arm, q), curve, asked.text, limit, model, decided)


def _one_of(model: Model | None, **given: object) -> None:
    """Raise InputError for two conflicting criteria of the selection of poses, or a criterion that needs a result."""
    named = [name for name, value in given.items() if value is not None]
    of_result = [name for name in named if name in ("rejected", "task")]
    if model is None and of_result:
        raise InputError("needs a result; expected a result in `after` too", of_result[0])
    if model is not None and "like" in named:
        raise InputError("is for a machine without measurements; expected `like` or `after`, not both", "like")
    if len(named) > 1:
        raise InputError(f"cannot be combined; expected {' or '.join(named)}, not both", named[-1])


def _of_type(fleet: FleetPart, arm: Mechanism, pool: Array) -> Aim:
    try:
        asked = (type_problem(prior_model(fleet, arm), pool),)
    except InputError as error:
        raise InputError(error.said, "like") from None
    said = f"like {len(fleet.machines)} machines of the type"
    return Aim(said, asked, asked, "± of the point over the workspace, with the prior of the type [mm]", 1e3)


def _before(arm: Mechanism, pool: Array, count: int, kind: str, noise: float) -> Aim:
    measure = geometric_problem(arm, pool, noise)
    unknowns = measure.columns.shape[2]
    if kind != "spread" and 3 * count <= unknowns:
        raise InputError(f"{count} poses give {3 * count} values for {unknowns} unknowns; expected more poses", "count")
    choose = () if kind == "spread" else (replace(measure, criterion=GOALS[kind](measure.columns)),)
    return Aim(kind, choose, (measure,), "± of the point over the workspace, by the geometric errors [mm]", 1e3)


def _curve(asked: Aim, order: IntArray, pool: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return the precision after each selected pose, and the precision with as many random poses."""
    draws = [rng.choice(pool, len(order), replace=False) for _ in range(DRAWS)]
    chosen, random = (
        asked.to_curve_unit(deviations(asked.measure, order)),
        np.mean([asked.to_curve_unit(deviations(asked.measure, draw)) for draw in draws], axis=0),
    )
    columns = {"poses": np.arange(len(order) + 1), asked.label: chosen, f"{asked.label}, of random poses": random}
    return pd.DataFrame(columns)


def _box(above: str | float | None, box: str | Sequence[Sequence[float]] | None) -> Array:
    limits = Constraints().box if box is None else box_limits(box, "box")
    if above is not None:
        limits = limits.copy()
        limits[0, 2] = max(limits[0, 2], to_si(above, "length", "above", least=-np.inf))
    return limits


def _tool(given: str | Sequence[float] | None, model: Model | None) -> Array:
    if given is not None:
        return np.array(to_point(given, "tool_point"))
    return np.zeros(3) if model is None else next(iter(model.saved.placement.tool.values()))[:3, 3]


def _sight(instrument: str | Sequence[float] | None, normal: Sequence[float], cone: float | None) -> Sight | None:
    axis = np.array(to_point(normal, "normal"))
    if not axis.any():
        raise InputError("(0, 0, 0), expected a vector longer than zero, in the measured frame", "normal")
    half = CONE if cone is None else check_number(cone, "cone", 1e-6, 180.0)
    if instrument is None:
        if cone is not None:
            raise InputError("needs the position of the instrument; expected --instrument too", "cone")
        return None
    return Sight(np.array(to_point(instrument, "instrument")), axis, float(np.radians(half)))
