"""Linear axes by the names of ISO 230-1, ripple at any frequency, and error motions of turning axes."""

from functools import cache

import numpy as np
import pytest
from effect_cases import bare, mechanism

from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.model.error_model import prepare

SLIDE = next(j for j in mechanism("dh").joints if j.kind == "prismatic")
OWN = SLIDE.drive[0][1][1].upper()


@cache
def pool(name: str, poses: int) -> dict[str, Candidate]:
    data = bare(name, poses, 2, payload=False)
    return {c.name: c for c in candidates(mechanism(name), prepare(mechanism(name), data).states)}


def grids(name: str) -> list[FrequencyGrid]:
    states = prepare(mechanism(name), bare(name, 150, 2, payload=False)).states
    return [c for f in catalogue for c in f.grids(mechanism(name), states)]


def test_the_six_error_motions_of_a_slide_have_their_names() -> None:
    mine = {n.split(", ")[0] for n, c in pool("dh", 150).items() if c.family == "linear_axis"}
    ways, turns = "XYZ", "ABC"
    own = ways.index(OWN)
    straight = {f"straightness E{w}{OWN}" for w in ways if w != OWN}
    tilts = {f"pitch or yaw E{t}{OWN}" for i, t in enumerate(turns) if i != own}
    assert mine == straight | tilts | {f"positioning E{OWN}{OWN}", f"roll E{turns[own]}{OWN}"}


def test_a_screw_off_its_centre_is_a_cyclic_error_of_its_lead() -> None:
    leads = {c.name for c in pool("dh", 150).values() if c.family == "cyclic_error"}
    assert f"cyclic error, every 10 mm, {SLIDE.name}" in leads
    there = next(c for c in grids("dh") if c.joint == SLIDE)
    truth = there.at(2000 * np.pi / 23.7)
    assert truth.name == f"cyclic error, every 23.7 mm, {SLIDE.name}"
    states = prepare(mechanism("dh"), bare("dh", 150, 2, payload=False)).states
    turn = 2 * np.pi / 0.0237 * (states[SLIDE.name] - there.start)
    found = [effect.terms[0].basis(states) for effect in truth.effects]
    np.testing.assert_allclose(found, [np.sin(turn), np.cos(turn)], atol=1e-4)


@pytest.mark.parametrize("name", ["dh", "ur5"])
def test_a_comb_is_finer_than_its_poses_tell_and_pays_for_all_they_do(name: str) -> None:
    states = prepare(mechanism(name), bare(name, 150, 2, payload=False)).states
    for there in grids(name):
        width = 2 * np.pi / float(np.ptp(states[there.joint.name]))
        assert there.step <= width / 4 * 1.001
        independent = (there.rates[-1] - there.rates[0]) / width
        assert np.exp(there.template.cost - 4.0) == pytest.approx(independent, rel=0.01)
        rate = float(there.rates[len(there.rates) // 2])
        assert there.value(there.value(rate)) == pytest.approx(rate)


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
