"""The shape of a finding."""

from dataclasses import replace

import numpy as np
from effect_cases import measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.report.shapes import shape_record


def test_where_rotations_were_measured_they_say_what_the_last_joint_does() -> None:
    """Its lever is that of the tool, which may be short: without them the points alone have to say it."""
    effect = drive_effect("true", mechanism("irb6400r").joints[5], Expression("sin(J6)"))
    truth = measure("irb6400r", [effect], [1e-3], 4, see=("position", "rotation"))
    fit = calibrate(truth.model, truth.poses)
    points = replace(truth.poses.dataset, rotation=np.full((len(truth.poses), 3), np.nan))
    candidate, heldout = Candidate("true", (effect,), "", 4.0), np.zeros(len(truth.poses), dtype=bool)
    scatter = []
    for dataset in (truth.poses.dataset, points):
        shape = shape_record(fit, replace(truth.poses, dataset=dataset), candidate, heldout, {})
        assert shape is not None
        scatter.append(np.std(np.subtract(shape.partial, np.interp(shape.x, shape.curve_x, shape.curve_y))))
    assert scatter[0] < 0.5 * scatter[1]
