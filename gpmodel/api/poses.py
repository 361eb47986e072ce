"""Measurement poses worth taking."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from gpmodel.api.arguments import among, file_path, quantity, whole
from gpmodel.api.display import notebook
from gpmodel.api.mechanism import MechanismLike, mechanism_of
from gpmodel.arrays import Array
from gpmodel.files import write_text
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.planning.poses import observable_poses, spacing, spread_poses
from gpmodel.table.write import joint_column, table_text

CRITERIA = {"spread": spread_poses, "observability": observable_poses}


@dataclass(frozen=True, repr=False)
class PosesResult:
    """Joint values q (N, n), rad and m, and how different the two most alike of them are, in ranges of a joint."""

    mechanism: Mechanism
    q: Array
    spacing: float

    def to_dataframe(self) -> pd.DataFrame:
        """One row a pose, headers with units as measured tables have them."""
        joints = zip(self.mechanism.joints, self.q.T, strict=True)
        return pd.DataFrame(dict(joint_column(j.name, j.kind, values) for j, values in joints))

    def summary(self) -> str:
        """How many, and how far apart."""
        apart = f", no two closer than {self.spacing:.2f} of a range" if len(self.q) > 1 else ""
        return f"{len(self.q)} poses of {self.mechanism.name}{apart}"

    def save(self, file: str | Path) -> None:
        """Write the poses as .csv. Raises InputError when it cannot be written."""
        write_text(file_path(file, "file"), table_text(self.to_dataframe()))

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def _repr_html_(self) -> str:
        return notebook(self.summary(), self.to_dataframe())


def choose_poses(
    mechanism: MechanismLike,
    count: int = 40,
    *,
    criterion: Literal["spread", "observability"] = "spread",
    above: str | float | None = None,
    seed: int = 0,
) -> PosesResult:
    """Joint values within the limits worth measuring at.

    criterion: "spread", every pose as different from the others as possible (Robertson 2003, 3.3.3); "observability",
    the geometric errors as well determined as possible (D-optimal; Borm and Menq 1991). above: lowest height of the
    tip over the root frame, "200 mm" or m. Collisions are not known here. Raises InputError: too few poses for
    observability, nothing above that height.
    """
    search = CRITERIA[among(criterion, CRITERIA, "criterion")]
    lowest = -np.inf if above is None else quantity(above, "length", "above", least=-np.inf)
    rng = np.random.default_rng(whole(seed, "seed"))
    arm = mechanism_of(mechanism)
    q = search(arm, whole(count, "count", 1), rng, lowest)
    return PosesResult(arm, q, spacing(arm, q))
