"""Test of a model on poses measured after its fit."""

from pathlib import Path

from gpmodel.api.arguments import called
from gpmodel.api.model import Model
from gpmodel.api.saved import model_of
from gpmodel.api.table import Described, TableLike, told_of_reading
from gpmodel.api.verification import VerifyResult, verify_saved
from gpmodel.progress import Say, silent
from gpmodel.report.verification import VerifyRequest

COMMAND = "gpmodel.verify"


def verify(
    model: Model | str | Path, table: TableLike, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None, progress: Say = silent,
    command: str = COMMAND,
) -> VerifyResult:  # fmt: skip
    """Judge a model by poses measured afterwards: does it hold, has the machine drifted, or is it another one?

    The registration is found anew, and where what stands in the world is: a camera in the hall, a board on the table,
    planes, points. Tool point, what links carry and everything else are the model's, at the end of its session. With r
    what the model leaves, V its covariance (noise and all that the model does not know better) and z the part of
    V^(-1/2) r at right angles to the registration, |z|² is compared with chi-square, and what could have changed
    (zeros, tool, sizes of effects, geometry, the catalogue) is tested against z. Both tests together call one machine
    in a hundred changed that is not.

    model: of a fit, or its folder or file. table: as of `read_table`; where it has the columns corrected_J1, ... that
    `compensate` gives, these are where the machine went, and what is missed of the targets J1, ... is said as well.
    tolerance: what no row may exceed, as "0.1 mm", of pixels "0.5 px". in_order: as of `predict`. cameras, board,
    surfaces: as of `read_table`, where they are others than in the table of the fit. progress: called with what is
    being done. command: what verify.json says made it. The verdict rests on 2000 rows of more, in even stretches; the
    tolerance on all, where points were measured.
    Raises InputError where the table does not fit the model, reads in a unit that the fit did not, or has fewer than
    four poses.
    """
    name, judged = Path(model).name if isinstance(model, str | Path) else "model", model_of(model, "model")
    called(progress, "progress")
    told_of_reading(table, progress)
    asked = VerifyRequest(command, name, judged.sha256)
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    return verify_saved(judged.saved, table, asked, tolerance, in_order, sights)
