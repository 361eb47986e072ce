"""The sentence that a check ends with."""

from dataclasses import replace

import numpy as np
from cli_cases import robot

from gpmodel.api.check import check
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare


def test_the_verdict_says_when_the_mechanism_is_another_one_than_described() -> None:
    arm, made = robot(60)
    longer = ErrorModel(arm, (*made.model.effects, effect_at("longer", "J2.moving", "Tz")))
    tip = observe(longer, prepare(arm, made.dataset), np.append(made.theta, 0.0496), made.placement).tip[:, :3, 3]
    right, wrong = (check(arm, replace(made.dataset, position=p)) for p in (made.dataset.position, tip))
    assert right.as_described
    assert "\nfit to calibrate with" in right.summary()
    assert not wrong.as_described
    assert "\nnot fit to calibrate with: irb6400r is not described as it was measured" in wrong.summary()
