"""Test that machines calibrated together give the true effects and a useful prior."""

import json
import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from executor_cases import Elsewhere
from fleet_cases import BASE, GEOMETRY, JOINT, MECHANISM, NOISE, SPREAD, TRUTH, machines, two_joint_arms, written

import gpmodel as gp
from gpmodel.api.fleet import FleetResult
from gpmodel.hierarchy.between import FEWEST, normal_score
from gpmodel.hierarchy.record import NOISE as NOISE_NAME
from gpmodel.hierarchy.record import SharedPart, prior_model, read_fleet
from gpmodel.numerics.interval import SIGNIFICANCE
from gpmodel.report.fleet import NOT_TESTED, band, html, pictures, spread, summary
from gpmodel.texts import SEAL, seal

pytestmark = pytest.mark.long

COUNT = 9


@pytest.fixture(scope="module")
def found() -> FleetResult:
    return gp.fleet(MECHANISM, machines(0, COUNT, outlier=3), [BASE, JOINT])


def part(found: FleetResult, name: str) -> SharedPart:
    return next(p for p in found.record.parameters if p.name == name)


@pytest.mark.parametrize("name", TRUTH)
def test_mean_and_spread_of_the_type_come_back(found: FleetResult, name: str) -> None:
    shared = part(found, name)
    assert abs(shared.mean - TRUTH[name]) < 3.0 * shared.stderr
    assert shared.low <= SPREAD * TRUTH[name] <= shared.high
    noise = part(found, NOISE_NAME)
    assert abs(noise.mean - np.log(NOISE)) < 3.0 * noise.stderr


def test_the_machine_that_is_no_part_of_it_is_named_and_keeps_its_own_number(found: FleetResult) -> None:
    assert [(found.record.machines[k].serial, p.name) for k, p in found.record.outliers()] == [
        ("R-04", "base compliance")
    ]
    assert found.record.worst_first()[0] == 3
    assert "R-04 in base compliance" in found.verdict
    shared = part(found, "base compliance")
    assert abs(shared.shrunken[3] - shared.values[3]) < shared.stderrs[3]
    assert not found.to_dataframe().query("serial != 'R-04'").outlier.any()


def test_what_is_believed_of_a_further_machine_is_what_was_planted(found: FleetResult) -> None:
    """Thirty-six geometric errors of eight machines; the mean of the type is itself known to one eighth of the
    variance.
    """
    for unit in ("m", "rad"):
        geometry = [p.deviation for p in found.record.prior if p.unit == unit]
        assert np.median(geometry) == pytest.approx(GEOMETRY * np.sqrt(9 / 8), rel=3.0 / np.sqrt(2 * 8 * 15))
    for name, value in TRUTH.items():
        believed = next(p for p in found.record.prior if p.name == name)
        assert abs(believed.mean - value) < 3.0 * believed.deviation / np.sqrt(8)
        assert believed.deviation == pytest.approx(SPREAD * value, rel=3.0 / np.sqrt(2 * 7))


def test_together_the_machines_are_predicted_better(found: FleetResult) -> None:
    alone, together = (np.array([getattr(m, k) for m in found.record.machines]) for k in ("own_mm", "fleet_mm"))
    assert np.mean(together**2) < np.mean(alone**2)
    assert np.sum(together < alone) > COUNT / 2


def test_spread_and_its_interval_are_said_in_one_unit(found: FleetResult) -> None:
    for part in found.record.parameters:
        unit = "%" if spread(part).endswith("%") else spread(part).split()[-1]
        assert band(part).endswith(unit)


def test_an_innocent_fleet_has_no_outlier() -> None:
    found = gp.fleet(MECHANISM, machines(1, 6), [BASE, JOINT], holdout=0.0)
    assert found.record.outliers() == []
    assert found.verdict.endswith("No machine is an outlier.")
    assert {m.own_mm for m in found.record.machines} == {None}


