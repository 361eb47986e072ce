"""The families of effects, and what they have on a mechanism."""

from dataclasses import replace

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.families.catalogue import catalogue, instances
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import prepare
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import unmeasured

POSES = 40
"""Random poses a family is tried on: enough for every instance to show, none is fitted."""

INSTRUMENT_AT = (1.0, 3.5, -0.5)
"""The mechanism's root in the frame of the instrument, m: as a tracker stands."""


def effects(mechanism: Mechanism) -> pd.DataFrame:
    """One row a family: family, explanation, source, instances, the inputs of the first, its name as an example, and
    whether it takes a payload for any of them.

    On random poses within the limits, read by an instrument beside the mechanism, with a payload that varies, a
    temperature, a time and directions of approach, rows in order.
    """
    rng = np.random.default_rng(0)
    time: Array = np.arange(0.0, 60.0 * POSES, 60.0)
    warming: Array = 20.0 + time / 600.0
    q = random_poses(mechanism, POSES, rng)
    approach = [f"approach_{joint.name}" for joint in mechanism.joints]
    dataset = replace(
        unmeasured([joint.name for joint in mechanism.joints], q, rng.uniform(0.0, 10.0, POSES)),
        extras={"temperature": warming, "time": time, **{name: rng.choice([-1.0, 1.0], POSES) for name in approach}},
        extra_units={"temperature": "degC", "time": "s", **dict.fromkeys(approach, "1")},
        in_order=True,
    )
    read = chain(mechanism.transforms(q))[-1][:, :3, 3] + INSTRUMENT_AT
    states = prepare(mechanism, replace(dataset, position=read)).states
    bare = prepare(mechanism, replace(dataset, position=read, payload=np.zeros(POSES))).states
    rows = []
    for family in catalogue:
        found = tuple(instances(family, mechanism, states))
        reads = dict.fromkeys(name for effect in found[0].effects for name in effect.inputs) if found else {}
        rows.append(
            {
                "family": family.name,
                "explanation": family.explanation,
                "source": family.source,
                "instances": len(found),
                "inputs": ", ".join(reads),
                "example": found[0].name if found else "",
                "payload": bool(found) and next(iter(instances(family, mechanism, bare)), None) is None,
            }
        )
    return pd.DataFrame(rows)
