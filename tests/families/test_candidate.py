"""A candidate knows what its unknowns are together, and their size."""

import numpy as np
import pytest
from effect_cases import measure, mechanism

from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect, effect_at

JOINT = mechanism("ur5").joints[3]
J = JOINT.name


def of(*bases: str) -> Candidate:
    effects = tuple(drive_effect(f"e{i}", JOINT, Expression(b)) for i, b in enumerate(bases))
    return Candidate("c", effects, "", 4.0)


STEP = Candidate("moved", tuple(effect_at(a, "base", a, Expression("row")) for a in ("Tx", "Ty", "Rz")), "", 4.0)


@pytest.mark.parametrize(
    ("candidate", "kind"),
    [
        (of(J), "single"),
        (of(f"sin(2*{J})", f"cos(2*{J})"), "harmonic"),
        (of(f"sin(2*{J})", f"cos(3*{J})"), "curve"),
        (of(f"sin({J})*row", f"cos({J})*row"), "curve"),
        (of(f"sin({J})", f"cos({J})", f"sin(2*{J})"), "curve"),
        (STEP, "vector"),
    ],
)
def test_the_kind_follows_from_the_bases(candidate: Candidate, kind: str) -> None:
    assert candidate.kind == kind


@pytest.mark.parametrize("candidate", [of(J), of(f"sin({J})", f"cos({J})"), of(J, f"{J}**2", "1"), STEP])
def test_the_gradient_of_the_amplitude_is_its_difference_quotient(candidate: Candidate) -> None:
    rng = np.random.default_rng(0)
    states = measure("ur5", (), (), 0).poses.states
    theta = rng.normal(size=len(candidate.effects))
    slope = candidate.amplitude(theta, states)[1]
    steps = 1e-6 * np.eye(len(theta))
    apart = [candidate.amplitude(theta + s, states)[0] - candidate.amplitude(theta - s, states)[0] for s in steps]
    np.testing.assert_allclose(slope, np.array(apart) / 2e-6, atol=1e-6)
