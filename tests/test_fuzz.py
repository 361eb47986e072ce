"""Test that every reader of files reads an edited text or refuses it in one line."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.scale.readers import TOKENS, Edit, Reader, edited, outcome, readers

EDIT = st.builds(Edit, st.integers(0, 4), st.floats(0.0, 1.0), st.integers(0, 40), st.integers(0, len(TOKENS) - 1))
EDITS = st.lists(EDIT, min_size=1, max_size=6)


@cache
def everything() -> Mapping[str, Reader]:
    return readers()


@pytest.mark.parametrize("name", ["expression", "model", "toml", "urdf", "table"])
def test_what_is_good_is_read(name: str, tmp_path: Path) -> None:
    reader = everything()[name]
    assert {outcome(reader, text, tmp_path) for text in reader.good} == {"read"}


@pytest.mark.parametrize("name", ["expression", "model", "toml", "urdf", "table"])
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_what_is_not_is_refused_in_one_line(name: str, data: st.DataObject, tmp_path: Path) -> None:
    reader = everything()[name]
    text = edited(data.draw(st.sampled_from(reader.good)), data.draw(EDITS))
    assert outcome(reader, text, tmp_path) in ("read", "refused"), text
