"""Test the noise floor of repeated poses: other temperatures, and drift along the rows."""

import numpy as np
import pytest
from instances import some

import gpmodel as gp
from gpmodel.mechanism.branches import random_poses
from gpmodel.table.cells import joint_table


def test_the_noise_floor_of_repeats_at_other_temperatures_is_that_of_their_noise() -> None:
    arm, name = gp.load_mechanism("irb6400r"), "thermal growth of the arm (temperature)"
    q = np.repeat(random_poses(arm, 20, np.random.default_rng(1)), 2, axis=0)
    inputs = {"temperature [degC]": np.tile([20.0, 30.0], 20)}
    poses = joint_table(arm, q)
    table = gp.simulate(arm, poses=poses, effects=[f"{name}=1.2e-5"], inputs=inputs, noise="0.03 mm", seed=1).table
    floors = [gp.calibrate(arm, table, effects=own, standard=["none"]).record for own in ([], [name])]
    assert {record.noise_from for record in floors} == {"repeats"}
    assert floors[0].noise_floor_mm > 0.1
    assert floors[1].noise_floor_mm == pytest.approx(0.03 * np.sqrt(3), rel=0.3)


REPEATED: dict[str, tuple[float, bool, str | None]] = {
    "no drift": (0.0, True, "repeats"),
    "drift of a zero": (4e-4, True, "drift"),
    "drift between repeats in succession": (4e-4, False, "repeats"),
}


@pytest.mark.parametrize("case", some(REPEATED, "no drift", "drift of a zero"))
def test_repeats_that_drift_along_the_rows_are_no_noise_floor(case: str) -> None:
    drift, mixed, source = REPEATED[case]
    arm, rng = gp.load_mechanism("irb6400r"), np.random.default_rng(2)
    q = np.repeat(random_poses(arm, 30, rng), 3, axis=0)[rng.permutation(90) if mixed else slice(None)]
    effects = [f"J2.moving:Rz:row={drift / 90} rad"] if drift else []
    table = gp.simulate(arm, poses=joint_table(arm, q), effects=effects, noise="0.03 mm", seed=1).table
    record = gp.calibrate(arm, table, standard=["none"], holdout=0.0).record
    assert record.noise_from == source
    assert ("at the noise floor" in record.verdict) == (drift == 0.0)
    assert (record.noise_floor_mm or 0.03 * np.sqrt(3)) == pytest.approx(0.03 * np.sqrt(3), rel=0.3)
