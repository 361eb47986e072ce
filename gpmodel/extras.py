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
"""Python modules that each optional extra of the package installs."""


@contextmanager
def extra_for(what: str, extra: str = "") -> Iterator[None]:
    """Context for imports of optional packages; for a missing one the error names the extra that installs it.

    extra: name of the extra; empty for the first extra with the missing module.
    Raises InputError for a module of an extra, ImportError for any other module.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        bring = [name for name, modules in EXTRAS.items() if module in modules]
        if not bring:
            raise
        raise InputError(f"{what} needs {module}: pip install 'gpmodel[{extra or bring[0]}]'") from error
