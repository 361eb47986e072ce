"""Optional dependencies and how to install them."""

from collections.abc import Iterator
from contextlib import contextmanager

from gpmodel.errors import InputError

EXTRAS = {
    "discover": ("numba", "llvmlite", "deap", "sympy"),
    "report": ("jinja2", "matplotlib", "plotly", "sympy"),
    "robots": ("pinocchio", "coal", "example_robot_data"),
    "cluster": ("distributed",),
    "excel": ("openpyxl",),
    "ros": ("rosbags",),
}
"""Extra -> the modules that it brings, as they are imported."""


@contextmanager
def extra_for(what: str, extra: str = "") -> Iterator[None]:
    """Around imports that `what` needs: of what a lean installation leaves out, says which extra brings it.

    extra: to name; the first that brings the module where empty.
    Raises InputError for a module of an extra; any other that is missing stays an ImportError.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        bring = [name for name, modules in EXTRAS.items() if module in modules]
        if not bring:
            raise
        raise InputError(f"{what} needs {module}: pip install 'gpmodel[{extra or bring[0]}]'") from error
