"""What an interrupted discovery leaves: text that reads back as it was, and is refused when damaged."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_cases import numbers
from loop_cases import QUICK, found, quick, robot

from gpmodel.discovery import checkpoint
from gpmodel.discovery.loop import discover
from gpmodel.errors import InputError

REQUEST = {"table": "cell.csv", "seed": 3, "noise": None, "choice": {"name": "irb6400r", "payload": 1.5}}


@pytest.mark.parametrize("case", ["windup", "nothing"])
def test_what_is_saved_reads_back_to_the_bit(case: str, tmp_path: Path) -> None:
    answer = found(case, 0)
    checkpoint.save(tmp_path, REQUEST, answer.findings, answer.rounds)
    request, findings, rounds = checkpoint.load(tmp_path)
    assert request == REQUEST
    assert tuple(findings) == answer.findings
    assert len(rounds) == len(answer.rounds)
    for one, other in zip(rounds, answer.rounds, strict=True):
        assert one.hypotheses == other.hypotheses
        assert one.exploration.candidates == other.exploration.candidates
        assert one.exploration.histogram == other.exploration.histogram
        np.testing.assert_array_equal(one.exploration.null_nats, other.exploration.null_nats)


def test_a_run_resumed_from_the_file_gives_the_same_numbers(tmp_path: Path) -> None:
    truth, train, heldout = robot("gear", 0)
    first = quick().rounds[:1]
    checkpoint.save(tmp_path, REQUEST, [f for f in quick().findings if f.round == 1], first)
    _, findings, rounds = checkpoint.load(tmp_path)
    resumed = discover(
        truth.model.mechanism, truth.poses, train, heldout, search=QUICK, resume=(findings, rounds)
    )  # fmt: skip
    assert numbers(resumed) == numbers(quick())


def test_numbers_that_are_not_finite_survive(tmp_path: Path) -> None:
    first = quick().rounds[0]
    exploration = replace(first.exploration, null_nats=np.array([-np.inf, np.inf, np.nan, 1.0]))
    checkpoint.save(tmp_path, REQUEST, (), (replace(first, exploration=exploration),))
    _, _, (again,) = checkpoint.load(tmp_path)
    np.testing.assert_array_equal(again.exploration.null_nats, [-np.inf, np.inf, np.nan, 1.0])
    text = (tmp_path / checkpoint.NAME).read_text()
    assert not json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON")).get("missing")


def test_it_is_text_and_is_written_whole(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, REQUEST, quick().findings, quick().rounds)
    assert [p.name for p in tmp_path.iterdir()] == [checkpoint.NAME]
    assert json.loads((tmp_path / checkpoint.NAME).read_text())["schema"] == checkpoint.SCHEMA


DAMAGE: dict[str, Callable[[str], str]] = {
    "cut": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "other json": lambda text: "[1, 2]",
    "no rounds": lambda text: text.replace('"rounds"', '"turns"'),
    "unknown type": lambda text: text.replace('"type": "Round"', '"type": "Path"'),
    "missing field": lambda text: text.replace('"number"', '"nummer"'),
    "code": lambda text: text.replace("sin(2*J4)", "__import__('os')"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_file_is_one_clear_line(kind: str, tmp_path: Path) -> None:
    checkpoint.save(tmp_path, REQUEST, quick().findings, quick().rounds)
    path = tmp_path / checkpoint.NAME
    text = DAMAGE[kind](path.read_text())
    assert text != path.read_text()
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        checkpoint.load(tmp_path)
    assert "\n" not in str(caught.value)


def test_another_schema_and_an_empty_folder_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no progress.json; expected the folder of an interrupted discover"):
        checkpoint.load(tmp_path)
    (tmp_path / checkpoint.NAME).write_text('{"schema": 99}')
    with pytest.raises(InputError, match="schema 99; this version resumes schema"):
        checkpoint.load(tmp_path)
