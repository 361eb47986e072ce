"""Test that compliance and hardening of one joint are found as one effect, and not as a formula of the same shape."""

import numpy as np
import pytest

import gpmodel as gp


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "joint"), [("irb6400r", "J2"), pytest.param("panda", "panda_joint2", marks=pytest.mark.long)]
)
def test_compliance_with_hardening_is_one_finding(name: str, joint: str) -> None:
    """The deflection is 0.3 mrad (x - 0.4 x³) at the relative torque x. Two findings would cost a second penalty."""
    bare = gp.simulate(name, (), poses=100, seed=1).table
    largest = float(np.max(np.abs(gp.load_mechanism(name).loads(bare.q, bare.payload)[f"torque_{joint}"])))
    planted = (f"joint_compliance {joint}={3e-4 / largest:.9g}", f"hardening_stiffness {joint}=-120 urad")
    table = gp.simulate(name, planted, poses=100, seed=1, noise="0.02 mm").table
    np.testing.assert_array_equal(table.q, bare.q)
    found = gp.discover(name, table, search=gp.Search(runs=0, workers=1), holdout=0.3)
    assert len(found.findings) == 1
    saved = found.model.saved
    at = [k for k, e in enumerate(saved.model.effects) if e.family == "hardening_stiffness"]
    assert np.all(np.abs(saved.theta[at] - [3e-4, -1.2e-4]) < 3.0 * saved.stderr[at])
