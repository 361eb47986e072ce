"""Machines whose effects come with priors: alone as `calibrate` has them, judged together as one block."""

import numpy as np
import pytest
from fleet_cases import MECHANISM, curved

import gpmodel as gp
from gpmodel.api.fleet import FleetResult
from gpmodel.report.fleet import summary

COUNT, ODD, CURVE = 8, 2, "joint_curve J1"


@pytest.fixture(scope="module")
def found() -> FleetResult:
    return gp.fleet(MECHANISM, curved(COUNT, ODD), [CURVE])


@pytest.mark.long
@pytest.mark.parametrize("serial", ["C-1", "C-3"])
def test_alone_a_machine_is_what_calibrate_makes_of_its_table(found: FleetResult, serial: str) -> None:
    alone = gp.calibrate(MECHANISM, curved(COUNT, ODD)[serial], [CURVE])
    machine = next(m for m in found.record.machines if m.serial == serial)
    assert machine.own_mm == pytest.approx(alone.record.ladder[-1].heldout.rms_mm, rel=1e-9)


@pytest.mark.long
def test_harmonics_have_one_row_together_and_none_alone(found: FleetResult) -> None:
    assert all(part.constant for part in found.record.effects)
    (block,) = found.record.blocks
    assert "J1" in block.name
    assert len(block.effects) == 24
    assert block.low <= block.spread <= block.high < 1.0
    assert f"{block.name}" in summary(found.record)
    rows = found.to_dataframe().query("parameter == @block.name")
    assert len(rows) == COUNT
    assert rows.value.isna().all()


@pytest.mark.long
def test_the_machine_with_another_curve_is_named_and_keeps_it(found: FleetResult) -> None:
    assert [(k, part.name) for k, part in found.record.outliers()] == [(ODD, found.record.blocks[0].name)]
    machine = found.record.machines[ODD]
    assert machine.fleet_mm < 1.2 * machine.own_mm


@pytest.mark.long
def test_a_further_machine_with_another_curve_is_said_so(found: FleetResult) -> None:
    told = gp.calibrate(MECHANISM, curved(COUNT, ODD)["C-3"], fleet=found.record, holdout=0.0)
    assert f"unlike its type in {found.record.blocks[0].name}." in told.verdict
    alike = gp.calibrate(MECHANISM, curved(COUNT, ODD)["C-1"], fleet=found.record, holdout=0.0)
    assert "unlike" not in alike.verdict


@pytest.mark.long
def test_together_the_others_are_predicted_better(found: FleetResult) -> None:
    alone, together = (
        np.array([getattr(m, name) for k, m in enumerate(found.record.machines) if k != ODD])
        for name in ("own_mm", "fleet_mm")
    )
    assert np.mean(together**2) < np.mean(alone**2)
