"""Pugh charts: the thesis' totals, weights and refusals."""

import pytest

from gpmodel.errors import InputError
from joints.pugh import PughChart, pugh_chart, read_mark
from joints.settings import DATA, read_toml


def thesis_chart(index: int) -> PughChart:
    entry = read_toml(DATA / "pugh.toml")["chart"][index]
    return pugh_chart(entry["title"], entry["concepts"], entry["marks"])


@pytest.mark.parametrize(
    ("index", "criteria", "scores"),
    [(0, 22, [0, 6, 7, 1]), (1, 13, [6, 4, 4, 4, 3, 5, 3])],
    ids=["Table 2.6", "Table 2.12"],
)
def test_totals_of_the_thesis(index: int, criteria: int, scores: list[int]) -> None:
    chart = thesis_chart(index)
    assert len(chart.criteria) == criteria
    assert chart.scores.tolist() == scores
    assert (chart.pluses - chart.minuses).tolist() == scores


def test_ranking_starts_with_the_best() -> None:
    assert thesis_chart(0).ranking == ("Kinematic", "Shoulder", "Slot and revolute", "INA")
    assert thesis_chart(1).ranking[:2] == ("CMM", "Tensile tester")


def test_weights_multiply_their_criterion() -> None:
    chart = pugh_chart("t", ["a", "b"], {"x": ["+", "-"], "y": ["0", "++"]}, {"x": 3})
    assert chart.scores.tolist() == [3, -1]
    assert chart.pluses.tolist() == [1, 2]
    assert chart.minuses.tolist() == [0, 1]


@pytest.mark.parametrize(("text", "mark"), [("0", 0), ("+", 1), ("++", 2), (" - ", -1), ("---", -3)])
def test_marks(text: str, mark: int) -> None:
    assert read_mark(text, "here") == mark


@pytest.mark.parametrize(
    ("concepts", "marks", "weights", "words"),
    [
        (["a"], {"x": ["+-"]}, None, r"Pugh chart 't', x: mark '\+-', expected 0"),
        (["a"], {"x": [""]}, None, "mark ''"),
        (["a", "b"], {"x": ["+"]}, None, "1 marks, expected 2, one a concept"),
        (["a"], {"x": ["+"]}, {"z": 2.0}, "weight of unknown criterion 'z'"),
        ([], {}, None, "no concepts or no criteria"),
    ],
)
def test_bad_charts_are_refused(
    concepts: list[str], marks: dict[str, list[str]], weights: dict[str, float] | None, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        pugh_chart("t", concepts, marks, weights)
