"""Records of machines calibrated together in fleet.json, each among the others."""

import msgspec
import numpy as np

from gpmodel.hierarchy.fleet import Fleet
from gpmodel.hierarchy.record import NOISE, BlockPart, FleetPart, SharedPart, prior_parts
from gpmodel.model.effect import Effect
from gpmodel.model.naming import table_names, translate


def shared_parts(final: Fleet) -> tuple[SharedPart, ...]:
    """Every effect without a prior of its own that all machines' poses tell and, last, the noise."""
    noise = Effect(NOISE, (), "1")
    out = []
    for k, (effect, of) in enumerate(zip((*final.effects, noise), final.shared, strict=True)):
        z, chances = final.deviations.z[:, k], final.deviations.chance[:, k]
        outside = np.flatnonzero(np.logical_not(final.deviations.inside[:, k]))
        fits = () if effect.constant else final.shrunken
        at = [[e.name for e in fit.model.effects].index(effect.name) for fit in fits]
        both = [(float(fit.theta[j]), float(fit.stderr[j])) for fit, j in zip(fits, at, strict=True)]
        out.append(
            SharedPart(
                name=effect.name, unit=effect.unit, constant=effect.constant and effect != noise,
                mean=of.mean, stderr=of.stderr, spread=of.spread, low=of.low, high=of.high,
                values=tuple(final.values[:, k].tolist()), stderrs=tuple(final.stderr[:, k].tolist()),
                shrunken=tuple(v for v, _ in both), shrunken_stderrs=tuple(e for _, e in both),
                z=tuple(z.tolist()), chances=tuple(chances.tolist()), outliers=tuple(outside.tolist()),
            )
        )  # fmt: skip
    return tuple(out)


def block_parts(final: Fleet) -> tuple[BlockPart, ...]:
    """Every block of effects with priors of their own."""
    out = []
    for k, block in enumerate(final.blocks, len(final.shared)):
        outside = np.flatnonzero(np.logical_not(final.deviations.inside[:, k]))
        of = (tuple(a.tolist()) for a in (final.deviations.z[:, k], final.deviations.chance[:, k], outside))
        out.append(BlockPart(block.name, prior_parts(block.effects), block.spread, block.low, block.high, *of))
    return tuple(out)


def in_table_names(fleet: FleetPart) -> FleetPart:
    """Return the record with the joint names of the tables, for reading; fleet.json has the mechanism's names."""
    names, renamed = table_names(fleet.joints, fleet.columns), msgspec.structs.replace

    def said(of: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(translate(name, names) for name in of)

    return renamed(
        fleet,
        chosen=translate(fleet.chosen, names),
        left_out=said(fleet.left_out),
        machines=tuple(renamed(m, effects=said(m.effects)) for m in fleet.machines),
        parameters=tuple(renamed(p, name=translate(p.name, names)) for p in fleet.parameters),
        blocks=tuple(renamed(b, name=translate(b.name, names)) for b in fleet.blocks),
    )
