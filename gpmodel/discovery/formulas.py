"""Propose formulas for the smooth functions that a selection contains."""

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
from gpmodel.evidence.residual import Residual, residual_of, squares_by_pose, winsorising
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
from gpmodel.model.memory import columns_of
from gpmodel.model.sites import Site, sites_of
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.selection.group import is_curve
from gpmodel.selection.programs import as_candidate, without_poles
from gpmodel.selection.result import Kept
from gpmodel.table.blocks import FOLD_SEED

PLAIN = 2
"""Largest number of effects of a group that is fitted by least squares without a prior, such as sine and cosine."""

TOGETHER, NUMBERS = 2, 3
"""Largest number of inputs of a formula at one site, and of coefficients of named groups that a formula replaces."""

MOST_DETERMINED = 20.0
"""Largest effective number of coefficients of a smooth function for which a formula is searched."""

MOST_INPUTS = 6
"""Largest number of inputs of an evolved program for which a formula of three inputs is searched."""


def curves_of(kept: Sequence[tuple[Candidate, Kept]], fresh: frozenset[str]) -> dict[tuple[str, ...], Candidate]:
    """Return the smooth functions of a selection that a formula may replace, by the names of their groups of effects.

    Named functions are included if the data determine few of their coefficients, evolved programs if the programs have
    several terms or are new. Groups at one site with at most two inputs in total are also added up to one function.
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
    """Yield the sum of all groups at one site with at most two inputs as one candidate, with the names of the groups.
    Groups that all have named causes are added up only for one input and at most NUMBERS coefficients."""
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
            name, maker = " and ".join(names), formula_of(c.found_by for c in parts)
            yield names, replace(parts[0], name=name, effects=effects, family="", found_by=maker, cost=cost, inner=None)


def places(candidate: Candidate) -> frozenset[tuple[tuple[str, str, float], ...]]:
    """Return the frames, axes and weights of the twists by which a candidate's effects act."""
    return frozenset(tuple((t.slot, t.axis, t.weight) for t in effect.terms) for effect in candidate.effects)


@dataclass(frozen=True)
class LawTask:
    """Search for a formula of one smooth function at a site, as sent to a worker. written: text of each input."""

    problem: SlotProblem
    inputs: tuple[str, ...]
    site: Site
    written: Mapping[str, str]


def run_law_task(task: LawTask) -> tuple[Solution, ...]:
    """Search formulas in the inputs of a smooth function; the result does not depend on the worker."""
    return formulas_at(task.problem, 0, task.inputs)


@dataclass(frozen=True)
class ShortLaw:
    """A formula for a smooth function: its program over the search's inputs, and the candidate effect at the site."""

    program: Program
    task: LawTask
    candidate: Candidate

    def simplified(self) -> Candidate:
        """Return the candidate with its formula simplified by computer algebra, which is slow."""
        program, task = simplify(self.program), self.task
        cost, maker = self.candidate.cost, self.candidate.found_by
        return as_candidate(program, task.site, task.written, cost, maker) or self.candidate


def formulas(left: Residual, curves: Sequence[Candidate], search: Search) -> Iterator[ShortLaw]:
    """Yield formulas in the inputs and at the site of each smooth function, and shorter forms of the best formulas.

    left: residual of a model with all the smooth functions. The searches run in parallel, and are repeated without
    winsorising outliers of the smooth function, since a formula may have a sharp bend.
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
    """Return the formula searches for a smooth function, in its inputs and at its site.

    For a smooth function of no family, the site of highest evidence is searched, too. A function with several sites or
    too many inputs has no search. If two inputs are lagged copies of one column, each input is searched separately.
    """
    residual = left.without(curve.effects)
    sites = places(curve)
    poses = len(residual.poses)
    rows = np.unique(np.linspace(0, poses - 1, min(poses, search.evolved_poses)).astype(int))
    inputs, written = readable_inputs(residual.poses.states, rows)
    most = TOGETHER if curve.family else MOST_INPUTS
    columns = len(columns_of(curve.inputs))
    if len(sites) > 1 or len(curve.inputs) > most or not set(curve.inputs) <= set(inputs.names):
        return []
    asked = [read for read in combinations(curve.inputs, columns) if len(columns_of(read)) == columns]
    own = Site(next(iter(sites)))
    found = []
    for site in dict.fromkeys((own, own if curve.family in names() else _likeliest(residual, curve, own))):
        problem = SlotProblem(inputs, targets(residual, (site,), rows), parsimony=search.nats_per_node)
        found += [LawTask(problem, read, site, written) for read in asked]
    return found


def _likeliest(residual: Residual, curve: Candidate, own: Site) -> Site:
    """Return the site of highest evidence for a smooth function, or its site `own` if no evidence is clearly higher.

    Evolution winsorises large errors, and may select the wrong one of two sites that move the tool nearly equally.
    """
    kind, mechanism = own.axis[0], residual.calibration.model.mechanism
    sites = [site for site in moving_sites(mechanism, residual.poses.dataset) if site.axis[0] == kind]
    there = [replace(curve, effects=tuple(_at(site, effect) for effect in curve.effects)) for site in sites]
    here, *nats = (score.nats for score in scores(residual, (curve, *there)))
    most, site = max(zip(nats, sites, strict=True), key=lambda one: one[0])
    return site if most > here + residual.criteria.tie else own


def _at(site: Site, effect: Effect) -> Effect:
    """Return a copy of an effect that acts at the given site (frame and axis)."""
    return replace(effect, terms=site.effect("", effect.terms[0].basis, effect.unit).terms)


def _as_laws(
    residual: Residual, curve: Candidate, task: LawTask, search: Search, programs: Iterable[tuple[Program, str]]
) -> Iterator[ShortLaw]:
    """Yield programs without a pole as candidate effects at the site of a search. programs: programs with origins."""
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
    """Remove nodes from the best formula one by one while its gain rises; return all shorter formulas.

    Formulas with a pole are excluded, since a formula with a pole could hide a better formula.
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
    """Return the largest log evidence gain of any formula, nats, and the formula."""
    nats = (score.nats for score in scores(residual, [law.candidate for law in laws]))
    return max(zip(nats, laws, strict=True), key=lambda pair: pair[0])


GROSS = 2.0
"""Ratio of the largest to the second largest pose error, without a smooth function, above which the pose is bad."""


def doubtful(left: Residual, curve: Candidate) -> Mask:
    """Mark poses that are outliers of a model with a smooth function, but no gross errors without the function."""
    motion = left.columns(curve.effects) @ np.array(left.calibration.values_of(curve.effects))
    before = _lengths(left, left.problem.residual + motion)
    out = winsorising(left.problem, len(left.poses), left.criteria.outlier_sigmas) < 1.0
    return np.asarray(out & (before <= GROSS * np.sort(before)[-2:].min(initial=np.inf)))


def taken_as_measured(left: Residual, poses: Mask) -> Residual:
    """Return the residual of the calibration without winsorising the poses of a mask."""
    return residual_of(left.calibration, left.poses, left.criteria, FOLD_SEED, poses)


def explained(residual: Residual, laws: Sequence[Candidate]) -> Mask:
    """Mark poses that are no outliers of the most likely formula. The likelihood counts an outlier as if its residual
    were at the outlier limit. residual: residual of the model without the formulas."""
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
    """Return the length of each pose's residual vector. values: values of the measured rows, m."""
    return np.sqrt(squares_by_pose(residual.problem, values, len(residual.poses)))
