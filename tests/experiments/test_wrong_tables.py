"""Wrong tables that nobody notices, and hostile values that end in anything but one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.wrong_tables.conventions import CURES, named
from experiments.wrong_tables.kinds import KINDS, measured
from experiments.wrong_tables.run import SOUND, judged

ROOT = Path(__file__).parents[2] / "experiments"


def results(name: str) -> dict[str, Any]:
    return dict(json.loads((ROOT / name / "results.json").read_text(encoding="utf-8")))


def test_at_most_two_percent_of_the_wrong_tables_are_silent_and_no_sound_one_is_refused() -> None:
    found, said = results("wrong_tables"), (ROOT / "wrong_tables/README.md").read_text(encoding="utf-8")
    assert found["silent"] <= 0.02 * found["wrong tables"]
    assert not found["refused"]
    counts = [sum(kind.get(word, 0) for kind in found["kinds"].values()) for word in ("refused", "unfit", "warned")]
    assert f"| | {' | '.join(map(str, [*counts, found['silent']]))} |" in said
    assert set(found["kinds"]) == set(KINDS)


def test_of_thirty_wrong_conventions_twenty_eight_are_named_with_the_cure() -> None:
    found = json.loads((ROOT / "wrong_tables/conventions.json").read_text(encoding="utf-8"))
    said = (ROOT / "wrong_tables/README.md").read_text(encoding="utf-8")
    assert set(found["not named on"]) == set(CURES)
    assert found["named on every arm"] >= 28 / 30 * len(CURES)
    assert f"| now (3 arms) | {found['named on every arm']} |" in said


@pytest.mark.long
@pytest.mark.parametrize("kind", ["zero of J2 off by 90 deg", "J1, J4, J6 flipped", "Euler ZYZ"])
def test_a_wrong_convention_is_named(kind: str) -> None:
    right, said = named(measured("ur3", 7, offset=1.5e-3), kind, 7)
    assert right, said


@pytest.mark.long
@pytest.mark.parametrize("kind", ["last joint shuffled", "two tools, 2 mm apart, from row 30 on", "J3 - J2"])
def test_a_wrong_table_is_noticed(kind: str) -> None:
    table = KINDS[kind](measured("ur3", 7, offset=1.5e-3), np.random.default_rng(7))
    assert judged(table)[0] != "silent"


@pytest.mark.long
@pytest.mark.parametrize("k", [1, 30, 65])
def test_a_sound_table_is_not_refused(k: int) -> None:
    assert judged(measured("panda", k, **SOUND[k]))[0] in ("silent", "warned")
