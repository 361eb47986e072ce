"""Contract checks of user-defined effects and families of effects."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.errors import InputError
from gpmodel.families.catalogue import Family, instances
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism, places
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.states import States
from gpmodel.numerics import se3
from gpmodel.table.dataset import unmeasured
from gpmodel.table.units import known_unit, split_header

PAYLOAD = 10.0
"""Largest payload of the random poses in a check of effects, kg."""

INSTRUMENT_AT = (-1.0, -3.5, 0.5)
"""Origin of the mechanism's root in the instrument's frame in the checks, m: a typical tracker position."""


def check_family(
    family: Family, mechanism: Mechanism, *, inputs: Mapping[str, Array] | None = None, poses: int = 24, seed: int = 0
) -> None:
    """Check the candidates of a family on a mechanism: names, values, text form and effect on the tool point.

    inputs: further columns by header: "temperature [degC]": values (poses,).
    The family cites a source and offers at least one candidate; names are unique, costs are not negative. Basis
    functions depend on known inputs only, are finite, and survive conversion to text. An effect's column is the
    derivative of the predicted point with respect to its coefficient, signs included.
    """
    scene, placement = _scene(mechanism, inputs or {}, poses, seed)
    found = tuple(instances(family, mechanism, scene.states))
    assert found, (
        f"family '{family.name}' has no candidate for {mechanism.name} with these columns; expected at least one"
    )
    names = [candidate.name for candidate in found]
    assert len(set(names)) == len(names), (
        f"family '{family.name}': two candidates have equal names; expected different names"
    )
    assert len(family.source) > 5, (
        f"family '{family.name}': has no source; expected a reference or a measured discovery"
    )
    for candidate in found:
        assert candidate.effects, f"candidate '{candidate.name}' has no effect; expected at least one"
        assert candidate.cost >= 0.0, f"candidate '{candidate.name}' has a negative cost; expected 0 or more"
        for effect in candidate.effects:
            _check_effect(effect, mechanism, scene, placement)


def check_effect(
    effect: Effect, mechanism: Mechanism, *, inputs: Mapping[str, Array] | None = None, poses: int = 24, seed: int = 0
) -> None:
    """Check a single effect: its values, its text form and its effect on the tool point."""
    _check_effect(effect, mechanism, *_scene(mechanism, inputs or {}, poses, seed))


def _check_effect(effect: Effect, mechanism: Mechanism, poses: Poses, placement: Placement) -> None:
    where = f"effect '{effect.name}'"
    unknown = set(effect.slots) - set(places(mechanism))
    assert not unknown, f"{where}: unknown slot '{min(unknown)}'; expected a slot of {mechanism.name}"
    assert effect.unit, f"{where}: has no unit; expected a unit such as rad"
    for term in effect.terms:
        for name in term.basis.inputs:
            assert _has(poses.states, name), f"{where}: unknown input '{name}'; expected a column of these poses"
        values = np.asarray(term.basis(poses.states), dtype=float)
        assert values.shape in ((), (len(poses),)), (
            f"{where}: the basis has shape {values.shape}; expected one value per pose"
        )
        assert np.isfinite(values).all(), (
            f"{where}: '{term.basis}' is infinite or undefined at some poses; expected finite values"
        )
        _check_text(where, str(term.basis), values, poses.states)
    model = ErrorModel(mechanism, (effect,))
    bare = ErrorModel(mechanism, ())
    column = effect_columns((effect,), bare, poses, observe(bare, poses, np.zeros(0), placement))[:, :3, 0]
    largest = max(float(np.abs(effect.twist(poses.states, slot)).max()) for slot in effect.slots)
    assert largest > 0.0, f"{where}: the effect is zero at every pose; expected a motion"
    step = np.array([1e-6 / largest])
    ahead, behind = (observe(model, poses, side * step, placement).tip[:, :3, 3] for side in (1, -1))
    miss = np.abs(column - (ahead - behind) / (2 * step)).max()
    assert miss < 1e-5 * np.abs(column).max() + 1e-9, (
        f"{where}: the column is not equal to the derivative of the prediction"
    )


def _has(states: States, name: str) -> bool:
    """Return whether the poses have a column or can compute it, as columns of time lags and instruments."""
    try:
        return len(states[name]) == len(states)
    except InputError:
        return False


def _check_text(where: str, text: str, values: Array, states: States) -> None:
    again = np.asarray(Expression(text)(states), dtype=float)
    assert np.allclose(again, values, rtol=1e-12, atol=0), (
        f"{where}: the values change when '{text}' is parsed again; expected equal values"
    )


def _scene(mechanism: Mechanism, inputs: Mapping[str, Array], count: int, seed: int) -> tuple[Poses, Placement]:
    rng = np.random.default_rng(seed)
    headers = {header: split_header(header) for header in inputs}
    for header, (_, unit) in headers.items():
        assert known_unit(unit or "nothing"), f"inputs '{header}': expected a unit, as in 'temperature [degC]'"
    q = random_poses(mechanism, count, rng)
    dataset = replace(
        unmeasured([j.name for j in mechanism.joints], q, rng.uniform(0.0, PAYLOAD, count)),
        extras={name: np.asarray(inputs[h], dtype=float) for h, (name, _) in headers.items()},
        extra_units={name: str(unit) for name, unit in headers.values()},
        in_order=True,
    )
    placement = Placement({"": se3.shift(INSTRUMENT_AT)}, {"": se3.shift((0.1, -0.05, 0.15))}, {})
    read = observe(ErrorModel(mechanism, ()), prepare(mechanism, dataset), np.zeros(0), placement).tip[:, :3, 3]
    return prepare(mechanism, replace(dataset, position=read)), placement
