"""Test of a model on poses measured after its fit."""

from pathlib import Path

from gpmodel.api.arguments import called
from gpmodel.api.model import Model
from gpmodel.api.next_check import NextCheck, next_check
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


def verify_next(
    model: Model | str | Path, table: TableLike | None = None, *, tolerance: str | None = None, in_order: bool = False,
    cameras: Described = None, board: Described = None, surfaces: Described = None,
) -> NextCheck:  # fmt: skip
    """Check a model pose by pose: what the poses say so far, and which one to measure next, until it is decided.

    Measure the pose of `next`, add it to the table, call it again. A look at n poses has the significance
    0.05 · 6 / (π² (n - 5)²), so that of machines that did not change at most one check in twenty ends with a change,
    however long it goes on. It ends where a change is seen and named, or where a change of any joint's zero that moves
    the tool by more than the tolerance would be with the chance 0.9; without a tolerance twice the error that the model
    expects. Poses are chosen among those of the fit, where the arm is known to go: the one that shows most of the zero
    that is seen worst.

    model, table, tolerance, in_order, cameras, board, surfaces: as of `verify`; no table, or fewer than six poses:
    the next of the first poses, far from the others. Raises InputError as `verify`, and where the model does not hold
    the table of its fit. Source: Robbins (1970), statistical methods related to the law of the iterated logarithm.
    """
    judged = model_of(model, "model")
    name = Path(model).name if isinstance(model, str | Path) else "model"
    sights = {"cameras": cameras, "board": board, "surfaces": surfaces}
    return next_check(
        judged.saved, table, VerifyRequest(COMMAND, name, judged.sha256), tolerance, in_order, sights
    )  # fmt: skip
