"""Find the effects that the model of a robot lacks, name them, and confirm them on held-out poses.

    import gpmodel as gp

    arm = gp.load_mechanism("irb6400r", payload="60 kg")
    table = gp.read_table("table.csv", arm)
    found = gp.discover(arm, table)
    print(found.summary())

A public name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from gpmodel._version import __version__ as __version__

if TYPE_CHECKING:
    from gpmodel.api.arguments import load_mechanism
    from gpmodel.api.calibrate import calibrate
    from gpmodel.api.certificate import certificate
    from gpmodel.api.check import check
    from gpmodel.api.discover import discover
    from gpmodel.api.evolve import evolve
    from gpmodel.api.fleet import fleet
    from gpmodel.api.model import Model, load_model
    from gpmodel.api.poses import choose_poses
    from gpmodel.api.regress import regress
    from gpmodel.api.saved import compare, explain, export, load_result
    from gpmodel.api.simulate import simulate
    from gpmodel.api.table import read_table
    from gpmodel.api.verify import verify, verify_next
    from gpmodel.discovery.search import Search
    from gpmodel.errors import InputError
    from gpmodel.evidence.criteria import Criteria
    from gpmodel.evolution.linear import Linear
    from gpmodel.evolution.settings import Tournament, Truncation
    from gpmodel.evolution.tree import Tree
    from gpmodel.families.candidate import Candidate
    from gpmodel.families.catalogue import Family, catalogue
    from gpmodel.formula.expression import Expression
    from gpmodel.mechanism.protocol import Joint, Mechanism
    from gpmodel.model.effect import Effect, Term, effect_at
    from gpmodel.model.states import States
    from gpmodel.table.dataset import Dataset

_HOME = {
    "Candidate": "families.candidate",
    "Criteria": "evidence.criteria",
    "Dataset": "table.dataset",
    "Effect": "model.effect",
    "Expression": "formula.expression",
    "Family": "families.catalogue",
    "InputError": "errors",
    "Joint": "mechanism.protocol",
    "Linear": "evolution.linear",
    "Mechanism": "mechanism.protocol",
    "Model": "api.model",
    "Search": "discovery.search",
    "States": "model.states",
    "Term": "model.effect",
    "Tournament": "evolution.settings",
    "Tree": "evolution.tree",
    "Truncation": "evolution.settings",
    "calibrate": "api.calibrate",
    "catalogue": "families.catalogue",
    "certificate": "api.certificate",
    "check": "api.check",
    "choose_poses": "api.poses",
    "compare": "api.saved",
    "discover": "api.discover",
    "effect_at": "model.effect",
    "evolve": "api.evolve",
    "explain": "api.saved",
    "export": "api.saved",
    "fleet": "api.fleet",
    "load_mechanism": "api.arguments",
    "load_model": "api.model",
    "load_result": "api.saved",
    "read_table": "api.table",
    "regress": "api.regress",
    "simulate": "api.simulate",
    "verify": "api.verify",
    "verify_next": "api.verify",
}

__all__ = [
    "Candidate",
    "Criteria",
    "Dataset",
    "Effect",
    "Expression",
    "Family",
    "InputError",
    "Joint",
    "Linear",
    "Mechanism",
    "Model",
    "Search",
    "States",
    "Term",
    "Tournament",
    "Tree",
    "Truncation",
    "calibrate",
    "catalogue",
    "certificate",
    "check",
    "choose_poses",
    "compare",
    "discover",
    "effect_at",
    "evolve",
    "explain",
    "export",
    "fleet",
    "load_mechanism",
    "load_model",
    "load_result",
    "read_table",
    "regress",
    "simulate",
    "verify",
    "verify_next",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            raise AttributeError(f"module 'gpmodel' has no attribute '{name}'")
        from gpmodel.extras import extra_for

        with extra_for(f"gpmodel.{name}"):
            globals()[name] = getattr(import_module(f"gpmodel.{_HOME[name]}"), name)
        return globals()[name]


def __dir__() -> list[str]:
    return __all__
