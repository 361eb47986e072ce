"""A table of J1, J2 on an arm of shoulder, elbow: its names are accepted and said everywhere, the arm's as well."""

from functools import cache

import pytest

import gpmodel as gp
from gpmodel.api.calibrate import CalibrationResult
from gpmodel.application.exports.forward import forward_of
from gpmodel.application.exports.rigid import refitted
from gpmodel.application.exports.sample import Place
from gpmodel.application.exports.sources import header_text, latex_text, numpy_text
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice

ROWS = """convention = "standard"
[[joint]]
name = "shoulder"
d_mm = 300
alpha_deg = 90
[[joint]]
name = "elbow"
a_mm = 500
"""


@cache
def arm() -> LoadedMechanism:
    return MechanismChoice("arm.toml", description=ROWS).load()


@cache
def fitted(slot: str = "J2.moving", angle: str = "J2") -> CalibrationResult:
    made = gp.simulate(arm(), ["elbow.moving:Ry:sin(elbow)=0.001 rad"], poses=30, noise="0.02 mm")
    table = made.to_dataframe().rename(columns={"shoulder [deg]": "J1 [deg]", "elbow [deg]": "J2 [deg]"})
    drag = gp.effect_at("drag at elbow", slot, "Ry", gp.Expression(f"sin({angle})"))
    return gp.calibrate(arm(), table, [drag], holdout=0.0)


@pytest.mark.long
@pytest.mark.parametrize(("slot", "angle"), [("J2.moving", "J2"), ("elbow.moving", "elbow"), ("elbow.moving", "J2")])
def test_a_slot_and_an_input_are_named_as_the_table_or_the_mechanism_does(slot: str, angle: str) -> None:
    effect = fitted(slot, angle).record.effects[0]
    assert effect.value == pytest.approx(0.001, rel=0.1)
    assert [(t.slot, t.basis) for t in effect.terms] == [("J2.moving", "sin(J2)")]
    assert effect.name == "drag at J2"


def test_written_out_effects_take_both_names_and_unknown_ones_are_refused() -> None:
    made = [gp.simulate(arm(), [f"{n}.moving:Ry:sin({n})=0.001 rad"], poses=5).to_dataframe() for n in ("J2", "elbow")]
    assert made[0].equals(made[1])
    with pytest.raises(gp.InputError, match=r"slot 'J3\.moving' is unknown"):
        gp.simulate(arm(), ["J3.moving:Ry:sin(elbow)=0.001 rad"], poses=5)


@pytest.mark.long
def test_next_poses_and_exports_are_in_the_names_of_the_table() -> None:
    model = fitted().model
    assert list(gp.choose_poses(count=2, after=model).to_dataframe()) == ["J1 [deg]", "J2 [deg]"]
    assert refitted(model.saved).missing == ("drag at J2",)
    forward = forward_of(model.saved, Place.of(model.saved, None, None))
    assert "JOINTS = ['J1', 'J2']" in numpy_text(forward, "")
    assert "q: J1, J2. " in header_text(forward, "")
    assert "J2.moving" in latex_text(forward)
    assert "elbow" not in latex_text(forward)


@pytest.mark.long
def test_a_search_tells_its_progress_in_the_names_of_the_table() -> None:
    table, told = fitted().model.saved.measured, []
    assert table is not None
    drag = gp.effect_at("drag at elbow", "J2.moving", "Ry", gp.Expression("sin(J2)"))
    found = gp.discover(
        arm(), table.dataset, candidates=(drag,), search=gp.Search(runs=0), holdout=0.3, progress=told.append
    )
    assert [f.name for f in found.findings] == ["drag at J2"]
    assert "round 1: added drag at J2" in [str(line) for line in told]


def test_the_numbers_of_a_fit_are_named_as_the_table_does() -> None:
    fit = fitted()
    names = list(fit.params.index)
    assert "J1 Tx" in names
    assert not any(name.startswith(("shoulder", "elbow")) for name in names)
    assert list(fit.stderr.index) == names == list(fit.covariance.columns)[-len(names) :]
