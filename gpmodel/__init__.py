"""Find what the model of a mechanism is missing: name it, add it, prove it on poses never seen.

    import gpmodel as gp

    arm = gp.load_mechanism("irb6400r", payload="60 kg")
    table = gp.read_table("table.csv", arm)
    found = gp.discover(arm, table)
    print(found.summary())

Every name is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from gpmodel._version import __version__

if TYPE_CHECKING:
    from gpmodel.api.calibrate import Calibration, calibrate
    from gpmodel.api.check import Check, check
    from gpmodel.api.mechanism import load_mechanism
    from gpmodel.api.model import Model, load_model
    from gpmodel.api.poses import ChosenPoses, choose_poses
    from gpmodel.api.simulate import Simulated, simulate
    from gpmodel.api.table import read_table
    from gpmodel.errors import InputError
    from gpmodel.families.candidate import Candidate
    from gpmodel.families.catalogue import catalogue
    from gpmodel.families.family import Family
    from gpmodel.formula.expression import Expression
    from gpmodel.mechanism.protocol import Joint, Mechanism
    from gpmodel.model.effect import Effect, Term, effect_at
    from gpmodel.model.states import States
    from gpmodel.table.dataset import Dataset

_HOME = {
    "Calibration": "api.calibrate",
    "Candidate": "families.candidate",
    "Check": "api.check",
    "ChosenPoses": "api.poses",
    "Dataset": "table.dataset",
    "Effect": "model.effect",
    "Expression": "formula.expression",
    "Family": "families.family",
    "InputError": "errors",
    "Joint": "mechanism.protocol",
    "Mechanism": "mechanism.protocol",
    "Model": "api.model",
    "Simulated": "api.simulate",
    "States": "model.states",
    "Term": "model.effect",
    "calibrate": "api.calibrate",
    "catalogue": "families.catalogue",
    "check": "api.check",
    "choose_poses": "api.poses",
    "effect_at": "model.effect",
    "load_mechanism": "api.mechanism",
    "load_model": "api.model",
    "read_table": "api.table",
    "simulate": "api.simulate",
}

__all__ = [
    "Calibration",
    "Candidate",
    "Check",
    "ChosenPoses",
    "Dataset",
    "Effect",
    "Expression",
    "Family",
    "InputError",
    "Joint",
    "Mechanism",
    "Model",
    "Simulated",
    "States",
    "Term",
    "__version__",
    "calibrate",
    "catalogue",
    "check",
    "choose_poses",
    "effect_at",
    "load_mechanism",
    "load_model",
    "read_table",
    "simulate",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            raise AttributeError(f"module 'gpmodel' has no attribute '{name}'")
        globals()[name] = getattr(import_module(f"gpmodel.{_HOME[name]}"), name)
        return globals()[name]


def __dir__() -> list[str]:
    return __all__
