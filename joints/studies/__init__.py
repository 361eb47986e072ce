"""One study per engineering model of the joint; a study turns settings into tables, numbers and figures."""

from collections.abc import Callable, Mapping
from pathlib import Path

from joints.studies.budget import budget_study
from joints.studies.contact import contact_study, contact_types_study, thermal_study
from joints.studies.design import design_study
from joints.studies.dynamics import dynamics_study
from joints.studies.film import film_study
from joints.studies.preload import preload_study
from joints.studies.pugh import pugh_study
from joints.studies.stiffness import stiffness_study
from joints.studies.study import Study, Table

STUDIES: Mapping[str, Callable[[Path | None, int], Study]] = {
    "design": design_study,
    "preload": preload_study,
    "contact": contact_study,
    "thermal": thermal_study,
    "film": film_study,
    "stiffness": stiffness_study,
    "dynamics": dynamics_study,
    "pugh": pugh_study,
    "budget": budget_study,
    "contact_types": contact_types_study,
}

__all__ = ["STUDIES", "Study", "Table"]