def test_effects_are_those_found_on_most_machines_wherever_these_are_searched(tmp_path: Path) -> None:
    folder = two_joint_arms(tmp_path / "arms", 2)
    found = gp.fleet(None, folder, holdout=0.3)
    gear = "gear error, 2 per turn, J2"
    assert {gear} == {p.name.split(", sin")[0].split(", cos")[0] for p in found.record.effects if not p.constant}
    assert f"{gear} on all (by itself on 2)" in found.record.chosen
    assert NOT_TESTED in found.verdict
    far = Elsewhere()
    assert gp.fleet(None, folder, holdout=0.3, executor=far).record == found.record
    assert far.functions == {"found"}


def test_a_machine_keeps_what_it_alone_has_and_is_named_with_it(tmp_path: Path) -> None:
    """One of four arms has a gear error: it is no part of the type, and part of the model of that arm."""
    folder = two_joint_arms(tmp_path / "arms", 4, geared=(2,))
    found = gp.fleet(None, folder)
    gear = "gear error, 2 per turn, J2"
    assert [m.effects for m in found.record.machines] == [(), (), (gear,), ()]
    assert f"{gear} on A-3" in found.record.chosen
    assert f"A-3 also has {gear}. No machine is an outlier in the common effects." in found.verdict
    fit = found.machines["A-3"]
    assert fit.rms < 0.5 * fit.record.ladder[1].heldout.rms_mm
    assert all(gear not in e.name for e in found.machines["A-1"].model.saved.model.effects)


def test_no_machine_is_far_where_none_stands_out() -> None:
    """Four machines hardly know their spread: sixty of it may be chance, and is then said as what it is."""
    assert abs(normal_score(-59.5, 0.02)) < abs(normal_score(-59.5, SIGNIFICANCE)) < 2.6
    assert normal_score(-59.5, 0.02) < 0.0
    assert normal_score(3.0, 1.0) == 0.0


def test_joints_are_said_as_the_tables_call_them(found: FleetResult) -> None:
    record = msgspec.structs.replace(found.record, columns=tuple(f"A{k}" for k in range(1, 7)))
    shown = FleetResult(record, found.machines)
    assert "joint compliance, A2" in shown.summary()
    assert "J2" not in shown.summary().split("[[Record]]")[0]
    assert prior_model(record, gp.load_mechanism(MECHANISM)).effects


@pytest.mark.long
def test_further_machines_with_few_poses_are_known_better(found: FleetResult) -> None:
    """Ten poses of a machine by themselves, and with what the others say of the type."""
    errors = []
    for seed in (50, 51, 52):
        table = machines(seed, 1)["R-01"]
        few, later = table.subset(np.arange(10)), table.subset(np.arange(10, 40))
        alone = gp.calibrate(MECHANISM, few, [BASE, JOINT], holdout=0.0)
        both = gp.calibrate(MECHANISM, few, fleet=found.record, holdout=0.0)
        errors.append([np.mean(fit.model.misses(later) ** 2) for fit in (alone, both)])
        assert "and the prior of the fleet" in both.verdict
        assert both.record.ladder[-1].step == "the prior of the fleet"
    without, beside = np.sqrt(np.mean(errors, axis=0))
    assert beside < 0.5 * without


def test_poses_that_do_not_determine_the_model_by_themselves_are_said(found: FleetResult) -> None:
    few = machines(50, 1)["R-01"].subset(np.arange(9))
    assert "do not determine the model" in gp.calibrate(MECHANISM, few, fleet=found.record, holdout=0.0).verdict


@pytest.mark.long
def test_the_page_of_a_machine_without_a_standard_model_compares_with_its_registration(
    found: FleetResult, tmp_path: Path
) -> None:
    known = gp.calibrate(MECHANISM, machines(50, 1)["R-01"].subset(np.arange(10)), fleet=found.record)
    assert "standard" not in known.record.plots.residual_mm
    assert known.record.effects
    known.report(tmp_path / "few")
    assert (tmp_path / "few" / "figures" / "arrows_above.png").is_file()


