"""Tables that predict and compensate wrote, given to them again: new results replace old ones of their names."""

from functools import cache
from pathlib import Path

import pandas as pd
import pytest
from cli_cases import robot, run, table, write

from gpmodel.api.calibrate import calibrate


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two models of one table that predict other points."""
    folder = tmp_path_factory.mktemp("models")
    mechanism, made = robot(40)
    for name, kept in (("a", 40), ("b", 30)):
        calibrate(mechanism, made.dataset[:kept], []).model.save(folder / f"{name}.json")
    return folder / "a.json", folder / "b.json"


@cache
def measured() -> pd.DataFrame:
    return table(6)


@pytest.mark.parametrize("command", ["predict", "compensate"])
@pytest.mark.parametrize("columns", ["joints", pytest.param("all", marks=pytest.mark.long)])
def test_another_model_on_the_output_of_the_first_gives_its_own_numbers(
    command: str, columns: str, models: tuple[Path, Path], tmp_path: Path
) -> None:
    first, second = models
    given = measured() if columns == "all" else measured().filter(like="J").assign(note="first", status="bad")
    write(given, tmp_path / "given.csv")
    wanted = tmp_path / "wanted.csv"
    for model, source, out in ((first, "given", "once"), (second, "once", "twice"), (second, "given", "wanted")):
        done = run(command, model, tmp_path / f"{source}.csv", "--out", tmp_path / f"{out}.csv")
        assert done.exit_code == 0, done.stderr
    once, twice, wanted = (pd.read_csv(tmp_path / f"{name}.csv", dtype=str) for name in ("once", "twice", "wanted"))
    if command == "predict" and columns == "joints":  # x, y, z stand in the table now, as if they were measured
        wanted = wanted.rename(columns={f"{a} [mm]": f"predicted_{a} [mm]" for a in "xyz"})
        twice = twice.drop(columns=[f"{a} [mm]" for a in "xyz"])
    assert set(twice) == set(wanted)
    pd.testing.assert_frame_equal(twice[list(wanted)], wanted)
    assert not once.filter(regex="^corrected_|^predicted_|^sigma").equals(
        twice.filter(regex="^corrected_|^predicted_|^sigma")
    )
    assert (
        twice[list(given.columns.drop("status", errors="ignore"))] == given.drop(columns="status", errors="ignore")
    ).all(axis=None)


@pytest.mark.parametrize("stale", [{"corrected_J1 [deg]": 77}, {"corrected_J1 [rad]": 1.5}, {"status": "bad"}])
def test_a_stale_result_among_targets_is_no_result(
    stale: dict[str, object], models: tuple[Path, Path], tmp_path: Path
) -> None:
    targets = measured().filter(like="J")
    outputs = []
    for frame in (targets, targets.assign(**stale)):
        write(frame, tmp_path / "targets.csv")
        done = run("compensate", models[0], tmp_path / "targets.csv")
        assert done.exit_code == 0, done.stderr
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1]


def test_compensate_states_the_error_of_orientation_that_remains(models: tuple[Path, Path], tmp_path: Path) -> None:
    write(measured().filter(like="J").assign(**{"J5 [deg]": 0.02}), tmp_path / "targets.csv")
    done = run("compensate", models[0], tmp_path / "targets.csv", "--out", tmp_path / "corrected.csv")
    remains = pd.read_csv(tmp_path / "corrected.csv")["residual_turn [mrad]"].max()
    assert remains > 1e-2
    assert f"up to {remains:.4f} mrad of the orientation not reached" in " ".join(done.output.split())
