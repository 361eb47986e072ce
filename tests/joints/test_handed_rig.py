"""A ball joint measured on a rig of `simulate`, whose tool is 0.1 m off its axis, handed to a machine."""

from pathlib import Path

import pytest

import gpmodel as gp
from gpmodel.application.joint_posterior import of_the_ball

LOBES = "out-of-round ball, 3 lobes over J2, lift along the lever"


@pytest.mark.long
def test_a_rig_whose_tool_is_off_the_axis_can_be_handed_over(tmp_path: Path) -> None:
    made = gp.simulate("spherical-joint", [f"{LOBES}=12 um"], poses=80, noise="1 um", seed=5)
    gp.calibrate("spherical-joint", made.table, [LOBES], holdout=0).model.save(tmp_path / "model.json")
    rig = gp.load_model(tmp_path).saved
    given = of_the_ball("L3.fixed", rig, gp.load_mechanism("tau"))
    known = [e for e in rig.model.effects if e.name.startswith("out-of-round")]
    assert len(given) == len(known)
    for effect, other in zip(given, known, strict=True):
        at = rig.model.effects.index(other)
        assert (effect.mean, effect.prior) == pytest.approx((float(rig.theta[at]), float(rig.stderr[at])))
