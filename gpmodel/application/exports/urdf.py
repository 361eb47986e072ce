"""The refitted geometry as URDF, for mechanisms that know how to write themselves."""

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gpmodel.application.exports.rigid import Rigid
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import ExportsUrdf, Mechanism, bare_of
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.wording import length

LINK = "Measured link: "
"""What the comment says before the link at which the tool point is given."""


def urdf_text(rigid: Rigid, note: str) -> str:
    """The nominal chain with the constant error twists in it and `note` as a comment.

    Raises InputError where the mechanism has no writer.
    """
    text, frame = written(rigid.fit.model.mechanism, rigid.twists)
    comment = f"{note}\n{LINK}{frame}".replace("--", "- -")
    return re.sub(r"(<\?xml[^>]*\?>\n?)?", lambda head: f"{head[0]}<!--\n{comment}\n-->\n", text, count=1)


def written(mechanism: Mechanism, twists: Mapping[str, Array]) -> tuple[str, str]:
    """The URDF text of a chain with constant error twists (6,), m and rad, by slot, and its measured link. Raises
    InputError as `urdf_text`."""
    bare = bare_of(mechanism)
    if not isinstance(bare, ExportsUrdf):
        raise InputError(f"{bare.name} cannot be written as URDF")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.urdf"
        frame = bare.write_urdf(path, twists)
        return path.read_text(encoding="utf-8"), frame


def measured_link(text: str) -> str:
    """The link that a text of `urdf_text` is measured at."""
    return text.partition(LINK)[2].partition("\n")[0]


def note_of(rigid: Rigid, link: str = "the measured link", at: Array | None = None) -> str:
    """What the geometry holds, how far it is off, and what is missing, in lines. link: that the tool point is said in;
    at: the measured link there, (4, 4), m."""
    fit = rigid.fit
    lines = [f"Geometry of {fit.model.mechanism.name}, fitted without what a rigid description cannot hold."]
    if len(rigid.heldout):
        rms, most = (length(1e3 * v) for v in (root_mean_square(rigid.heldout), float(rigid.heldout.max())))
        lines.append(f"Error on held-out poses: {rms} RMS, {most} at most.")
    else:
        lines.append("No poses were held out: its error on other poses is not known.")
    lines.append(f"Missing: {'; '.join(rigid.missing)}." if rigid.missing else "Nothing of the model is missing.")
    for name, tool in rigid.placement.tool.items():
        point = ", ".join(f"{1e3 * v:.4f}" for v in ((np.eye(4) if at is None else at) @ tool)[:3, 3])
        lines.append(f"Tool point{f' {name}' if name else ''} in {link}, mm: {point}.")
    return "\n".join(lines)
