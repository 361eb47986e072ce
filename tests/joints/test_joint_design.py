"""Test that the saved design experiment equals the result of its script."""

import importlib.util
import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

HERE = Path(__file__).parents[2] / "experiments" / "joint_design"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict:
    spec = importlib.util.spec_from_file_location("joint_design_run", HERE / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    out = tmp_path_factory.mktemp("design")
    module.main(out)
    assert sorted(p.name for p in (out / "figures").iterdir()) == sorted(p.name for p in (HERE / "figures").iterdir())
    return json.loads((out / "results.json").read_text())


def test_the_optimum_of_tables_3_1_and_4_1_comes_out_whole(results: dict) -> None:
    assert (results["table_3_1_and_4_1"]["matching"], results["table_3_1_and_4_1"]["cells"]) == (42, 42)


def test_the_design_guide_of_table_4_2_misses_three_named_cells(results: dict) -> None:
    table = results["table_4_2"]
    assert (table["matching"], table["cells"]) == (85, 88)
    assert [(d["row"], d["column"]) for d in table["differences"]] == [
        (42, "orifice_atm"),
        (48, "resistance_ratio"),
        (50, "orifice_atm"),
    ]


def test_every_single_figure_comes_out(results: dict) -> None:
    assert all(figure["matches"] for figure in results["figures"])


def test_the_committed_results_are_the_computed_ones(results: dict) -> None:
    def close(committed: object, computed: object) -> bool:
        if isinstance(committed, dict) and isinstance(computed, dict):
            return committed.keys() == computed.keys() and all(close(committed[k], computed[k]) for k in committed)
        if isinstance(committed, list) and isinstance(computed, list):
            return len(committed) == len(computed) and all(map(close, committed, computed))
        if isinstance(committed, float):
            return computed == pytest.approx(committed, rel=1e-6, abs=1e-12)
        return committed == computed

    committed = json.loads((HERE / "results.json").read_text())
    made_by = {"versions"}  # what computed the committed ones, another version or processor as may be
    assert close({k: v for k, v in committed.items() if k not in made_by}, {
        k: v for k, v in results.items() if k not in made_by
    })  # fmt: skip
