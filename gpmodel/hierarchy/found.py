"""Select effects that machines of one type have in common, and effects of each machine alone."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated, paired, paired_t
from gpmodel.evidence.dependence import depends_on_time
from gpmodel.evidence.residual import Residual, independent_blocks, residual_of
from gpmodel.evidence.score import fitted, with_refitted_noise
from gpmodel.evolution.chance import chance_of
from gpmodel.evolution.variances import DECADES, GRID, best
from gpmodel.executor import Workers
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.progress import Reporter
from gpmodel.records.unfinished import Unfinished
from gpmodel.selection.group import Group, Shapes, group_of
from gpmodel.table.blocks import FOLD_SEED
from gpmodel.wording import listed

Residuals = Callable[[Sequence[Candidate]], Sequence[Residual]]
"""Function from candidates to the residual of every machine, calibrated with the geometry and the candidates."""


@dataclass(frozen=True)
class PooledGroup:
    """A candidate group of effects, scored on all machines.

    nats: net gain at the best prior variances of mean and machines, nats.
    typical: whether more than half of the machines gain at the best common variance about zero, and the net gain
    without the machine of largest gain is positive.
    """

    nats: float
    typical: bool


def select_for_type(
    proposals: Mapping[str, Candidate], residuals: Residuals, criteria: Criteria, seed: int
) -> tuple[Candidate, ...]:
    """Select candidates for the type by forward selection with backward elimination over all machines.

    Each step adds the candidate with the largest pooled net gain, if the candidate is typical (no effect of a minority)
    and passes the limits of `criteria`: net gain, permutation null over all candidates, pooled cross-validation. After
    each addition, a selected candidate that explains less than another, given the others, is exchanged for it; one that
    fails given all other candidates is deleted for good.
    """
    rng, chosen, left = np.random.default_rng(seed), dict[str, Candidate](), dict(proposals)
    while left:
        machines = residuals(tuple(chosen.values()))
        groups = _groups(left, machines)
        typical = _typical(groups, machines)
        name = max(typical, key=typical.__getitem__, default=None)
        if name is None or not _passes(machines, groups[name], typical[name], criteria):
            break
        null = _null(machines, list(groups.values()), rng, criteria.shuffles)
        if chance_of(typical[name], null).p >= criteria.significance:
            break
        chosen[name] = left.pop(name)
        chosen = _exchanged(chosen, left, residuals)
        chosen = _weeded(chosen, residuals, criteria)
    return tuple(chosen.values())


def pooled(machines: Sequence[Residual], group: Group) -> PooledGroup:
    """Score a candidate group on all machines. The noise of each machine is estimated with the group.

        b_i = μ + δ_i,   μ ~ N(0, a P),   δ_i ~ N(0, d P)                 b_i: coefficients of machine i; P: prior

    The prior variances a of the mean and d of the machines are those of the largest marginal likelihood. Machines that
    agree hence pay once for the size of a coefficient, not once a machine.
    """
    spectra = [_spectrum(of, group, of.values[:, None]) for of in machines]
    gains = _gains(machines, group, spectra)
    others = [k for k in range(len(machines)) if k != int(np.argmax(gains))]
    rest = _gains([machines[k] for k in others], group, [spectra[k] for k in others])
    typical = float(np.mean(gains > 0.0)) > 0.5 and float(np.sum(rest)) > group.cost
    (gain,), (own,), (mean,) = _with_common_mean(group, spectra)
    fits = zip(machines, _fits(spectra, own, mean), strict=True)
    noise = [float(with_refitted_noise(np.zeros(1), np.array([fit]), float(of.freedom))[0]) for of, fit in fits]
    return PooledGroup(float(gain) + sum(noise) - group.cost, typical)


Spectrum = tuple[Array, Array, Array]
"""Eigenvalues s and eigenvectors V of S = XᵀX, and VᵀXᵀr for each residual r. X: columns of a group, over the noise."""


def _with_common_mean(group: Group, spectra: Sequence[Spectrum]) -> tuple[Array, Array, Array]:
    """Return for each residual the log evidence gain, nats, and its variances d of the machines and a of the mean.

    Given d, machine i has the information W_i = S_i (1 + d S_i)⁻¹ about μ, and the gain is that of the machines about
    zero plus that of μ.
    """
    s, turn, q = (np.array(part) for part in zip(*spectra, strict=True))
    trials = q.shape[1]
    found = np.full((3, trials), -np.inf)
    for d in (0.0, *(group.cap**2 * 10.0 ** -np.linspace(0.0, DECADES, GRID))):
        left = 1.0 / (1.0 + d * s)
        about_zero = 0.5 * np.sum(d * q**2 * left[:, None] + np.log(left)[:, None], axis=(0, 2))
        sizes, basis = np.linalg.eigh(np.einsum("mik,mk,mjk->ij", turn, s * left, turn))
        along = np.einsum("mik,mbk->bi", turn, left[:, None] * q) @ basis
        gains, a = best(np.tile(sizes, (trials, 1)), along, np.full(trials, group.cap))
        here = np.array([about_zero + gains, np.full(trials, d), a])
        found = np.where(here[0] > found[0], here, found)
    return found[0], found[1], found[2]


def _fits(spectra: Sequence[Spectrum], d: float, a: float) -> Iterator[float]:
    """Yield the misfit that each machine's posterior mean of a group removes. d, a: variances of machines and mean."""
    information = sum((turn * (s / (1.0 + d * s))) @ turn.T for s, turn, _ in spectra)
    towards = sum(turn @ (q[0] / (1.0 + d * s)) for s, turn, q in spectra)
    mean = a * np.linalg.solve(np.eye(len(towards)) + a * information, towards)
    for s, turn, q in spectra:
        own = turn.T @ mean
        yield float(q[0] @ (own + d * (q[0] - s * own) / (1.0 + d * s)))


