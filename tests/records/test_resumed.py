"""An interrupted loop goes on from its finished runs, to the same numbers."""

from pathlib import Path

import pytest
from effect_cases import numbers
from loop_cases import QUICK, quick, robot

from gpmodel.discovery.loop import discover
from gpmodel.records.run_files import RunFiles
from gpmodel.records.unfinished import Unfinished


class Interrupted(Exception):
    pass


LONG = [pytest.param(moment, marks=pytest.mark.long) for moment in ("round 2", "round 2: evolving, 1 of")]


@pytest.mark.long
@pytest.mark.parametrize("moment", ["round 1: evolving, 1 of", *LONG])
def test_an_interrupted_run_goes_on_to_the_same_numbers(moment: str, tmp_path: Path) -> None:
    truth, train, heldout = robot("gear", 0)
    notes = RunFiles(Unfinished(tmp_path, {}, {}))

    def say(text: str) -> None:
        if str(text).startswith(moment):
            raise Interrupted

    with pytest.raises(Interrupted):
        discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, progress=say, kept=notes)
    done = {path: path.stat().st_mtime_ns for path in notes.files.folder.glob("run-*")}
    assert max(path.name for path in done).startswith("run-2" if "2: evolving" in moment else "run-1")
    resumed = discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, kept=notes)
    assert numbers(resumed) == numbers(quick())
    assert {path: path.stat().st_mtime_ns for path in done} == done
