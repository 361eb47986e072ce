"""Test the histogram of referenced inputs and its p-values."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.input_histogram import RunRecord, histogram, input_prices, without_runs
from gpmodel.formula.expression import parse

INPUTS = ("J1", "J2", "J3", "J4")


def records(texts: list[str], strengths: np.ndarray, *, shuffled: bool, kind: str = "linear") -> list[RunRecord]:
    return [
        RunRecord(kind, shuffled, parse(text), float(strength)) for text, strength in zip(texts, strengths, strict=True)
    ]


def chance_runs(count: int, rng: np.random.Generator) -> list[RunRecord]:
    texts = [f"sin({INPUTS[k]})" for k in rng.integers(0, 4, count)]
    return records(texts, rng.gumbel(4.0, 1.0, count), shuffled=True)


def test_counts_are_of_effective_code_by_representation() -> None:
    runs = [
        *records(["sin(J1)*J1", "J1 + J2"], np.ones(2), shuffled=False),
        *records(["cos(J3)"], np.ones(1), shuffled=False, kind="tree"),
        *records(["J4"], np.ones(1), shuffled=True),
    ]
    found = histogram(runs, INPUTS, 0.05)
    assert found.counts["linear"] == (2, 1, 0, 0)
    assert found.counts["tree"] == (0, 0, 1, 0)
    assert found.shuffled == {"linear": (0, 0, 0, 1), "tree": (0, 0, 0, 0)}
    assert found.referring_by_chance == (0, 0, 0, 1)
    assert found.operators == {"linear": {"add": 1, "multiply": 1, "sin": 1}, "tree": {"cos": 1}}
    assert found.runs == {"linear": 2, "tree": 1}


def test_an_input_that_stands_out_is_significant_and_the_others_are_not() -> None:
    rng = np.random.default_rng(0)
    real = records(["sin(J2)"] * 12, 30.0 + rng.normal(size=12), shuffled=False)
    found = histogram([*real, *chance_runs(12, rng)], INPUTS, 0.05)
    assert found.significant == ("J2",)
    assert min(found.p_values[k] for k in (0, 2, 3)) == 1.0


def test_an_input_every_run_finds_but_no_better_than_chance_is_not_significant() -> None:
    rng = np.random.default_rng(1)
    real = records(["sin(J2)"] * 12, np.full(12, 5.0), shuffled=False)
    found = histogram([*real, *chance_runs(12, rng)], INPUTS, 0.05)
    assert found.count_p[1] < 0.05 < found.strength_p[1]
    assert found.significant == ()


def test_an_input_that_shuffled_runs_refer_to_as_often_is_not_significant_however_much_is_explained() -> None:
    rng = np.random.default_rng(3)
    null = records(["sin(J2)"] * 12, rng.gumbel(4.0, 1.0, 12), shuffled=True)
    found = histogram([*records(["sin(J2)"] * 12, np.full(12, 90.0), shuffled=False), *null], INPUTS, 0.05)
    assert found.strength_p[1] < 0.05 < found.count_p[1]
    assert found.significant == ()


@pytest.mark.long
def test_chance_alone_is_called_significant_no_more_often_than_said() -> None:
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(200):
        null = chance_runs(20, rng)
        real = [RunRecord(r.representation, False, r.program, r.strength) for r in chance_runs(20, rng)]
        hits += bool(histogram([*real, *null], INPUTS, 0.05).significant)
    assert hits <= 20


def test_without_shuffled_runs_nothing_is_claimed() -> None:
    real = records(["sin(J2)"] * 12, np.full(12, 50.0), shuffled=False)
    assert histogram(real, INPUTS, 0.05).p_values == (1.0,) * 4


def test_no_runs_is_an_error() -> None:
    with pytest.raises(InputError, match="no run"):
        histogram([], INPUTS, 0.05)


def test_the_price_of_an_input_is_what_references_say_against_their_null() -> None:
    real, null = ["sin(J2)"] * 8, ["sin(J1)", "cos(J2)", "J3", "J4"]
    found = histogram(
        [*records(real, np.ones(8), shuffled=False), *records(null, np.ones(4), shuffled=True)], INPUTS, 0.05
    )
    prices = input_prices([found])
    factor = {"J2": 9 / 10 * 6 / 2, "J1": 1 / 10 * 6 / 2}
    mean = (factor["J2"] + 3 * factor["J1"]) / 4
    assert prices["J2"] == pytest.approx(np.log(mean / factor["J2"]))
    assert prices["J1"] == prices["J3"] == pytest.approx(np.log(mean / factor["J1"]))
    assert sum(np.exp(-value) for value in prices.values()) == pytest.approx(len(INPUTS))
    assert input_prices([without_runs(INPUTS, 0.05)]) == {}
