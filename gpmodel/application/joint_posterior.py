"""Posterior of a ball joint from its rig, used as prior of a ball of a machine: thesis, section 1.5.1."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Ball, Mechanism, Reaching, Shift, balls_of
from gpmodel.model.effect import Effect, Term
from gpmodel.model.sites import translate

ALONG = 0.7
"""Least cosine between an effect and a direction of the ball that it is taken for: under 45 degrees."""


def of_the_ball(name: str, joint: SavedModel, machine: Mechanism) -> tuple[Effect, ...]:
    """The varying shifts of a joint's ball at the ball `name` of a machine, with the posterior as their prior.

    An effect of the joint with value θ ± s along a direction of its socket, over its first or second angle, is there
    N(θ, s²) along the same direction of that ball, over its roll or pitch: the ball stands on the machine as on its
    rig, its axis along the link at home. What turns a ball about its own link is not known on a machine, and constants
    of the rig are its own; both stay behind.
    Raises InputError: no such ball, a result of something else than one ball joint, nothing that could be handed over.
    """
    balls = {ball.name: ball for ball in balls_of(machine) if ball.name}
    if name not in balls:
        raise InputError(f"'{name}' is no ball of {machine.name}; it has {choices(name, balls)}", "joint")
    rig = joint.mechanism
    if isinstance(rig, Reaching) and len(joint.placement.tool) == 1:  # a lever ends where the fit found the tool
        rig = rig.reaching(next(iter(joint.placement.tool.values()))[:3, 3])
    single = balls_of(rig)
    if len(single) != 1 or single[0].name:
        raise InputError(f"{name}: a result of {joint.mechanism.name}, expected one of a ball joint alone", "joint")
    there = balls[name]
    handed = [
        _handed(effect, float(theta), float(stderr), single[0], there)
        for effect, theta, stderr in zip(joint.model.effects, joint.theta, joint.stderr, strict=True)
    ]
    found = tuple(effect for effect in handed if effect is not None)
    if not found:
        known = ", ".join(e.name for e in joint.model.effects if not e.constant) or "constants alone"
        raise InputError(f"{name}: of that joint {known} is known, expected a shift over the tilt of its ball", "joint")
    return found


def _handed(effect: Effect, theta: float, stderr: float, one: Ball, there: Ball) -> Effect | None:
    """One effect at the other ball; None where it is none of the ball, or nobody knows its size."""
    names = dict(zip(one.angles, there.angles, strict=False))
    if effect.constant or not set(effect.inputs) <= set(names) or not stderr > 0:
        return None
    for (_, shift), (_, other) in zip(one.shifts.items(), there.shifts.items(), strict=True):
        weights = _weights(effect.terms, shift)
        if weights is not None:
            basis = Expression(translate(str(effect.terms[0].basis), names))
            size = float(np.linalg.norm(weights) * np.sign(weights @ [w for *_, w in shift]))
            terms = tuple(Term(slot, axis, basis, size * weight) for slot, axis, weight in other)
            name = f"{translate(effect.name, names)}, {there.name}"
            return replace(effect, name=name, terms=terms, mean=theta, prior=stderr)
    return None


def _weights(terms: Sequence[Term], shift: Shift) -> Array | None:
    """Weights of an effect along the terms of a shift, None where it acts elsewhere or across it."""
    given = {(term.slot, term.axis): term.weight for term in terms}
    if len({str(term.basis) for term in terms}) > 1 or not set(given) <= {(slot, axis) for slot, axis, _ in shift}:
        return None
    weights = np.array([given.get((slot, axis), 0.0) for slot, axis, _ in shift])
    along = abs(weights @ [w for *_, w in shift]) / max(float(np.linalg.norm(weights)), 1e-300)
    return weights if along > ALONG else None
