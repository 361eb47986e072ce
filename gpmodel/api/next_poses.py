"""Purpose of the next poses after a result."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gpmodel.api.arguments import file_path
from gpmodel.api.model import Model, load_model
from gpmodel.application.model_file import SavedModel
from gpmodel.application.next_poses import Outlook, Questioned
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.families.candidate import without_phase
from gpmodel.model.sites import names_of, translate
from gpmodel.planning.design import Asked, Question, at_best
from gpmodel.planning.poses import pool_of
from gpmodel.planning.reach import Reach
from gpmodel.report.saved import NAME, read_report
from gpmodel.report.schema import Report

POOLED = 40
"""Poses that a pool is made for where none are chosen: the default of choosing them."""
TOLD_APART = 2.0
"""Standard deviations that all poses of the pool must put between rivals for any of them to be taken for it."""
MOST_RIVALS = 3
"""Largest number of alternatives of each finding, the closest first.

Later ones predict worse and become distinguishable on the way.
"""


def read_result(after: Model | str | Path) -> tuple[Model, Report | None]:
    """A model and, where it lies in a folder of discover or calibrate, its report. Raises InputError for neither."""
    if isinstance(after, Model):
        return after, None
    path = file_path(after, "after")
    folder = path if path.is_dir() else path.parent
    return load_model(path), read_report(folder) if (folder / NAME).is_file() else None


def next_questions(
    saved: SavedModel, record: Report | None, pool: Array, criterion: str | None, rng: np.random.Generator
) -> Asked:
    """Pose the design question of a pool (P, n) of poses after a result, by "rivals", "effect", "i-optimal" or
    "spread".

    None: the first of these that applies. Raises InputError where none applies.
    """
    outlook = Outlook.over(saved, pool, rng)
    of_point = outlook.of_the_point()
    point = Asked("i-optimal", (of_point,), (of_point,), "± of the predicted point over the workspace [mm]", 1e3)
    if criterion == "spread":
        return replace(point, said="spread, away from what is measured", choose=(), taken=outlook.measured.dataset.q)
    if criterion == "i-optimal":
        return point
    findings = findings_of(outlook, record)
    asked = [*findings, *constants_of(outlook, record)]
    pairs = {f"{f.name} or {name}": outlook.beside(f, effects) for f in asked for name, effects in f.rivals}
    told = {said: asked for said, asked in pairs.items() if at_best(asked) < 1.0 / TOLD_APART}
    alike = "; ".join(said for said in pairs if said not in told)
    if told and criterion in (None, "rivals"):
        said = f"rivals: {'; '.join(told)}" + (f"; no poses tell {alike}" if alike else "")
        return Asked(said, tuple(told.values()), tuple(told.values()), "closest rivals apart [sigma]", inverse=True)
    if criterion == "rivals":
        none = f"no poses tell {alike}" if alike else "no finding has one of the catalogue that predicts about as well"
        raise InputError(f"rivals: {none}", "criterion")
    if not findings and criterion == "effect":
        raise InputError("effect: the model has nothing beside its geometry", "criterion")
    if not findings:
        return point
    sizes: tuple[Question, ...] = tuple(outlook.of_finding(finding) for finding in findings)
    said = f"effect: {'; '.join(f.name for f in findings)}" + (f"; no poses tell {alike}" if alike else "")
    return Asked(said, sizes, sizes, "± of the worst known effect [%]", 100.0)


def of_rejected(saved: SavedModel, record: Report | None, pool: Array, number: int, rng: np.random.Generator) -> Asked:
    """Pose the design question of a pool (P, n) of poses that decides a rejected candidate of a result, counted from
    1.

    Raises InputError where there is no candidate of that number, or the catalogue has none of its name.
    """
    rejected = record.rejected if record else ()
    if not 1 <= number <= len(rejected):
        there = f"1 to {len(rejected)}" if rejected else "a result of discover that lists rejected candidates"
        raise InputError(f"{number}, expected {there}", "rejected")
    outlook = Outlook.over(saved, pool, rng)
    names, name = names_of(outlook.measured.dataset), rejected[number - 1].name
    effects = next((e for c, e in outlook.candidates.items() if translate(c, names) == name), None)
    if effects is None:
        raise InputError(f"{number}, {name}, has no name in the catalogue; expected one that has", "rejected")
    question = outlook.of_more(effects)
    return Asked(f"rejected candidate: {name}", (question,), (question,), "± of what it moves the point by [mm]", 1e3)


def tellable_causes(model: Model, record: Report) -> frozenset[str]:
    """Names of the other causes in a result that poses of a pool could tell from their findings, by the same pool and
    limit as the next poses are chosen by."""
    rng = np.random.default_rng(0)
    outlook = Outlook.over(model.saved, pool_of(model.mechanism, POOLED, rng, Reach()), rng)
    asked = ((name, outlook.beside(f, own)) for f in findings_of(outlook, record) for name, own in f.rivals)
    return frozenset(name for name, question in asked if at_best(question) < 1.0 / TOLD_APART)


def findings_of(outlook: Outlook, record: Report | None) -> list[Questioned]:
    """The findings of a report with their close rivals; without one every effect beside the geometry by itself."""
    saved = outlook.saved
    effects = saved.model.effects
    names = names_of(outlook.measured.dataset)
    if record is None or record.kind != "discover" or not record.effects:
        stems: dict[str, list[int]] = {}
        for i in (i for i, e in enumerate(effects) if not e.constant and saved.theta[i]):
            stems.setdefault(without_phase(effects[i].name), []).append(i)
        return [Questioned(translate(name, names), np.array(own)) for name, own in stems.items()]
    by_mechanism = {translate(c, names): c for c in outlook.candidates}
    found = []
    for effect in record.effects:
        called = [translate(e.name, names) for e in effects]
        mine = [name == effect.name or name.startswith(f"{effect.name},") for name in called]
        own = np.flatnonzero(np.logical_and(mine, saved.theta)).tolist()
        others = [cause.names[0] for cause in effect.others]
        wanted = [by_mechanism[name] for name in others if name in by_mechanism][:MOST_RIVALS]
        rivals = tuple((translate(n, names), outlook.candidates[n]) for n in wanted)
        if own:
            found.append(Questioned(effect.name, np.array(own), rivals))
    return found


def constants_of(outlook: Outlook, record: Report | None) -> list[Questioned]:
    """The constants of a report that something else could equally be, each with that."""
    names = names_of(outlook.measured.dataset)
    own = {translate(e.name, names): i for i, e in enumerate(outlook.saved.model.effects)}
    rivals = {translate(name, names): effects for name, effects in outlook.candidates.items()} if record else {}
    return [
        Questioned(mimic.constant, np.array([own[mimic.constant]]), ((mimic.rival, rivals[mimic.rival]),))
        for mimic in (record.mimics if record else ())
        if mimic.constant in own and mimic.rival in rivals
    ]