@pytest.mark.long
def test_a_further_machine_unlike_its_type_is_said_so(found: FleetResult) -> None:
    odd = machines(4, 1, outlier=0)["R-01"]
    told = gp.calibrate(MECHANISM, odd, fleet=found.record)
    assert "unlike its type in base compliance." in told.verdict
    effect = next(e for e in told.record.effects if e.name == "base compliance")
    assert effect.value == pytest.approx(3.0 * TRUTH["base compliance"], rel=0.5)


@pytest.mark.parametrize("wave", [0.0, 5e-4])
def test_a_further_machine_with_an_effect_that_its_type_lacks_is_said_so(found: FleetResult, wave: float) -> None:
    machine = machines(50, 1)["R-01"]
    position = machine.position + wave * np.sin(2 * machine.q[:, 1:2]) * np.sin(machine.q[:, :3])
    told = gp.calibrate(MECHANISM, replace(machine, position=position), fleet=found.record)
    assert ("times the noise of the type" in told.verdict) == bool(wave)


def test_the_file_is_read_back_and_refused_where_it_was_changed(found: FleetResult, tmp_path: Path) -> None:
    found.save(tmp_path / "fleet.json")
    assert read_fleet(tmp_path / "fleet.json") == found.record
    content = json.loads((tmp_path / "fleet.json").read_text())
    content["parameters"][0]["mean"] += 1.0
    (tmp_path / "fleet.json").write_text(json.dumps(content))
    with pytest.raises(gp.InputError, match="was changed after writing"):
        read_fleet(tmp_path / "fleet.json")
    content["parameters"][0]["values"].pop()
    content[SEAL] = seal(content)
    (tmp_path / "fleet.json").write_text(json.dumps(content))
    with pytest.raises(gp.InputError, match="expected 9 values"):
        gp.calibrate(MECHANISM, machines(0, COUNT, outlier=3)["R-01"], fleet=tmp_path / "fleet.json")


def test_the_fleet_of_another_mechanism_is_refused(found: FleetResult) -> None:
    with pytest.raises(gp.InputError, match="fleet: is of machines of another type, irb6400r"):
        prior_model(found.record, gp.load_mechanism("ur10"))
    with pytest.raises(gp.InputError, match="effects: the fleet already defines"):
        gp.calibrate(MECHANISM, machines(50, 1)["R-01"], [BASE], fleet=found.record)


def test_a_machine_of_the_type_is_known_whatever_it_is_called(found: FleetResult) -> None:
    renamed = replace(gp.load_mechanism(MECHANISM).bare, name="robot")
    assert prior_model(found.record, renamed).effects


@pytest.mark.long
def test_the_same_numbers_from_a_folder(found: FleetResult, tmp_path: Path) -> None:
    folder = written(tmp_path / "tables", dict(list(machines(0, COUNT, outlier=3).items())[:2]))
    (folder / "fleet.toml").write_text(f'mechanism = "{MECHANISM}"\n[serials]\n"R-01.csv" = "first"\n')
    of_files = gp.fleet(None, folder, [BASE])
    assert [m.serial for m in of_files.record.machines] == ["first", "R-02"]


def test_every_cell_of_the_page_says_on_a_phone_what_it_is() -> None:
    template = (Path(gp.__file__).parent / "report" / "templates" / "fleet.html.j2").read_text(encoding="utf-8")
    assert template.count("<table") == template.count(' stack">') == 3
    assert [cell for cell in re.findall(r"<td[^>]*>", template) if "data-label=" not in cell] == []


@pytest.mark.long
@pytest.mark.parametrize("count", [3, 4])
def test_what_was_not_tested_has_no_column(count: int) -> None:
    record = gp.fleet(MECHANISM, dict(list(machines(0, COUNT, outlier=3).items())[:count]), [BASE], holdout=0.0).record
    page = html(record, {p.name: "" for p in pictures(record)})
    tested = count >= FEWEST
    assert ("farthest" in page) == ("farthest" in summary(record)) == tested
    assert (NOT_TESTED in page) == (NOT_TESTED in summary(record)) == (not tested)
    assert ("No machine is an outlier" in page) == (tested and not record.outliers())
    assert ("standing" in {p.name for p in pictures(record)}) == bool(record.outliers())
    assert not any(head in page for head in ("together, mm", "effects of its own"))
