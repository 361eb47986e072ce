"""A candidate knows what its unknowns are together, and their size."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.families.candidate import Candidate, relative
from gpmodel.families.inner import remembered
from gpmodel.formula.expression import Columns, Expression
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.error_model import prepare

JOINT = mechanism("ur5").joints[3]
J = JOINT.name


def of(*bases: str) -> Candidate:
    effects = tuple(drive_effect(f"e{i}", JOINT, Expression(b)) for i, b in enumerate(bases))
    return Candidate("c", effects, "", 4.0)


STEP = Candidate("moved", tuple(effect_at(a, "base", a, Expression("row")) for a in ("Tx", "Ty", "Rz")), "", 4.0)


@pytest.mark.parametrize(
    ("values", "unit", "text"),
    [
        ((31.0, 38.0), "degC", "c - 20"),
        ((300.0, 310.0), "K", "c - 293.15"),
        ((1.7e9, 1.7e9 + 3600), "s", "c - 1700000000"),
        ((990.0, 1030.0), "hPa", "c - 990"),
        ((-3.0, -2.0), "1", "c + 2"),
        ((-1.0, 1.0), "1", "c"),
        ((0.0, 50.0), "kg", "c"),
    ],
)
def test_a_column_counts_from_where_the_constants_hold(values: tuple[float, ...], unit: str, text: str) -> None:
    arm = mechanism("ur5")
    states = prepare(arm, replace(bare("ur5", 2), extras={"c": np.array(values)}, extra_units={"c": unit})).states
    assert relative(states, "c", unit) == text


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


def test_what_remembers_has_the_constants_of_its_columns_inside() -> None:
    effects = (effect_at("a lag_T_30p5", "base", "Tx", Expression("lag_T_30p5*stop_J2_0p1 + lag_T_30p5")),)
    inner = remembered("on lag_T_30p5", effects, lambda what, of: f"{what} of {of}")
    assert inner is not None
    assert [(c.name, c.unit, c.value) for c in inner.constants] == [
        ("lag", "lag of T", 30.5), ("half-width", "stop of J2", 0.1),
    ]  # fmt: skip
    assert (inner.full_name, inner.effects) == ("on lag_T_30p5", effects)
    moved = inner.at((41.25, 0.2))
    assert moved.full_name == "on lag_T_41p25"
    assert str(moved.effects[0].terms[0].basis) == "lag_T_41p25*stop_J2_0p2 + lag_T_41p25"
    assert remembered("plain", (effect_at("plain", "base", "Tx", Expression("last_move_J2")),), str.__add__) is None


def test_a_law_that_loses_a_term_loses_it_from_its_names() -> None:
    name = "lag_t_30 and lag_t_40 on J1.moving Tx"
    bases = [Expression("lag_t_30"), Expression("lag_t_40")]
    effects = tuple(effect_at(f"{name} [{k}]", "J1.moving", "Tx", basis) for k, basis in enumerate(bases, 1))
    inner = remembered(name, effects, lambda what, of: "min")
    assert inner is not None
    fewer = inner.without(0)
    assert fewer.full_name == "lag_t_40 on J1.moving Tx"
    assert [e.name for e in fewer.effects] == ["lag_t_40 on J1.moving Tx"]


@dataclass(frozen=True)
class Notch:
    """A basis in Python, whose text is no expression."""

    at: float
    inputs: tuple[str, ...] = ("J1",)

    def __call__(self, states: Columns) -> np.ndarray:
        return np.exp(-((states["J1"] - self.at) ** 2))

    def __str__(self) -> str:
        return f"a notch at {self.at} rad"


def test_two_bases_in_python_are_a_curve() -> None:
    effects = tuple(effect_at(f"notch {a}", "base", "Rx", Notch(a)) for a in (0.1, 0.2))
    assert Candidate("notches", effects, "", 4.0).kind == "curve"
    assert Candidate("notch", effects[:1], "", 4.0).kind == "single"
