"""What the links weigh on the joints, link by link, whatever their masses are."""

from dataclasses import dataclass
from functools import cached_property

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism, Weighed


@dataclass(frozen=True, eq=False)
class UnitLoads:
    """The unit loads of a mechanism at all poses of a table, computed when the first is read."""

    mechanism: Mechanism
    q: Array

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Loads (N,) by name, as `Weighed.unit_loads` has them; none for a mechanism that does not say."""
        return self.mechanism.unit_loads(self.q) if isinstance(self.mechanism, Weighed) else {}

    def column(self, name: str) -> Array | None:
        """The load (N,) of that name, None where there is none."""
        return self.columns.get(name) if "_of_" in name else None

    def unit(self, name: str) -> str:
        """N·m; of a first moment of mass (`_of_J4_x`) N·m a kg·m, which is m/s²."""
        return "m/s^2" if name[-2:] in ("_x", "_y", "_z") else "Nm"
