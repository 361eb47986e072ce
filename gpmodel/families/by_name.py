"""Read the names of error effects as written on a command line."""

import numpy as np

from gpmodel.errors import InputError, choices
from gpmodel.families import catalogue
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism, places
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.sites import in_mechanism_names, with_joint_names
from gpmodel.model.states import States

MOST_INSTANCES = 12
"""Largest number of effects that the name of a catalogue family may select, and that a message lists."""


def effects_named(name: str, mechanism: Mechanism, states: States) -> tuple[Effect, ...]:
    """Return the effects of a catalogue name, of a whole family, or of a formula `slot:axis:expression`.

    `gear_harmonic J4` selects one effect of a family; `gear_harmonic` selects the effects of all joints, at most
    MOST_INSTANCES. Raises InputError for an unknown name, slot (frame), axis or input, or if the effect is not finite
    at some pose.
    """
    if "=" in name and name.count(":") != 2:
        raise InputError(
            f"effect '{name}': '=VALUE' is for simulate only; expected the name alone, since the value is fitted"
        )
    if name.count(":") == 2:
        effects: tuple[Effect, ...] = (in_mechanism_names(_written_out(name, mechanism), mechanism, states),)
    else:
        effects = _of_catalogue(with_joint_names(name, mechanism), mechanism, states)
    for effect in effects:
        check_defined(effect, mechanism, states, name)
    return effects


def check_defined(effect: Effect, mechanism: Mechanism, states: States, name: str = "") -> None:
    """Raise InputError if an effect has no term, an unknown slot (frame) or input, or is not finite at some pose.

    name: name of the effect in the message, if different from the effect's name.
    """
    message = f"effect '{name or effect.name}'"
    if not effect.terms:
        raise InputError(f"{message}: has no terms; expected one at least, as in (Term('base', 'Rx'),)")
    for term in effect.terms:
        if term.slot not in places(mechanism):
            raise InputError(
                f"{message}: slot '{term.slot}' is unknown; available: {choices(term.slot, places(mechanism))}"
            )
        if not np.isfinite(term.basis(states)).all():
            raise InputError(f"{message}: '{term.basis}' is infinite or undefined at some poses")


def one_effect_named(name: str, mechanism: Mechanism, states: States) -> tuple[Effect, ...]:
    """Return the effects that a name selects at one site: one effect, or a sine and its cosine.

    Raises InputError in the cases of `effects_named`, and for a name of effects at several sites.
    """
    instances = [c.name for c in catalogue.of_family(name, mechanism, states)]
    if len(instances) > 1:
        raise InputError(
            f"effect '{name}' stands for {len(instances)} effects of {mechanism.name}; expected one of "
            f"{'; '.join(instances[:MOST_INSTANCES])}"
        )
    return effects_named(name, mechanism, states)


def _written_out(name: str, mechanism: Mechanism) -> Effect:
    slot, axis, text = (part.strip() for part in name.split(":"))
    return effect_at(
        name, with_joint_names(slot, mechanism), axis, Expression(with_joint_names(text, mechanism, "[ _]"))
    )


def _of_catalogue(name: str, mechanism: Mechanism, states: States) -> tuple[Effect, ...]:
    instances = catalogue.of_family(name, mechanism, states)
    if len(instances) > MOST_INSTANCES:
        few = "; ".join(c.name for c in instances[:MOST_INSTANCES])
        raise InputError(
            f"effect '{name}' stands for {len(instances)} effects of {mechanism.name}; expected one, for example {few}"
        )
    return tuple(e for c in instances for e in c.effects) or catalogue.build(name, mechanism, states)
