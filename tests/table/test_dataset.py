"""The measured table in memory."""

from typing import Any

import numpy as np
import pytest
from cli_cases import robot

DATA = robot(10, inputs={"temperature": np.arange(10.0)}, input_units={"temperature": "degC"}, payload=np.arange(10.0))[
    1
].dataset


@pytest.mark.parametrize("name", ["q", "position", "rotation", "row", "payload"])
def test_arrays_cannot_be_changed(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(DATA, name)[0] = 0


@pytest.mark.parametrize("name", ["distances", "labels", "extras", "extra_units"])
def test_mappings_cannot_be_changed(name: str) -> None:
    with pytest.raises(TypeError):
        getattr(DATA, name)["new"] = 0


@pytest.mark.parametrize("rows", [[0, 3, 9], np.array([9, 0]), np.arange(10) % 2 == 0])
def test_subset_takes_the_same_rows_of_everything(rows: Any) -> None:
    part = DATA.subset(rows)
    at = np.arange(10)[rows]
    assert len(part) == len(at)
    np.testing.assert_array_equal(part.row, at + 1)
    np.testing.assert_array_equal(part.q, DATA.q[at])
    np.testing.assert_array_equal(part.position, DATA.position[at])
    np.testing.assert_array_equal(part.payload, at)
    np.testing.assert_array_equal(part.extras["temperature"], at)
    assert part.joints == DATA.joints
    assert part.extra_units == DATA.extra_units


def test_codes_number_labels_in_order_of_appearance() -> None:
    from dataclasses import replace

    labelled = replace(DATA.subset(range(4)), labels={"setup": np.array(["b", "a", "b", ""])})
    names, index = labelled.codes("setup")
    assert names == ["b", "a", ""]
    assert index.tolist() == [0, 1, 0, 2]
    assert DATA.codes("tool") == ([""], pytest.approx(np.zeros(10)))


def test_rotations_are_there_or_not() -> None:
    from dataclasses import replace

    assert not DATA.has_rotation
    assert replace(DATA, rotation=np.zeros((10, 3))).has_rotation
