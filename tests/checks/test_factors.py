"""Positions or joint values times a constant: named with its size, where neither lengths nor loads explain it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot

from gpmodel.checks.judge import Remark, check_dataset
from gpmodel.table.dataset import Dataset

AXES = np.array([1.0, 1.0, 1.001])


def joint_4(data: Dataset) -> Dataset:
    return replace(data, q=data.q * np.where(np.arange(6) == 3, 1.001, 1.0))


def said(change: Callable[[Dataset], Dataset], arm: str, **settings: object) -> Remark:
    mechanism, made = robot(60, name=arm, **settings)
    (one,) = [r for r in check_dataset(mechanism, change(made.dataset)) if "scale" in r.text]
    return one


@pytest.mark.parametrize("arm", ["irb6400r", "ur10"])
@pytest.mark.parametrize(
    ("change", "words", "fit"),
    [
        (lambda d: replace(d, position=1.01 * d.position), "x, y and z look scaled by 1.0", False),
        (lambda d: replace(d, position=AXES * d.position), "column 'z' looks scaled by 1.0010", True),
        (joint_4, "looks scaled by 1.00", True),
    ],
)
def test_a_scaled_column_is_named(change: Callable[[Dataset], Dataset], words: str, fit: bool, arm: str) -> None:
    found = said(change, arm)
    assert found.severity == "warning"
    assert words in found.text
    assert fit == (not found.unfit)


@pytest.mark.parametrize(
    "effects", [(), ("base_compliance=1e-6",), ("joint_compliance J2=2e-6", "joint_compliance J3=2e-6")]
)
def test_an_arm_that_yields_is_not_scaled(effects: tuple[str, ...]) -> None:
    found = said(lambda d: d, "irb6400r", effects=effects)
    assert found.severity == "note"
    assert abs(float(found.text.split(": ")[1].split(" ")[0]) - 1.0) < 1e-3


def test_lengths_of_a_tenth_of_a_percent_are_no_scale_but_are_said() -> None:
    found = said(lambda d: replace(d, position=1.001 * d.position), "ur5")
    assert found.severity == "note"
    value, deviation = (float(text) for text in found.text.split(": ")[1].split(" ± "))
    assert abs(value - 1.001) < 3 * deviation < 3e-3
