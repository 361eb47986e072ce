"""Wherever the independent parts of a discovery are done, in whatever order, it gives the same numbers."""

from dataclasses import replace

from effect_cases import numbers
from executor_cases import Elsewhere
from loop_cases import QUICK, found, robot

from gpmodel.discovery.loop import discover


def test_runs_and_laws_of_curves_may_be_done_anywhere() -> None:
    truth, train, heldout = robot("windup", 0)
    elsewhere = Elsewhere()
    search = replace(QUICK, executor=elsewhere)
    again = discover(truth.model.mechanism, truth.poses, train, heldout, search=search, seed=0)
    assert numbers(again) == numbers(found("windup", 0, QUICK))
    assert elsewhere.functions == {"run_task", "run_law_task"}
