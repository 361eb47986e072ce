"""What is odd beside the model: named, with what it shares, and never where chance gives as much."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from effect_cases import Truth, bare, measure, mechanism

from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.result import Suspect
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Journal, State
from gpmodel.discovery.suspects import _rejected, in_common, suspects_of
from gpmodel.evidence.criteria import Criteria, Test, Verdict
from gpmodel.evidence.score import Score
from gpmodel.evolution.chance import Chance
from gpmodel.families.catalogue import catalogue
from gpmodel.families.load import backlash_load
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.progress import Teller

ARM, POSES, ODD = "ur5", 60, 3
PLAY = "backlash by load, elbow_joint"


@cache
def one_sided() -> Truth:
    """A robot with play under load at its elbow, whose torque has the other sign at three of the poses."""
    arm, data = mechanism(ARM), bare(ARM, 400, 1, payload=False)
    data = replace(data, extras={}, extra_units={})
    states = prepare(arm, data).states
    rare, usual = (np.flatnonzero(sign * states["torque_elbow_joint"] > 0) for sign in (1, -1))
    (play,) = next(c for c in backlash_load(arm, states) if c.name == PLAY).effects
    kept = data.subset(np.sort(np.concatenate([rare[:ODD], usual[: POSES - ODD]])))
    return measure(ARM, (play,), [5e-4], 1, dataset=kept)


def suspects(poses: Poses) -> tuple[Suspect, ...]:
    """Those of the standard model alone."""
    arm, nothing = mechanism(ARM), np.zeros(0, dtype=np.int64)
    standard = geometric_effects(arm)
    state = State(
        arm, poses, np.arange(len(poses)), nothing, standard, (), catalogue, Search(), Criteria(shuffles=49), None, 0,
        Teller(), Journal(),
    )  # fmt: skip
    return suspects_of(state, calibrate(ErrorModel(arm, standard), poses, condition_limit=50.0))


def test_poses_that_play_shows_alone_are_odd_share_the_sign_of_the_load_and_name_the_play() -> None:
    poses = one_sided().poses
    odd = np.flatnonzero(poses.states["torque_elbow_joint"] > 0)
    (found,) = suspects(poses)
    assert PLAY in (found.candidate.name, *found.alternatives)
    assert found.rows.tolist() == odd.tolist()
    assert found.shared == "torque_elbow_joint positive"
    assert found.after < 0.5 * found.before
    assert f"{ODD} of {POSES}" in found.why


@pytest.mark.parametrize(("after", "listed"), [(0.287, False), (0.2440, False), (0.2435, False), (0.20, True)])
def test_a_rejected_candidate_is_listed_where_it_lowers_the_cross_validated_error(after: float, listed: bool) -> None:
    (play,) = (c for c in backlash_load(mechanism(ARM), one_sided().poses.states) if c.name == PLAY)
    verdict = Verdict((Test("chance", 0.0, 0.01, True), Test("nats", 352.0, 5.0, True), Test("rows", 1.0, 5.0, False)))
    rejected = Hypothesis(play, Score(0.3, 352.0, 0.5), Chance(1e-6, 99), after, 0.244, (), verdict)
    state = SimpleNamespace(rounds=[SimpleNamespace(hypotheses=(rejected,))], found=())
    assert [s.candidate.name for s in _rejected(state)] == [PLAY] * listed  # type: ignore[arg-type]


def test_readings_that_went_wrong_at_random_are_no_suspect() -> None:
    truth = measure(ARM, (), (), 1, dataset=replace(one_sided().poses.dataset))
    position = truth.poses.dataset.position.copy()
    position[[5, 20, 41]] += 1e-3 * np.random.default_rng(0).normal(size=(3, 3))
    assert suspects(prepare(mechanism(ARM), replace(truth.poses.dataset, position=position))) == ()


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (lambda z: np.argsort(z)[-4:], "z above"),
        (lambda z: np.argsort(z)[:4], "z below"),
        (lambda z: np.argsort(z)[30:34], "z from"),
        (lambda z: np.arange(3, 60, 15), ""),
    ],
    ids=["highest", "lowest", "between", "anywhere"],
)
def test_what_poses_share_is_a_side_or_a_range_that_chance_does_not_give(rows: object, said: str) -> None:
    states = one_sided().poses.states
    chosen: IntArray = rows(states["z"])  # type: ignore[operator]
    found = in_common(states, chosen, 0.01)
    assert found.startswith(said) if said else found == ""
