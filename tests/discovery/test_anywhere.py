"""Test that the place and order of parallel parts of a search do not change its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from effect_cases import numbers
from executor_cases import Elsewhere
from loop_cases import QUICK

from gpmodel.discovery.loop import discover
from gpmodel.model.error_model import prepare
from gpmodel.table.blocks import hold_out


@pytest.mark.long
def test_runs_and_laws_of_curves_may_be_done_anywhere() -> None:
    arm, made = robot(60, 0, "ur5", effects=["shoulder_lift_joint.moving:Ry:tanh(3*sin(shoulder_lift_joint))=0.5 mrad"])
    train, heldout = hold_out(made.dataset, 0.25, np.random.default_rng(0))
    elsewhere, poses = Elsewhere(), prepare(arm, made.dataset)
    here, there = (
        discover(arm, poses, train, heldout, search=replace(QUICK, max_effects=1, executor=executor))
        for executor in (None, elsewhere)
    )
    assert numbers(here) == numbers(there)
    assert here.findings
    assert elsewhere.functions == {"run_task", "run_law_task"}
