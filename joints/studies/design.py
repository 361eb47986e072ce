"""`gpmodel joint design`: one page with every limit of a joint, and its governing limit."""

import base64
import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from gpmodel._version import __version__
from joints import figures
from joints.contact import LoopPart, allowed_temperature_change
from joints.design import JointDesign, joint_design, moving_film
from joints.film import design_film, displacement_at_inlet, film_geometry, orifice_law
from joints.orifice import ATMOSPHERE, SCCM
from joints.preload import MagnetRing, socket_fixed_limit, total_preload
from joints.studies.study import MICRO, N_PER_UM, Study, Table, png


def design_study(path: Path | None = None, seed: int = 0) -> Study:
    """Make tables and a page of every limit of a joint, its governing limit, and the numbers used for the limits."""
    design = joint_design(path, seed)
    limits = Table(
        "What is used of what is there",
        ("Limit", "Quantity", "Used", "There", "Unit", "Share [%]"),
        [(x.topic, x.quantity, x.used, x.there, x.unit, 100 * x.share) for x in design.limits],
        design.verdict,
    )
    parts = _parts(design)
    drawn = _figures(design)
    data = {
        "joint": design.joint.name,
        "contact": design.settings["demand"]["contact"],
        "verdict": design.verdict,
        "governing": design.governing.topic,
        "limits": [{**asdict(x), "share": x.share} for x in design.limits],
    }
    return Study((limits, *parts), data, drawn, {"joint_design.html": _page(design, parts, drawn)})


def _parts(design: JointDesign) -> tuple[Table, ...]:
    """Tabulate the parts of the thermal loop and, for a joint on an air film, the design guide of the film."""
    thermal = design.settings["thermal"]
    loop = [LoopPart(**part) for part in thermal["part"]]
    rates = [(part.name, part.growth_per_kelvin) for part in loop]
    rows = [(n, r * MICRO, float(allowed_temperature_change(thermal["tolerance"], r))) for n, r in rates]
    tables = [Table("Thermal loop", ("Part", "Growth [um/K]", "Allowed change [K]"), rows)]
    if design.settings["demand"]["contact"] == "fluid":
        s, lifts = design.settings["film"], np.array(design.settings["film"]["displacements"])
        preload = total_preload([MagnetRing(**ring) for ring in design.settings["preload"]["ring"]])
        guide = design_film(film_geometry(s), preload, orifice_law(s["orifice"]), lifts)
        columns = (
            lifts * MICRO, guide.gap * MICRO, guide.flow / SCCM, guide.inlet_pressure / ATMOSPHERE,
            guide.stiffness_constant_inlet * N_PER_UM,
        )  # fmt: skip
        heads = ("Lift [um]", "Gap [um]", "Flow [sccm]", "Inlet [atm]", "Stiffness [N/um]")
        film, mass, magnets = moving_film(design.settings)
        begins = 1e9 * film.hammering_pocket(mass, magnets) / s["orifices"]
        behind = 1e9 * s["orifice"]["pocket"]
        note = f"flat plate, {preload:.4g} N of preload; the sphere's film hammers with {begins:.3g} mm^3 of air behind"
        note += f" each orifice, and has {behind:.3g}"
        tables.append(Table("Air film", heads, list(zip(*(c.tolist() for c in columns), strict=True)), note))
    return tuple(tables)


def _figures(design: JointDesign) -> dict[str, Figure]:
    s = design.settings
    drawn = {}
    angles = np.radians(np.linspace(0, 90, 181))
    if s["demand"]["contact"] in ("sliding", "fluid"):
        preload = total_preload([MagnetRing(**ring) for ring in s["preload"]["ring"]])
        limit = socket_fixed_limit(preload, angles, s["preload"]["reaction_angle"])
        drawn["design_preload.png"] = figures.preload_sliding(angles, preload, limit)
    thermal = s["thermal"]
    per_kelvin = {part["name"]: LoopPart(**part).growth_per_kelvin for part in thermal["part"]}
    drawn["design_thermal.png"] = figures.thermal(per_kelvin, thermal["temperature_change"], thermal["tolerance"])
    if s["demand"]["contact"] == "fluid":
        geometry, orifice = film_geometry(s["film"]), orifice_law(s["film"]["orifice"])
        inlets = np.linspace(1.0, 1.2 * s["demand"]["supply"] / ATMOSPHERE, 120) * ATMOSPHERE
        lift = displacement_at_inlet(geometry, preload, orifice, inlets)
        drawn["design_lift.png"] = figures.design_lift(inlets, lift, s["demand"]["supply"], s["demand"]["lift"])
    return drawn


def _page(design: JointDesign, parts: tuple[Table, ...], drawn: dict[str, Figure]) -> str:
    loader = PackageLoader(__name__.partition(".")[0])
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    limits = [
        {"topic": x.topic, "quantity": x.quantity, "used": f"{x.used:.3g}", "there": f"{x.there:.3g}",
         "unit": _micro(x.unit), "percent": f"{100 * x.share:.0f}" if x.share >= 0.01 else "< 1", "over": x.share > 1,
         "width": f"{100 * min(x.share, 1):.1f}", "governs": x is design.governing}
        for x in design.limits
    ]  # fmt: skip
    return environment.get_template("design.html.j2").render(
        name=design.joint.name,
        contact=design.settings["demand"]["contact"],
        lever=f"{1e3 * np.linalg.norm(design.joint.tooling_ball):.4g}",
        verdict=_micro(f"{design.verdict[0].upper()}{design.verdict[1:]}."),
        limits=limits,
        tables=[
            replace(t, columns=list(map(_micro, t.columns)), rows=[list(map(_text, r)) for r in t.rows]) for t in parts
        ],
        figures=[{"name": name, "data": base64.b64encode(png(figure)).decode()} for name, figure in drawn.items()],
        version=__version__,
    )


def _micro(text: str) -> str:
    """Replace the unit um, as in terminals and JSON keys, by µm."""
    return re.sub(r"\bum\b", "µm", text)


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