def _gains(machines: Sequence[Residual], group: Group, spectra: Sequence[Spectrum]) -> Array:
    """Return the log evidence gain of each machine by a group of effects at the best variance about zero, nats."""
    s, q = (np.concatenate([spectrum[k] for spectrum in spectra], axis=-1) for k in (0, 2))
    variance = float(best(s[None], q, np.array([group.cap]))[1][0])
    return np.array([_gain(of, variance, *own) for of, own in zip(machines, spectra, strict=True)])


def _gain(of: Residual, variance: float, s: Array, _: Array, q: Array) -> float:
    """Return the log evidence gain of a group of effects on one machine at a given prior variance, nats."""
    ratio = 1.0 + variance * s
    gain = 0.5 * float(np.sum(variance * q[0] ** 2 / ratio - np.log(ratio)))
    fit = fitted(np.array([variance]), s[None], q)
    return float(with_refitted_noise(np.array([gain]), fit, float(of.freedom))[0])


def _spectrum(of: Residual, group: Group, trials: Array) -> Spectrum:
    """Return the spectrum of a group for each residual in `trials`, which have measured rows and prior rows."""
    left, _ = of.projected(group.effects)
    x = left * np.linalg.norm(of.columns(group.effects), axis=0) * np.array(group.spreads) / of.sigma
    s, turn = np.linalg.eigh(x.T @ x)
    return np.maximum(s, 0.0), turn, (trials.T / of.sigma) @ x @ turn


def _null(machines: Sequence[Residual], groups: Sequence[Group], rng: np.random.Generator, count: int) -> Array:
    """Return the largest pooled net gain of any group of effects on residuals permuted within each machine, nats."""
    trials, most = [of.permuted(rng, count) for of in machines], np.full(count, -np.inf)
    for group in groups:
        gains, _, _ = _with_common_mean(
            group, [_spectrum(of, group, t) for of, t in zip(machines, trials, strict=True)]
        )
        most = np.maximum(most, gains - group.cost)
    return most


def _exchanged(chosen: dict[str, Candidate], left: dict[str, Candidate], residuals: Residuals) -> dict[str, Candidate]:
    """Return the selected candidates, each exchanged for a typical candidate of `left` with a larger net gain in its
    place, the largest increase first; exchanged candidates leave `left` for good."""
    while len(chosen) > 1:
        full, gains = residuals(tuple(chosen.values())), dict[tuple[str, str], float]()
        for own, candidate in chosen.items():
            without = [of.without(candidate.effects) for of in full]
            nats = _typical(_groups({own: candidate, **left}, without), without)
            gains |= {(own, name): n - nats.get(own, 0.0) for name, n in nats.items() if name != own}
        own, name = max(gains, key=gains.__getitem__, default=("", ""))
        if not gains or gains[own, name] <= 0.0:
            return chosen
        chosen = {(name if n == own else n): left.pop(name) if n == own else c for n, c in chosen.items()}
    return chosen


def _groups(proposals: Mapping[str, Candidate], machines: Sequence[Residual]) -> dict[str, Group]:
    """Return the group of each candidate that all machines can have."""
    return {name: group for name, c in proposals.items() if (group := _common(c, machines)) is not None}


