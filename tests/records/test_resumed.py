"""An interrupted loop goes on from what its journal has, to the same numbers."""

import pytest
from effect_cases import numbers
from loop_cases import QUICK, SMALL, Notes, found, quick, robot

from gpmodel.discovery.loop import discover


class Interrupted(Exception):
    pass


LONG = [pytest.param(moment, marks=pytest.mark.long) for moment in ("round 2", "round 2: evolving, 1 of")]


@pytest.mark.parametrize("moment", ["round 1: evolving, 1 of", *LONG])
def test_an_interrupted_run_goes_on_to_the_same_numbers(moment: str) -> None:
    truth, train, heldout = robot("gear", 0)
    notes = Notes()

    def say(text: str) -> None:
        if str(text).startswith(moment):
            raise Interrupted

    with pytest.raises(Interrupted):
        discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, progress=say, journal=notes)
    assert len(notes.rounds) == int(moment[6]) - 1
    assert bool(notes.runs)
    done = sum(number[0] > len(notes.rounds) for number in notes.runs)
    resumed = discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, journal=notes)
    assert numbers(resumed) == numbers(quick())
    assert notes.found_again == done


def test_a_finished_run_resumed_searches_no_more() -> None:
    truth, train, heldout = robot("nothing", 0)
    done = found("nothing", 0)
    said: list[str] = []
    again = discover(
        truth.model.mechanism, truth.poses, train, heldout, search=SMALL, progress=said.append,
        journal=Notes(done.findings, done.rounds),
    )  # fmt: skip
    assert numbers(again) == numbers(done)
    assert not any(str(text).startswith("round") for text in said)
