"""A million texts made of good ones by a few edits: every reader reads or refuses in one line, in bounded time.

    python -m experiments.scale.fuzz --inputs 1000000

Tasks run in processes of their own, so that a reader that would take its process with it is noticed. Writes fuzz.json.
"""

import argparse
import json
import random
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from experiments.scale.mutations import edited, random_edits
from experiments.scale.readers import Reader, outcome, readers
from gpmodel.executor import Processes
from gpmodel.files import to_json

CHUNK = 500
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
    """How often each outcome, the texts of those that are neither read nor refused or slow, and the slowest's time."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--only", default=None)
    chosen = parser.parse_args()
    chunks = [
        Chunk(name, CHUNK, seed)
        for name, reader in readers().items()
        if chosen.only in (None, name)
        for seed in range(max(1, round(chosen.inputs * reader.share / CHUNK)))
    ]
    table = {c.name: {"inputs": 0, "read": 0, "refused": 0, "wrong": 0, "slowest_s": 0.0} for c in chunks}
    wrong: list[str] = []
    for done, (place, (counts, odd, slowest)) in enumerate(Processes(chosen.workers)(tried, chunks), 1):
        row = table[chunks[place].name]
        for key, count in counts.items():
            row[key] += count
            row["inputs"] += count
        row["slowest_s"] = max(row["slowest_s"], slowest)
        wrong += [f"{chunks[place].name}: {text}" for text in odd][: max(0, 100 - len(wrong))]
        if done % 100 == 0:
            print(f"{done} of {len(chunks)} chunks, {len(wrong)} odd", flush=True)
    total = sum(row["inputs"] for row in table.values())
    (Path(__file__).parent / "fuzz.json").write_text(to_json({"inputs": total, "readers": table, "odd": wrong}))
    print(json.dumps(table, indent=1))
    print("\n".join(wrong[:20]))


if __name__ == "__main__":
    main()