def _typical(groups: Mapping[str, Group], machines: Sequence[Residual]) -> dict[str, float]:
    """Return the pooled net gains of the typical groups."""
    scored = {name: pooled(machines, group) for name, group in groups.items()}
    return {name: score.nats for name, score in scored.items() if score.typical}


def _weeded(chosen: dict[str, Candidate], residuals: Residuals, criteria: Criteria) -> dict[str, Candidate]:
    """Delete candidates that fail the criteria given all others, the weakest first; return the remaining candidates."""
    while len(chosen) > 1:
        full = residuals(tuple(chosen.values()))
        nats = dict[str, float]()
        for name, candidate in chosen.items():
            without = [of.without(candidate.effects) for of in full]
            group = _common(candidate, without)
            score = pooled(without, group) if group is not None else PooledGroup(-np.inf, False)
            passes = group is not None and score.typical and _passes(without, group, score.nats, criteria)
            nats[name] = np.inf if passes else score.nats
        weakest = min(nats, key=nats.__getitem__)
        if nats[weakest] == np.inf:
            return chosen
        chosen = {name: c for name, c in chosen.items() if name != weakest}
    return chosen


def _passes(machines: Sequence[Residual], group: Group, nats: float, criteria: Criteria) -> bool:
    """Return whether the net gain and the cross-validated gain over all machines pass the criteria.

    The prediction errors of each machine are in units of its noise.
    """
    if nats <= criteria.minimum_nats:
        return False
    gains = [
        (cross_validated(of, ()).per_unit - cross_validated(of, group.effects).per_unit) / of.sigma**2
        for of in machines
    ]
    return paired_t(np.concatenate(gains)) > criteria.apart_cv_t


def _common(candidate: Candidate, machines: Sequence[Residual]) -> Group | None:
    """Return a candidate as one group for all machines, with averaged prior deviations; None if a machine lacks it."""
    try:
        groups = [group_of(candidate, Shapes(of.poses.states)) for of in machines]
    except InputError:
        return None
    if any(group is None or len(group.effects) < len(candidate.effects) for group in groups):
        return None
    known = [group for group in groups if group is not None]
    spreads = np.mean([group.spreads for group in known], axis=0)
    return replace(known[0], spreads=tuple(spreads.tolist()), cap=min(group.cap for group in known))


@dataclass(frozen=True)
class MachineFindings:
    """Effects found on one machine, and whether the machine's held-out poses confirm them."""

    candidates: tuple[Candidate, ...]
    confirmed: bool

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects found on one machine."""
        return frozenset(c.name for c in self.candidates)


@dataclass(frozen=True)
class FindingsFile:
    """Storage of the findings of each machine in a file, so that an interrupted run repeats only unfinished machines.

    files: files of the storage; None for no storage.
    """

    files: Unfinished | None = None

    def machine(self, name: str) -> MachineFindings | None:
        """Return the stored findings of one machine's search, or None if there are none."""
        content = self.files.read(name) if self.files else None
        return None if content is None else MachineFindings(tuple(content["found"]), bool(content["confirmed"]))

    def keep_machine(self, name: str, found: MachineFindings) -> None:
        """Store the findings of one machine. Raises WriteError if the file cannot be written."""
        if self.files:
            self.files.write(name, {"found": found.candidates, "confirmed": found.confirmed})


Rows = tuple[IntArray, IntArray]


@dataclass(frozen=True)
class MachineSearch:
    """Data of the search on one machine, sent to a worker process.

    rows: numbers of the training and held-out poses.
    known: effects that the machine's model contains before the search.
    """

    mechanism: Mechanism
    poses: Poses
    rows: Rows
    seed: int
    known: tuple[Candidate, ...] = ()

    def found(self) -> MachineFindings:
        """Search the catalogue for effects of one machine, without genetic programming."""
        result = discover(
            self.mechanism, self.poses, *self.rows, search=Search(runs=0, workers=1), known=self.known, seed=self.seed
        )
        return MachineFindings(tuple(finding.candidate for finding in result.findings), result.confirmed)

    def fit(self, shared: Sequence[Candidate]) -> Calibration:
        """Fit the geometric constants and the effects `shared` to the training poses of the machine."""
        effects = (*geometric_effects(self.mechanism), *(e for c in shared for e in c.effects))
        return calibrate(ErrorModel(self.mechanism, effects), self.poses.subset(self.rows[0]), seed=self.seed)

    def residual(self, shared: Sequence[Candidate], criteria: Criteria) -> Residual:
        """Return the residual of the training poses after a fit of the geometric constants and the effects `shared`."""
        return residual_of(self.fit(shared), self.poses.subset(self.rows[0]), criteria, FOLD_SEED)


