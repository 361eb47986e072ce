"""Two calibrations of one machine: what changed stands out, what did not does not."""

import dataclasses

import numpy as np
import pytest
from report_runs import discovered

from gpmodel.errors import InputError
from gpmodel.report.compare import SIGNIFICANCE, compare, html, text, verdict
from gpmodel.report.schema import MechanismRecord, Report
from gpmodel.report.schema_search import EffectRecord


def remeasured(seed: int, shift: float = 0.0) -> Report:
    """The same machine measured again: every parameter drawn anew within its σ, the first moved by `shift` σ."""
    report, rng = discovered(), np.random.default_rng(seed)
    drawn = [
        dataclasses.replace(p, value=p.value + p.stderr * rng.normal()) if p.stderr else p for p in report.parameters
    ]
    at = next(i for i, p in enumerate(drawn) if p.kept)
    drawn[at] = dataclasses.replace(drawn[at], value=drawn[at].value + shift * drawn[at].stderr)
    return dataclasses.replace(report, parameters=tuple(drawn))


def test_a_report_does_not_differ_from_itself() -> None:
    found = compare(discovered(), discovered())
    assert {c.chance for c in (*found.parameters, *found.effects, *found.placement)} == {1.0}
    assert {c.name for c in found.placement} >= {"tool x", "registration rz"}
    assert (found.only_before, found.only_after, found.incomparable) == ((), (), ())
    assert verdict(found).startswith("0 of ")


def test_noise_alone_is_seldom_called_a_change_and_a_shift_is_found() -> None:
    wrong = sum(
        any(c.significant for c in compare(remeasured(2 * s), remeasured(2 * s + 1)).parameters) for s in range(200)
    )
    assert wrong <= 200 * 3 * SIGNIFICANCE
    moved = compare(remeasured(1), remeasured(2, shift=12.0))
    changed = [c.name for c in moved.parameters if c.significant]
    assert changed == [next(p.name for p in discovered().parameters if p.kept)]
    assert moved.parameters[0].name == changed[0]
    assert changed[0] in verdict(moved)


def test_effects_that_came_and_went_are_named() -> None:
    report = discovered()
    new = dataclasses.replace(report, effects=(EffectRecord("something new", value=1.0, stderr=0.1),))
    found = compare(report, new)
    assert [e.name for e in found.only_after] == ["something new"]
    assert [e.name for e in found.only_before] == [report.effects[0].name]
    assert "new: something new" in verdict(found)


def test_parameters_that_only_one_could_fit_are_not_compared() -> None:
    report = discovered()
    kept = next(p for p in report.parameters if p.kept)
    without = [dataclasses.replace(p, kept=False, stderr=None) if p is kept else p for p in report.parameters]
    found = compare(report, dataclasses.replace(report, parameters=tuple(without)))
    assert found.incomparable == (kept.name,)
    assert kept.name not in {c.name for c in found.parameters}
    assert "fitted in one only" in text(found)
    assert verdict(found).startswith(f"0 of {len(found.effects)} quantities")


def test_text_and_page_show_every_change_in_80_columns() -> None:
    found = compare(remeasured(1), remeasured(2, shift=12.0))
    said = text(found)
    assert max(map(len, said.splitlines())) <= 80
    assert sum(line.endswith("*") for line in said.splitlines()) == 1
    page = html(found)
    assert all(
        c.name[:14] in said and c.name.split()[-1] in said and c.name in page
        for c in (*found.parameters, *found.effects)
    )


def test_another_machine_is_refused() -> None:
    report = discovered()
    other = dataclasses.replace(report, mechanism=MechanismRecord("ur5", report.mechanism.joints))
    with pytest.raises(InputError, match="expected two calibrations of one machine"):
        compare(report, other)
