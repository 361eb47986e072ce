"""Test every reader on a million edited texts: read or refused in one line, in bounded time.

    python -m experiments.scale.fuzz --inputs 1000000

Tasks run in processes of their own, so that a reader that would take its process with it is noticed. fuzz.json is
written now and then; started again, texts that were not tried yet are added until all inputs are together.
"""

import json
import random
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from experiments.options import parsed
from experiments.scale.readers import Reader, edited, outcome, random_edits, readers
from gpmodel.executor import Forks
from gpmodel.files import to_json

FILE = Path(__file__).parent / "fuzz.json"
CHUNK = 500
SAVED = 20
"""Chunks after which the counts are written."""

SLOW = 2.0
"""Seconds of processor time for which a text is kept."""


@dataclass(frozen=True)
class Chunk:
    """Texts for one reader: its name, how many, and the seed they are made from."""

    name: str
    count: int
    seed: int


@cache
def _reader(name: str) -> Reader:
    return readers()[name]


def tried(chunk: Chunk) -> tuple[Counter[str], list[str], float]:
    """Count the outcomes; return also texts that are neither read nor refused or are slow, and the slowest time."""
    reader, counts, odd, slowest = _reader(chunk.name), Counter[str](), [], 0.0
    place = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(chunk.count):
            rng = random.Random(chunk.seed * CHUNK + number)
            text = edited(rng.choice(reader.good), random_edits(rng))
            began = time.process_time()
            said = outcome(reader, text, Path(folder))
            taken = time.process_time() - began
            slowest = max(slowest, taken)
            counts[said if said in ("read", "refused") else "wrong"] += 1
            if said not in ("read", "refused") or taken > SLOW:
                odd.append(f"{taken:.1f} s, {said}: {text[:2000]!r}")
    return counts, odd, slowest


@dataclass(frozen=True)
class Tally:
    """Totals of all readers; chunks: number of chunks made, tried or lost for each reader."""

    chunks: Counter[str]
    readers: dict[str, dict[str, float]]
    odd: list[str]

    @staticmethod
    def read() -> "Tally":
        """That of fuzz.json."""
        content = json.loads(FILE.read_text()) if FILE.exists() else {"chunks": {}, "readers": {}, "odd": []}
        return Tally(Counter(content["chunks"]), content["readers"], content["odd"])

    def add(self, chunk: Chunk, counts: Counter[str], odd: list[str], slowest: float) -> None:
        """Count one chunk more."""
        row = self.readers.setdefault(chunk.name, {"inputs": 0, "read": 0, "refused": 0, "wrong": 0, "slowest_s": 0.0})
        for key, count in counts.items():
            row[key] += count
            row["inputs"] += count
        row["slowest_s"] = max(row["slowest_s"], slowest)
        self.chunks[chunk.name] = max(self.chunks[chunk.name], chunk.seed + 1)
        self.odd.extend(f"{chunk.name}: {text}" for text in odd[: max(0, 100 - len(self.odd))])

    def write(self) -> None:
        """Into fuzz.json."""
        total = sum(row["inputs"] for row in self.readers.values())
        content = {"inputs": total, "chunks": self.chunks, "readers": self.readers, "odd": self.odd}
        FILE.write_text(to_json(content))


def missing(tally: Tally, inputs: int, only: str) -> list[Chunk]:
    """List the chunks that remain until `inputs` inputs are tried, alternating between readers."""
    ordered = []
    for name, reader in readers().items():
        done = tally.readers.get(name, {"inputs": 0})["inputs"]
        count = round((inputs * reader.share - done) / CHUNK) if only in ("", name) else 0
        ordered += [(k / count, Chunk(name, CHUNK, tally.chunks[name] + k)) for k in range(count)]
    return [chunk for _, chunk in sorted(ordered, key=lambda pair: pair[0])]


def main() -> None:
    chosen = parsed(__doc__, inputs=1_000_000, workers=0, only="")
    tally = Tally.read()
    chunks = missing(tally, chosen.inputs, chosen.only)
    for done, (place, found) in enumerate(Forks(chosen.workers)(tried, chunks), 1):
        tally.add(chunks[place], *found)
        if done % SAVED == 0 or done == len(chunks):
            tally.write()
            print(f"{done} of {len(chunks)} chunks, {len(tally.odd)} odd", flush=True)
    print(json.dumps(tally.readers, indent=1))
    print("\n".join(tally.odd[:20]))


if __name__ == "__main__":
    main()