@dataclass(frozen=True)
class FleetSearch:
    """The searches for effects on all machines.

    kept: storage of the findings of each machine. A machine with stored findings is not searched again.
    """

    serials: Sequence[str]
    tasks: Sequence[MachineSearch]
    workers: Workers
    kept: FindingsFile
    say: Reporter
    criteria: Criteria = field(default_factory=Criteria)

    def found(self, places: Sequence[int], known: tuple[Candidate, ...] = ()) -> dict[int, MachineFindings]:
        """Return {index: findings} of the machines with the indices `places`. known: effects in the models before the
        search."""
        names = {k: f"machine-{k + 1:04d}{'-again' if known else ''}" for k in places}
        done = {k: one for k, name in names.items() if (one := self.kept.machine(name)) is not None}
        left, which = [k for k in places if k not in done], "again, " if known else ""
        for number, one in self.workers(MachineSearch.found, [replace(self.tasks[k], known=known) for k in left]):
            self.kept.keep_machine(names[left[number]], one)
            done[left[number]] = one
            self.say(f"searching {which}{len(done)} of {len(names)} machines done", passing=True)
        return done

    def shared(self, found: Sequence[MachineFindings]) -> tuple[Candidate, ...]:
        """Return the effects of the type, or none if the held-out poses of all machines together do not confirm them.

        The pooled evidence of the training poses selects among the findings of all machines and the catalogue.
        """
        first = self.tasks[0]
        named = candidates(first.mechanism, first.poses.states)
        proposals: dict[str, Candidate] = {}
        for c in (*chain.from_iterable(one.candidates for one in found), *named):
            if not depends_on_time(c, first.poses.states):
                same = proposals.get(c.name)
                proposals[c.name] = c if same is None or len(c.effects) < len(same.effects) else same

        def residuals(shared: Sequence[Candidate]) -> list[Residual]:
            return [task.residual(shared, self.criteria) for task in self.tasks]

        chosen = select_for_type(proposals, residuals, self.criteria, first.seed)
        return chosen if chosen and self._confirmed(chosen) else ()

    def _confirmed(self, chosen: tuple[Candidate, ...]) -> bool:
        """Test the type's effects on held-out poses of all machines, with errors in units of each machine's noise."""
        errors, units, count = [], [], 0
        for task in self.tasks:
            fits, unseen = (task.fit(()), task.fit(chosen)), task.poses.subset(task.rows[1])
            errors.append([errors_on(fit, unseen) / fits[1].sigma for fit in fits])
            units.append(count + independent_blocks(unseen.dataset, self.criteria))
            count += len(unseen)
        before, after = np.concatenate(errors, axis=1)
        return paired(before, after, np.concatenate(units), self.criteria).passed


def found_on_type(search: FleetSearch) -> tuple[tuple[Effect, ...], tuple[tuple[Effect, ...], ...], str]:
    """Return the effects of the type, the additional effects of each machine, and a text on their origin.

    Every machine is searched alone. The evidence of all machines together selects the effects of the type. A machine
    with other findings is searched again given the effects of the type; confirmed new findings are its own effects.
    """
    everyone = range(len(search.tasks))
    search.say("searching every machine alone", passing=True)
    alone = search.found(everyone)
    search.say("selecting the effects of the type by all machines together", passing=True)
    shared = search.shared([alone[k] for k in everyone])
    names = frozenset(c.name for c in shared)
    again = search.found([k for k in everyone if alone[k].names != names], shared) if shared else {}
    last = [again.get(k, MachineFindings((), True) if shared else alone[k]) for k in everyone]
    own = [one.candidates if one.confirmed else () for one in last]
    counts = {c.name: sum(c.name in one.names for one in alone.values()) for c in shared}
    said = [f"{name} on all (by itself on {count})" for name, count in counts.items()]
    for name in dict.fromkeys(c.name for of in own for c in of):
        having = [s for s, of in zip(search.serials, own, strict=True) if name in {c.name for c in of}]
        said.append(f"{name} on {listed(having)}")
    source = f"selected from the catalogue by the evidence of {len(search.tasks)} machines together"
    chosen = f"{source}: {'; '.join(said) or 'none'}"
    effects = tuple(effect for c in shared for effect in c.effects)
    return effects, tuple(tuple(e for c in of for e in c.effects) for of in own), chosen
