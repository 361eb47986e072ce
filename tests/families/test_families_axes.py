"""Linear axes by the names of ISO 230-1, ripple at any frequency, and error motions of turning axes."""

from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.residual import Residual, residual_of
from gpmodel.discovery.score import best_nats, scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.families.inner import at, refined
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.geometric import geometric_effects

SLIDE = next(j for j in mechanism("dh").joints if j.kind == "prismatic")
OWN = SLIDE.drive[0][1][1].upper()


@cache
def pool(name: str, poses: int) -> dict[str, Candidate]:
    data = bare(name, poses, 2, payload=False)
    return {c.name: c for c in candidates(mechanism(name), prepare(mechanism(name), data).states)}


def left_by(name: str, effects: tuple[Effect, ...], millimetres: float, poses: int = 150) -> Residual:
    data = bare(name, poses, 2, payload=False)
    theta = sized(name, effects, data, millimetres) if effects else ()
    truth = measure(name, effects, theta, 2, dataset=data)
    arm = mechanism(name)
    return residual_of(calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses), truth.poses, Criteria(), 0)


def test_the_six_error_motions_of_a_slide_have_their_names() -> None:
    mine = {n.split(", ")[0] for n, c in pool("dh", 150).items() if c.family == "linear_axis"}
    ways, turns = "XYZ", "ABC"
    own = ways.index(OWN)
    straight = {f"straightness E{w}{OWN}" for w in ways if w != OWN}
    tilts = {f"pitch or yaw E{t}{OWN}" for i, t in enumerate(turns) if i != own}
    assert mine == straight | tilts | {f"positioning E{OWN}{OWN}", f"roll E{turns[own]}{OWN}"}


def test_a_screw_off_its_centre_is_a_cyclic_error_of_its_lead() -> None:
    offered = pool("dh", 150)
    start = next(c for c in offered.values() if c.family == "cyclic_error" and 39 < c.inner.value < 41)
    truth = at(start, 40.0)
    there = left_by("dh", tuple(truth.effects), 0.0)
    assert there.rms < 2e-4
    free = tuple(Effect(e.name, e.terms, e.unit, e.family) for e in truth.effects)
    there = left_by("dh", free, 0.15)
    all_ = tuple(offered.values())
    best = all_[int(np.argmax([s.nats for s in scores(there, all_)]))]
    assert best.family == "cyclic_error"
    found = refined(best, lambda c: scores(there, [c])[0].nats)
    assert found.inner.value == pytest.approx(40.0, abs=0.3)


@pytest.mark.parametrize("ratio", [6.4, 10.7])
def test_a_ripple_between_whole_numbers_is_found_and_refined(ratio: float) -> None:
    offered = pool("ur5", 150)
    some = next(c for c in offered.values() if c.family == "transmission_ripple" and c.name.endswith("elbow_joint"))
    there = left_by("ur5", at(some, ratio).effects, 0.3)
    all_ = tuple(offered.values())
    best = all_[int(np.argmax([s.nats for s in scores(there, all_)]))]
    assert best.family == "transmission_ripple"
    found = refined(best, lambda c: scores(there, [c])[0].nats)
    assert found.inner.value == pytest.approx(ratio, abs=0.05)
    assert found.name == f"transmission ripple, {found.inner.value:.5g} per turn, elbow_joint"


def test_a_scan_of_frequencies_pays_for_all_it_looked_at() -> None:
    """The best of all ripples on noise alone saves nothing more often than e^-5 would have it, some doubled."""
    ripples = [c for c in pool("ur5", 150).values() if c.family == "transmission_ripple"]
    there = left_by("ur5", (), 0.0)
    noise = np.random.default_rng(0).normal(size=(len(there.values), 300))
    assert np.mean(best_nats(there, ripples, noise) > 5.0) <= 0.01
    per_joint = len(ripples) / len(mechanism("ur5").joints)
    assert all(np.exp(c.cost) > per_joint / 4 for c in ripples)


def test_wobble_and_run_out_are_curves_on_every_axis_but_the_drives() -> None:
    mine = [c for c in pool("ur5", 150).values() if c.family == "axis_motion"]
    assert len(mine) == 5 * len(mechanism("ur5").joints)
    for joint in mechanism("ur5").joints:
        drive = joint.drive[0]
        assert not any(e.terms[0].axis == drive[1] and e.terms[0].slot == drive[0] for c in mine for e in c.effects)


def test_all_joints_curves_come_as_one_block_too() -> None:
    block = pool("ur5", 150)["error curve of the angle, every joint"]
    assert {i for e in block.effects for i in e.inputs} == {j.name for j in mechanism("ur5").joints}
    assert block.has_priors
