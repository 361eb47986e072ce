"""A law that was found, with the constants inside it, is one term wherever it is exported; what is none, nowhere."""

from dataclasses import replace
from pathlib import Path

import pytest

import gpmodel as gp
from gpmodel.application.exports.make import exports_of
from gpmodel.application.exports.sample import Place

EXPONENTIAL = {".tex": ("e^{", "\\xi_"), ".py": ("np.exp(", "twists["), ".c": ("exp(", "twists[")}
"""By suffix: how it is written, and what its line has."""


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_bump_is_found_named_and_exported_with_one_exponential() -> None:
    arm = gp.load_mechanism("irb6400r")
    planted = "J2.moving:Rz:exp(-13*square(J2 - 0.3))=0.8 mrad"
    made = gp.simulate(arm, [planted], poses=60, noise="0.02 mm", seed=3)
    found = gp.discover(arm, made.table, search=gp.Search(runs=0), holdout=0.3)
    (finding,) = found.findings
    assert finding.name.startswith("bump of J2 at 17.")
    saved = found.model.saved
    texts = {Path(export.file).suffix: export.text for export in exports_of(saved, Place.of(saved)).made}
    for suffix, (written, place) in EXPONENTIAL.items():
        (line,) = [line for line in texts[suffix].splitlines() if written in line and place in line]
        assert line.count(written) == 1


def test_an_effect_that_is_undefined_where_it_was_fitted_is_exported_nowhere() -> None:
    arm = gp.load_mechanism("irb6400r")
    saved = gp.calibrate(arm, gp.simulate(arm, poses=40, seed=3).table).model.saved
    first, *others = saved.model.effects
    odd = replace(first, terms=(replace(first.terms[0], basis=gp.Expression("1/(J1-J1)")),))
    saved = replace(saved, model=replace(saved.model, effects=(odd, *others)))
    with pytest.raises(gp.InputError, match="is infinite or undefined at some poses"):
        exports_of(saved, Place.of(saved))
