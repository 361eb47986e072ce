"""What none of the kinds of reading in a table can show, and what would."""

from collections.abc import Iterator

from gpmodel.calibration.size import shows_size
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation
from gpmodel.model.pixel import Pixels


def unseen(kinds: tuple[Observation, ...]) -> Iterator[str]:
    """One sentence each, of the kinds that were read; none where points or poses in an instrument's frame were."""
    read = [kind for kind in kinds if kind.readings.any()]
    if not read or any(kind.absolute for kind in read):
        return
    what = f"what was read ({', '.join(kind.name for kind in read)})"
    if not any(map(shows_size, read)):
        yield (
            f"{what} fits a machine that is larger as a whole as well: its lengths stay, on the whole, as described; a "
            "bar, a ball of known diameter, an artefact or a camera with its board would show it"
        )
    if all(isinstance(kind, Pixels | Inclination) for kind in read):
        yield f"{what} does not show the tool point: it stays at the flange; touches of one point would show it"
    yield (
        f"{what} does not show where the base stands: what is predicted is in the frame of the root; points of a "
        "tracker, three at least, would place it in theirs"
    )
