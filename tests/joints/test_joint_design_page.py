"""The design page: every limit follows its own model, and the one that governs changes with what is asked."""

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from joints.design import JointDesign, joint_design
from joints.film_design import design_film
from joints.film_settings import film_geometry, orifice_law
from joints.orifice import ATMOSPHERE
from joints.studies import STUDIES
from joints.studies.design import design_study


def design(folder: Path, text: str) -> JointDesign:
    file = folder / "mine.toml"
    file.write_text(text)
    return joint_design(file)


def limit(found: JointDesign, quantity: str) -> float:
    return next(x.share for x in found.limits if quantity in x.quantity)


def test_the_thesis_joint_is_too_soft_for_table_1_2_tilts_too_little_and_outgrows_its_micrometre() -> None:
    """The whole loop grows 2.1 um/K: 1.05 um in the 0.5 K that section 3.4 allows for the socket's 1.17 um/K alone.

    Its sphere's film has 4.6 N/um, less 0.26 of the magnets; its pitch turns by 85 deg to either side.
    """
    found = joint_design()
    missed = {x.topic: x.share for x in found.limits if x.share > 1}
    assert found.verdict.endswith("not met: thermal, workspace, stiffness")
    assert missed == pytest.approx({"thermal": 1.053, "workspace": 180 / 170, "stiffness": 10 / 4.338}, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "governs"),
    [
        ('[demand]\npull = "80 N"', "preload"),
        ('[demand]\nsupply = "3 atm"', "film"),
        ('[demand]\nload_change = "40 N"', "stiffness"),
        ('[demand]\naccuracy = "5 um"', "accuracy"),
        ('[demand]\ncontact = "point"', "contact"),
        ('[thermal]\ntemperature_change = "3 K"', "thermal"),
    ],
)
def test_the_limit_that_governs_is_the_one_that_was_tightened(tmp_path: Path, text: str, governs: str) -> None:
    demand = "" if "[demand]" in text else "\n[demand]"
    found = design(tmp_path, f'{text}{demand}\nstiffness = "1 N/um"\nworkspace = "90 deg"')
    assert found.governing.topic == governs
    assert found.verdict.startswith(f"{governs} governs")
    assert f"not met: {', '.join(x.topic for x in found.limits if x.share > 1)}" in found.verdict


def test_shares_follow_the_demands_in_proportion(tmp_path: Path) -> None:
    twice = design(tmp_path, '[demand]\npull = "20 N"\nsupply = "14 atm"\ndeflection = "6 um"')
    for quantity in ("pull before", "inlet pressure", "deflection by"):
        assert limit(twice, quantity) == pytest.approx(limit(joint_design(), quantity) / 2)


def test_air_behind_the_orifices_makes_the_joint_hammer(tmp_path: Path) -> None:
    """Without air 62 % of a vibration remain a cycle later; three pockets of 10.6 mm^3 sustain it."""
    assert "hammers with 10.6 mm^3 of air behind each orifice, and has 0" in design_study().tables[-1].note
    for pocket, left in (("0", 0.621), ("10.5", 0.997), ("20", 1.295)):
        found = design(tmp_path, f'[film.orifice]\npocket = "{pocket} mm^3"')
        assert limit(found, "left a cycle later") == pytest.approx(left, abs=5e-3)
        assert ("hammer" in found.verdict) == (left > 1)


def test_one_file_is_the_joint_and_its_design(tmp_path: Path) -> None:
    """A longer lever of the same joint has the larger error where its shaft is askew, and a ball its own film."""
    found = design(
        tmp_path,
        'kind = "spherical"\n[ball]\ndiameter = "60 mm"\n[tooling_ball]\ncentre = ["-40 mm", "0 mm", "100 mm"]\n',
    )
    assert found.joint.name == "mine"
    assert limit(found, "geometric error") > limit(joint_design(), "geometric error")
    film = found.settings["film"]
    assert film["ball_radius"] == pytest.approx(0.03)
    guide = design_film(film_geometry(film), 100.69, orifice_law(film["orifice"]), 50e-6)
    pressure = limit(found, "inlet pressure") * 7 * ATMOSPHERE
    assert pressure == pytest.approx(float(guide.inlet_pressure), rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("contact", ["point", "rolling", "sliding", "fluid"])
def test_every_contact_has_its_page(tmp_path: Path, contact: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'[demand]\ncontact = "{contact}"')
    study = STUDIES["design"](file, 0)
    page = study.pages["joint_design.html"]
    HTMLParser().feed(page)
    for entry in study.data["limits"]:
        assert np.isfinite(entry["share"])
        assert entry["quantity"].replace("'", "&#39;") in page
    assert "http" not in page
    assert page.count("governs") >= 2
