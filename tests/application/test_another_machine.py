"""Test tables and models of another machine with equal joint names."""

from pathlib import Path

import pandas as pd
import pytest
from cli_cases import table
from model_cases import fitted

import gpmodel as gp
from gpmodel.application.model_file import save_model


@pytest.mark.long
@pytest.mark.parametrize(
    ("other", "range_share", "said"),
    [
        ("ur10", 1.0, "expected a table of irb6400r"),
        ("irb6400r-2.8", 0.3, "do not fit the model of irb6400r, which leaves"),
    ],
)
def test_positions_of_another_machine_are_refused_though_its_joints_have_the_same_names(
    other: str, range_share: float, said: str, tmp_path: Path
) -> None:
    save_model(tmp_path / "model.json", fitted("geometry")[0])
    model = gp.load_model(tmp_path)
    poses = range_share * table(30, seed=3).filter(regex="^J").astype(float)
    there, here = (
        gp.simulate(arm, poses=poses, seed=3).to_dataframe().filter(regex="mm") for arm in (other, "irb6400r")
    )
    for use in (model.predict, model.compensate):
        assert len(use(poses)) == len(use(pd.concat([poses, here], axis=1))) == 30
        with pytest.raises(gp.InputError, match=said):
            use(pd.concat([poses, there], axis=1))
    with pytest.raises(gp.InputError, match="irb6400r"):
        model.verify(pd.concat([poses, there], axis=1))


def test_a_model_of_another_machine_is_named_by_its_own(tmp_path: Path) -> None:
    save_model(tmp_path / "model.json", fitted("geometry")[0])
    with pytest.raises(gp.InputError, match="a model of 'irb6400r'; expected one of irb6400r-2"):
        gp.load_model(tmp_path, "irb6400r-2.8")
