"""Families over the loads that name no part: compliance of any axis under its own wrench, curves over a torque."""

from collections.abc import Iterator

import numpy as np

from gpmodel.families.candidate import Candidate, loaded, one, revolute
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.sites import Site, sites_of
from gpmodel.model.states import States


def compliances(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Each axis of a joint shifts under the force along it; each axis of the base turns under its own moment."""
    joints = {f"{j.name}.{side}": j.name for j in mechanism.joints for side in ("fixed", "moving")}
    for site in sites_of(mechanism):
        owner, along = joints.get(site.slot, site.slot), site.axis[0] == "T"
        load = f"{'force' if along else 'moment'}_{owner}_{site.axis[1]}"
        if loaded(states, load) and along != (owner == "base"):
            name = f"compliance of {site.name}"
            unit = "m/N" if along else "rad/Nm"
            yield one(name, site.effect(name, Expression(load), unit, "structure_compliance"), 6.0)


def all_torques(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """A joint under the torque of another: stiffness that is not where it is drawn."""
    for j in revolute(mechanism):
        for other in revolute(mechanism):
            if other is not j and loaded(states, f"torque_{other.name}"):
                name = f"compliance of {j.name} under the torque of {other.name}"
                effect = Site(j.drive).effect(name, Expression(f"torque_{other.name}"), "rad/Nm", "cross_compliance")
                yield one(name, effect, 6.5)


def load_curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Deflection as a loose curve of the own torque: linear, saturating, hardening, dead band."""
    for j in revolute(mechanism):
        torque = f"torque_{j.name}"
        if not loaded(states, torque):
            continue
        scale = float(np.max(np.abs(states[torque])))
        load = f"{torque}/{scale:.4g}"
        texts = [f"tanh(3*({load}))", f"tanh(10*({load}))", f"abs({load})"]
        texts += [f"max({load} - {b}, 0)" for b in (0.25, 0.5)] + [f"min({load} + {b}, 0)" for b in (0.25, 0.5)]
        name = f"curve over the torque, {j.name}"
        effects: list[Effect] = [
            Site(j.drive).effect(f"{name}, {k}", Expression(t), "rad", "load_curve")
            for k, t in enumerate([load, *texts], 1)
            if np.ptp(Expression(t)(states)) > 0
        ]
        yield Candidate(name, tuple(effects), "load_curve", 6.0)
