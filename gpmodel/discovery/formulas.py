"""Propose formulas for the curves of a selection, and constants of its nonlinear groups where they are most likely."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, count, repeat

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.gauge import moving_sites
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import readable_inputs, targets
from gpmodel.evidence.residual import Residual, residual_of, squares, winsorising
from gpmodel.evidence.score import scores
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.formulas import formulas_at, shorter
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import SlotProblem
from gpmodel.families.candidate import Candidate, formula_of
from gpmodel.families.catalogue import names
from gpmodel.formula.algebra import simplify
from gpmodel.formula.program import Program, description_size
from gpmodel.model.effect import Effect
from gpmodel.model.memory import read_by
from gpmodel.model.sites import Site, sites_of
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.selection.group import is_curve
from gpmodel.selection.programs import as_candidate, without_poles
from gpmodel.selection.result import Kept
from gpmodel.table.bundles import JUDGED

PLAIN = 2
"""Effects up to which a group is solved by plain least squares: a number or a sine and cosine need no prior."""

TOGETHER, NUMBERS = 2, 3
"""Inputs of a formula of groups at one site; unknowns of named groups that a formula may replace."""

MOST_DETERMINED = 20.0
"""Unknowns of a curve that the data determine, up to which a formula is searched: the most that a smooth curve has."""

MOST_INPUTS = 6
"""Inputs of what was evolved, of which a law in three may say as much: the others may be there by chance."""


def curves_of(kept: Sequence[tuple[Candidate, Kept]], fresh: frozenset[str]) -> dict[tuple[str, ...], Candidate]:
    """Curves of a selection that a formula may replace, by the names of the groups that each is made of.

    Smooth terms and named curves of few determined unknowns; evolved programs of several terms, or new ones. Groups at
    one site that read two inputs together are one more.
    """
    found: dict[tuple[str, ...], Candidate] = {
        (c.name,): c
        for c, k in kept
        if (PLAIN < k.determined <= MOST_DETERMINED and c.inner is None)
        or (not c.family and (len(c.effects) > 1 or c.name in fresh))
    }
    learned = (replace(c, effects=k.effects) for c, k in kept if k.determined <= MOST_DETERMINED)
    return found | dict(_at_one_site(learned))


def _at_one_site(candidates: Iterable[Candidate]) -> Iterator[tuple[tuple[str, ...], Candidate]]:
    """Candidates at one site that read two inputs together, by their names: functions of both and of one may stand for
    one formula. Named ones stay if they read two or have more unknowns than a formula."""
    at: dict[frozenset[object], list[Candidate]] = defaultdict(list)
    for one in candidates:
        at[places(one)].append(one)
    for sites, parts in at.items():
        read = {name for c in parts for name in c.inputs}
        effects = tuple(e for c in parts for e in c.effects)
        named = all(c.family and not is_curve(c) for c in parts)
        most = (1 if len(effects) <= NUMBERS else 0) if named else TOGETHER
        if len(sites) == 1 and len(parts) > 1 and len(read) <= most:
            names, cost = tuple(c.name for c in parts), sum(c.cost for c in parts)
            said = " and ".join(names)
            maker = formula_of(c.found_by for c in parts)
            whole = replace(parts[0], name=said, effects=effects, family="", found_by=maker, cost=cost, inner=None)
            yield names, whole


def places(candidate: Candidate) -> frozenset[tuple[tuple[str, str, float], ...]]:
    """Slots, axes and weights at which a candidate acts."""
    return frozenset(tuple((t.slot, t.axis, t.weight) for t in effect.terms) for effect in candidate.effects)


@dataclass(frozen=True)
class LawTask:
    """The search for a law of one curve: all that a worker needs. written: its inputs as the table has them."""

    problem: SlotProblem
    inputs: tuple[str, ...]
    site: Site
    written: Mapping[str, str]


def run_law_task(task: LawTask) -> tuple[Solution, ...]:
    """Laws in the inputs of the curve; the same wherever it runs."""
    return formulas_at(task.problem, 0, task.inputs)


@dataclass(frozen=True)
class ShortLaw:
    """A law at a curve's place: its program over the task's inputs, and that as an effect."""

    program: Program
    task: LawTask
    candidate: Candidate

    def simplified(self) -> Candidate:
        """The effect as computer algebra writes it; it takes longer than all that is asked of a law before."""
        program, task = simplify(self.program), self.task
        cost, maker = self.candidate.cost, self.candidate.found_by
        return as_candidate(program, task.site, task.written, cost, maker) or self.candidate


def formulas(left: Residual, curves: Sequence[Candidate], search: Search) -> Iterator[ShortLaw]:
    """Formulas of one term in the inputs and at the site of each curve, and shorter ones of the best.

    left: residual of a model with all the curves. The searches run side by side, once more with the poses that stand
    out of the curve as they were measured: a formula may be sharper than its curve.
    """
    doubted = [doubtful(left, curve) for curve in curves]
    views = [(left, taken_as_measured(left, out)) if out.any() else (left,) for out in doubted]
    posed = [[t for view in own for t in _posed(view, curve, search)] for curve, own in zip(curves, views, strict=True)]
    found = dict(search.side_by_side(run_law_task, list(chain.from_iterable(posed))))
    numbers = count()
    for curve, tasks, out, (residual, *sharp) in zip(curves, posed, doubted, views, strict=True):
        ways = [partial(_as_laws, residual, curve, task, search) for task in tasks]
        makers = partial(formula_of, [curve.found_by])
        searched = [list(f((law.program, makers(law.generation)) for law in found[next(numbers)])) for f in ways]
        laws = list(chain.from_iterable(searched))
        yield from laws
        if laws and sharp:
            trusted = out & explained(sharp[0].without(curve.effects), [law.candidate for law in laws])
            residual = taken_as_measured(left, trusted)
        residual = residual.without(curve.effects)
        for as_laws, some in zip(ways, searched, strict=True):
            yield from _shortened(some, residual, as_laws) if some else ()


def _posed(left: Residual, curve: Candidate, search: Search) -> list[LawTask]:
    """Pose the formula searches of a curve: formulas of its inputs at its site.

    Unnamed formulas are searched where they would save more. No search is posed for several sites or more inputs. If
    two inputs are lagged copies of one column, each is searched separately.
    """
    residual = left.without(curve.effects)
    sites = places(curve)
    poses = len(residual.poses)
    rows = np.unique(np.linspace(0, poses - 1, min(poses, search.evolved_poses)).astype(int))
    inputs, written = readable_inputs(residual.poses.states, rows)
    most = TOGETHER if curve.family else MOST_INPUTS
    columns = len(_columns(curve.inputs))
    if len(sites) > 1 or len(curve.inputs) > most or not set(curve.inputs) <= set(inputs.names):
        return []
    asked = [read for read in combinations(curve.inputs, columns) if len(_columns(read)) == columns]
    own = Site(next(iter(sites)))
    found = []
    for site in dict.fromkeys((own, own if curve.family in names() else _likeliest(residual, curve, own))):
        problem = SlotProblem(inputs, targets(residual, (site,), rows), parsimony=search.nats_per_node)
        found += [LawTask(problem, read, site, written) for read in asked]
    return found


def _likeliest(residual: Residual, curve: Candidate, own: Site) -> Site:
    """The place where a curve saves most, of those along or about an axis like its own, which it stays at where none
    saves more than a tie.

    What evolves sees large errors cut short, and of two places that move the tool nearly alike may take the other.
    """
    kind, mechanism = own.axis[0], residual.calibration.model.mechanism
    sites = [site for site in moving_sites(mechanism, residual.poses.dataset) if site.axis[0] == kind]
    there = [replace(curve, effects=tuple(_at(site, effect) for effect in curve.effects)) for site in sites]
    here, *nats = (score.nats for score in scores(residual, (curve, *there)))
    most, site = max(zip(nats, sites, strict=True), key=lambda one: one[0])
    return site if most > here + residual.criteria.tie else own


def _at(site: Site, effect: Effect) -> Effect:
    """An effect of one place at another."""
    return replace(effect, terms=site.effect("", effect.terms[0].basis, effect.unit).terms)


def _columns(names: Iterable[str]) -> set[str]:
    """The columns of the table that inputs are made of."""
    return {column for name in names for column in read_by(name) or (name,)}


def _as_laws(
    residual: Residual, curve: Candidate, task: LawTask, search: Search, programs: Iterable[tuple[Program, str]]
) -> Iterator[ShortLaw]:
    """Programs, and who made each, as effects at the curve's place, without those that pass a pole."""
    states = residual.poses.states
    between = states.between()
    places = len(sites_of(residual.calibration.model.mechanism))
    for program, maker in programs:
        cost = search.cost(description_size(program), 1 if curve.family else places) + curve.cost * bool(curve.family)
        candidate = as_candidate(program, task.site, task.written, cost, maker)
        if candidate and without_poles(residual.criteria, candidate, states, between):
            yield ShortLaw(program, task, candidate)


