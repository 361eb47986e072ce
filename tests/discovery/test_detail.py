"""Test that the evidence sets the number of harmonics of a smooth term."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.choose import Problem, choose
from gpmodel.discovery.judge import judge
from gpmodel.discovery.refinement import detailed
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.angle import wave
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import catalogue
from gpmodel.families.curves import continued, curves
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.group import Shapes, group_of

ARM, COUNT = "irb6400r", 240
LINE = 70
"""Waves a turn of the planted line: past the forty harmonics that a curve is chosen with."""


@cache
def fine_curves() -> dict[str, Candidate]:
    arm = mechanism(ARM)
    shapes = Shapes(prepare(arm, bare(ARM, COUNT, 3)).states)
    groups = (group_of(c, shapes) for c in curves(arm, shapes.states))
    fine = [g for g in groups if g is not None and g.name.startswith("fine") and g.name.endswith(("J2", "J3"))]
    return {g.name: Candidate(g.name, g.with_prior(2e-4**2), g.family, g.cost) for g in fine}


@cache
def left(amplitude: float) -> Residual:
    """Return the residual of fine curves of two joints, for a robot whose second drive has a single harmonic, rad."""
    joint = mechanism(ARM).joints[1]
    planted = [drive_effect("line", joint, wave("sin", LINE, "J2"))]
    truth = measure(ARM, planted, [amplitude], 3, dataset=bare(ARM, COUNT, 3))
    effects = (*geometric_effects(truth.model.mechanism), *(e for c in fine_curves().values() for e in c.effects))
    fit = calibrate(ErrorModel(truth.model.mechanism, effects), truth.poses)
    return residual_of(fit, truth.poses, Criteria(), 0)


def test_a_curve_with_a_line_past_its_harmonics_gets_more_of_them_and_no_other_does() -> None:
    found = detailed(left(1e-4), fine_curves())
    sizes = {name[-2:]: len(candidate.effects) for name, candidate in found.items()}
    assert sizes == {"J2": 160, "J3": 80}


def test_curves_without_such_a_line_stay_as_they_are() -> None:
    assert detailed(left(0.0), fine_curves()) == fine_curves()


def test_a_curve_gets_no_more_numbers_than_half_the_poses() -> None:
    finer = {name: replace(c, effects=(*c.effects, *continued(c))) for name, c in fine_curves().items()}
    assert detailed(left(1e-4), finer) == finer


def test_what_continues_a_curve_is_new_and_believed_to_be_smaller() -> None:
    curve = fine_curves()["fine error curve of the angle, J2"]
    more = continued(curve)
    assert not {e.terms for e in more} & {e.terms for e in curve.effects}
    assert max(e.prior for e in more) < curve.effects[-1].prior
    assert [str(e.terms[0].basis) for e in more[-2:]] == ["sin(80*J2)", "cos(80*J2)"]
    assert np.all(np.diff([e.prior for e in more[::2]]) < 0)


@pytest.mark.parametrize("fewer", [2, 20])
def test_what_is_no_fine_curve_is_not_continued(fewer: int) -> None:
    curve = fine_curves()["fine error curve of the angle, J2"]
    assert continued(replace(curve, effects=curve.effects[:fewer])) == ()
    assert continued(replace(curve, effects=curve.effects[1:])) == ()


@pytest.mark.long
def test_what_is_judged_and_handed_on_is_the_fit_with_all_its_harmonics() -> None:
    arm = mechanism(ARM)
    joint, rng = arm.joints[1], np.random.default_rng(1)
    rough = [drive_effect(f"{f} {k}", joint, wave(f, k, "J2")) for k in range(5, 80) for f in ("sin", "cos")]
    truth = measure(ARM, rough, list(rng.normal(0.0, 5e-5, len(rough))), 3, dataset=bare(ARM, COUNT, 3))
    geometry = geometric_effects(arm)

    def fit(found: Sequence[Candidate], start: Calibration | None = None) -> Calibration:
        return calibrate(ErrorModel(arm, (*geometry, *(e for c in found for e in c.effects))), truth.poses, start=start)

    standard = fit(())
    problem = Problem(standard, fit, truth.poses, tuple(catalogue), Search(runs=0), Criteria(shuffles=19))
    judged = judge(problem, choose(problem, (), frozenset())[0], np.zeros(0))
    accepted = {e.name for h in judged.hypotheses if h.accepted for e in h.candidate.effects}
    assert "fine error curve of the angle, J2, sin 79" in accepted
    assert {e.name for e in judged.calibration.model.effects} == accepted | {e.name for e in geometry}
