"""Effects that the machines of a type have in common, and effects of each machine alone."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import paired
from gpmodel.evidence.dependence import reads_a_clock
from gpmodel.evidence.residual import Residual, independent_units, residual_of
from gpmodel.executor import Workers
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.hierarchy.pooled import select_for_type
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.progress import Teller
from gpmodel.records.unfinished import Unfinished
from gpmodel.table.split import JUDGED
from gpmodel.wording import listed


@dataclass(frozen=True)
class Found:
    """Findings of one machine's search, and whether its held-out poses confirm them."""

    candidates: tuple[Candidate, ...]
    confirmed: bool

    @property
    def names(self) -> frozenset[str]:
        """Names of the findings."""
        return frozenset(c.name for c in self.candidates)


@dataclass(frozen=True)
class KeptMachines:
    """Where the findings of a machine go at once, a file each, so that an interrupted fleet repeats only what was under
    way; nowhere without files."""

    files: Unfinished | None = None

    def machine(self, name: str) -> Found | None:
        """Findings of the search of that name, None where it is still to be made."""
        content = self.files.read(name) if self.files else None
        return None if content is None else Found(tuple(content["found"]), bool(content["confirmed"]))

    def keep_machine(self, name: str, found: Found) -> None:
        """Keep them. Raises WriteError where they cannot be written."""
        if self.files:
            self.files.write(name, {"found": found.candidates, "confirmed": found.confirmed})


Rows = tuple[IntArray, IntArray]


@dataclass(frozen=True)
class Searched:
    """One machine's search: all that a worker needs. rows: training and held-out ones of its poses. known: effects in
    its model from the start."""

    mechanism: Mechanism
    poses: Poses
    rows: Rows
    seed: int
    known: tuple[Candidate, ...] = ()

    def found(self) -> Found:
        """Search the catalogue alone."""
        result = discover(
            self.mechanism, self.poses, *self.rows, search=Search(runs=0, workers=1), known=self.known, seed=self.seed
        )
        return Found(tuple(finding.candidate for finding in result.findings), result.confirmed)

    def fit(self, shared: Sequence[Candidate]) -> Calibration:
        """Calibrate the training poses with effects beside the geometry."""
        effects = (*geometric_effects(self.mechanism), *(e for c in shared for e in c.effects))
        return calibrate(ErrorModel(self.mechanism, effects), self.poses.subset(self.rows[0]), seed=self.seed)

    def residual(self, shared: Sequence[Candidate], criteria: Criteria) -> Residual:
        """Residual of the training poses with effects beside the geometry."""
        return residual_of(self.fit(shared), self.poses.subset(self.rows[0]), criteria, JUDGED)


@dataclass(frozen=True)
class FleetSearch:
    """The searches of all machines. kept: where findings go at once; machines found there are not searched again."""

    serials: Sequence[str]
    tasks: Sequence[Searched]
    workers: Workers
    kept: KeptMachines
    say: Teller
    criteria: Criteria = field(default_factory=Criteria)

    def found(self, places: Sequence[int], known: tuple[Candidate, ...] = ()) -> dict[int, Found]:
        """Findings of the machines at some places, by place, given the `known` effects."""
        names = {k: f"machine-{k + 1:04d}{'-again' if known else ''}" for k in places}
        done = {k: one for k, name in names.items() if (one := self.kept.machine(name)) is not None}
        left, which = [k for k in places if k not in done], "again, " if known else ""
        for number, one in self.workers(Searched.found, [replace(self.tasks[k], known=known) for k in left]):
            self.kept.keep_machine(names[left[number]], one)
            done[left[number]] = one
            self.say(f"searching {which}{len(done)} of {len(names)} machines done", passing=True)
        return done

    def shared(self, found: Sequence[Found]) -> tuple[Candidate, ...]:
        """Effects of the type: selected by the pooled evidence of the training poses among the findings of all machines
        and the catalogue, where the held-out poses of all machines together confirm them."""
        first = self.tasks[0]
        named = candidates(first.mechanism, first.poses.states)
        proposals: dict[str, Candidate] = {}
        for c in (*chain.from_iterable(one.candidates for one in found), *named):
            if not reads_a_clock(c, first.poses.states):
                same = proposals.get(c.name)
                proposals[c.name] = c if same is None or len(c.effects) < len(same.effects) else same

        def residuals(shared: Sequence[Candidate]) -> list[Residual]:
            return [task.residual(shared, self.criteria) for task in self.tasks]

        chosen = select_for_type(proposals, residuals, self.criteria, first.seed)
        return chosen if chosen and self._confirmed(chosen) else ()

    def _confirmed(self, chosen: tuple[Candidate, ...]) -> bool:
        """Paired test on the held-out poses of all machines, errors in units of each machine's noise."""
        errors, units, count = [], [], 0
        for task in self.tasks:
            fits, unseen = (task.fit(()), task.fit(chosen)), task.poses.subset(task.rows[1])
            errors.append([errors_on(fit, unseen) / fits[1].sigma for fit in fits])
            units.append(count + independent_units(unseen.dataset, self.criteria))
            count += len(unseen)
        before, after = np.concatenate(errors, axis=1)
        return paired(before, after, np.concatenate(units), self.criteria).passed


def found_on_type(search: FleetSearch) -> tuple[tuple[Effect, ...], tuple[tuple[Effect, ...], ...], str]:
    """Effects of the type, of each machine what it has beside them, and in words where both are from.

    Every machine is searched by itself. The type's effects are selected by the evidence of all machines together. A
    machine whose findings are others than these is searched again given them: what is confirmed there is its own.
    """
    everyone = range(len(search.tasks))
    search.say("searching every machine by itself", passing=True)
    alone = search.found(everyone)
    search.say("selecting the effects of the type by all machines together", passing=True)
    shared = search.shared([alone[k] for k in everyone])
    names = frozenset(c.name for c in shared)
    again = search.found([k for k in everyone if alone[k].names != names], shared) if shared else {}
    last = [again.get(k, Found((), True) if shared else alone[k]) for k in everyone]
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
