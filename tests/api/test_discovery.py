"""`gp.discover` and `gp.evolve`: the same as the commands, and what their results offer."""

import json
from functools import partial
from importlib.resources import files
from pathlib import Path
from unittest import mock

import pandas as pd
import pytest
from cli_cases import run, table, write

import gpmodel as gp
from gpmodel.api.discover import DiscoveryResult

DEMO = Path(str(files("gpmodel") / "data" / "demo.csv"))
SMALL = partial(gp.Search, population=48, generations=4)
GEAR = table(70, effects=("gear_harmonic J4=200 arcsec",))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(GEAR, tmp_path_factory.mktemp("table") / "rows.csv")


@pytest.fixture(scope="module")
def found(rows: Path) -> DiscoveryResult:
    return gp.discover(gp.load_mechanism("irb6400r"), rows, search=SMALL(runs=1), noise="0.03 mm", holdout=0.3)


def comparable(folder: Path) -> dict[str, object]:
    report = json.loads((folder / "report.json").read_text())
    return {key: value for key, value in report.items() if key not in ("seconds", "command")}


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_it_gives_what_the_command_gives_whatever_the_number_of_workers(
    found: DiscoveryResult, rows: Path, tmp_path: Path
) -> None:
    with mock.patch("gpmodel.cli.discover.Search", SMALL):
        command = run(
            "discover", rows, "--mechanism", "irb6400r", "--runs", 1, "--noise", "0.03mm", "--holdout", 0.3,
            "--workers", 1, "--out", tmp_path / "command", "--quiet",
        )  # fmt: skip
    assert command.exit_code == 0, command.output
    found.save(tmp_path / "report.json")
    found.model.save(tmp_path / "model.json")
    assert comparable(tmp_path) == comparable(tmp_path / "command")
    assert (tmp_path / "model.json").read_text() == (tmp_path / "command" / "model.json").read_text()


@pytest.mark.slow
def test_on_the_shipped_demo_the_default_search_finds_the_compliance_and_gives_what_the_command_gives(
    tmp_path: Path,
) -> None:
    assert run("demo", "--out", tmp_path / "command", "--quiet").exit_code == 0
    arm = gp.load_mechanism("irb6400r")
    found = gp.discover(arm, gp.read_table(DEMO, arm))
    found.save(tmp_path / "report.json")
    assert comparable(tmp_path) == comparable(tmp_path / "command")
    assert [f.name for f in found.findings] == ["joint compliance, J5"]
    assert found.record.ladder[-1].heldout.rms_mm == pytest.approx(0.036, abs=0.001)


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_result_says_what_was_found_and_keeps_it(found: DiscoveryResult, tmp_path: Path) -> None:
    assert [f.name for f in found.findings] == ["gear error, 2 per turn, J4"]
    assert found.verdict in " ".join(found.summary().split())
    rows = found.to_dataframe()
    assert rows.loc[0, "unit"] == "rad"
    assert rows.loc[0, "value"] > 3 * rows.loc[0, "stderr"]
    assert repr(found) == "<discovery on rows.csv: added gear error, 2 per turn, J4>"
    assert "<table" in found._repr_html_()
    found.report(tmp_path / "out")
    found.save(tmp_path / "found.json")
    kept, written = (json.loads((tmp_path / name).read_text()) for name in ("found.json", "out/report.json"))
    assert written["exports"]
    assert kept == written
    found.model.save(tmp_path / "model.json")
    assert gp.load_model(tmp_path / "model.json").misses(GEAR).mean() < 0.1


@pytest.mark.long
def test_own_families_and_effects_are_judged_like_all_others() -> None:
    arm = gp.load_mechanism("irb6400r")
    said: list[str] = []
    mine = gp.effect_at("cable drag", "J4.moving", "Rx", gp.Expression("tanh(3*sin(J4))*J2"))
    measured = table(70, effects=("J4.moving:Rx:tanh(3*sin(J4))*J2=0.5 mrad",))
    found = gp.discover(
        arm,
        measured,
        search=SMALL(runs=1),
        holdout=0.3,
        candidates=(*gp.catalogue, mine),
        progress=lambda say: said.append(str(say)),
    )
    assert [f.name for f in found.findings] == [mine.name]
    assert found.findings[0].value == pytest.approx(5e-4, rel=0.05)
    assert any("round 1: evolving" in line for line in said)
    strict = gp.Criteria(minimum_nats=1e9)
    assert gp.discover(arm, measured, search=SMALL(runs=1), holdout=0.3, criteria=strict).findings == ()


@pytest.mark.long
def test_evolving_gives_runs_beside_those_on_shuffled_errors(tmp_path: Path) -> None:
    arm = gp.load_mechanism("irb6400r")
    result = gp.evolve(arm, GEAR, space="slot", strategies=(gp.Linear(),), runs=2, population=64, generations=3)
    assert len(result.to_dataframe()) == 4
    assert set(result.inputs().columns) == {"input", "linear", "linear shuffled", "p_value"}
    path = write(GEAR, tmp_path / "t.csv")
    command = run(
        "evolve", path, "--mechanism", "irb6400r", "--space", "slot", "--representation", "linear", "--runs", 2,
        "--population", 64, "--generations", 3, "--out", tmp_path / "command",
    )  # fmt: skip
    assert command.stdout.startswith(result.summary())
    assert (tmp_path / "command" / "programs.txt").read_text() == result.programs()


WRONG = {
    "search": lambda arm: gp.discover(arm, GEAR, search=4),
    "criteria": lambda arm: gp.discover(arm, GEAR, criteria="strict"),
    "noise": lambda arm: gp.discover(arm, GEAR, noise=0.0),
    "holdout": lambda arm: gp.discover(arm, GEAR, holdout=0),
    "seed": lambda arm: gp.discover(arm, GEAR, seed=0.5),
    "condition_limit": lambda arm: gp.discover(arm, GEAR, condition_limit=0),
    "candidates": lambda arm: gp.discover(arm, GEAR, candidates=("gear",)),
    "table": lambda arm: gp.discover(arm, pd.DataFrame()),
    "runs": lambda arm: gp.evolve(arm, GEAR, runs=0),
    "workers": lambda arm: gp.discover(arm, GEAR, search=gp.Search(workers=0)),
    "stop_after": lambda arm: gp.discover(arm, GEAR, search=gp.Search(stop_after=float("nan"))),
    "max_effects": lambda arm: gp.discover(arm, GEAR, search=gp.Search(max_effects=-1)),
    "strategies": lambda arm: gp.discover(arm, GEAR, search=gp.Search(strategies=())),
    "significance": lambda arm: gp.discover(arm, GEAR, criteria=gp.Criteria(significance=float("nan"))),
    "effects": lambda arm: gp.calibrate(arm, GEAR, effects="base_compliance"),
    "space": lambda arm: gp.evolve(arm, GEAR, space="outer"),
    "population": lambda arm: gp.evolve(arm, GEAR, population=20),
}


@pytest.mark.parametrize("argument", WRONG)
def test_what_is_wrong_with_an_argument_is_one_line_that_names_it(argument: str) -> None:
    with pytest.raises(gp.InputError) as caught:
        WRONG[argument](gp.load_mechanism("irb6400r"))  # type: ignore[no-untyped-call]
    assert str(caught.value).startswith(f"{argument}: ")
    assert "\n" not in str(caught.value)
