"""One kept group for another, where what stands beside it has to change as well."""

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized
from group_cases import started

from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import prepare
from gpmodel.selection.exchange import exchanged
from gpmodel.selection.group import Shapes, group_of
from gpmodel.selection.moves import with_optimal_variances

LIFT, ELBOW = "shoulder_lift_joint", "elbow_joint"
BASE, WAVE, CROSS = "base compliance", f"eccentricity, 1 per turn, {LIFT}", "shoulder under the elbow's torque"


@pytest.mark.parametrize("seed", [1, 5])
def test_what_explains_it_takes_the_place_of_what_explains_it_with_less_beside_it(seed: int) -> None:
    """A tilting base turns by the shoulder's torque, which is the elbow's and a cosine of the shoulder. Where a wave of
    the shoulder hides most of that cosine, the elbow's torque at the shoulder needs a small wave beside it and the tilt
    the whole one: held to its size, the wave would keep the tilt out."""
    arm, data = mechanism("ur5"), bare("ur5", 150, seed, payload=False)
    states = prepare(arm, data).states
    pool = {c.name: c for c in catalogue.candidates(arm, states)}
    pool[CROSS] = Candidate(CROSS, (drive_effect(CROSS, arm.joints[1], Expression(f"torque_{ELBOW}")),), "", 5.0)
    waves = np.column_stack([np.sin(states[LIFT]), np.cos(states[LIFT]), np.ones(len(states))])
    apart = np.linalg.lstsq(waves, states[f"torque_{LIFT}"] - states[f"torque_{ELBOW}"], rcond=None)[0][:2]
    tilt = sized("ur5", pool[BASE].effects, data, 0.1)
    effects = [*pool[BASE].effects, *pool[WAVE].effects]
    truth = measure("ur5", effects, np.concatenate([tilt, -1.3 * tilt[0] * apart]), seed, dataset=data)

    groups = [group_of(pool[name], Shapes(truth.poses.states)) for name in (BASE, WAVE, CROSS)]
    active, number = started(truth, [g for g in groups if g is not None])
    active = with_optimal_variances(active.added(number[WAVE], 1e-9).added(number[CROSS], 1e-9))
    chosen, _ = exchanged(active)
    assert {number[BASE], number[WAVE]} <= set(chosen.variances)
    assert number[CROSS] not in chosen.variances
