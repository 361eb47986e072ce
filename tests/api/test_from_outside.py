"""Extensions run in the loop: a family in ten lines, a selection scheme in thirty, defined here."""

import inspect
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

import gpmodel as gp
from gpmodel.evolution.scoring import Scores

ARM = gp.load_mechanism("irb6400r")
CABLE = gp.simulate(ARM, ["J4.moving:Ry:sin(J4)*tanh(temperature-25)=0.5 mrad"], poses=90, seed=4,
                    inputs={"temperature [degC]": "20:30"})  # fmt: skip
QUICK = gp.Search(runs=1, population=64, generations=6)


def cable_drag(mechanism: gp.Mechanism, states: gp.States) -> Iterator[gp.Effect]:
    for joint in mechanism.joints[3:]:
        shape = gp.Expression(f"sin({joint.name})*tanh(temperature-25)")
        yield gp.effect_at(f"cable drag, {joint.name}", f"{joint.name}.moving", "Ry", shape)


FAMILY = gp.Family("cable_drag", "a stiff cable pulls at the wrist", "own measurements, 2024", cable_drag)


@dataclass(frozen=True)
class Roulette:
    """Parents in proportion to what they explain (Holland 1975); the best `kept` of them live on."""

    kept: int = 8

    def eligible(self, population: int) -> int:
        return population

    def parents(self, scores: Scores, rng: np.random.Generator) -> np.ndarray:
        fit = np.where(np.isfinite(scores.score), scores.score, np.inf)
        worth = np.maximum(np.max(fit[np.isfinite(fit)], initial=0.0) - fit, 0.0)
        worth = np.where(np.isfinite(worth), worth, 0.0) + 1e-12
        return rng.choice(len(worth), (2, len(worth)), p=worth / worth.sum())

    def survivors(self, scores: Scores, population: int) -> np.ndarray:
        best = np.argsort(scores.score[:population], kind="stable")[: self.kept]
        young = population + np.argsort(scores.score[population:], kind="stable")[: population - self.kept]
        return np.concatenate([best, young])


def test_they_are_as_short_as_is_promised() -> None:
    assert len(inspect.getsource(cable_drag).splitlines()) + 1 <= 10
    assert len(inspect.getsource(Roulette).splitlines()) <= 30


@pytest.mark.long
def test_a_family_from_outside_is_found_named_and_explained() -> None:
    found = gp.discover(ARM, CABLE.table, holdout=0.3, candidates=(*gp.catalogue, FAMILY), search=QUICK)
    assert [(f.name, f.catalogue) for f in found.findings] == [("cable drag, J4", "cable_drag")]
    assert found.findings[0].explanation == "a stiff cable pulls at the wrist (own measurements, 2024)"
    assert found.findings[0].value == pytest.approx(5e-4, abs=5 * found.findings[0].stderr)


@pytest.mark.long
def test_the_loop_evolves_with_a_selection_scheme_from_outside() -> None:
    search = gp.Search(runs=4, population=256, generations=20, selection=Roulette())
    made = gp.simulate(ARM, ["J4.moving:Rx:tanh(3*sin(J4))*J2=0.5 mrad"], poses=90, seed=4)
    found = gp.discover(ARM, made.table, holdout=0.3, candidates=(), search=search)
    assert found.findings[0].slot == "J4.moving"
    assert "J4" in found.findings[0].inputs
    assert found.record.ladder[-1].heldout.rms_mm < 0.6 * found.record.ladder[1].heldout.rms_mm
