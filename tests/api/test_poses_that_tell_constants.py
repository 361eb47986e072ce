"""Next poses distinguish a constant of the standard model from its alternatives."""

from pathlib import Path

import numpy as np
import pytest
from spherical_cases import JOINT, OFFSETS

import gpmodel as gp
from experiments.spherical_joint.rig import Rig
from gpmodel.report.saved import read_report
from gpmodel.table.write import frame_of


@pytest.mark.long
def test_ten_poses_after_a_calibration_tell_a_constant_from_what_it_could_be(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rig = Rig(JOINT, parameters=OFFSETS)
    first = rig.poses(31, rng)
    gp.calibrate("spherical-joint", frame_of(rig.measure(first, rng), JOINT)).report(tmp_path)
    (mimic,) = read_report(tmp_path).mimics
    chosen = gp.choose_poses(count=10, after=tmp_path, criterion="rivals")
    assert f"{mimic.constant} or {mimic.rival}" in chosen.said
    more = rig.measure(np.vstack([first, chosen.q]), np.random.default_rng(1))
    assert mimic not in gp.calibrate("spherical-joint", frame_of(more, JOINT)).record.mimics