def _shortened(
    laws: Sequence[ShortLaw], residual: Residual, as_laws: Callable[[Iterable[tuple[Program, str]]], Iterator[ShortLaw]]
) -> list[ShortLaw]:
    """The law that saves most less a node at a time, the least missed, for as long as it saves more.

    At the place alone a shorter law that passes a pole may say as much, and hide what is left.
    """
    steps: list[ShortLaw] = []
    most, best = _best(residual, laws)
    while fewer := list(as_laws(zip(shorter(best.program, best.task.problem), repeat(best.candidate.found_by)))):
        saved, best = _best(residual, fewer)
        if saved <= most:
            break
        most = saved
        steps.append(best)
    return steps


def _best(residual: Residual, laws: Sequence[ShortLaw]) -> tuple[float, ShortLaw]:
    """The law that saves most, and what it saves, nats."""
    nats = (score.nats for score in scores(residual, [law.candidate for law in laws]))
    return max(zip(nats, laws, strict=True), key=lambda pair: pair[0])


GROSS = 2.0
"""Times the second largest that an error without the curve may be; a larger one is that of the measurement."""


def doubtful(left: Residual, curve: Candidate) -> Mask:
    """Poses (N,) that stand out of a model with a curve, but are no gross errors beside others without it."""
    motion = left.columns(curve.effects) @ np.array(left.calibration.values_of(curve.effects))
    before = _lengths(left, left.problem.residual + motion)
    out = winsorising(left.problem, len(left.poses), left.criteria.outlier_sigmas) < 1.0
    return np.asarray(out & (before <= GROSS * np.sort(before)[-2:].min(initial=np.inf)))


def taken_as_measured(left: Residual, poses: Mask) -> Residual:
    """The residual with some of its poses (N,) as they are, the others winsorised."""
    return residual_of(left.calibration, left.poses, left.criteria, JUDGED, poses)


def explained(residual: Residual, laws: Sequence[Candidate]) -> Mask:
    """Poses (N,) that do not stand out of the model with the likeliest of some laws, where what stands out of one
    counts as if it stood at the limit. residual: without them."""
    sigmas, found = residual.criteria.outlier_sigmas, list[tuple[float, Mask]]()
    for law in laws:
        columns, _ = residual.projected(law.effects)
        left = residual.values - columns @ np.linalg.lstsq(columns, residual.values, rcond=None)[0]
        errors = _lengths(residual, left[: residual.measured])
        limit = outlier_limit(errors, sigmas)
        gain = 1.0 - float(np.sum(np.minimum(errors, limit) ** 2)) / residual.energy
        found.append((law.cost - float(fit_nats(gain, residual.freedom)), errors <= limit))
    return min(found, key=lambda one: one[0])[1]


def _lengths(residual: Residual, values: Array) -> Array:
    """Length (N,) of the values (M,) of each pose."""
    return np.sqrt(squares(residual.problem, values, len(residual.poses)))
