"""The geometric part of a fitted model as URDF, for mechanisms that know how to write themselves."""

from pathlib import Path

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import ExportsUrdf
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.states import States


def write_urdf(saved: SavedModel, states: States, path: Path) -> None:
    """Write the nominal chain with the constant error twists in it; nothing where the mechanism has no writer.

    states: of any pose, which constant twists do not depend on.
    """
    mechanism = saved.mechanism
    bare = mechanism.bare if isinstance(mechanism, LoadedMechanism) else mechanism
    if not isinstance(bare, ExportsUrdf):
        return
    twists: dict[str, Array] = {}
    for effect, value in zip(saved.model.effects, saved.theta, strict=True):
        if effect.constant and value != 0.0:
            for slot in effect.slots:
                one = value * effect.twist(states.subset(np.arange(1)), slot)[0]
                twists[slot] = twists.get(slot, np.zeros(6)) + one
    bare.write_urdf(path, twists)
