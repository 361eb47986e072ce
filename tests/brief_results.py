"""Write results with one picture and no lookup grid, because both take most of the time of a small run."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from unittest import mock

from gpmodel.errors import InputError
from gpmodel.report import page

_every = page.pictures


@contextmanager
def one_picture() -> Iterator[None]:
    """For what does not depend on how much is drawn."""
    with mock.patch.object(page, "pictures", lambda report: islice(_every(report), 1)):
        yield


@contextmanager
def brief() -> Iterator[None]:
    """For what does not depend on how much is drawn and exported, nor on a compiler: every step of writing it is still
    taken."""
    with (
        one_picture(),
        mock.patch("gpmodel.application.exports.make.lookup_grid", side_effect=InputError("left out by a test")),
        mock.patch("gpmodel.application.exports.make.tested", return_value={"RMS": math.nan, "largest": math.nan}),
    ):
        yield
