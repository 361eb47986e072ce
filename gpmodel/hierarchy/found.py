"""Which effects the machines of a type have in common: what the search finds on most of them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from gpmodel.arrays import IntArray
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.executor import Workers
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.progress import Teller
from gpmodel.records.unfinished import Unfinished
from gpmodel.wording import listed


@dataclass(frozen=True)
class KeptMachines:
    """Where what was found on a machine goes at once, a file each, so that an interrupted fleet repeats only what was
    under way; nowhere without files."""

    files: Unfinished | None = None

    def machine(self, place: int) -> tuple[Candidate, ...] | None:
        """What was found on the machine at that place, None where it has yet to be searched."""
        content = self.files.read(_name(place)) if self.files else None
        return None if content is None else content["found"]

    def keep_machine(self, place: int, found: tuple[Candidate, ...]) -> None:
        """Keep it. Raises WriteError where it cannot be written."""
        if self.files:
            self.files.write(_name(place), {"found": found})


def _name(place: int) -> str:
    return f"machine-{place + 1:04d}"


Rows = tuple[IntArray, IntArray]


@dataclass(frozen=True)
class Searched:
    """One machine's search: all that a worker needs. rows: training and held-out ones of its poses."""

    mechanism: Mechanism
    poses: Poses
    rows: Rows
    seed: int

    def found(self) -> tuple[Candidate, ...]:
        """What the catalogue alone finds, where its held-out poses confirm it."""
        result = discover(self.mechanism, self.poses, *self.rows, search=Search(runs=0, workers=1), seed=self.seed)
        return tuple(finding.candidate for finding in result.findings) if result.confirmed else ()


def found_on_most(
    serials: Sequence[str], tasks: Sequence[Searched], workers: Workers, kept: KeptMachines, say: Teller
) -> tuple[tuple[Effect, ...], tuple[tuple[Effect, ...], ...], str]:
    """Effects found and confirmed on more than half of the machines, each searched by itself with the catalogue alone;
    of each machine what it has beside these; and in words where they are from: on which machines each thing was found.

    workers: where the machines are searched. kept: where what is found goes at once; machines found there are not
    searched again. Where machines found a curve in more or less detail, the plainest is
    taken, which all of them can tell.
    """
    by_machine = {place: done for place in range(len(tasks)) if (done := kept.machine(place)) is not None}
    left = [place for place in range(len(tasks)) if place not in by_machine]
    say("searching every machine by itself", passing=True)
    for number, candidates in workers(Searched.found, [tasks[place] for place in left]):
        kept.keep_machine(left[number], candidates)
        by_machine[left[number]] = candidates
        say(f"searching, {len(by_machine)} of {len(tasks)} machines done", passing=True)
    found = [candidate for place in range(len(tasks)) for candidate in by_machine[place]]
    counts = Counter(candidate.name for candidate in found)
    common = [name for name, count in counts.items() if 2 * count > len(tasks)]
    plainest = [min((c for c in found if c.name == name), key=lambda c: len(c.effects)) for name in common]
    shared = tuple(effect for candidate in plainest for effect in candidate.effects)
    own = tuple(
        tuple(e for c in by_machine[place] if c.name not in common for e in c.effects) for place in range(len(tasks))
    )
    on = {n: [serials[k] for k in range(len(tasks)) if any(c.name == n for c in by_machine[k])] for n in counts}
    said = {name: str(len(serials)) if name in common else listed(serials) for name, serials in on.items()}
    where = "; ".join(f"{name} on {said[name]}" for name, _ in counts.most_common())
    chosen = f"found on more than half of {len(tasks)} machines, by the catalogue alone: {where or 'nothing on any'}"
    return shared, own, chosen
